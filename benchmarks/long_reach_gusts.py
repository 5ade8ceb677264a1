"""Fly `sensor-install` in gusts, with a longer link and with a larger swing.

    python benchmarks/long_reach_gusts.py [--seeds 1 2 3] [--table FILE]

Each condition is flown with each seed and the mission's default errors of map and robot. Conditions
that the plan refuses are flown as well, with the limits of the two refusing requirements raised,
and evaluated with the original limits: a refusal is right if the flights exceed them. The table
benchmarks/long-reach-gusts.csv is written after each flight; its rows are not flown again.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import Any

from skywright.description.loader import load_description
from skywright.errors import SkywrightError
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate

TABLE = Path(__file__).with_name("long-reach-gusts.csv")
SHORT = "mission.task.hover_s=0"
LONG = (
    "robot.pendulum.length_m=1.0", "robot.pendulum.com_m=0.785", "robot.pendulum.folded_deg=-84",
    "robot.arm.shoulder_pitch.folded_deg=-6",
)  # fmt: skip
"""The link of the authors' public simulation model; on the ground its end is as high as ours."""
LARGE = "mission.task.swing_deg=20"
FREE = (
    "mission.requirements.platform.excursion_m.limit=1",
    "mission.requirements.swing.decay_s.limit=10",
)
"""Limits with which no plan refuses."""
ASKED = {"platform.excursion_m": 0.03, "swing.decay_s": 2.0}
"""Limits of the mission."""
WINDS = {
    f"Dryden, {mean:g} m/s {way}": (
        "world.wind.kind=dryden", f"world.wind.mean_mps={mean}", f"world.wind.toward_deg={toward}",
    )
    for mean in (1.0, 2.0, 2.5, 3.0)
    for way, toward in (("along the swing", 0), ("across the swing", 90))
}  # fmt: skip
"""The robot faces along x, the direction of the link's swing."""
CONDITIONS: dict[str, tuple[str, ...]] = {
    "still air": (),
    "still air, link of 1.0 m": LONG,
    "still air, released at 20 deg": (LARGE,),
    "still air, link of 1.0 m, released at 20 deg": (*LONG, LARGE),
    **WINDS,
    "released at 20 deg, Dryden, 2 m/s along the swing": (
        LARGE, *WINDS["Dryden, 2 m/s along the swing"]
    ),
}  # fmt: skip
FIELDS = (
    "condition", "seed", "refused", "excursion_mm", "decay_s", "start_deg", "force_error_n",
    "lever_min", "met", "reason",
)  # fmt: skip


def fly(condition: str, seed: int) -> dict[str, Any]:
    """Fly one condition with one seed."""
    sets = [SHORT, *CONDITIONS[condition]]
    refused = plan_mission(load_description("sensor-install", sets=sets, seed=seed)).blocked_by
    row: dict[str, Any] = {"condition": condition, "seed": seed, "refused": refused or ""}
    try:
        flown = fly_and_evaluate(load_description("sensor-install", sets=[*sets, *FREE], seed=seed))
    except SkywrightError as error:
        return row | {"met": False, "reason": str(error)}
    m = flown.metrics
    within = all(m.get(name, float("inf")) <= limit for name, limit in ASKED.items())
    return row | {
        "excursion_mm": f"{1e3 * m.get('platform.excursion_m', float('nan')):.1f}",
        "decay_s": f"{m.get('swing.decay_s', float('nan')):.2f}",
        "start_deg": f"{m.get('swing.start_deg', float('nan')):.1f}",
        "force_error_n": f"{m.get('force.mean_error_n', float('nan')):.3f}",
        "lever_min": f"{m.get('arm.lever_min', float('nan')):.2f}",
        "met": within and flown.outcome == "succeeded",
        "reason": flown.reason or "; ".join(
            f"{r.name} {r.value}" for r in flown.requirements if not r.passed
        ),
    }  # fmt: skip


def read_table(file: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Read the flown rows."""
    if not file.exists():
        return {}
    with file.open(encoding="utf-8", newline="") as text:
        return {(r["condition"], int(r["seed"])): dict(r) for r in csv.DictReader(text)}


def main() -> None:
    """Fly the missing rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--table", type=Path, default=TABLE)
    a = parser.parse_args()
    rows, order = read_table(a.table), list(CONDITIONS)
    for seed in a.seeds:
        for condition in CONDITIONS:
            if (condition, seed) in rows:
                continue
            rows[condition, seed] = row = fly(condition, seed)
            print(row, flush=True)
            with a.table.open("w", encoding="utf-8", newline="") as text:
                out = csv.DictWriter(text, FIELDS, lineterminator="\n")
                out.writeheader()
                known = [k for k in rows if k[0] in order]
                out.writerows(rows[k] for k in sorted(known, key=lambda k: (order.index(k[0]), k)))


if __name__ == "__main__":
    main()
