"""Estimated against flown duration of each mission: `python benchmarks/fly_durations.py`.

Three seeds each, without operator. A mission that needs a file of the user is left out. Retries,
which no estimate contains, are part of the flown duration.
"""

from __future__ import annotations

import csv
from pathlib import Path

from skywright.description.loader import list_missions, load_description
from skywright.errors import InputError
from skywright.run.run import fly_and_evaluate

SEEDS = (1, 2, 3)
TABLE = Path(__file__).with_name("durations.csv")


def main() -> None:
    """Fly and write the table."""
    rows = []
    for mission in (entry.name for entry in list_missions()):
        for seed in SEEDS:
            try:
                result = fly_and_evaluate(load_description(mission, seed=seed))
            except InputError as error:
                print(f"{mission}: {error}")
                break
            flown, told = result.metrics["flight.duration_s"], result.plan.flight_s
            off = f"{100.0 * (told / flown - 1.0):+.1f}"
            rows.append([mission, seed, f"{told:.1f}", f"{flown:.1f}", off, result.outcome])
            print(*rows[-1], flush=True)
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["mission", "seed", "estimated_s", "flown_s", "difference_percent", "outcome"])
        out.writerows(rows)


if __name__ == "__main__":
    main()
