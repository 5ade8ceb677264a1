"""Missions over MAVLink with events of link, autopilot or pilot, each in each phase.

    python benchmarks/mavlink_events.py [MOMENT...] [--event NAME...]

`skywright run MISSION --backend mavlink:URL` flies `skywright serve hexarotor --mavlink URL`, both
with a common clock (tests/mavlink_pair.py), so that flights are repeatable. Each event begins at
one moment of the flight; after the mission the vehicle continues alone for 15 s. Each flight is a
row of benchmarks/mavlink-events.csv.

- `link 0.2 s`, `link 2 s`, `link lost`: no message arrives in either direction for this time.
- `restart`: the autopilot restarts on the ground, with a new clock and without memory.
- `pilot`: the pilot switches to Position, flies for 3 s and switches back to Offboard.
- `pilot lands`: the pilot switches to Land.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
import skywright
from mavlink_pair import Pair
from short_mission import write_short
from skywright.links.mavlink import modes
from skywright.links.mavlink.robot import Stick
from skywright.run import backends
from skywright.run.result import RunResult
from skywright.run.run import run_mission

KEPT = Path(__file__).resolve().parent / "mavlink-events.csv"
SILENCES = {"link 0.2 s": 0.2, "link 2 s": 2.0, "link lost": math.inf}
EVENTS = (*SILENCES, "restart", "pilot", "pilot lands")
ARMING, TOUCH_DOWN = "arming", "touch-down"
MOMENTS = {
    ARMING: 0.0, "take_off": 2.0, "waypoint 1": 1.0, "hold 1": 0.3, "land": 2.0, TOUCH_DOWN: 0.1,
}  # fmt: skip
"""Phase, or state of the vehicle -> s from its start to the event."""
RULES = {
    "link lost": "silent for 10 s", "restart": "restarted", "pilot lands": "the pilot landed",
}  # fmt: skip
"""Event -> part of the reason of a mission that it ends."""
PILOT_S, AFTER_S = 3.0, 15.0
LANDS = (0.6, 0.3)  # m, landing point of the mission
NEAR_M = 0.3  # m, maximum distance from it


class Row(NamedTuple):
    """One flight."""

    moment: str
    event: str
    outcome: str
    reason: str
    phases: str  # after the event
    vehicle: str  # mode and motors, 15 s after the end
    away_m: float  # m, distance from the landing point at that time
    passed: bool


class Event:
    """Triggers one event; an observer of the run and of the vehicle's ticks."""

    def __init__(self, pair: Pair, saved: Any, moment: str, event: str) -> None:
        self.pair, self.saved, self.moment, self.event = pair, saved, moment, event
        self.at = math.inf  # s, common clock
        self.phase = ""
        self._done = 0
        for cable in (pair.up, pair.down):
            cable.lost = lambda t: self.at <= t < self.at + SILENCES.get(event, 0.0)
        pair.on_tick = self._act

    def on_plan(self, plan: Any, description: Any) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        """Check whether the moment's phase has begun."""
        self.phase = phase
        if phase == self.moment:
            self._begin()

    def _begin(self) -> None:
        self.at = min(self.at, self.pair.clock.t + MOMENTS[self.moment])

    def _act(self, pair: Pair) -> None:
        robot, t = pair.service.robot, pair.clock.t
        if self.moment == ARMING and robot.mode == modes.OFFBOARD:
            self._begin()
        if self.moment == TOUCH_DOWN and robot.mode == modes.LAND:
            self._begin()
        if t < self.at:
            return
        if self.event == "pilot" and self._done and t < self.at + PILOT_S:
            robot.take_stick(Stick(0.0, 0.0, 0.0, 0.0))
        if self._done == 0:
            self._done = 1
            if self.event == "restart":
                pair.restart(self.saved)
            elif self.event.startswith("pilot"):
                robot.choose(modes.POSITION if self.event == "pilot" else modes.LAND)
        elif self._done == 1 and self.event == "pilot" and t >= self.at + PILOT_S:
            self._done = 2
            robot.choose(modes.OFFBOARD)


def fly(folder: Path, backend: Any, saved: Any, moment: str, event: str) -> tuple[Event, RunResult]:
    """Fly once; the vehicle continues for AFTER_S."""
    backend.restore(saved)
    pair = Pair(write_short(folder), backend)
    happens = Event(pair, saved, moment, event)

    class Module:
        open_backend = staticmethod(pair.open)
        check_backend = staticmethod(lambda address, setup: None)

    real, backends.import_module = backends.import_module, lambda name: Module  # type: ignore[assignment]
    try:
        result = run_mission(
            pair.description, backend="mavlink:udpin:14540", out=folder / "run",
            observers=[happens],
        )  # fmt: skip
    finally:
        backends.import_module = real
    pair.link = None  # the companion has ended
    pair.clock.sleep(AFTER_S)
    return happens, result


def judge(happens: Event, result: RunResult) -> Row:
    """Return the row of a flight."""
    robot, event, moment = happens.pair.service.robot, happens.event, happens.moment
    sim = happens.pair.backend.sim
    away = float(np.linalg.norm(sim.qpos[:2] - LANDS))
    names = [p.name for p in result.phases]
    done = result.outcome == "succeeded" and not robot.armed and away < NEAR_M
    told = result.outcome == "aborted" and RULES.get(event, "") in result.reason
    passed = {
        "link 0.2 s": done,
        "link 2 s": done,
        "link lost": told and robot.mode == modes.HOLD,
        "restart": told,
        "pilot": done and ("rejoin" in names or moment == TOUCH_DOWN),
        "pilot lands": told and not robot.armed,
    }[event]
    if moment == TOUCH_DOWN and event == "pilot lands":  # equals the mission's own landing
        passed = done
    if moment == ARMING and event != "link 0.2 s":
        passed = result.outcome == "aborted" and result.reason != "" and not robot.armed
    motors = "motors on" if robot.armed else "motors off"
    later = names[names.index(moment) + 1 :] if moment in names else []
    return Row(
        moment, event, result.outcome, result.reason, " ".join(later), f"{robot.mode}, {motors}",
        round(away, 2), math.isfinite(happens.at) and passed,
    )  # fmt: skip


def main() -> None:
    """Fly the requested cases; other rows are kept."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("moments", nargs="*", default=list(MOMENTS), metavar="MOMENT")
    parser.add_argument("--event", nargs="+", choices=EVENTS, default=EVENTS)
    args = parser.parse_args()
    rows: dict[tuple[str, str], list[str]] = {}
    if KEPT.is_file():
        with KEPT.open(newline="", encoding="utf-8") as file:
            rows = {(r[0], r[1]): r for r in list(csv.reader(file))[1:]}
    with tempfile.TemporaryDirectory() as scratch:
        backend = skywright.build_vehicle(write_short(Path(scratch)))
        saved = backend.save()
        for moment in args.moments:
            for event in args.event:
                with tempfile.TemporaryDirectory() as folder:
                    row = judge(*fly(Path(folder), backend, saved, moment, event))
                rows[moment, event] = [str(x) for x in row]
                print(*row, sep=" | ", flush=True)
    known = [rows[m, e] for m in MOMENTS for e in EVENTS if (m, e) in rows]
    with KEPT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Row._fields)
        writer.writerows(known)


if __name__ == "__main__":
    main()
