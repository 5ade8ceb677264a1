"""Accuracy of localisation: `python benchmarks/bench_locate.py [--seeds N] [--out FILE]`.

Simulated flights with one seed each; errors are three-dimensional, against the truth, rms over all
seeds. The outage is flown with cameras of different drift, each compared with its own lower bound.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from skywright.analysis.locate import reach
from skywright.models.tracking_camera import CameraErrors

CAMERAS = {
    "1.5 cm per sqrt(m)": CameraErrors(),
    "2 cm per sqrt(s)": CameraErrors(walk_m_per_sqrt_m=0.0, walk_m_per_sqrt_s=0.02),
    "heading 0.3 deg per sqrt(s)": CameraErrors(
        walk_m_per_sqrt_m=0.01, yaw_rate_deg_per_min=0.0, yaw_walk_deg_per_sqrt_s=0.3
    ),
    "scale 0.3 % per sqrt(s)": CameraErrors(walk_m_per_sqrt_m=0.01, scale_walk_per_sqrt_s=0.003),
}
"""Drift of the camera; the first entry is the default."""


def rms(values: Any) -> float:
    """Return the root mean square, m."""
    return round(math.sqrt(float(np.mean(np.square(values)))), 5)


def measure_outages(seeds: int) -> dict[str, Any]:
    """Measure 13 s without the station, for each camera."""
    table = {}
    for name, camera in CAMERAS.items():
        o = reach.measure_outage(seeds, camera)
        table[name] = {
            "error_m": rms(o.fused), "floor_m": rms(o.floor), "ratio": round(o.ratio, 3),
            "predicted_m": rms(o.predicted), "paper_filter_m": rms(o.paper),
            "aligned_camera_m": rms(o.aligned), "lasted_s": round(float(o.lasted.mean()), 2),
            "path_m": round(float(o.path.mean()), 2),
            "below_1_cm_after_s": round(o.recovery_time(0.01), 2),
            "paper_filter_2_s_after_m": round(float(o.recovery_paper[40]), 4),
        }  # fmt: skip
    return table


def main() -> None:
    """Measure and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    began = time.perf_counter()
    nominal = reach.measure_nominal(args.seeds)
    late = reach.measure_nominal(args.seeds, arrival_stamps=True)
    outages = measure_outages(args.seeds)
    climb = reach.measure_climb(args.seeds)
    revisit = reach.measure_revisit()
    first = next(iter(outages.values()))
    result = {
        "seeds": args.seeds,
        "locate.rms_m": round(nominal.fused, 5),
        "locate.outage_error_m": first["error_m"],
        "locate.outage_ratio": first["ratio"],
        "locate.climb_error_m": rms(climb.fused),
        "locate.revisit_m": round(revisit.rms, 5),
        "nominal": {k: round(v, 5) for k, v in nominal._asdict().items()},
        "nominal, stamped on arrival": {k: round(v, 5) for k, v in late._asdict().items()},
        "outage": outages,
        "climb": {
            "fused_m": rms(climb.fused), "worst_m": round(float(climb.fused.max()), 4),
            "similarity_m": rms(climb.similarity), "affine_m": rms(climb.affine),
            "paper_filter_m": rms(climb.paper),
            "flatness": round(float(climb.flatness.mean()), 4),
        },
        "revisit": {
            "flights": len(revisit.errors), "rms_m": round(revisit.rms, 5),
            "predicted_m": rms(revisit.predicted),
            "every_point_believed_m": rms(np.linalg.norm(revisit.untested, axis=1)),
            "moved_points": revisit.moved, "found": revisit.found,
            "false_alarms": revisit.false_alarms,
        },
        "wall_s": round(time.perf_counter() - began, 1),
    }  # fmt: skip
    text = json.dumps(result, indent=2)
    print(text)
    if args.out is not None:
        args.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
