"""Draw requests for benchmarks/oracle.py: `python benchmarks/oracle_conditions.py MISSION`.

Writes a table for `skywright campaign MISSION --record all --vary FILE.csv`. What is asked for
varies, not only what is in the way: for the weld scan the sector, the pattern and its passes; the
number of welds (none in a sixth of the rows, two in a quarter), their place, angle and width (seams
along the axis in a tenth); the pipe's pose and size, the map's errors and the arm's.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from conditions_table import save_table

APART_M = 0.009  # between passes; closer ones are refused


def draw_scan(rng: np.random.Generator) -> dict[str, Any]:
    """Draw one request for a weld scan."""
    diameter = rng.uniform(0.3, 0.6)
    arc = rng.uniform(20.0, 120.0)
    pattern = rng.choice(["raster", "spiral", "line"], p=[0.7, 0.2, 0.1])
    passes = int(rng.integers(1, 9))
    around = 0.5 * diameter * math.radians(arc)
    passes = min(passes, 1 + int(around / APART_M))
    angle = 90.0 if rng.random() < 0.1 else rng.uniform(-60.0, 60.0)
    offset = rng.uniform(-0.05, 0.05)
    other = offset + rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.09)
    lean = 0.0 if angle == 90.0 else rng.uniform(-10.0, 10.0)
    second = 90.0 if rng.random() < 0.1 else angle + lean
    welds = rng.choice([0, 1, 2], p=[1 / 6, 7 / 12, 1 / 4])
    row = {
        "mission.task.pattern": str(pattern),
        "mission.task.side": "angle",
        "mission.task.centre_angle_deg": rng.uniform(-30.0, 30.0)
        + (180.0 if rng.random() < 0.15 else 0.0),
        "mission.task.arc_deg": arc,
        "mission.task.passes": passes,
        "mission.task.pass_length_m": rng.uniform(0.12, 0.25),
        "mission.task.speed_mps": rng.uniform(0.01, 0.02),
        "world.weld.present": str(welds > 0).lower(),
        "world.weld.angle_deg": angle,
        "world.weld.offset_m": offset,
        "world.weld.half_width_m": rng.uniform(0.004, 0.007),
        "world.welds.second.present": str(welds > 1).lower(),
        "world.welds.second.angle_deg": second,
        "world.welds.second.offset_m": other,
        "world.pipe.diameter_m": diameter,
        "world.pipe.length_m": 2.0,  # its posts stand aside
        "world.pipe.yaw_deg": rng.uniform(-180.0, 180.0),
        "world.pipe.inclination_deg": rng.uniform(-20.0, 20.0),
        "plant.map_error_m": rng.uniform(0.0, 0.03),
        "plant.map_error_deg": rng.uniform(0.0, 3.0),
        "plant.map_error_size_m": rng.uniform(0.0, 0.005),
        "plant.link_length_error_m": rng.uniform(-0.005, 0.005),
        "plant.joint_offset_error_deg": rng.uniform(-0.5, 0.5),
    }
    return {k: round(v, 5) if isinstance(v, float) else v for k, v in row.items()}


DRAWS: dict[str, Callable[[np.random.Generator], dict[str, Any]]] = {"pipe-weld-scan": draw_scan}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", choices=sorted(DRAWS))
    parser.add_argument("--rows", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    rng = np.random.default_rng(a.seed)
    rows = [DRAWS[a.mission](rng) for _ in range(a.rows)]
    save_table(rows, Path(__file__).with_name(f"oracle-{a.mission}-conditions.csv"))
