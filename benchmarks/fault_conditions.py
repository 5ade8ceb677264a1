"""Draw the faults of a campaign: `python benchmarks/fault_conditions.py MISSION`.

Writes a table for `skywright campaign MISSION --vary FILE.csv --record all`: in each row one kind
of fault, the kinds in turn, at a random time between take-off and landing; which rotor, joint or
sensor fails, and how badly, the seed of the run draws. `benchmarks/judge_faults.py FOLDER/runs`
judges the recordings.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from conditions_table import save_table

from skywright.core.find import find, list_kinds
from skywright.description.loader import load_description

MISSIONS = {
    "pipe-weld-scan": (5.0, 219.0), "sensor-install": (5.0, 199.0), "tool-install": (5.0, 184.0),
    "bridge-contact": (5.0, 119.0),
}  # fmt: skip
"""Mission -> s between which a fault begins: from the take-off to the landing of seed 1."""


def draw_table(mission: str, rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows."""
    rng, d = np.random.default_rng(seed), load_description(mission)
    kinds = [
        k
        for k in list_kinds("fault")
        if k != "random" and find("fault", k).cls.draw_table(rng, d.robot, d.world) is not None
    ]
    out = []
    for i in range(rows):
        start = round(float(rng.uniform(*MISSIONS[mission])), 2)
        out.append(
            {
                "plant.faults.fault.kind": "random",
                "plant.faults.fault.among": f'["{kinds[i % len(kinds)]}"]',
                "plant.faults.fault.start_s": start,
                "plant.faults.fault.end_s": start,
            }
        )
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw the conditions of a campaign of faults.")
    parser.add_argument("mission", choices=MISSIONS)
    parser.add_argument("--rows", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    file = a.out or Path(__file__).with_name(f"faults-{a.mission}.csv")
    save_table(draw_table(a.mission, a.rows, a.seed), file)
