"""Ports of the plant's side of compliant arms; the robot's side sees none."""

from __future__ import annotations

from skywright.core.record import Vec3
from skywright.vehicle.arms.ports import HandFrames, HandPoints, PerJoint
from skywright.vehicle.component import Output


class HandTruth(Output):
    """The hands now."""

    p_WH: HandPoints  # m
    R_WH: HandFrames
    f_WH: HandPoints  # N, force that each hand exerts on what it touches


class TapePull(Output):
    """Tension of a tape on a hand."""

    hand: int
    pull: float  # N
    normal_W: Vec3  # direction of pressing


class ServoState(Output):
    """State of a position servo: its command, and its progress towards it."""

    held: PerJoint  # rad
    now: PerJoint  # rad


class SpringTruth(Output):
    """Shafts and springs of the joints."""

    theta: PerJoint  # rad, servo shafts
    deflection: PerJoint  # rad, theta - q
