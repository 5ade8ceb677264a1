"""Readings of the built-in sensors: the ports between the plant's sensors and the robot's side.

Units are SI and radians, frames as in bus.py. `t` is the time of the sample, `fresh` 1 if it is new
in this tick (component.py: Output).
"""

from __future__ import annotations

from typing import Annotated

from skywright.core.record import Array, Mat3, Vec3
from skywright.core.types import IMU_BATCH, MAX_JOINTS, MAX_ROTORS
from skywright.vehicle.component import Output


class ImuBatch(Output):
    """Inertial samples that arrived in this tick, oldest first."""

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
    period: float  # s, since the last delivered sample
    p_WB: Vec3
    R_WB: Mat3
    p_WT: Vec3
    axis_W: Vec3  # of the probe


class TargetCapture(Output):
    """Pose of a tracked thing from motion capture."""

    fresh: float
    p_WO: Vec3
    R_WO: Mat3


class DatumImage(Output):
    """Position of the datum mark from the probe's camera."""

    fresh: float
    p_TM: Vec3  # m, from the tip


class Fix(Output):
    """Position of a point of the robot from satellites or a total station."""

    fresh: float
    t: float  # s, by the clock of the instrument
    heading: float  # rad, of B's x axis, by satellites
    p: Vec3  # m, in W


class Odometry(Output):
    """The robot's pose from the tracking camera, in its own scaled frame C."""

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
    """Wrench at a six-axis sensor in the arm: of the outer parts on the inner ones, in its axes."""

    fresh: float
    t: float  # s
    force: Vec3  # N
    torque: Vec3  # N m


class TipForce(Output):
    """The force sensor of a probe."""

    force: float  # N


class Telemetry(Output):
    """Data from the electronics of battery and motors."""

    charge: float  # share of the battery's energy that is left
    speed: Annotated[Array, MAX_ROTORS]  # rad/s, of each rotor
