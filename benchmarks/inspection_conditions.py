"""Draw random sites of an inspection: `python benchmarks/inspection_conditions.py MISSION`.

Writes a table for `skywright campaign MISSION --vary FILE.csv`: the surface, its paint and
roughness, steady wind from any direction, the map's error and the plant's deviations, all at once.
The velocity of a wall is normal about the block's; all else is uniform over its range.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from conditions_table import save_table

PLANT = {
    "plant.map_error_m": (0.0, 0.02),
    "plant.map_error_deg": (0.0, 2.0),
    "plant.mass_error": (-0.05, 0.05),
    "plant.rotor_gain_error": (-0.05, 0.05),
    "world.wind.toward_deg": (-180.0, 180.0),
}
RANGES = {
    "thickness-survey": {
        "world.things.steel.paint_m": (0.0, 0.0005),
        "world.things.steel.roughness_front_m": (0.0, 1.5e-5),
        "world.things.steel.roughness_back_m": (0.0, 4e-5),
        "world.wind.mean_mps": (0.0, 2.0),
    },
    "crack-scan": {
        "world.pipe.diameter_m": (0.36, 0.6),
        "world.things.steel.paint_m": (0.0, 0.0002),
        "world.things.crack1.angle_deg": (-90.0, 90.0),
        "world.things.crack1.around_deg": (-8.0, 8.0),
        "world.things.crack2.angle_deg": (-90.0, 90.0),
        "world.things.crack2.around_deg": (-8.0, 8.0),
        "world.wind.mean_mps": (0.0, 3.0),
    },
}
VELOCITY = 5920.0, 0.003  # m/s, and the deviation of a wall's as a fraction


def draw_table(mission: str, rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(rows):
        row = {k: float(f"{rng.uniform(*r):.4g}") for k, r in {**RANGES[mission], **PLANT}.items()}
        if mission == "thickness-survey":
            mean, share = VELOCITY
            row["world.things.steel.velocity_m_per_s"] = round(rng.normal(mean, share * mean), 1)
        else:
            row["world.things.steel.kind"] = "wall"  # type: ignore[assignment]
        out.append(dict(sorted(row.items())))
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", choices=sorted(RANGES))
    parser.add_argument("--rows", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    name = f"{a.mission}-conditions.csv"
    save_table(draw_table(a.mission, a.rows, a.seed), Path(__file__).with_name(name))
