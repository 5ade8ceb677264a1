"""Draw the faults of a campaign: `python benchmarks/fault_conditions.py MISSION`.

Writes a table for `skywright campaign MISSION --seed SEED --vary FILE.csv --record all`, with the
mission's seed of SEEDS. Each row has one kind of fault, the kinds in turn, at a random time between
take-off and landing. The seed of the run draws the affected rotor, joint or sensor, and the
severity. `benchmarks/judge_faults.py FOLDER/runs` evaluates the recordings.
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
"""Mission -> s, range of the start of a fault: from take-off to landing with seed 1."""
SEEDS = {mission: 2001 + i for i, mission in enumerate(MISSIONS)}
"""Mission -> seed of its table and of its campaign, so that missions have different faults."""
DELAY_S = 0.001
"""s each way, delay of the control link in rows with the fault `link`. The worlds of these missions
have no delay, because law and rotors are on one computer. Every attitude loop tolerates this delay.
"""
NO_LINK, LINKED = "0.0", str(DELAY_S)


def list_drawn(mission: str) -> list[str]:
    """Return the kinds of fault that can occur in a mission's world.

    `random` is only a placeholder. `tool_dropped` needs a thing with a handle, which only
    tool-install carries.
    """
    d = load_description(mission, sets=[f"world.link.delay_s={DELAY_S}"])
    rng = np.random.default_rng(0)
    return [
        k
        for k in list_kinds("fault")
        if k != "random" and find("fault", k).cls.draw_table(rng, d.robot, d.world) is not None
    ]


def draw_table(mission: str, rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows."""
    rng, kinds = np.random.default_rng(seed), list_drawn(mission)
    out = []
    for i in range(rows):
        start, kind = round(float(rng.uniform(*MISSIONS[mission])), 2), kinds[i % len(kinds)]
        out.append(
            {
                "plant.faults.fault.kind": "random",
                "plant.faults.fault.among": f'["{kind}"]',
                "plant.faults.fault.start_s": start,
                "plant.faults.fault.end_s": start,
                "world.link.delay_s": LINKED if kind == "link" else NO_LINK,
            }
        )
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw the conditions of a campaign of faults.")
    parser.add_argument("mission", choices=MISSIONS)
    parser.add_argument("--rows", type=int, default=50)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--out", type=Path)
    a = parser.parse_args()
    file = a.out or Path(__file__).with_name(f"faults-{a.mission}.csv")
    seed = SEEDS[a.mission] if a.seed is None else a.seed
    save_table(draw_table(a.mission, a.rows, seed), file)
