"""The delay of a control link that the attitude loop of a mission tolerates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.errors import InputError
from skywright.models.link_age import compute_mean_age
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, posture
from skywright.models.rotor_reaction import compute_reaction_times
from skywright.run.gyro_limit import compute_strain
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.component import Law
from skywright.vehicle.interface import Backend
from skywright.vehicle.loops import compute_delay_margin
from skywright.vehicle.simulated import SimulatedVehicle

SCALED = (
    "attitude_bandwidth_rad_s", "attitude_integral_rad_s",
    "position_bandwidth_rad_s", "position_integral_rad_s",
)  # fmt: skip
"""Keys that are scaled together, to keep the ratio of position and attitude bandwidths."""
TO_LAND = {"motion_sensitivity": 0.0, "phase_margin_deg": 55.0, "swing_damping": 0.1}
"""Keys of [robot.control] in a landing: no motion sensitivity, and less damping."""
SHARES = np.geomspace(1.0, 0.2, 12)
"""Shares of the bandwidths that are tried if the delay of a link grows."""
SIGMAS = 3.0  # of the gyroscope's noise, that must fit the rotors' margin
SPARE = math.radians(30.0)
"""Phase margin of the slower loop; its damping is then about 0.27."""


def find_exceeded_delay(setup: Setup[Any]) -> str | None:
    """Return a message if the link's delay exceeds what the attitude loop tolerates, or None.

    Laws whose gains account for the delay are not checked.
    """
    d, link = setup.description, setup.description.world.link
    if link.delay_s + link.jitter_s + link.loss_fraction == 0.0:
        return None
    law = build_law(d, setup)
    loop = law.get_attitude_loop(d.robot)
    if loop is None:
        return None
    most = compute_most_delay(setup, law, math.radians(d.mission.link_phase_deg))
    asked = compute_mean_age(link, 1.0 / d.robot.control.rate_hz)
    if asked <= most:
        return None
    return (
        f"the packets of world.link have a mean age of {1000.0 * asked:.1f} ms each way (delay_s, "
        "jitter_s, loss_fraction, the order of packets, the wait for a control tick), more than "
        f"the {1000.0 * most:.1f} ms at which the attitude loop of {d.robot.name!r} has a phase "
        f"margin of {d.mission.link_phase_deg:g} deg (mission.link_phase_deg); "
        f"robot.control.attitude_bandwidth_rad_s = {loop.bandwidth:g} sets that loop, and a lower "
        "one bears more"
    )


def compute_most_delay(nominal: Nominal, law: Law, spare: float = 0.0) -> float:
    """Return the delay (s) each way at which a law keeps `spare` (rad) of phase; NaN if unknown."""
    robot, world = nominal.robot, nominal.world
    period, loop = 1.0 / robot.control.rate_hz, law.get_attitude_loop(robot)
    if loop is None:
        return law.compute_borne_delay(nominal, spare)
    weight = float(nominal.model["mass0"][0] + nominal.model["mass"][0].sum()) * world.gravity_mps2
    reaction = float(np.min(compute_reaction_times(nominal.rotors, nominal.allocator, weight)[:2]))
    # one period of sampling and computing is subtracted; both directions share the rest
    both = compute_delay_margin(loop, nominal.rotors.time_constant, spare, reaction) - period
    return max(0.5 * both, 0.0)


def slow_down(vehicle: Backend, delay: float) -> float | None:
    """Slow a law in flight until it tolerates packets that take `delay` (s) each way.

    `delay` is measured, so it includes the jitter; the loss is that of `[world.link]`. Returns the
    share of the bandwidths, or None if none of SHARES suffices or the law cannot be changed.
    """
    if not isinstance(vehicle, SimulatedVehicle):
        return None
    nominal, law = vehicle.nominal, vehicle.law
    link = nominal.world.link.model_copy(update={"delay_s": delay, "jitter_s": 0.0})
    world = nominal.world.model_copy(update={"link": link})
    age = compute_mean_age(link, 1.0 / nominal.robot.control.rate_hz)
    for share in SHARES:
        told = {k: v for k, v in law.table if v is not None}
        own = {k: TO_LAND.get(k, share * told[k]) for k in (*SCALED, *TO_LAND) if k in told}
        control = nominal.robot.control
        slow = {k: share * getattr(control, k) for k in SCALED}
        control = control.model_copy(update=slow | TO_LAND)
        robot = nominal.robot.model_copy(update={"control": control})
        slower = type(law)(law.name, law.table.model_copy(update=own))
        there = Nominal(robot, world)
        try:
            late = compute_most_delay(there, slower, SPARE) < age
            if late or is_strained(there, slower, SIGMAS):
                continue
            vehicle.tune_law(slower, there)
        except InputError:  # no gains exist for that delay
            continue
        return float(share)
    return None


def is_strained(nominal: Nominal, law: Law, sigmas: float) -> bool:
    """Whether a law answers the gyroscope's noise with more than the rotors have."""
    mass, c, I_B = compute_body(nominal.model, posture(nominal.robot, "working"))
    I_C = I_B - mass * (c @ c * np.eye(3) - np.outer(c, c))
    torque = law.compute_rate_torque(nominal, I_C)
    return torque is not None and compute_strain(nominal, torque).exceeds(sigmas)
