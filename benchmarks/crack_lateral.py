"""Lateral deviation of the passes of a crack scan in gusts, compared with the plan's assumption.

    python benchmarks/crack_lateral.py [--means 0 1.5 2.5] [--seeds 1 2 3] [--out FILE.json]

Flies `crack-scan` in Dryden gusts on the side and on the top of the pipe, without map errors, and
compares the deviation of the measured tip across its passes with missions/crack_scan/lateral.py. A
pass consists of the samples in which the reference moves along the pipe at half of the speed or
more. The mean over all passes is excluded, because it is an error of the localisation, which shifts
the whole map.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from skywright.description.loader import load_description
from skywright.missions.scan.coverage import SCAN
from skywright.run.run import fly_and_evaluate

SIDES = ("side", "top")


def measure(side: str, mean: float, seed: int) -> dict[str, object]:
    """Fly once; return planned and measured deviations (mm) across the passes."""
    sets = {
        "mission.task.side": side, "world.wind.kind": "dryden" if mean else "steady",
        "world.wind.mean_mps": str(mean), "world.wind.toward_deg": "90" if side == "side" else "0",
        "plant.map_error_m": "0", "plant.map_error_deg": "0", "plant.map_error_size_m": "0",
    }  # fmt: skip
    result = fly_and_evaluate(load_description("crack-scan", sets=sets, seed=seed))
    out: dict[str, object] = {"side": side, "mean_mps": mean, "seed": seed}
    if result.plan is None or not result.plan.feasible:
        return out | {"refused": result.reason}
    s = result.samples[SCAN.select(result.samples, result.phases)]
    axis = np.array([0.0, 1.0, 0.0])
    around = np.cross(s["ref_normal_W"], axis)
    around /= np.linalg.norm(around, axis=1)[:, None]
    across = np.sum((s["meas_p_WT"] - s["ref_p_WT"]) * around, axis=1)
    step = np.gradient(s["ref_p_WT"] @ axis) / np.gradient(s["t"])
    passing = np.abs(step) > 0.5 * result.description.mission.task.speed_mps
    off = across[passing] - np.mean(across[passing])
    return out | {
        "outcome": result.outcome,
        "planned_mm": round(1e3 * result.plan.way.lateral_std_m, 3),
        "std_mm": round(1e3 * float(np.std(off)), 3),
        "max_mm": round(1e3 * float(np.max(np.abs(off))), 3),
        "area": round(result.metrics.get("coverage.area_fraction", float("nan")), 4),
    }


def main() -> None:
    """Fly all cases and print one line each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--means", type=float, nargs="+", default=[0.0, 1.5, 2.5])
    parser.add_argument("--sides", nargs="+", default=SIDES, choices=SIDES)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    rows = []
    for side in a.sides:
        for mean in a.means:
            for seed in a.seeds:
                rows.append(measure(side, mean, seed))
                print(json.dumps(rows[-1]), flush=True)
    if a.out is not None:
        a.out.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
