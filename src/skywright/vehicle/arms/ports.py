"""What components of compliant arms exchange on the robot's side.

Units are SI and radians. Frames: W world, B body, A base of the arms (B, or the passive link's that
carries them), M marker. Equation numbers are those of Suarez 2020.
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
    """The arms as the controller believes them: constant, filled when the vehicle is built."""

    dt: float  # s, period of the arms' law
    n_hands: int
    n: int  # joints an arm
    chain: int  # 1: pitch, roll, yaw, elbow, of which inverse kinematics are known
    first: Annotated[Integers, MAX_HANDS]  # index of each arm's first joint in q
    swing: int  # index of the passive joint that carries the arms in q, -1: none
    k: PerJoint  # N m/rad, springs of the joints; 0: rigid
    d: PerJoint  # N m s/rad
    linear: PerJoint  # rad, range of the linear spring; 0: no end
    hardening: PerJoint  # stiffness beyond it over k; a stop counts as 10
    slack: PerJoint  # rad, half the play of the servo's gear, in the deflection
    sensed: PerJoint  # 1: the deflection is measured
    q_min: PerJoint  # rad, of the output links
    q_max: PerJoint
    stall: PerJoint  # N m, of the servos
    servo_tau: float  # s, T_s of (17)
    speed_max: float  # rad/s, of the servos
    upper: float  # m, upper arm
    fore: float  # m, forearm with the hand
    pad: PerHand  # m, from the hand's end back to its ball's centre
    p_BS: HandPoints  # m, shoulders, in B (where a passive link carries them: in that link's frame)


class Joints(Output):
    """Springs of the joints at this tick."""

    deflection: PerJoint  # rad, theta - q: measured, or that of t_gravity
    t_gravity: PerJoint  # N m, torque that the joints carry at rest in free air


class Deflections(Output):
    """Readings of the encoders on the springs."""

    deflection: PerJoint  # rad, shaft minus output link, where it is measured


class Hands(Output):
    """Kinematics of the hands at the servos' rate."""

    p_BH: HandPoints  # m, at the output links
    R_BH: HandFrames
    J_BH: HandJacobians  # m/rad, in B
    J_BP: HandJacobians  # m/rad, of the ball's centre, where forces act
    p_BH_stiff: HandPoints  # m, hands if the joints were rigid: FK(theta)
    p_BA: Vec3  # m, frame A of the arms' base
    R_BA: Mat3
    p_WH: HandPoints  # m, estimated hands
    v_WH: HandPoints  # m/s, of the platform's motion and the joints'
    manipulability: PerHand  # m^2, sin of the elbow times upper times fore


class HandForce(Output):
    """Estimated force of each hand on the touched object."""

    f_WH: HandPoints  # N
    across: float  # 1: the part across the direction of the task means something


class HandState(Output):
    """Commands of the arms' law for the hands."""

    q_goal: PerJoint  # rad, what it would bring the links to in free air, unwound
    p_ref: HandPoints  # m, where the hand would be without contact, in W
    v_ref: HandPoints  # m/s, at which it moves
    task_last: PerHand
    saturated: PerHand  # 1: a limit of angle or workspace holds the hand back
    lever: PerHand  # m, speed of the hand in the task's direction over the joints'
    singular: PerHand  # 1: too near a singularity for that direction
    shift_W: HandPoints  # m, platform move that bends the elbow again
    speed_hand: float  # m/s, v of (23) where the reference gives none


class HandsReference(ReferenceBlock):
    """Tasks of the hands: a block of the reference (see the tasks in core/types.py)."""

    rules: ClassVar[dict[str, int]] = {"task": HOLD, "gamma": HOLD, "delta": HOLD, "tare": HOLD}

    task: PerHand
    p_WH: HandPoints  # m, desired hand position
    v_WH: HandPoints  # m/s
    f_WH: HandPoints  # N, force that the hand shall exert on what it touches
    gamma: PerHand  # weight of force over position in (31)
    load: PerHand  # N, weight that hangs on each hand, fed forward
    tau: PerJoint  # N m, torque that a joint's spring shall carry (18)
    delta: PerJoint  # (22): 1 output position `q`, 0 torque `tau`
    tare: float  # 1: the estimated contact forces of now are called zero


class Floating(FloatingInertia, Output):
    """Response of the platform while a joint swings freely, filled each control tick."""


class Wrench(Output):
    """External wrench on the robot (vehicle/arms/external_wrench.py)."""

    f_hands_W: Vec3  # N, reaction of what the hands press, as their joints measure it
    t_hands_B: Vec3  # N m, about the origin of B
    s_hands: float  # N m, about the joint that swings
    f_rest_W: Vec3  # N, every other external force: wind, payload, errors of the model
    s_rest: float  # N m, external torque about the joint besides that of the hands
    s_slow: float  # N m, the whole external torque, low-passed
    balance_rate: float  # rad/s, at which the angle moves where the link is in balance
    f_swing: float  # N, level force at the hands from the swing angle (Suarez 2020, VI-C)


class MarkerImage(Output):
    """A marker's pose by the onboard camera."""

    fresh: float
    p_BM: Vec3  # m
    R_BM: Mat3


class Marker(Target):
    """Position of the marker that hands move to."""
