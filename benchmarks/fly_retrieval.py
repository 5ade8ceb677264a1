"""Operators fly `tool-install` by hand, with the retrieval; each flight is a row of retrieval.csv.

    python benchmarks/fly_retrieval.py [--seeds N] [--beside-mm X ...]

Three operator models (ground/operator_model.py) do the whole work with the seeds 1 to N. Then the
careful one retrieves the tool with a wrong aim: its view of the hooks is offset by X, forward and
to the left. Flights that the file contains are not repeated.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from pathlib import Path

import numpy as np

import skywright
from skywright.ground.operator_model import MANNERS, ModelOperator
from skywright.run.operator import Sight, Stick
from skywright.run.run import run_mission

KEPT = Path(__file__).resolve().parent / "retrieval.csv"
SETS = ("mission.task.hover_s=0", "mission.task.wait_s=1")
COLUMNS = (
    "seed", "operator", "ahead_mm", "left_mm", "outcome", "returned", "retries", "install_s",
    "retrieval_s", "install_n", "retrieval_n", "collisions", "reason",
)  # fmt: skip
METRICS = (
    "tool.returned", "tool.retries", "operator.time_s", "operator.retrieval_time_s",
    "operator.force_max_n", "operator.retrieval_force_max_n", "contact.collisions",
)  # fmt: skip


class Misled(ModelOperator):
    """An operator model whose view of the hooks is offset by `beside` (3,) m."""

    def __init__(self, manner: str, seed: int, beside: np.ndarray) -> None:
        super().__init__(manner, seed, 0.03)
        self.beside = beside

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Return the stick for the view."""
        if sight.towards[2] > 0.0:  # the hooks go up into the handle
            sight = sight._replace(off=sight.off + self.beside)
        return super().read(t, sight)


def fly(flight: tuple[str, ...]) -> list[str]:
    """Fly once; return the row."""
    seed, operator, ahead, left = flight
    beside = 1e-3 * np.array([float(ahead), float(left), 0.0])
    with tempfile.TemporaryDirectory() as folder:
        result = run_mission(
            skywright.load("tool-install", sets=(*SETS, f"mission.seed={seed}")),
            out=Path(folder) / "run", operator=Misled(operator, int(seed), beside),
        )  # fmt: skip
    numbers = [f"{result.metrics[n]:.4g}" if n in result.metrics else "" for n in METRICS]
    return [*flight, result.outcome, *numbers, result.reason]


def main() -> None:
    """Fly the missing flights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--beside-mm", type=float, nargs="*", default=[8.0, 20.0, -20.0])
    args = parser.parse_args()
    flights = [(str(k), m, "0", "0") for k in range(1, args.seeds + 1) for m in MANNERS]
    for x in args.beside_mm:
        flights += [("1", "careful", f"{x:g}", "0"), ("1", "careful", "0", f"{x:g}")]
    flown = set()
    if KEPT.is_file():
        with KEPT.open(newline="", encoding="utf-8") as file:
            flown = {tuple(row[c] for c in COLUMNS[:4]) for row in csv.DictReader(file)}
    else:
        KEPT.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    for flight in flights:
        if flight not in flown:
            row = fly(flight)
            with KEPT.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerow(row)
            print(*row, flush=True)


if __name__ == "__main__":
    main()
