"""Operated flights with faults: each mission, each moment of the work, each fault.

    python benchmarks/operated_faults.py [MISSION...] [--fault NAME...] [--moment NAME...]

The careful operator works over a radio link of 50 ms. A first flight without fault gives the time
of each moment; then a fault is injected at that moment. Each flight is a row of
benchmarks/operated-faults.csv: outcome, the rule that acted, the reported reason, and whether the
flight passed. Flights in the table are not repeated.

- `silent`: the operator's input ends. The work ends, and the robot returns.
- `link 0.2 s`, `link 2 s`: the radio transmits nothing for this time. The work continues.
- `link lost`: the radio transmits nothing any more. After 180 s the work ends, the robot returns.
- `battery`: 15 % of the charge is left. The rule `battery_low` starts the return.
- `fence`: a push moves the robot over a fence 0.1 m beside it. `geofence` starts the return.
- `pilot`: the pilot takes over, holds for 2 s and gives control back. The robot returns, or starts
  the contact again.
- `killed`: the vehicle's process is killed. The recording up to then is readable.

Collisions count only away from the landing point: a tool or a bar in the hooks touches the ground
before the gear does.
"""

from __future__ import annotations

import argparse
import csv
import math
import multiprocessing
import os
import signal
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import skywright
from skywright.description.world.radio import Radio
from skywright.ground.operator_model import ModelOperator
from skywright.ground.radio_operator import RadioOperator
from skywright.models.scene import build_scene
from skywright.run.operator import Sight, Stick
from skywright.run.result import RunResult
from skywright.run.results import open_run
from skywright.run.run import run_mission

KEPT = Path(__file__).resolve().parent / "operated-faults.csv"
COLUMNS = (
    "mission", "moment", "fault", "outcome", "rule", "reason", "last_phase", "home_m", "collisions",
    "passed",
)  # fmt: skip
RADIO = Radio(delay_s=0.05)
NO_RADIO = RADIO.model_copy(update={"loss_fraction": 1.0})
PUSH, PUSH_S, FENCE_M = 3.5, 0.8, 0.1  # m/s^2 of the robot, s, m
HOME_M = 0.3  # m, maximum distance from the take-off point
SOON_S = 0.05  # s, time limit for the pilot to get control


class Moment(NamedTuple):
    """Time of a fault: `after_s` after a phase of the work began."""

    name: str
    phase: str
    after_s: float
    below_m: float = math.inf  # and only below this height above the goal


class Work(NamedTuple):
    """A mission with manual work."""

    sets: tuple[str, ...]
    seed: int
    moments: tuple[Moment, ...]


WORKS = {
    "tool-install": Work(
        ("mission.task.hover_s=0", "mission.task.wait_s=1"), 1,
        (Moment("install: in the air", "install", 1.0),
         Moment("install: on the pipe", "install", 1.0, 0.004),
         Moment("retrieval: below the handle", "hook", 2.0),
         Moment("retrieval: lifted", "lift off", 3.0)),
    ),
    "bar-insertion": Work(
        (), 1,
        (Moment("align", "align", 1.0), Moment("lower", "lower", 0.5),
         Moment("insert", "insert", 0.3)),
    ),
    "wall-contact": Work(
        ("mission.task.survey=false", "mission.task.hold_s=2", "plant.map_error_m=0",
         "plant.map_error_deg=0"), 3,
        (Moment("free touch", "free touch", 0.5), Moment("free press", "free press", 0.2)),
    ),
}  # fmt: skip
LINKS = {"link 0.2 s": 0.2, "link 2 s": 2.0, "link lost": math.inf}
FAULTS = ("killed", "silent", "pilot", "battery", "fence", *LINKS)
OTHERS = ("unintended_contact", "strayed", "excess_force")
"""Rules that would act on the push before the fence's rule."""
RULES = {"battery": "battery_low", "fence": "geofence"}


