"""Judge flights with faults from their recordings' truth: `python benchmarks/judge_faults.py DIR`.

DIR contains run directories, as `skywright campaign ... --record all --out FOLDER` writes them to
FOLDER/runs. The script reports for each flight the fault, the rule that acted and its delay, the
number of collisions that began before and after that in the air, and whether the robot is down at
the end: at rest, motors off, on the ground.

A collision is a contact of parts that should not touch anything. It lasts until there was no
contact for 0.3 s, so a contact that began before the rule acted and persists counts once. A flight
passes if the robot is down, there was no second collision, and it has a reason unless it succeeded.
The first collision may be the fault itself, for example if a gust pushes the robot onto its
workpiece. The touched parts are found with a model of the true scene in the recorded pose. Ground
contact of an arm that hangs without torque at the speed of a landing is not a collision, and
neither is ground contact of a robot that falls. Counted separately are

- as `fell` the contacts of a robot that falls because its motors were stopped: it is uncontrolled,
  and the fall is known before take-off (`skywright capability`: without which rotor, and without
  the control link);
- as `own` contacts of the robot with itself or only with its load, with `own_n` as their largest
  force: a forearm without torque swings against its base, and a tool set down on the ground touches
  the arms. A tool that the robot does not carry counts as any other object.

`--table FILE` writes the result, one row per flight. The exit code is 1 if a flight fails.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from skywright.description.loader import Description, load_description
from skywright.models.scene import build_scene
from skywright.recordings.recording import read_recording
from skywright.run.parts import build_named
from skywright.vehicle.component import Fault

TOUCH_N = 0.5  # N, threshold of an unintended contact
APART_S = 0.3  # s, minimum time between two collisions
LOW_M = 0.05  # m above the height of the platform when standing
OFF_N = 0.5  # N, sum of all rotors
LINK_M = 1.0  # m, height below which a link that hangs from the platform may touch the ground
STILL_MPS = 0.1
LANDING_MPS = 0.5  # maximum speed at which a hanging arm may touch the ground
CAME_M = 0.05  # m, minimum motion of the load since a rule acted
NEAR_M = 0.02  # shapes closer than this touch, because the arm's springs are not posed


class Judged(NamedTuple):
    """Result of one flight."""

    run: str
    mission: str
    fault: str
    start_s: float
    rule: str
    after_s: float
    outcome: str
    before: int
    later: int
    own: int
    own_n: float
    fell: int
    is_down: bool
    passed: bool
    reason: str


def list_collisions(s: Any, aloft: Any) -> list[int]:
    """Return the samples at which collisions begin among those `aloft` (n,)."""
    at = np.flatnonzero((s["f_collision"] > TOUCH_N) & aloft)
    return [int(k) for k in at[np.diff(s["t"][at], prepend=-np.inf) > APART_S]]


class Touched(NamedTuple):
    """Contacts at a sample."""

    all: set[str]  # objects other than the robot
    but_feet: set[str]  # of these, touched by other parts than the feet
    own: set[frozenset[str]]  # pairs of parts of the robot that touch each other
    stands: bool  # a movable object is on the ground


def list_touched(d: Description[Any], s: Any) -> Touched:
    """Return the contacts at a sample, with robot and movable things posed as recorded."""
    scene = build_scene(d.robot, d.true_world)
    model, places = scene.model, scene.places
    model.geom_margin[:] = NEAR_M
    data = mujoco.MjData(model)
    data.qpos[:7] = [*s["p_WB"], *s["q_WB"]]
    data.qpos[places.joint_qpos] = s["q"]
    moved = find_movable(d, model)
    if moved and "object0_p_WO" in s.dtype.names:
        body = model.geom_bodyid[next(iter(moved))]
        model.body_pos[body], model.body_quat[body] = s["object0_p_WO"], s["object0_q_WO"]
    mujoco.mj_forward(model, data)
    robot, feet = set(places.robot_geoms.tolist()), set(places.feet_geoms.tolist())
    pairs = [{int(c.geom1), int(c.geom2)} for c in data.contact]

    def name(wanted: set[int]) -> set[str]:
        return {model.geom(g).name for p in pairs if p & wanted for g in p - robot}

    own = {frozenset(model.geom(g).name for g in p) for p in pairs if p <= robot}
    lowest = min((float(data.geom_xpos[g][2] - model.geom_rbound[g]) for g in moved), default=1.0)
    return Touched(name(robot), name(robot - feet), own, lowest < NEAR_M)


def find_movable(d: Description[Any], model: mujoco.MjModel) -> set[int]:
    """Return the geoms of the thing that can be carried, its first geom first."""
    names = [n for n, thing in d.true_world.things.items() if getattr(thing, "mass_kg", 0.0)]
    return {g for g in range(model.ngeom) for n in names[:1] if model.geom(g).name.startswith(n)}


def _is_landing(d: Description[Any], s: Any, falls: bool) -> bool:
    """Return whether a hit is ground contact of a falling robot, or of an arm at landing speed."""
    slow = float(np.linalg.norm(s["v_WB"])) < LANDING_MPS
    return (falls or slow) and list_touched(d, s).but_feet == {"ground"}


def _is_own(d: Description[Any], s: Any, k: int, at: float) -> bool:
    """Return whether only parts of the robot, or a load that moved since a rule acted, touch."""
    met, model = list_touched(d, s[k]), build_scene(d.robot, d.true_world).model
    carried = {model.geom(g).name for g in find_movable(d, model)}
    if met.but_feet:
        way = s["object0_p_WO"][k] - s["object0_p_WO"][s["t"] <= at][-1] if carried else np.zeros(3)
        return met.but_feet <= carried and float(np.linalg.norm(way)) > CAME_M
    return bool(met.own - list_touched(d, s[0]).own)


def find_most(s: Any, begins: list[int]) -> float:
    """Return the largest force (N) of the collisions that begin at the samples `begins`."""
    most, on = 0.0, s["f_collision"] > TOUCH_N
    for k in begins:
        gone = np.flatnonzero(~on[k:])
        last = k + int(gone[0]) if len(gone) else len(s)
        most = max(most, float(np.max(s["f_collision"][k:last])))
    return most


def judge(folder: Path) -> Judged:
    """Evaluate one flight."""
    told = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    d = load_description(folder)
    fault = next(c for c in build_named(d) if isinstance(c, Fault))
    s = read_recording(folder / "recording.mcap").samples
    stands = d.robot.platform.gear_height_m
    height = s["p_WB"][:, 2]
    free = LINK_M if d.robot.pendulum is not None else LOW_M
    aloft = height > stands + free
    acted = told["faults"]
    at = acted[0]["t_s"] if acted else np.inf
    still = float(np.linalg.norm(s["v_WB"][-1])) < STILL_MPS
    off = float(np.sum(s["rotor_thrust"][-1])) < OFF_N
    is_down = still and off and "ground" in list_touched(d, s[-1]).all
    begins = list_collisions(s, aloft)
    falls = min((a["t_s"] for a in acted if a["response"] == "let_go"), default=np.inf)
    first = sum(bool(s["t"][k] <= at) for k in begins)
    others = [
        k for k in begins if s["t"][k] > at and not _is_landing(d, s[k], bool(falls < np.inf))
    ]
    fell = [k for k in others if s["t"][k] > falls]
    others = [k for k in others if s["t"][k] <= falls]
    mine = [k for k in others if _is_own(d, s, k, at)]
    own, later = len(mine), len(others) - len(mine)
    has_reason = told["outcome"] == "succeeded" or bool(told["reason"])
    if told["outcome"] == "failed":  # the requirements are the reason
        has_reason = any(not r["passed"] for r in told["requirements"])
    keys = fault.table.model_dump(exclude={"start_s"})
    what = f"{type(fault).__name__} " + " ".join(f"{k}={v}" for k, v in keys.items())
    return Judged(
        folder.name, d.mission.name, what, fault.table.start_s,
        "+".join(a["rule"] for a in acted) or "-", at - fault.table.start_s, told["outcome"],
        first, later, own, find_most(s, mine), len(fell), is_down,
        is_down and has_reason and first + later <= 1, told["reason"],
    )  # fmt: skip


FIELDS = (*Judged._fields, "commit")
"""Columns of the table; `commit` is that of the flight, if known."""


def to_row(r: Judged) -> dict[str, str]:
    """Return the row of the table, without the commit."""
    values = (round(x, 2) if isinstance(x, float) else x for x in r)
    return {k: str(v) for k, v in zip(Judged._fields, values, strict=True)} | {"commit": ""}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--table", type=Path)
    a = parser.parse_args()
    found = sorted(m.parent for f in a.folders for m in f.glob("*/metrics.json"))
    runs = [run for run in found if run.suffix != ".partial"]  # interrupted by the user
    rows = [judge(run) for run in runs]
    for r in rows:
        mark = "ok  " if r.passed else "FAIL"
        print(
            f"{mark} {r.run:12s} {r.mission:15s} {r.start_s:6.1f} s {r.fault[:60]:60s} "
            f"{r.rule:34s} {r.after_s:+6.2f} s {r.outcome:9s} "
            f"hits {r.before}/{r.later}, own {r.own} ({r.own_n:.1f} N), fell onto {r.fell} "
            f"{'down' if r.is_down else 'NOT DOWN'} {r.reason[:70]}"
        )
    if a.table is not None:
        with a.table.open("w", encoding="utf-8", newline="") as file:
            out = csv.DictWriter(file, FIELDS, lineterminator="\n")
            out.writeheader()
            out.writerows(to_row(r) for r in rows)
    good = sum(r.passed for r in rows)
    print(f"{good} of {len(rows)} flights pass; {sum(r.rule != '-' for r in rows)} ended by a rule")
    return 0 if good == len(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
