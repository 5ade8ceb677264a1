"""Records of the robot as a rigid body: link tree, kinematics at given joint angles, composite
body."""

from typing import Annotated

from skywright.core.record import Array, Integers, Mat3, Record, Vec3
from skywright.core.types import MAX_HANDS, MAX_JOINTS

MAX_LINKS = 12

Links = Annotated[Integers, MAX_LINKS]


class BodyModel(Record):
    """The link tree of a robot."""

    n_links: int
    n_joints: int
    gravity: float
    mass0: float  # kg, platform
    com0: Vec3  # m, in B
    inertia0: Mat3  # kg m^2 about the origin of B
    parent: Links  # link index, -1 for the platform
    joint: Links  # index into q, -1 when fixed
    slide: Links
    axis: Links  # 0 x, 1 y, 2 z of the link frame
    offset: Annotated[Array, MAX_LINKS, 3]  # m, joint in the parent's frame
    turn: Annotated[Array, MAX_LINKS, 3, 3]  # R_PL, joint at zero
    mass: Annotated[Array, MAX_LINKS]
    com: Annotated[Array, MAX_LINKS, 3]
    inertia: Annotated[Array, MAX_LINKS, 3, 3]  # kg m^2 about the link's own com
    tip_link: int  # -1: no arm, the tip is the origin of B
    tip_offset: Vec3
    tip_rot: Mat3  # R_LT
    n_hands: int  # ends of arms; hand 0 is the tip unless the probe is elsewhere
    hand_link: Annotated[Integers, MAX_HANDS]
    hand_offset: Annotated[Array, MAX_HANDS, 3]
    hand_rot: Annotated[Array, MAX_HANDS, 3, 3]  # R_LH
    q_min: Annotated[Array, MAX_JOINTS]
    q_max: Annotated[Array, MAX_JOINTS]
    belt: Annotated[Array, MAX_JOINTS, MAX_JOINTS]  # J_AM: joint = belt * motor speeds
    belt_inv: Annotated[Array, MAX_JOINTS, MAX_JOINTS]
    motor_speed_max: Annotated[Array, MAX_JOINTS]


class Kinematics(Record):
    """The kinematics of the link tree at given joint angles."""

    p: Annotated[Array, MAX_LINKS, 3]  # m, joint origins in B
    R: Annotated[Array, MAX_LINKS, 3, 3]
    p_BT: Vec3
    R_BT: Mat3
    J_BT: Annotated[Array, 3, MAX_JOINTS]  # m/rad, in B
    Jw_BT: Annotated[Array, 3, MAX_JOINTS]  # rad/rad, in B
    p_BH: Annotated[Array, MAX_HANDS, 3]  # m, hands in B (`fill_hands`)
    R_BH: Annotated[Array, MAX_HANDS, 3, 3]
    J_BH: Annotated[Array, MAX_HANDS, 3, MAX_JOINTS]  # m/rad, in B


class Body(Record):
    """The nominal rigid body at the estimated configuration; it contains no plant data."""

    mass: float  # kg, whole robot
    gravity: float  # m/s^2, positive down
    p_BC: Vec3  # m, whole-robot centre of mass in B
    I_B: Mat3  # kg m^2, composite inertia about the origin of B
    p_BT: Vec3  # m, tip in B (without probe and arm: the origin)
    R_BT: Mat3
    J_BT: Annotated[Array, 3, MAX_JOINTS]  # m/rad, tip position Jacobian in B
    n_joints: int
