"""Draw what a robot does not know: `python benchmarks/unknown_conditions.py`.

Writes a table for `skywright campaign MISSION --vary FILE.csv`, for every mission at a mapped pipe
or structure: the map's bounds at their largest (where the structure is within them is drawn from
each run's seed) and the plant's deviations, all at once. Rotors' spread, markers and sensors are
drawn from the seeds as always.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from conditions_table import write_table

MAP = {"plant.map_error_m": 0.03, "plant.map_error_deg": 3.0}
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
}
PIPE = {"world.pipe.friction": (0.1, 0.3), "world.pipe.friction_variation": (0.0, 0.3)}


def draw_table(rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows of a mission at a pipe."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(rows):
        drawn = {k: round(rng.uniform(*r), 5) for k, r in {**RANGES, **PIPE}.items()}
        out.append({**MAP, "plant.map_error_size_m": 0.005, **drawn})
    return out


if __name__ == "__main__":
    write_table(draw_table, "pipe-weld-scan", 100, "unknown-pipe-conditions.csv")
