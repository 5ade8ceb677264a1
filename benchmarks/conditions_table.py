"""Command line of the scripts that draw a campaign's conditions: rows, seed, and a CSV file."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

Table = list[dict[str, Any]]


def write_table(draw: Callable[[int, int], Table], mission: str, rows: int, name: str) -> None:
    """Draw (rows, seed) and write the table; `rows` and `name` (beside this file) are defaults."""
    parser = argparse.ArgumentParser(description=f"Draw the conditions of the {mission} campaign.")
    parser.add_argument("--rows", type=int, default=rows)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name(name))
    a = parser.parse_args()
    save_table(draw(a.rows, a.seed), a.out)


def save_table(table: Table, path: Path) -> None:
    """Write a table as CSV and print its path."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    print(path)
