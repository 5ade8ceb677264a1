"""Fly operated presses with every level of assistance; each flight is a row of assistance.csv.

    python benchmarks/fly_assistance.py [--seeds N] [--control position|force]

Three operator models (ground/operator_model.py), three delays of the radio and four levels of
assistance press the sensor of `sensor-install`, each with the same seeds 1 to N. Flights that the
file has already are left out, seeds come one after the other: an interrupted study is balanced and
can be continued. `python docs/generate_assistance.py` makes the page's table of the file.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import tempfile
from pathlib import Path

import skywright
from skywright.ground.operator_model import MANNERS

KEPT = Path(__file__).resolve().parent / "assistance.csv"
LEVELS = ("none", "slow", "guard", "hold")
DELAYS_MS = (0, 150, 300)
"""There and back, half of it each way."""
FLIGHT = {
    "mission.task.hover_s": 0,
    "mission.task.swing_deg": 0,
    "mission.task.survey": False,
    "mission.task.stick_speed_mps": 0.06,
}
COLUMNS = (
    "seed", "operator", "delay_ms", "assistance", "control", "outcome", "force_max_n", "time_s",
    "force_rms_error_n", "reason",
)  # fmt: skip


def list_flights(seeds: int, control: str) -> list[tuple[str, ...]]:
    """Return the first columns of each flight, seed by seed."""
    cases = itertools.product(range(1, seeds + 1), MANNERS, DELAYS_MS, LEVELS)
    return [(*map(str, case), control) for case in cases]


def fly(flight: tuple[str, ...]) -> list[str]:
    """Fly one; returns its row."""
    seed, operator, delay, level, control = flight
    sets = {
        **FLIGHT,
        "mission.seed": int(seed),
        "mission.task.assistance": level,
        "mission.task.control": control,
        "world.radio.delay_s": 0.5e-3 * int(delay),
    }
    with tempfile.TemporaryDirectory() as folder:
        result = skywright.run(
            skywright.load("sensor-install", sets=sets),
            operator=f"model:{operator}", report=False, out=Path(folder) / "run",
        )  # fmt: skip
    names = ("operator.force_max_n", "operator.time_s", "force.rms_error_n")
    numbers = [f"{result.metrics[n]:.4g}" if n in result.metrics else "" for n in names]
    return [*flight, result.outcome, *numbers, result.reason]


def main() -> None:
    """Fly what is missing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--control", choices=("position", "force"), default="position")
    args = parser.parse_args()
    flown = set()
    if KEPT.is_file():
        with KEPT.open(newline="", encoding="utf-8") as file:
            flown = {tuple(row[c] for c in COLUMNS[:5]) for row in csv.DictReader(file)}
    else:
        KEPT.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    for flight in list_flights(args.seeds, args.control):
        if flight not in flown:
            row = fly(flight)
            with KEPT.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerow(row)
            print(*row[:-1], flush=True)


if __name__ == "__main__":
    main()