class Hand(RadioOperator):
    """The operator behind the radio, and an observer that injects a fault at a moment."""

    def __init__(self, work: Work, moment: str = "", fault: str = "") -> None:
        super().__init__(ModelOperator("careful", work.seed, 0.03), RADIO, work.seed)
        self.moments, self.moment, self.fault = work.moments, moment, fault
        self.times: dict[str, float] = {}  # flight time (s) of each moment
        self.acted: list[str] = []
        self.pilot: list[bool] = []
        self._supervisor: Any = None
        self._t, self._gap = 0.0, math.inf
        self._phases: dict[str, float] = {}

    @property
    def at(self) -> float:
        """Time of the fault (s); inf before it."""
        return self.times.get(self.moment, math.inf)

    def on_supervisor(self, supervisor: Any) -> None:
        """Keep the supervisor for the pilot."""
        self._supervisor = supervisor

    def on_plan(self, plan: Any, description: Any) -> None:
        """Do nothing."""

    def on_acted(self, acted: Any) -> None:
        """Record a rule that acted."""
        self.acted.append(acted.rule)

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        """Detect moments and inject the fault."""
        self._t = t
        began = self._phases.setdefault(phase, t)
        for m in self.moments:
            if m.phase == phase and t > began + m.after_s and self._gap < m.below_m:
                self.times.setdefault(m.name, t)
        if t < self.at:
            return
        if self.fault == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.fault == "pilot":
            self._fly(t)

    def _fly(self, t: float) -> None:
        """Take over, hold, give back."""
        s = self._supervisor
        if not self.pilot:
            self.pilot = [s.choose_mode("position"), s.take_over()]
        elif t > self.at + 2.0 and s.pilot.flies and s.pilot.switch:
            self.pilot.append(s.give_back())
        elif s.pilot.flies:
            s.move_stick([0.0, 0.0, 0.0, 0.0])

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Return the stick as received by the robot."""
        self._gap = float(sight.off[2])
        since = self._t - self.at
        if self.fault == "silent" and since >= 0.0:
            return None
        out = 0.0 <= since < LINKS.get(self.fault, 0.0)
        self._up.radio = self._down.radio = NO_RADIO if out else RADIO
        return super().read(t, sight)


def fly(mission: str, hand: Hand, folder: Path, *sets: str) -> RunResult:
    """Fly once."""
    work = WORKS[mission]
    return run_mission(
        skywright.load(mission, sets=(*work.sets, f"mission.seed={work.seed}", *sets)), out=folder,
        operator=hand, observers=[hand],
    )  # fmt: skip


def find_sets(mission: str, fault: str, at: float, plain: RunResult) -> tuple[str, ...]:
    """Return the settings of a fault at `at` (s), from the flight without it."""
    if fault == "battery":
        return ('plant.faults.cell.kind="battery"', f"plant.faults.cell.start_s={at}")
    if fault != "fence":
        return ()
    p = plain.samples["p_WB"]
    here = p[np.searchsorted(plain.samples["t"], at)]
    for axis, sign in ((1, 1.0), (1, -1.0), (0, -1.0), (0, 1.0)):
        if np.max(sign * p[:, axis]) < sign * here[axis] + 0.05:  # the path to work stays inside
            name, side = "xy"[axis], "max" if sign > 0.0 else "min"
            return (
                f"mission.fence.{name}_{side}_m={float(here[axis] + sign * FENCE_M)!r}",
                'plant.faults.gust.kind="bump"', f"plant.faults.gust.start_s={at}",
                f"plant.faults.gust.force_{name}_n={sign * PUSH * _weigh(mission)}",
                f"plant.faults.gust.for_s={PUSH_S}",
                *(f"mission.faults.{rule}.on=false" for rule in OTHERS),
            )  # fmt: skip
    raise RuntimeError("there is no side on which a fence would not cross the way to work")


def _weigh(mission: str) -> float:
    """Return the robot's mass (kg)."""
    d = skywright.load(mission)
    model = build_scene(d.robot, d.world).model
    return float(model.body_subtreemass[model.body("platform").id])


