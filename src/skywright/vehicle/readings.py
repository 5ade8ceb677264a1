"""What the built-in sensors say: the ports between the plant's sensors and the robot's side.

Units are SI and radians, frames as in bus.py. `t` is when a sample was taken, `fresh` 1 where it is
new in this tick (component.py: Output).
"""

from __future__ import annotations

from typing import Annotated

from skywright.core.record import Array, Mat3, Vec3
from skywright.core.types import IMU_BATCH, MAX_JOINTS, MAX_ROTORS
from skywright.vehicle.component import Output


class ImuBatch(Output):
    """Inertial samples that came in this tick, oldest first."""

    t: float  # s
    n: int
    gyro: Annotated[Array, IMU_BATCH, 3]  # rad/s, in B, mean over a sample's period
    accel: Annotated[Array, IMU_BATCH, 3]  # m/s^2, specific force at the unit, in B


class Shafts(Output):
    """Encoders on the servos' shafts (of passive joints: on the joint)."""

    q: Annotated[Array, MAX_JOINTS]  # rad
    qd: Annotated[Array, MAX_JOINTS]  # rad/s


class MocapSample(Output):
    """Motion capture of the platform and of the probe."""

    fresh: float
    t: float  # s, of the exposure
    period: float  # s, since the last sample that was delivered
    p_WB: Vec3
    R_WB: Mat3
    p_WT: Vec3
    axis_W: Vec3  # of the probe


class TargetCapture(Output):
    """The pose of a tracked thing by motion capture."""

    fresh: float
    p_WO: Vec3
    R_WO: Mat3


class DatumImage(Output):
    """Where the probe's camera sees the datum mark."""

    fresh: float
    p_TM: Vec3  # m, from the tip


class Fix(Output):
    """Where a point of the robot was, by satellites or a total station."""

    fresh: float
    t: float  # s, by the clock of what measured
    heading: float  # rad, of B's x axis, by satellites
    p: Vec3  # m, in W


class Odometry(Output):
    """The robot's pose by the tracking camera, in its own scaled frame C."""

    fresh: float
    t: float  # s
    p: Vec3
    R: Mat3


class Range(Output):
    """Distance below the robot."""

    fresh: float
    t: float  # s
    distance: float  # m


class WrenchSample(Output):
    """What the parts beyond a six-axis sensor in the arm exert on those before it, in its axes."""

    fresh: float
    t: float  # s
    force: Vec3  # N
    torque: Vec3  # N m


class TipForce(Output):
    """The force sensor of a probe."""

    force: float  # N


class Telemetry(Output):
    """What the battery's and the motors' own electronics tell."""

    charge: float  # share of the battery's energy that is left
    speed: Annotated[Array, MAX_ROTORS]  # rad/s, of each rotor
