"""Write crack-gusts-conditions.csv for `skywright pod crack-scan`.

The command is `python benchmarks/crack_gusts.py`.

Nine cracks of 6 mm in a sector, of random depth and direction in each flight, without an error of
the map; two robots (law of Tognon 2018 and `direct_force`) in calm air and in gusts, in turns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from conditions_table import write_table

ROBOTS, MEANS = ("othex", "othex-force"), (0.0, 2.0)
DEPTHS = 0.2e-3, 1.0e-3  # m, uniform in the logarithm


def draw_table(rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows: each site by four flights, one of each robot and wind."""
    out = []
    for i in range(rows):
        rng = np.random.default_rng([seed, i // 4])
        mean = MEANS[i // 2 % 2]
        row: dict[str, Any] = {
            "mission.robot": ROBOTS[i % 2],
            "world.wind.kind": "dryden" if mean else "steady",
            "world.wind.mean_mps": mean,
            "plant.map_error_m": 0, "plant.map_error_deg": 0, "plant.map_error_size_m": 0,
            "mission.task.pass_length_m": 0.1, "mission.task.arc_deg": 20,
        }  # fmt: skip
        for k in range(9):
            crack = f"world.things.crack{k + 1}"
            row[f"{crack}.kind"] = "crack"
            row[f"{crack}.s_m"] = round(0.07 + 0.03 * (k // 3) + rng.uniform(-0.002, 0.002), 4)
            row[f"{crack}.around_deg"] = round(7.0 * (k % 3 - 1) + rng.uniform(-0.5, 0.5), 2)
            row[f"{crack}.angle_deg"] = round(rng.uniform(-90, 90), 1)
            low, high = np.log(DEPTHS)
            row[f"{crack}.depth_m"] = float(f"{np.exp(rng.uniform(low, high)):.4g}")
        out.append(row)
    return out


if __name__ == "__main__":
    write_table(draw_table, "crack-scan (gusts)", 40, "crack-gusts-conditions.csv")
