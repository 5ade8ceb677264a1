"""Draw deviations unknown to a robot: `python benchmarks/unknown_conditions.py MISSION`.

Writes a table for `skywright campaign MISSION --vary FILE.csv`, for a mission at a mapped pipe or
structure: the largest bounds of the map (each run's seed draws the pose of the structure within
them) and the deviations of the plant, all together. The seeds also draw the spread of rotors,
springs (10 %), markers and sensors, as in any run.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from conditions_table import save_table

MAP = {"plant.map_error_m": 0.03, "plant.map_error_deg": 3.0, "plant.map_error_size_m": 0.005}
RANGES = {
    "plant.mass_error": (-0.05, 0.05),
    "plant.rotor_gain_error": (-0.05, 0.05),
    "plant.com_x_error_m": (-0.005, 0.005),
    "plant.com_y_error_m": (-0.005, 0.005),
    "plant.com_z_error_m": (-0.005, 0.005),
    "plant.inertia_error": (-0.1, 0.1),
    "plant.link_length_error_m": (-0.005, 0.005),
    "plant.joint_offset_error_deg": (-0.5, 0.5),
    "plant.drag_error": (-0.3, 0.3),
    "plant.hardening_error": (-0.2, 0.2),
    "plant.backlash_error": (-0.5, 0.5),
    "plant.servo_lag_error": (-0.2, 0.2),
}
OWN: dict[str, tuple[dict[str, float], dict[str, tuple[float, float]]]] = {
    "pipe-weld-scan": (
        MAP, {"world.pipe.friction": (0.1, 0.3), "world.pipe.friction_variation": (0.0, 0.3)}
    ),
    "tool-install": (MAP, {"world.pipe.friction": (0.2, 1.0)}),
    "bridge-contact": (
        {k: v for k, v in MAP.items() if "size" not in k},  # a deck has none
        {"world.structure.friction": (0.4, 0.8)},
    ),
    "wall-contact": (MAP, {"world.structure.friction": (0.4, 0.8)}),
    "sensor-install": (MAP, {"world.pipe.friction": (0.2, 1.0)}),
}  # fmt: skip
"""Mission -> bounds of its map, and further variations."""


def draw_table(mission: str, rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows."""
    bounds, own = OWN[mission]
    rng, out = np.random.default_rng(seed), []
    for _ in range(rows):
        drawn = {k: round(rng.uniform(*r), 5) for k, r in {**RANGES, **own}.items()}
        out.append({**bounds, **drawn})
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", choices=sorted(OWN))
    parser.add_argument("--rows", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    name = f"unknown-{a.mission}-conditions.csv"
    save_table(draw_table(a.mission, a.rows, a.seed), Path(__file__).with_name(name))
