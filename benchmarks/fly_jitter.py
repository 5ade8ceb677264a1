"""Fly weld scans over links with delay, jitter and loss: `python benchmarks/fly_jitter.py`.

The check before take-off (run/link_limit.py) compares the mean age of what a link has delivered
with the delay at which the linear attitude loop becomes unstable. Here the check is left out, so
the table shows where the flights saturate.
"""

from __future__ import annotations

import csv
from pathlib import Path

from fly_late_link import SHORT

from skywright.description.loader import load_description
from skywright.models.link_age import compute_mean_age
from skywright.run import planning
from skywright.run.run import fly_and_evaluate

LINKS = (
    (0.004, 0.0, 0.0), (0.004, 0.001, 0.0), (0.002, 0.004, 0.0), (0.004, 0.002, 0.0),
    (0.003, 0.0035, 0.0), (0.0044, 0.0004, 0.0), (0.004, 0.0025, 0.0), (0.0058, 0.0004, 0.0),
    (0.002, 0.005, 0.0), (0.004, 0.003, 0.0), (0.004, 0.004, 0.0), (0.004, 0.0, 0.3),
    (0.0, 0.0, 0.7), (0.004, 0.0, 0.5), (0.0, 0.0, 0.8),
)  # fmt: skip
"""delay_s, jitter_s, loss_fraction"""
SEEDS = (1, 2, 3)
TABLE = Path(__file__).with_name("jitter.csv")


def main() -> None:
    """Fly each link with all seeds; write and print the table."""
    planning.find_exceeded_delay = lambda setup: None
    rows = []
    for delay, jitter, loss in LINKS:
        table = {"delay_s": delay, "jitter_s": jitter, "loss_fraction": loss}
        sets = [*SHORT, *(f"world.link.{key}={value}" for key, value in table.items())]
        sets.append("mission.faults.link_late.limit=100")  # it would slow the loop down and land
        shares = []
        for seed in SEEDS:
            d = load_description("pipe-weld-scan", sets=sets, seed=seed)
            flown = fly_and_evaluate(d).samples
            shares.append(100.0 * float((flown["saturated"] > 0).mean()))
        age = compute_mean_age(d.world.link, 1.0 / d.robot.control.rate_hz)
        found = " ".join(f"{share:.1f}" for share in shares)
        rows.append(
            [f"{1e3 * delay:g}", f"{1e3 * jitter:g}", f"{100 * loss:g}", f"{1e3 * age:.2f}", found]
        )
        print(*rows[-1], sep=", ", flush=True)
    rows.sort(key=lambda row: float(row[3]))
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows(
            [["delay_ms", "jitter_ms", "loss_percent", "age_ms", "saturated_percent"], *rows]
        )


if __name__ == "__main__":
    main()
