"""Working data of the law of compliant arms."""

from __future__ import annotations

from typing import Any, NamedTuple

from skywright.core.record import Record
from skywright.vehicle.arms.ports import PerJoint


class ArmsMemory(Record):
    """Gains and memory of the law."""

    kp_torque: float  # gains of (19) and (21)
    ki_torque: float
    kp_position: float
    ki_position: float
    ki_force: float  # rad/s, of the force loop
    ki_hold: float  # rad/s, of the hand's position while it exerts a force
    theta_ref: PerJoint  # rad, last command
    shaft: PerJoint  # rad, shafts as (17) says of the commands
    wind: PerJoint  # rad, by which shafts lead for the force of a hand
    w_goal: PerJoint  # rad a period, speed of the servos' profiles
    i_torque: PerJoint  # rad, integral part of (19)
    i_position: PerJoint  # rad, of (21)


class ArmsView(NamedTuple):
    """Records of one step of the law (vehicle/arms/ports.py, vehicle/bus.py)."""

    me: Any  # ArmsMemory
    arm: Any  # ArmModel
    joints: Any  # Joints
    hands: Any  # Hands
    force: Any  # HandForce
    marker: Any  # Marker
    tasks: Any  # HandsReference
    ref: Any  # Reference
    est: Any  # Estimate
    shafts: Any  # Shafts
    state: Any  # HandState
    cmd: Any  # ShaftCommand
