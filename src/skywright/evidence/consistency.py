"""Consistency of the filter: `python -m skywright.evidence.consistency`.

Flies a mission with many seeds and compares the filter's errors with its covariance: the squared
error in units of the covariance (NEES) is chi-square distributed if the filter is consistent
(Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section
5.4). For N independent runs, N times their average is chi-square with 15 N degrees of freedom at
each instant. The whitened innovations should have unit variance and no correlation.
"""

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import numpy as np
from scipy.stats import chi2

from skywright.core.arrays import Array
from skywright.core.record import View
from skywright.core.rotations import log_so3
from skywright.description.loader import load_description
from skywright.evidence.command import Command
from skywright.run.planning import MissionPlan
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.estimators._strapdown import head_covariance
from skywright.vehicle.sensors.inertial import Inertial

EVERY = 10  # mission ticks between values: 0.2 s
START = 3.0  # s; before, the filter's initial velocity is a guess
PARTS = {
    "all": slice(0, 15),
    "position": slice(0, 3),
    "velocity": slice(3, 6),
    "attitude": slice(6, 9),
    "gyroscope bias": slice(9, 12),
    "accelerometer bias": slice(12, 15),
}


class Trace(NamedTuple):
    """One flight: errors (n, 15), covariances (n, 15, 15), whitened innovations (m, 6)."""

    t: Array
    error: Array
    covariance: Array
    innovation: Array


class Watcher:
    """Collects the filter's errors during a mission (an evaluation.run.Observer)."""

    def __init__(self) -> None:
        self._t: list[float] = []
        self._error: list[Array] = []
        self._covariance: list[Array] = []
        self._innovation: list[Array] = []
        self._ticks, self._fused = 0, 0

    def on_plan(self, plan: MissionPlan, description: Any) -> None:
        """Do nothing."""

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        """Compare state and covariance with the truth of the same tick."""
        flt = vehicle.read_memory("estimator")
        if flt["ready"] < 2.0 or t < START:
            return
        if flt["fused"] != self._fused:
            self._fused = int(flt["fused"])
            self._innovation.append(flt["nu"].copy())
        self._ticks += 1
        if self._ticks % EVERY == 0:
            P = np.empty((15, 15))
            head_covariance(View(flt), vehicle.world.gravity_mps2, P)
            self._t.append(t)
            self._error.append(compute_error(vehicle))
            self._covariance.append(P)

    def close(self) -> None:
        """Do nothing."""

    def trace(self) -> Trace:
        """Return the collected values."""
        return Trace(
            np.array(self._t), np.array(self._error), np.array(self._covariance),
            np.array(self._innovation),
        )  # fmt: skip


def compute_error(vehicle: Any) -> Array:
    """Return the error (15,), truth minus estimate, of the filter's state; attitude error in W."""
    flt, pl, im = vehicle.read_memory("estimator"), vehicle.read(Truth), vehicle.find(Inertial)
    R, lever = pl["R_WB"], flt["p_BI"]
    out = np.empty(15)
    out[0:3] = pl["p_WB"] + R @ lever - flt["p"]
    out[3:6] = pl["v_WB"] + R @ np.cross(pl["w_WB_B"], lever) - flt["v"]
    log_so3(np.ascontiguousarray(R @ flt["R"].T), out[6:9])
    # the filter does not have the samples since the start of the tick yet
    waiting = int(vehicle.read_memory(im.name)["n"])
    bias = im.read_bias(max(int(vehicle.read(Clock)["fast"]) - 1 - waiting, 0))
    out[9:12], out[12:15] = bias[:3] - flt["bg"], bias[3:] - flt["ba"]
    return out


def compute_nees(trace: Trace, part: slice) -> Array:
    """Return the normalised squared error (n,) of a part of the state."""
    e, P = trace.error[:, part], trace.covariance[:, part, part]
    return np.asarray(np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0]))


def fly_traces(mission: str, sets: Sequence[str], seeds: Sequence[int]) -> list[Trace]:
    """Fly a mission once per seed. Raises InputError and InfeasibleError as a run does."""
    out = []
    for seed in seeds:
        watcher = Watcher()
        fly_and_evaluate(load_description(mission, sets=sets, seed=seed), observers=[watcher])
        out.append(watcher.trace())
    return out


class Consistency(NamedTuple):
    """Result for one part of the state over all runs."""

    mean: float  # NEES over degrees of freedom; 1 is consistent
    low: float  # bounds of the average over the runs at one instant, 95 %
    high: float
    inside: float  # fraction of instants within them


def compute_consistency(traces: list[Trace], part: slice) -> Consistency:
    """Average the NEES over the runs at each instant."""
    n = min(len(t.t) for t in traces)
    nees = np.mean([compute_nees(t, part)[:n] for t in traces], axis=0)
    dof = part.stop - part.start
    low, high = chi2.ppf([0.025, 0.975], dof * len(traces)) / len(traces)
    inside = float(np.mean((nees > low) & (nees < high)))
    return Consistency(float(np.mean(nees)) / dof, low / dof, high / dof, inside)


def compute_whiteness(traces: list[Trace]) -> tuple[Array, Array]:
    """Return variance and correlation of successive whitened innovations, (6,) each."""
    nu = [t.innovation for t in traces]
    variance = np.mean([np.mean(x**2, axis=0) for x in nu], axis=0)
    memory = np.mean([np.mean(x[1:] * x[:-1], axis=0) for x in nu], axis=0) / variance
    return variance, memory


@click.command("consistency", cls=Command, help=__doc__)
@click.argument("mission", default="pipe-weld-scan")
@click.option("--seeds", type=click.IntRange(1), default=20)
@click.option("--set", "sets", multiple=True, metavar="KEY=VALUE")
def main(mission: str, seeds: int, sets: tuple[str, ...]) -> None:
    """Fly and print a table; the exit code is 1 if the whole state is not consistent."""
    traces = fly_traces(mission, sets, range(1, seeds + 1))
    print(f"{mission}, {seeds} seeds, {min(len(t.t) for t in traces)} instants each\n")
    print("| part | NEES / n | 95 % bounds | instants inside |\n|---|---|---|---|")
    for name, part in PARTS.items():
        c = compute_consistency(traces, part)
        told = "whole state (15)" if name == "all" else name
        print(f"| {told} | {c.mean:.3f} | {c.low:.3f} to {c.high:.3f} | {100 * c.inside:.0f} % |")
    variance, memory = compute_whiteness(traces)
    print("\ninnovations, variance   ", np.round(variance, 3))
    print("innovations, correlation", np.round(memory, 3))
    c = compute_consistency(traces, PARTS["all"])
    sys.exit(not c.low < c.mean < c.high)


if __name__ == "__main__":
    main()
