"""Comparison of laws that carry the bar: `python -m skywright.evidence.transport_laws`.

Flies the transport with the cascade and with the model inversion of Caballero 2018, in still air,
in steady wind and in gusts, with another wind direction for each seed, and prints the table of
docs/papers/caballero-2018.md. Both laws have the same bandwidths.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import numpy as np

from skywright.description.loader import load_description
from skywright.evidence.command import Command
from skywright.run.run import fly_and_evaluate

SPEED = 3.0  # m/s
CONDITIONS: dict[str, dict[str, Any]] = {
    "still air": {},
    "steady 3 m/s": {"world.wind.kind": "steady", "world.wind.mean_mps": SPEED},
    "Dryden 3 m/s": {"world.wind.kind": "dryden", "world.wind.mean_mps": SPEED},
}
LAWS = ("cascade", "model_inversion")
TURN_DEG = 70.0  # wind direction from one seed to the next; the first eighteen differ


class Row(NamedTuple):
    """One law in one condition: the worst of its flights; rms and energy are means."""

    condition: str
    law: str
    met: int
    flights: int
    tip_max_m: float
    tip_rms_m: float
    swing_max_deg: float
    clearance_min_m: float
    energy_wh: float


def measure(condition: str, law: str, seeds: Sequence[int]) -> Row:
    """Fly the transport once per seed."""
    found, met = [], 0
    for seed in seeds:
        sets = {**CONDITIONS[condition], "mission.law": law}
        if "world.wind.kind" in sets:
            sets["world.wind.toward_deg"] = (TURN_DEG * seed) % 360.0
        run = fly_and_evaluate(load_description("bar-transport", sets=sets, seed=seed))
        met += run.outcome == "succeeded"
        m = run.metrics
        found.append([
            m.get(name, np.nan)
            for name in (
                "tip.tracking_max_m", "tip.tracking_rms_m", "swing.max_deg",
                "transport.clearance_min_m", "transport.energy_wh",
            )
        ])  # fmt: skip
    tip, rms, swing, clearance, energy = np.array(found).T
    return Row(
        condition, law, met, len(seeds), float(np.max(tip)), float(np.sqrt(np.mean(rms**2))),
        float(np.max(swing)), float(np.min(clearance)), float(np.mean(energy)),
    )  # fmt: skip


@click.command("transport-laws", cls=Command, help=__doc__)
@click.option("--seeds", type=click.IntRange(1), default=5)
def main(seeds: int) -> None:
    """Fly everything and print Markdown."""
    print(
        "| condition | law | requirements met | bar's centre, largest error | rms "
        "| largest swing | smallest clearance | energy |\n|---|---|---|---|---|---|---|---|"
    )
    for condition in CONDITIONS:
        for law in LAWS:
            r = measure(condition, law, range(1, seeds + 1))
            print(f"| {condition} | `{law}` | {r.met} of {r.flights} | {100 * r.tip_max_m:.1f} cm "
                  f"| {100 * r.tip_rms_m:.1f} cm | {r.swing_max_deg:.1f} deg "
                  f"| {100 * r.clearance_min_m:.0f} cm | {r.energy_wh:.2f} Wh |",
                  flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
