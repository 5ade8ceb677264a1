"""Plant-side ports of compliant arms; no robot-side component reads them."""

from __future__ import annotations

from skywright.core.record import Vec3
from skywright.vehicle.arms.ports import HandFrames, HandPoints, PerJoint
from skywright.vehicle.component import Output


class HandTruth(Output):
    """True state of the hands."""

    p_WH: HandPoints  # m
    R_WH: HandFrames
    f_WH: HandPoints  # N, force of each hand on the touched object


class TapePull(Output):
    """Tension of a tape on a hand."""

    hand: int
    pull: float  # N
    normal_W: Vec3  # direction of pressing


class ServoState(Output):
    """State of the position servos: command and present angle."""

    held: PerJoint  # rad
    now: PerJoint  # rad


class SpringTruth(Output):
    """Shafts and springs of the joints."""

    theta: PerJoint  # rad, servo shafts
    deflection: PerJoint  # rad, theta - q
