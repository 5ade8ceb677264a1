"""Draw the conditions of the sensor's campaign: `python benchmarks/sensor_install_conditions.py`.

Writes a table for `skywright campaign sensor-install --vary FILE.csv`: pipe diameters and heights
over the range of the mission, a mass error of the nominal model, and a steady wind from any
direction. The seeds of the runs, which draw sensors and deviations of the plant, are the
campaign's.
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
            "world.pipe.diameter_m": round(rng.uniform(0.1, 0.4), 3),
            "world.pipe.z_m": round(rng.uniform(2.2, 3.5), 2),
            "plant.mass_error": round(rng.uniform(-0.05, 0.05), 4),
            "world.wind.kind": "steady",
            "world.wind.mean_mps": round(rng.uniform(0.0, 3.0), 2),
            "world.wind.toward_deg": round(rng.uniform(-180.0, 180.0), 1),
        }
        for _ in range(rows)
    ]


if __name__ == "__main__":
    write_table(draw_table, "sensor-install", 40, "sensor-install-conditions.csv")
