"""The force that the robot's own law asks for, as shares of the rotors' thrust: `?force`.

The law runs at its own rate on the autopilot's estimate. Its force goes out with each set-point;
its torque does not, because the autopilot closes the attitude loop.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.links.mavlink.link import PERIOD, VehicleLink
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.models.rigid_body import posture
from skywright.vehicle.bus import WrenchCommand
from skywright.vehicle.component import AttitudeGains
from skywright.vehicle.loops import compute_delay_margin

Array = NDArray[np.float64]

SPARE = math.radians(30.0)
"""rad of phase that the position loop keeps."""
REPORT_S = 0.02
"""s between the vehicle's reports of its position."""


class BodyForce:
    """The law's force, tick by tick."""

    def __init__(self, vehicle: Any, link: VehicleLink) -> None:
        """Raises InputError where the rotors push no way but up, or the link is too slow."""
        robot = vehicle.robot
        gravity = vehicle.world.gravity_mps2
        tilt = compute_hover_tilt(robot, posture(robot, "folded"), gravity)
        if not tilt > math.radians(1.0):
            raise InputError(
                f"mavlink:URL?force: the rotors of {robot.name!r} do not push sideways; fly it by "
                "positions, without ?force"
            )
        self._v = vehicle
        rotors = vehicle.rotors
        self._unit = float(rotors.axis[:, 2] @ rotors.thrust_max)  # N, of a share of 1
        if not link.heard.simulated and "MPC_THR_HOVER" not in link.heard.parameters:
            raise InputError("mavlink:URL?force: the vehicle tells no MPC_THR_HOVER")
        law = [i for i, s in enumerate(vehicle.assembly.steps) if s.component is vehicle.law]
        self.rows = [i for i in law if vehicle.assembly.steps[i].slot == "control"]
        self.delay, self.most = measure_delay(link), compute_most(robot, rotors.time_constant)
        if not self.delay <= self.most:
            raise InputError(explain(robot, self.delay, self.most))
        self._command = vehicle.assembly.get(WrenchCommand)

    def compute(self) -> Array:
        """Return the shares (3,) along B of the force that the law asked for last."""
        return np.asarray(self._command["f_B"]) / self._unit


def measure_delay(link: VehicleLink) -> float:
    """Return the dead time (s) of the loop over a link.

    A message and its answer take the round trip; half a period goes by until a position is
    reported, half of one until the next set-point goes out, and half of one while it is held.
    """
    link.wait(lambda h: len(h.round_trips) >= 4, 4.0)
    return link.delay + 0.5 * REPORT_S + PERIOD


def compute_most(robot: Any, rotor_tau: float) -> float:
    """Return the dead time (s) with which the position loop keeps SPARE of phase."""
    c = robot.control
    loop = AttitudeGains(c.position_bandwidth_rad_s, c.position_damping, c.position_integral_rad_s)
    return compute_delay_margin(loop, rotor_tau, SPARE)


def explain(robot: Any, delay: float, most: float) -> str:
    """Say that a link is too slow for the position loop."""
    return (
        f"mavlink:URL?force: the position loop of {robot.name!r} keeps a phase margin of "
        f"{math.degrees(SPARE):.0f} deg with a dead time up to {1e3 * most:.0f} ms; this link "
        f"has {1e3 * delay:.0f} ms (round trip, reports and set-points every "
        f"{1e3 * PERIOD:.0f} ms): fly by positions, without ?force, or lower "
        "robot.control.position_bandwidth_rad_s"
    )
