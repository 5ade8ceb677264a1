"""Errors of each estimator: `python -m skywright.evidence.estimators`.

Flies the weld scan with the filter, the observer and the truth itself, in good and in degraded
conditions of motion capture and link, and prints the table of docs/howto/estimator-and-link.md.
"""

from collections.abc import Sequence
from typing import NamedTuple

import click
import numpy as np

from skywright.description.loader import load_description
from skywright.description.map_error import KEYS
from skywright.evidence.command import Command
from skywright.run.run import fly_and_evaluate

CONDITIONS: dict[str, tuple[str, ...]] = {
    "as in the world file, 100 Hz": (),
    "30 Hz, link 4 ms and 1 ms jitter": (
        "world.mocap.rate_hz=30", "world.link.delay_s=0.004", "world.link.jitter_s=0.001",
    ),
    "half of the samples missing": ("world.mocap.dropout_fraction=0.5",),
    "2 % artefacts up to 2 m": ("world.mocap.outlier_fraction=0.02",),
}  # fmt: skip
ESTIMATORS = ("filter", "observer", "truth")
TRUTH_IN = next(iter(CONDITIONS))  # the truth does not depend on motion capture
START = 4.0  # s, errors count from here


class Row(NamedTuple):
    """One estimator in one condition; errors are rms values over the completed flights."""

    condition: str
    estimator: str
    met: int
    lost: int  # flights that did not finish
    flights: int
    position_mm: float
    velocity_mmps: float
    tip_mm: float


def measure(condition: str, estimator: str, seeds: Sequence[int]) -> Row:
    """Fly the weld scan once per seed."""
    squares, met = [], 0
    exact = [f"plant.{key}=0" for key in KEYS]  # no survey
    sets = [*exact, *CONDITIONS[condition], f"mission.estimator={estimator}"]
    for seed in seeds:
        run = fly_and_evaluate(load_description("pipe-weld-scan", sets=sets, seed=seed))
        met += run.outcome == "succeeded"
        if run.outcome not in ("succeeded", "failed"):
            continue
        s = run.samples[run.samples["t"] > START]
        squares.append([
            np.mean(np.sum((s["est_p_WB"] - s["p_WB"]) ** 2, axis=1)),
            np.mean(np.sum((s["est_v_WB"] - s["v_WB"]) ** 2, axis=1)),
            1e-6 * run.metrics["tip.tangential_rms_mm"] ** 2,
        ])  # fmt: skip
    rms = 1e3 * np.sqrt(np.mean(squares, axis=0)) if squares else np.full(3, np.nan)
    lost = len(seeds) - len(squares)
    return Row(condition, estimator, met, lost, len(seeds), *(float(x) for x in rms))


def measure_all(condition: str, seeds: Sequence[int]) -> list[Row]:
    """Measure every estimator in a condition; the truth only once, as motion capture has no
    effect."""
    names = [e for e in ESTIMATORS if e != "truth" or condition == TRUTH_IN]
    return [measure(condition, estimator, seeds) for estimator in names]


@click.command("estimators", cls=Command, help=__doc__)
@click.option("--seeds", type=click.IntRange(1), default=3)
def main(seeds: int) -> None:
    """Fly everything and print Markdown."""
    print("| condition | estimator | requirements | position error | velocity error "
          "| tip along the surface |\n|---|---|---|---|---|---|")  # fmt: skip
    for condition in CONDITIONS:
        for row in measure_all(condition, range(1, seeds + 1)):
            errors = (
                f"{row.position_mm:.2f} mm | {row.velocity_mmps:.0f} mm/s | {row.tip_mm:.1f} mm"
                if row.lost < row.flights
                else "lost control | | "
            )
            print(f"| {condition} | {row.estimator} | {row.met} of {row.flights} | {errors} |",
                  flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
