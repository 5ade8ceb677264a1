"""Effect of a collision on the platform: `python -m skywright.evidence.impacts`.

Suarez 2020, table 3, calls the compliant and the long-reach arm safer, without a number. Flies
`impact` with stiff joints, compliant joints, at the end of the passive link, and with that link
itself, at several speeds and seeds, and prints the table of docs/papers/suarez-2020.md: means over
the seeds, and the numbers of flights that met the requirements and that a guard ended.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.run.run import fly_and_evaluate

VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "hand, stiff joints": ("bimanual", ("mission.task.joints=stiff",)),
    "hand, compliant joints": ("bimanual", ()),
    "hand, passive link": ("bimanual-longreach", ()),
    "the passive link itself": ("bimanual-longreach", ("mission.task.part=link",)),
}
"""Impacting part -> robot and settings of the mission."""
SPEEDS = (0.3, 0.5, 1.0)  # m/s
COLUMNS = {
    "impact.contact_force_n": "force on pad (N)",
    "impact.peak_force_n": "force on platform (N)",
    "impact.peak_torque_nm": "torque on platform (N m)",
    "impact.recoil_deg": "platform tilt (deg)",
    "impact.swing_deg": "link swing (deg)",
    "impact.deflection_deg": "spring deflection (deg)",
    "impact.impulse_ns": "impulse (N s)",
}
"""Metric -> heading of its column."""


class Row(NamedTuple):
    """One variant at one speed: mean and maximum of each metric over the flights."""

    variant: str
    speed_mps: float
    flights: int
    touched: int
    met: int  # flights that met every requirement
    aborted: int  # flights that a guard ended after the contact: their later peaks are missing
    mean: dict[str, float]
    largest: dict[str, float]


def measure(variant: str, speed: float, seeds: Sequence[int]) -> Row:
    """Fly into the pad once per seed."""
    robot, sets = VARIANTS[variant]
    found, met, aborted = [], 0, 0
    for seed in seeds:
        settings = [*sets, f"mission.task.speed_mps={speed:g}"]
        run = fly_and_evaluate(load_description("impact", robot, sets=settings, seed=seed))
        met += run.outcome == "succeeded"
        aborted += run.outcome == "aborted"
        if "impact.impulse_ns" in run.metrics:
            found.append(run.metrics)
    have = [c for c in COLUMNS if found and all(c in m for m in found)]
    values = {c: [m[c] for m in found] for c in have}
    return Row(
        variant, speed, len(seeds), len(found), met, aborted,
        {c: float(np.mean(v)) for c, v in values.items()},
        {c: float(np.max(v)) for c, v in values.items()},
    )  # fmt: skip


def _write(x: float) -> str:
    return f"{x:.2g}" if x < 99.5 else f"{x:.0f}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m skywright.evidence.impacts")
    parser.add_argument("--seeds", type=int, default=3, help="flights a row")
    parser.add_argument("--speeds", type=float, nargs="+", default=SPEEDS, help="m/s")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    if options.seeds < 1:
        parser.error("--seeds must be at least 1")
    try:
        for speed in options.speeds:
            load_description("impact", sets=[f"mission.task.speed_mps={speed:g}"])
    except InputError as error:
        parser.error(f"--speeds: {error}")
    seeds = range(1, options.seeds + 1)
    if not options.json:
        heads = ["impacting part", "m/s", *COLUMNS.values(), "requirements met", "aborted"]
        print("| " + " | ".join(heads) + " |")
        print("|---" * len(heads) + "|")
    rows = []
    for variant in VARIANTS:
        for speed in options.speeds:
            row = measure(variant, speed, seeds)
            rows.append(row)
            if options.json:
                continue
            cells = [_write(row.mean[c]) if c in row.mean else "" for c in COLUMNS]
            shares = [f"{n}/{row.flights}" for n in (row.met, row.aborted)]
            cells = [variant, f"{speed:.1f}", *cells, *shares]
            print("| " + " | ".join(cells) + " |", flush=True)
    if options.json:
        print(json.dumps({"rows": [row._asdict() for row in rows]}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
