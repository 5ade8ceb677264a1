"""Force command of the robot's own law as shares of the rotors' thrust: option `?force`.

The law runs at its own rate on the autopilot's estimate. Each set-point contains its force but not
its torque, because the autopilot closes the attitude loop.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.description.robot.spec import Control, Robot
from skywright.errors import InputError
from skywright.links.mavlink.link import PERIOD, VehicleLink
from skywright.links.px4.parameters import build_airframe
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.models.rigid_body import posture
from skywright.vehicle.bus import WrenchCommand
from skywright.vehicle.component import Law
from skywright.vehicle.loops import (
    AttitudeGains,
    PositionLoop,
    choose_bandwidths,
    compute_delay_margin,
)

Array = NDArray[np.float64]

SPARE = math.radians(30.0)
"""rad, phase margin of the position loop."""
REPORT_S = 0.02
"""s between the vehicle's reports of its position."""


class BodyForce:
    """The law's force at each tick."""

    def __init__(self, vehicle: Any, link: VehicleLink) -> None:
        """Raises InputError if robot or law have no such force, or if the link is too slow."""
        says = find_forceless(vehicle.robot, vehicle.law, vehicle.world.gravity_mps2)
        if says:
            raise InputError(f"?force: {says}")
        rotors = vehicle.rotors
        self._unit = np.full(3, float(rotors.axis[:, 2] @ rotors.thrust_max))
        """N, force of a share of 1 along each axis of B."""
        if not link.heard.simulated:
            self._unit = build_airframe(vehicle.robot, vehicle.world).force_units
        steps = vehicle.assembly.steps
        mine = [i for i, s in enumerate(steps) if s.component is vehicle.law]
        self.rows = [i for i in mine if steps[i].slot == "control"]
        control = choose_bandwidths(vehicle.law.table, vehicle.nominal)
        self.delay, self.most = measure_delay(link), compute_most(control, rotors.time_constant)
        if not self.delay <= self.most:
            raise InputError(explain(vehicle.robot.name, self.delay, self.most))
        self._command = vehicle.assembly.get(WrenchCommand)

    def compute(self) -> Array:
        """Return the shares (3,) along B of the law's last force."""
        return np.asarray(self._command["f_B"]) / self._unit


def find_forceless(robot: Robot, law: Law, gravity: float) -> str:
    """Return why a robot cannot fly by body forces over MAVLink, or ""."""
    tilt = compute_hover_tilt(robot, posture(robot, "folded"), gravity)
    if not tilt > math.radians(1.0):
        return f"the rotors of {robot.name!r} do not push sideways; fly it without ?force"
    kind = type(law)
    known = issubclass(kind.Me, PositionLoop) or getattr(kind, "follows_bandwidths", False)  # type: ignore[attr-defined]
    if not (kind.needs_full_actuation and known):
        return (
            f"the law {kind.__name__} of {robot.name!r} has no position loop of its own whose "
            "delay is known; fly it without ?force"
        )
    return ""


def measure_delay(link: VehicleLink) -> float:
    """Return the dead time (s) of the loop over a link.

    It is the round trip of a message and its answer, half a period until a position is reported,
    half of one until the next set-point is sent, and half of one while it is held.
    """
    link.wait(lambda h: len(h.round_trips) >= 4, 4.0)
    return link.delay + 0.5 * REPORT_S + PERIOD


def compute_most(control: Control, rotor_tau: float) -> float:
    """Return the dead time (s) at which the position loop keeps the phase margin SPARE."""
    c = control
    loop = AttitudeGains(c.position_bandwidth_rad_s, c.position_damping, c.position_integral_rad_s)
    return compute_delay_margin(loop, rotor_tau, SPARE)


def explain(robot: str, delay: float, most: float) -> str:
    """Return the message that a link is too slow for the position loop."""
    return (
        f"?force: the position loop of {robot!r} keeps a phase margin of "
        f"{math.degrees(SPARE):.0f} deg with a dead time up to {1e3 * most:.0f} ms; this link "
        f"has {1e3 * delay:.0f} ms (round trip, reports and set-points every "
        f"{1e3 * PERIOD:.0f} ms): fly by positions, without ?force, or lower "
        "robot.control.position_bandwidth_rad_s"
    )
