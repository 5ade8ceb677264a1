"""Ports of the plant's side, which components of the robot's side cannot read."""

from __future__ import annotations

from typing import Annotated

from skywright.core.record import Array, Vec3
from skywright.core.types import MAX_JOINTS, MAX_ROTORS
from skywright.vehicle.component import Output

SAMPLE_RATE = 100.0
"""Hz, of the rows in slots derive, record and peaks."""
MISSION_TICK = 0.02
"""s, period at which missions read the vehicle."""
SETTLE = 2.0
"""s before take-off in which the estimator starts."""


class RotorState(Output):
    """State of the rotors."""

    n: int
    speed: Annotated[Array, MAX_ROTORS]  # rad/s
    thrust: Annotated[Array, MAX_ROTORS]  # N, in free air, of nominal rotors


class RotorGain(Output):
    """Ratio of thrust to thrust in free air, near surfaces."""

    gain: Annotated[Array, MAX_ROTORS]


class Wind(Output):
    """The air around the robot; updated at the end of a tick."""

    varies: int  # 1: the air at each rotor differs from that at the body
    body_W: Vec3  # m/s, at the origin of B
    rotor_W: Annotated[Array, MAX_ROTORS, 3]  # m/s, at every hub; where it varies


class AirForce(Output):
    """Force of the air on the robot, besides thrust."""

    f_W: Vec3  # N


class Surface(Output):
    """The tip relative to the pipe or structure that it must touch."""

    gap: float  # m, of the tip's sphere, negative inside; 1000 where there is no surface
    gap_max: float  # m, since the last sample
    tilt: float  # rad, of the probe's axis from the inward normal
    normal: Vec3  # outward, in W
    s: float  # m, along a pipe's axis
    phi: float  # rad, around it
    c: float  # m, radius times phi


class Docking(Output):
    """The docking feet."""

    f_W: Vec3  # N, force of the structure on them


class JointTruth(Output):
    """The joints of the arm, links' side."""

    q: Annotated[Array, MAX_JOINTS]  # rad
    qd: Annotated[Array, MAX_JOINTS]  # rad/s
