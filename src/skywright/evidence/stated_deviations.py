"""Errors over stated deviations: `python -m skywright.evidence.stated_deviations`.

Flies missions with sensors that are noisier or quieter than their data sheets, with and without
outages of the localisation, and prints the table of docs/howto/estimator-and-link.md. A ratio is
the rms of the position error divided by `p_std`, the deviation that the filter states, over the
axes and flights; 1 is right. The last column compares medians: of the error's size in the outages,
and of the size of Gaussian errors with the stated deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import load_description
from skywright.evidence.command import Command
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.sensors.gnss import SatelliteReceiver
from skywright.vehicle.sensors.mocap import MotionCapture

BEAR = (
    "mission.faults.localisation_stale.on=false",
    "mission.faults.localisation_lost.on=false",
    "mission.timestep_ms=2",
)
HIDDEN = (
    "world.localisation=total-station",
    "world.total_station.blocked_s=[[8,11],[14,17],[20,23],[26,30],[34,37]]",
)
START_S = 3.0  # s; before, the initial state of the filter is a guess
DRAWS = 20  # Gaussian errors per sample


class Silence:
    """Silences a sensor for `quiet` of every `period` (s) in flight, as an observer of the run."""

    def __init__(self, memory: type[Any], name: str, quiet: float, period: float) -> None:
        self.memory, self.name, self.quiet, self.period = memory, name, quiet, period
        self._usual: float | None = None

    def on_plan(self, plan: Any, description: Any) -> None:
        """Nothing to do."""

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        """Silence the sensor."""
        if not self.quiet:
            return
        memory = vehicle.assembly.get(self.memory, self.name)
        if self._usual is None:
            self._usual = float(memory["dropout"])
        quiet = t % self.period < self.quiet and phase not in ("start", "take_off", "land")
        memory["dropout"] = 1.0 if quiet else self._usual

    def close(self) -> None:
        """Nothing to do."""


class Case(NamedTuple):
    """Flights of one mission with one localisation."""

    told: str
    mission: str
    robot: str | None
    sets: tuple[str, ...]
    flights: int
    late: float  # s since the last fix from which it is an outage
    silence: tuple[type[Any], str, float, float] | None = None
    docks: bool = False


CASES = (
    Case("`waypoints`, motion capture, silent for 1.5 s of 5", "waypoints", None, BEAR, 15, 0.25,
         (MotionCapture.Me, "mocap", 1.5, 5.0)),
    Case("`waypoints`, satellites, silent for 2 s of 8", "waypoints", None,
         (*BEAR, "world.localisation=gnss"), 10, 0.6, (SatelliteReceiver.Me, "gnss", 2.0, 8.0)),
    Case("`waypoints`, total station, hidden five times for 3 to 4 s", "waypoints", "f550-bridge",
         HIDDEN, 10, 0.6),
    Case("`bridge-contact`, total station, hidden by the deck", "bridge-contact", None, (), 10, 0.6,
         docks=True),
    Case("`pipe-weld-scan`, motion capture", "pipe-weld-scan", None, (), 3, 0.25),
)  # fmt: skip


class Row(NamedTuple):
    """Ratios of a case; NaN without samples of this kind."""

    view: float
    docked: float
    outage: float
    error_mm: float  # median in outages
    stated_mm: float


def measure(case: Case, seeds: Sequence[int]) -> Row:
    """Fly a case once per seed."""
    rng = np.random.default_rng(0)
    squares: dict[str, list[float]] = {"view": [], "docked": [], "outage": []}
    sizes, drawn = list[NDArray[Any]](), list[NDArray[Any]]()
    for seed in seeds:
        watch = [] if case.silence is None else [Silence(*case.silence)]
        d = load_description(case.mission, case.robot, sets=case.sets, seed=seed)
        r = fly_and_evaluate(d, observers=watch)
        s = r.samples[(r.samples["rotor_thrust"].sum(axis=1) > 0.5) & (r.samples["t"] > START_S)]
        error, std = s["est_p_WB"] - s["p_WB"], s["p_std"]
        over = np.mean((error / std) ** 2, axis=1)
        away = s["fix_age"] > case.late
        held = s["docked"] > 0.5 if case.docks else np.zeros(len(s), bool)
        for name, which in (("view", ~away & ~held), ("docked", ~away & held), ("outage", away)):
            if np.any(which):
                squares[name].append(float(np.mean(over[which])))
        sizes.append(np.linalg.norm(error[away], axis=1))
        shape = (DRAWS, int(np.sum(away)), 3)
        drawn.append(np.linalg.norm(std[away] * rng.standard_normal(shape), axis=2).ravel())
    rms = {k: float(np.sqrt(np.mean(v))) if v else np.nan for k, v in squares.items()}
    size, stated = np.concatenate(sizes), np.concatenate(drawn)
    medians = [1e3 * float(np.median(x)) if len(x) else np.nan for x in (size, stated)]
    return Row(rms["view"], rms["docked"], rms["outage"], *medians)


@click.command("stated_deviations", cls=Command, help=__doc__)
@click.option("--flights", type=click.IntRange(1), help="Flights of each row.")
def main(flights: int | None) -> None:
    """Print the table."""
    print(
        "| flights (number) | in view | in outages | median error in an outage, and its value for "
        "a Gaussian with the stated deviations |\n|---|---|---|---|"
    )
    for case in CASES:
        n = flights or case.flights
        row = measure(case, range(1, n + 1))
        view = f"{row.view:.2f}" + (f"; docked {row.docked:.2f}" if case.docks else "")
        outage, median = "", ""
        if np.isfinite(row.outage):
            outage = f"{row.outage:.2f}"
            median = f"{row.error_mm:.2g} of {row.stated_mm:.2g} mm"
        print(f"| {case.told} ({n}) | {view} | {outage} | {median} |", flush=True)


if __name__ == "__main__":
    main()