def judge(fault: str, hand: Hand, result: RunResult) -> tuple[float, bool]:
    """Return the final distance (m) from home, and whether the result is as documented."""
    p = result.samples["p_WB"]
    away = float(np.linalg.norm(p[-1] - p[0]))
    home = bool(np.all(np.isfinite(p))) and away < HOME_M
    happened = math.isfinite(hand.at) and home
    if fault in ("link 0.2 s", "link 2 s"):
        return away, happened and result.outcome == "succeeded"
    told = result.outcome in ("aborted", "failed") and happened
    if fault in RULES:
        return away, told and hand.acted[:1] == [RULES[fault]]
    if fault == "pilot":
        manual = [x for x in result.phases if x.name == "manual"]
        at_once = bool(manual) and manual[0].start_s - hand.at < SOON_S
        return away, happened and all(hand.pilot) and len(hand.pilot) == 3 and at_once
    words = "the operator took more than 180 s" if fault == "link lost" else "input ended"
    return away, told and words in result.reason and not hand.acted


def count_collisions(result: RunResult) -> int:
    """Return the number of collisions away from the landing point, where the load lands first."""
    s = result.samples
    away = np.linalg.norm(s["p_WB"][:, :2] - s["p_WB"][-1, :2], axis=1) > HOME_M
    hits = (s["f_collision"] > 0.0) & away
    return int(np.count_nonzero(hits[1:] & ~hits[:-1]))


def fly_case(
    mission: str, moment: str, fault: str, folder: Path, plain: RunResult, at: float
) -> list[str]:
    """Fly a fault at a moment, which is at `at` (s) of the flight `plain`; return its row."""
    hand = Hand(WORKS[mission], moment, fault)
    if fault == "killed":
        return [mission, moment, fault, *_kill(mission, hand, folder, at)]
    result = fly(mission, hand, folder, *find_sets(mission, fault, at, plain))
    away, passed = judge(fault, hand, result)
    return [
        mission, moment, fault, result.outcome, " ".join(hand.acted[:1]), result.reason,
        result.phases[-1].name, f"{away:.2f}",
        str(count_collisions(result)), str(passed),
    ]  # fmt: skip


def _kill(mission: str, hand: Hand, folder: Path, at: float) -> list[str]:
    """Fly in a process that is killed at the moment; return the rest of the row."""
    process = multiprocessing.get_context("fork").Process(target=fly, args=(mission, hand, folder))
    process.start()
    process.join()
    run = open_run(folder.with_name(folder.name + ".partial"))
    t = run["t"]
    read = len(t) > 0 and at - 1.5 < float(t[-1]) <= at + 0.1
    passed = process.exitcode == -signal.SIGKILL and read and run.phases[-1].name != ""
    reason = f"recorded up to {at - float(t[-1]):.1f} s before it"
    return ["killed", "", reason, run.phases[-1].name, "", "", str(passed)]


def main() -> None:
    """Fly the missing flights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("missions", nargs="*", default=list(WORKS), metavar="MISSION")
    parser.add_argument("--fault", nargs="+", choices=FAULTS, default=FAULTS)
    parser.add_argument("--moment", nargs="+", metavar="NAME", help="of the table's")
    args = parser.parse_args()
    flown = set()
    if KEPT.is_file():
        with KEPT.open(newline="", encoding="utf-8") as file:
            flown = {(r["mission"], r["moment"], r["fault"]) for r in csv.DictReader(file)}
    else:
        KEPT.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    for mission in args.missions:
        cases = [
            (m.name, fault)
            for fault in args.fault
            for m in WORKS[mission].moments
            if m.name in (args.moment or [m.name]) and (mission, m.name, fault) not in flown
        ]
        if cases:
            _fly_mission(mission, cases)


def _fly_mission(mission: str, cases: list[tuple[str, str]]) -> None:
    """Fly moments and faults of a mission, after a flight without fault."""
    with tempfile.TemporaryDirectory() as scratch:
        first = Hand(WORKS[mission])
        plain = fly(mission, first, Path(scratch) / "plain")
        for i, (moment, fault) in enumerate(cases):
            row = fly_case(
                mission, moment, fault, Path(scratch) / f"{i}", plain, first.times[moment]
            )
            with KEPT.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerow(row)
            print(*row, sep=" | ", flush=True)


if __name__ == "__main__":
    main()
