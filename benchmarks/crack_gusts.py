"""Probability of detection in gusts, by law: conditions and table for `skywright pod crack-scan`.

    python benchmarks/crack_gusts.py               # writes crack-gusts-conditions.csv
    skywright pod crack-scan --runs 50 --seed 5 --vary benchmarks/crack-gusts-conditions.csv \
        --group mission.robot --out FOLDER
    python benchmarks/crack_gusts.py FOLDER        # writes inspection/gusts.json

Each flight inspects a sector with nine cracks of 6 mm, of random depth and direction, without map
errors. Ten sites are each flown five times: with the law of Tognon 2018 (`othex`) and
`direct_force` (`othex-force`), in calm air and in gusts. The plan for `othex` accepts gusts up to
about 2.7 m/s.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from conditions_table import save_table
from fly_inspections import HERE, KEPT, read_commit

from skywright.analysis.pod.groups import compare_groups
from skywright.analysis.pod.method import Method
from skywright.analysis.pod.pod import compute_pod
from skywright.analysis.pod.table import load_inspections
from skywright.errors import InputError

CELLS = (
    ("othex", 0.0), ("othex-force", 0.0), ("othex", 2.6), ("othex-force", 2.6),
    ("othex-force", 3.5),
)  # fmt: skip
"""Robot, and mean speed of the gusty wind in m/s."""
DEPTHS = 0.2e-3, 1.0e-3  # m, uniform in the logarithm
ROBOT, MEAN = "mission.robot", "world.wind.mean_mps"


def draw_table(rows: int, seed: int) -> list[dict[str, Any]]:
    """Draw all rows: each site once per cell."""
    out = []
    for i in range(rows):
        rng = np.random.default_rng([seed, i // len(CELLS)])
        robot, mean = CELLS[i % len(CELLS)]
        row: dict[str, Any] = {
            ROBOT: robot, "world.wind.kind": "dryden" if mean else "steady", MEAN: mean,
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


def evaluate(folder: Path) -> dict[str, Any]:
    """Return the curve of each cell of a flown campaign."""
    with (folder / "pod.csv").open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    cells = []
    for robot, mean in CELLS:
        mine = [r for r in rows if r[ROBOT] == robot and float(r[MEAN]) == mean]
        with tempfile.TemporaryDirectory() as at:
            file = Path(at) / "pod.csv"
            with file.open("w", encoding="utf-8", newline="") as text:
                out = csv.DictWriter(text, list(rows[0]))
                out.writeheader()
                out.writerows(mine)
            table = load_inspections(file, None)
        sizes = np.array([float(r["size_mm"]) for r in mine])
        hit = np.array([r["hit"] == "1" for r in mine])
        flaws = sizes > 0
        cell: dict[str, Any] = {
            "robot": robot, "mean_mps": mean,
            "flights": len({r["flaw"].partition("/")[0] for r in mine if r["flaw"]}),
            "flaws": int(flaws.sum()), "found": int((flaws & hit).sum()),
            "sites": int((~flaws).sum()), "calls": int((~flaws & hit).sum()),
            "largest_missed_mm": round(float(np.max(sizes[flaws & ~hit])), 3),
            "smallest_found_mm": round(float(np.min(sizes[flaws & hit])), 3),
        }  # fmt: skip
        with contextlib.suppress(InputError):  # separated hits and misses have no curve
            curve = compute_pod(table, Method()).to_json()
            cell |= {k: curve[k] for k in ("a50", "a90", "a90_95")}
        cells.append(cell)
    p = compare_groups(load_inspections(folder / "pod.csv", None), ROBOT, Method()).to_json()
    return {"commit": read_commit(), "one_curve_p": p["p_same"], "cells": cells}


def main() -> None:
    """Write the conditions, or the results of the flights in a folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", help="of the flown campaign")
    folder = parser.parse_args().folder
    if folder is None:
        save_table(draw_table(50, 1), HERE / "crack-gusts-conditions.csv")
    else:
        text = json.dumps(evaluate(folder), indent=1)
        (KEPT / "gusts.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
