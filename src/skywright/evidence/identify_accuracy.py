"""Accuracy of an identification: `python -m skywright.evidence.identify_accuracy`.

Flies `excitation` with the default deviations of the plant, identifies the robot with its true
mass, and compares with the parameters of the simulated plant. Prints the first table of
docs/howto/identify.md: the largest error and the largest half of the interval over the flights.
With `--lags` it prints the second one: lags of the rotors from flights of other missions. A flight
that turns too little is refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import click

import skywright
from skywright.analysis.identify.identify import Identification, identify
from skywright.analysis.identify.truth import compute_truth
from skywright.description.loader import Description
from skywright.errors import InputError, SimulationError
from skywright.evidence.command import Command
from skywright.models.rigid_body import posture

EXCITED = {
    "f550-bridge": ['mission.task.poses=["folded"]'],
    "hexarotor": ["mission.task.acceleration_mps2=1.5"],
}
"""Robot -> settings of `excitation`."""
FLOWN = (
    ("hexarotor", "waypoints", None, (1, 2, 3)),
    ("hexarotor", "waypoints", 0.03, (1,)),
    ("hexarotor", "waypoints", 0.1, (1,)),
    ("othex", "waypoints", None, (1, 2)),
    ("othex", "pipe-weld-scan", None, (1,)),
    ("othex", "waypoints", 0.045, (1,)),
    ("f550-bridge", "waypoints", None, (1, 2)),
    ("f550-scan", "waypoints", None, (1, 2)),
)
"""Robot, mission, lag of the rotors (s) in place of the file's, seeds."""


class Quantity(NamedTuple):
    """Parameters of a fit that share a row; errors are divided by the true value if `share`."""

    told: str
    names: tuple[str, ...]
    share: bool


QUANTITIES = (
    Quantity("rotor gains", tuple(f"rotor_gain_{i}" for i in range(1, 7)), True),
    Quantity("centre of mass, x and y", ("pose_1.com_x_m", "pose_1.com_y_m"), False),
    Quantity("centre of mass, z", ("pose_1.com_z_m",), False),
    Quantity(
        "inertia about x and y", ("pose_1.inertia_xx_kgm2", "pose_1.inertia_yy_kgm2"), True
    ),
    Quantity("inertia about z", ("pose_1.inertia_zz_kgm2",), True),
    Quantity("rotors' drag coefficient", ("drag_coefficient_n_per_rads_mps",), True),
    Quantity("C_D A of the body", tuple(f"drag_area_{a}_m2" for a in "xyz"), True),
)  # fmt: skip


def fly(
    mission: str, robot: str, sets: Sequence[str], seed: int
) -> tuple[Description, Identification]:
    """Fly a mission, and identify the robot with its true mass."""
    d = skywright.load(mission, robot=robot, sets=list(sets), seed=seed)
    with TemporaryDirectory() as folder:
        out = Path(folder) / "flown"
        if skywright.run(d, out=out, report=False).outcome not in ("succeeded", "failed"):
            raise SimulationError(f"{mission}, {robot}, seed {seed}: the flight was not completed")
        mass = compute_truth(d, posture(d.robot, "folded")[None])[1]
        return d, identify([out], None, mass)


def compare(quantity: Quantity, flights: list[tuple[Description, Identification]]) -> str:
    """Return the two cells of a quantity: largest error, largest half of the interval."""
    error, half, known = 0.0, 0.0, False
    for d, found in flights:
        true = compute_truth(d, found.poses)[0]
        for e in found.fit.estimates:
            name = e.parameter.name
            if name in quantity.names and e.identified:
                size = abs(true[name]) if quantity.share else 1e-3
                error, half = (
                    max(error, abs(e.value - true[name]) / size),
                    max(half, e.half_width / size),
                )
                known = True
    if not known:
        return "not identified | "
    unit, scale = ("%", 100.0) if quantity.share else ("mm", 1.0)
    return " | ".join(f"{scale * x:.1f} {unit}" for x in (error, half))


def compare_lags(flights: list[tuple[Description, Identification]]) -> str:
    """Return the two cells of the rotors' lag."""
    true = 1e3 * flights[0][0].robot.rotors.time_constant_s
    lags = [f.rotor_lag for _, f in flights if f.rotor_lag is not None and f.rotor_lag.identified]
    if len(lags) < len(flights):
        return "not identified | "
    error = max(abs(1e3 * lag.lag - true) for lag in lags)
    return f"{error:.2f} ms of {true:g} ms | {1e3 * max(lag.half_lag for lag in lags):.1f} ms"


def print_accuracy(seeds: Sequence[int]) -> None:
    """Print the table of the excited flights."""
    flights = {
        robot: [fly("excitation", robot, sets, seed) for seed in seeds]
        for robot, sets in EXCITED.items()
    }
    heads = [f"`{robot}`: error | half of the interval" for robot in flights]
    print(f"| parameter | {' | '.join(heads)} |\n|---|{2 * len(flights) * '---|'}")
    for quantity in QUANTITIES:
        print(f"| {quantity.told} | {' | '.join(compare(quantity, f) for f in flights.values())} |")
    print(f"| rotors' lag | {' | '.join(compare_lags(f) for f in flights.values())} |")


def print_lags() -> None:
    """Print the table of lags from flights with less motion."""
    print("| robot | mission | seeds | true lag | identified |\n|---|---|---|---|---|")
    for robot, mission, given, seeds in FLOWN:
        told, true = [], math.nan
        for seed in seeds:
            sets = [] if given is None else [f"robot.rotors.time_constant_s={given}"]
            true = 1e3 * skywright.load_robot(robot).rotors.time_constant_s
            true = true if given is None else 1e3 * given
            try:
                lag = fly(mission, robot, sets, seed)[1].rotor_lag
            except InputError:  # it turns too little
                told.append("refused")
                continue
            if lag is not None and lag.identified:
                told.append(f"{1e3 * lag.lag:.1f} ± {1e3 * lag.half_lag:.1f} ms")
            else:
                told.append("not identified")
        which = ", ".join(map(str, seeds))
        row = f"`{robot}` | `{mission}` | {which} | {true:g} ms | {', '.join(told)}"
        print(f"| {row} |", flush=True)


@click.command("identify_accuracy", cls=Command, help=__doc__)
@click.option("--lags", is_flag=True, help="Print the lags of flights with less motion.")
@click.option("--seeds", type=click.IntRange(1), default=5, help="Excited flights of each robot.")
def main(lags: bool, seeds: int) -> None:
    """Print a table."""
    if lags:
        print_lags()
    else:
        print_accuracy(range(2, 2 + seeds))


if __name__ == "__main__":
    main()
