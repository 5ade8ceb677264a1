"""Ports that the robot-side components of compliant arms exchange.

Units are SI and radians. Frames: W world, B body, A base of the arms (B, or the frame of the
passive link that carries them), M marker. Equation numbers are those of Suarez 2020.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

from skywright.core.record import Array, Integers, Mat3, Vec3
from skywright.core.types import HOLD, MAX_HANDS, MAX_JOINTS
from skywright.models.floating import FloatingInertia
from skywright.vehicle.component import Output, ReferenceBlock
from skywright.vehicle.targets import Target

PerJoint = Annotated[Array, MAX_JOINTS]
PerHand = Annotated[Array, MAX_HANDS]
HandPoints = Annotated[Array, MAX_HANDS, 3]
HandFrames = Annotated[Array, MAX_HANDS, 3, 3]
HandJacobians = Annotated[Array, MAX_HANDS, 3, MAX_JOINTS]


class ArmModel(Output):
    """The controller's model of the arms: constant, filled when the vehicle is built."""

    dt: float  # s, period of the arms' law
    n_hands: int
    n: int  # joints an arm
    chain: int  # 1: pitch, roll, yaw, elbow, which have closed-form inverse kinematics
    first: Annotated[Integers, MAX_HANDS]  # index of each arm's first joint in q
    swing: int  # index of the passive joint that carries the arms in q, -1: none
    k: PerJoint  # N m/rad, springs of the joints; 0: rigid
    d: PerJoint  # N m s/rad
    linear: PerJoint  # rad, range of the linear spring; 0: unlimited
    hardening: PerJoint  # stiffness beyond it over k; a stop counts as 10
    slack: PerJoint  # rad, half the play of the servo's gear, part of the deflection
    sensed: PerJoint  # 1: the deflection is measured
    q_min: PerJoint  # rad, of the output links
    q_max: PerJoint
    stall: PerJoint  # N m, of the servos
    servo_tau: float  # s, T_s of (17)
    speed_max: float  # rad/s, of the servos
    upper: float  # m, upper arm
    fore: float  # m, forearm with the hand
    pad: PerHand  # m, from the hand's end back to its ball's centre
    p_BS: HandPoints  # m, shoulders, in B, or in the frame of the passive link that carries them


class Joints(Output):
    """Springs of the joints."""

    deflection: PerJoint  # rad, theta - q: measured, or that of t_gravity
    t_gravity: PerJoint  # N m, torque that the joints carry at rest in free air


class Deflections(Output):
    """Readings of the encoders on the springs."""

    deflection: PerJoint  # rad, shaft minus output link, of joints with an encoder


class Hands(Output):
    """Kinematics of the hands at the servos' rate."""

    p_BH: HandPoints  # m, for the angles of the output links
    R_BH: HandFrames
    J_BH: HandJacobians  # m/rad, in B
    J_BP: HandJacobians  # m/rad, of the ball's centre, where forces act
    p_BH_stiff: HandPoints  # m, hands with rigid joints: FK(theta)
    p_BA: Vec3  # m, frame A of the arms' base
    R_BA: Mat3
    p_WH: HandPoints  # m, estimated hands
    v_WH: HandPoints  # m/s, from the motion of the platform and of the joints
    manipulability: PerHand  # m^2, sin(elbow) * upper * fore


class HandForce(Output):
    """Estimated force of each hand on the touched object."""

    f_WH: HandPoints  # N
    across: float  # 1: the component transverse to the task's direction is valid


class HandState(Output):
    """Commands of the arms' law for the hands."""

    q_goal: PerJoint  # rad, link angles that the command gives in free air, without winding
    p_ref: HandPoints  # m, commanded hand position without contact, in W
    v_ref: HandPoints  # m/s, its velocity
    task_last: PerHand
    saturated: PerHand  # 1: a limit of angle or workspace clips the command
    lever: PerHand  # m, hand speed in the task's direction over joint speed
    singular: PerHand  # 1: too near a singularity for that direction
    shift_W: HandPoints  # m, platform displacement that bends the elbow to 90 deg
    speed_hand: float  # m/s, v of (23) if the reference gives none


class HandsReference(ReferenceBlock):
    """Tasks of the hands: a block of the reference (see the tasks in core/types.py)."""

    rules: ClassVar[dict[str, int]] = {"task": HOLD, "gamma": HOLD, "delta": HOLD, "tare": HOLD}

    task: PerHand
    p_WH: HandPoints  # m, desired hand position
    v_WH: HandPoints  # m/s
    f_WH: HandPoints  # N, desired force of the hand on the touched object
    gamma: PerHand  # weight of force over position in (31)
    load: PerHand  # N, weight that hangs on each hand, fed forward
    tau: PerJoint  # N m, desired torque of a joint's spring (18)
    delta: PerJoint  # (22): 1 output position `q`, 0 torque `tau`
    tare: float  # 1: average the estimated contact forces and subtract them from now on


class Floating(FloatingInertia, Output):
    """Response of the platform with a freely swinging joint, filled each control tick."""


class Wrench(Output):
    """External wrench on the robot (vehicle/arms/external_wrench.py)."""

    f_hands_W: Vec3  # N, reaction to the forces of the hands, measured at their joints
    t_hands_B: Vec3  # N m, about the origin of B
    s_hands: float  # N m, about the joint that swings
    f_rest_W: Vec3  # N, all other external forces: wind, payload, errors of the model
    s_rest: float  # N m, external torque about the joint, without that of the hands
    s_slow: float  # N m, the total external torque, low-passed
    balance_rate: float  # rad/s, rate of the equilibrium angle of the link
    f_swing: float  # N, horizontal force at the hands from the swing angle (Suarez 2020, VI-C)


class MarkerImage(Output):
    """A marker's pose by the onboard camera."""

    fresh: float
    p_BM: Vec3  # m
    R_BM: Mat3


class Marker(Target):
    """Position of the marker that hands move to."""
