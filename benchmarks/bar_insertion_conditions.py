"""Draw the conditions of the bar's campaign: `python benchmarks/bar_insertion_conditions.py`.

Writes a table for `skywright campaign bar-insertion --vary FILE.csv`: a socket with an offset of up
to 2 cm and 5 deg from the world file and a slope of up to 2 deg, varied mass and friction of the
bar, a mass error of the nominal model, and light turbulence from any direction. The clearance is
always 2 mm. The seeds of the runs, which draw sensors, the survey's error and further deviations of
the plant, are the campaign's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from conditions_table import write_table


def draw_table(rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows."""
    rng = np.random.default_rng(seed)
    return [
        {
            "plant.socket_x_error_m": round(rng.uniform(-0.02, 0.02), 4),
            "plant.socket_y_error_m": round(rng.uniform(-0.02, 0.02), 4),
            "plant.socket_z_error_m": round(rng.uniform(-0.01, 0.01), 4),
            "plant.socket_yaw_error_deg": round(rng.uniform(-5.0, 5.0), 2),
            "plant.socket_roll_error_deg": round(rng.uniform(-2.0, 2.0), 2),
            "plant.socket_pitch_error_deg": round(rng.uniform(-2.0, 2.0), 2),
            "plant.mass_error": round(rng.uniform(-0.05, 0.05), 4),
            "world.things.peg.mass_kg": round(rng.uniform(0.3, 0.5), 3),
            "world.things.peg.friction": round(rng.uniform(0.2, 0.6), 3),
            "world.wind.kind": "dryden",
            "world.wind.mean_mps": round(rng.uniform(0.1, 1.0), 2),
            "world.wind.toward_deg": round(rng.uniform(-180.0, 180.0), 1),
            "world.wind.dryden.sigma_mps": round(rng.uniform(0.05, 0.15), 3),
        }
        for _ in range(rows)
    ]


if __name__ == "__main__":
    write_table(draw_table, "bar-insertion", 100, "bar-insertion-conditions.csv")
