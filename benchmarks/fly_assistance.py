"""Fly operated presses with every level of assistance; each flight is a row of assistance.csv.

    python benchmarks/fly_assistance.py [--seeds N] [--control position|force]
        [--condition calm|gusts|fast|late] [--operators NAME ...] [--delays MS ...]

Operator models (ground/operator_model.py) press the sensor of `sensor-install` with several radio
delays and four levels of assistance, all with the seeds 1 to N. Flights that the file contains are
not repeated. Seeds are flown one after the other, so that an interrupted study is balanced and can
be continued. `python docs/generate_assistance.py` generates the page's table from the file.

Each condition was fixed before its first flight. A force above the limit for 0.1 s ends the work.

- "gusts": the strongest that the plan accepts (2.54 m/s along the swing of the link), and a sensor
  that withstands 1.5 times the desired force, an assumption.
- "fast": a full stick moves the hand twice as fast, and the sensor withstands twice the desired
  force. The hasty operator approaches the pipe at 0.6 * 0.12 = 0.072 m/s. With 300 ms of radio
  delay the stick responds to the touch after 0.3 + 0.3 + 0.1 s, in which the hand's reference moves
  by 50 mm: 7.6 N at the 150 N/m that the operators assume. Two seeds gave 3.0 N: the floating
  platform yields in series with the arm, and both together have 60 N/m.
- "late", for 600 ms of radio delay: the same with a sensor that withstands 1.5 times the desired
  force. 72 mm at 60 N/m give 4.3 N for the hasty operator, and 2.6 N for the practised one
  (0.048 m/s for 0.9 s), with a limit of 3 N.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import tempfile
from pathlib import Path
from typing import Any

import skywright
from skywright.ground.operator_model import MANNERS

KEPT = Path(__file__).resolve().parent / "assistance.csv"
LEVELS = ("none", "slow", "guard", "hold")
DELAYS_MS = (0, 150, 300)
"""Round-trip delays, half in each direction."""
FLIGHT = {
    "mission.task.hover_s": 0,
    "mission.task.swing_deg": 0,
    "mission.task.survey": False,
    "mission.task.stick_speed_mps": 0.06,
}
CONDITIONS: dict[str, dict[str, Any]] = {
    "calm": {},
    "gusts": {
        "world.wind.kind": "dryden",
        "world.wind.mean_mps": 2.5,
        "mission.faults.excess_force.limit": 3.0,
    },
    "fast": {"mission.task.stick_speed_mps": 0.12, "mission.faults.excess_force.limit": 4.0},
    "late": {"mission.task.stick_speed_mps": 0.12, "mission.faults.excess_force.limit": 3.0},
}
COLUMNS = (
    "seed", "operator", "delay_ms", "assistance", "control", "condition", "outcome", "force_max_n",
    "time_s", "force_rms_error_n", "reason",
)  # fmt: skip
CASE = 6
"""Number of columns that identify a flight."""


def fly(flight: tuple[str, ...]) -> list[str]:
    """Fly once; return the row."""
    seed, operator, delay, level, control, condition = flight
    sets = {
        **FLIGHT,
        **CONDITIONS[condition],
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
    """Fly the missing flights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--control", choices=("position", "force"), default="position")
    parser.add_argument("--condition", choices=CONDITIONS, default="calm")
    parser.add_argument("--operators", nargs="+", choices=MANNERS, default=list(MANNERS))
    parser.add_argument("--delays", nargs="+", type=int, default=DELAYS_MS, metavar="MS")
    args = parser.parse_args()
    flown = set()
    if KEPT.is_file():
        with KEPT.open(newline="", encoding="utf-8") as file:
            flown = {tuple(row[c] for c in COLUMNS[:CASE]) for row in csv.DictReader(file)}
    else:
        KEPT.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    seeds = range(1, args.seeds + 1)
    for case in itertools.product(seeds, args.operators, args.delays, LEVELS):
        flight = (*map(str, case), args.control, args.condition)
        if flight not in flown:
            row = fly(flight)
            with KEPT.open("a", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerow(row)
            print(*row[:-1], flush=True)


if __name__ == "__main__":
    main()
