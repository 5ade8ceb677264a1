"""Planning time, warm: `python benchmarks/bench_planning.py [--out FILE]`.

For each case 20 seeds: how many plans exist, the median and the slowest time, and what one
clearance query of the whole robot costs.
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from skywright.missions.loader import load_description
from skywright.missions.planning import plan_mission
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.scene import build_scene

CASES: dict[str, tuple[str, ...]] = {
    "default": (),
    "behind the pipe": ("world.pipe.yaw_deg=180",),
    "0.6 m, inclined": ("world.pipe.diameter_m=0.6", "world.pipe.inclination_deg=30"),
    "0.3 m, inclined, from the far side": (
        "world.pipe.diameter_m=0.3", "world.pipe.inclination_deg=-30", "world.pipe.yaw_deg=150",
    ),
    "top": ('mission.scan.side="top"',),
    "underside (refused: posts)": ('mission.scan.side="underside"',),
}  # fmt: skip
SEEDS = 20


def measure_case(sets: tuple[str, ...]) -> dict[str, Any]:
    """Plan with every seed; times in s."""
    times, found, clearance, margin = [], 0, [], []
    for seed in range(SEEDS):
        description = load_description("pipe-weld-scan", sets=sets, seed=seed)
        plan = plan_mission(description)
        times.append(plan.plan_s)
        found += plan.feasible
        clearance.append(plan.min_clearance_m)
        margin.append(plan.min_rotor_margin)
    return {
        "feasible": f"{found}/{SEEDS}",
        "plan_s_median": round(statistics.median(times), 3),
        "plan_s_max": round(max(times), 3),
        "min_clearance_m": round(min(clearance), 4) if found else None,
        "min_rotor_margin": round(min(margin), 3) if found else None,
    }


def measure_query(count: int = 2000) -> float:
    """Microseconds of one clearance query at random poses near the pipe, called from Python."""
    d = load_description("pipe-weld-scan")
    query = build_clearance(build_scene(d.robot, d.world))
    poses = np.array([1.2, 0.0, 1.4]) + np.random.default_rng(0).uniform(-0.2, 0.2, (count, 3))
    q, eye = np.array([-0.7, 0.7]), np.eye(3)
    compute_clearance(query, poses[0], eye, q)
    began = time.perf_counter()
    for p in poses:
        compute_clearance(query, p, eye, q)
    return 1e6 * (time.perf_counter() - began) / count


def main() -> None:
    """Measure and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    plan_mission(load_description("pipe-weld-scan", sets=CASES["behind the pipe"]))  # compile
    result: dict[str, Any] = {"machine": platform.machine(), "python": platform.python_version()}
    result["cases"] = {name: measure_case(sets) for name, sets in CASES.items()}
    result["clearance_query_us"] = round(measure_query(), 1)
    text = json.dumps(result, indent=2)
    print(text)
    if out is not None:
        out.write_text(text + "\n")


if __name__ == "__main__":
    main()
