"""Draw the conditions of the transport's campaign: `python benchmarks/transport_conditions.py`.

Writes a table for `skywright campaign bar-transport --vary FILE.csv`: random pipe structures of any
difficulty, and a wind of 3 m/s with Dryden turbulence from any direction. The seeds of the runs,
which draw sensors, gusts and the planner's samples, are the campaign's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from conditions_table import write_table

SPEED = 3.0  # m/s


def draw_table(rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows."""
    rng = np.random.default_rng(seed)
    return [
        {
            "world.scenario_seed": int(rng.integers(100, 1_000_000)),  # not in the benchmark
            "world.difficulty": round(rng.uniform(), 3),
            "world.wind.kind": "dryden",
            "world.wind.mean_mps": SPEED,
            "world.wind.toward_deg": round(rng.uniform(-180.0, 180.0), 1),
        }
        for _ in range(rows)
    ]


if __name__ == "__main__":
    write_table(draw_table, "bar-transport", 30, "transport-conditions.csv")
