"""The links of a robot as one list: passive link, then the arm, or both arms of a mirrored pair.

A robot file describes one arm. With `arm.sides = 2` the right one is its mirror image in the plane
y = 0: offsets change the sign of y, joints about x and z the sign of their angles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.description.robot.arm import Link, Servo
from skywright.description.robot.spec import Robot

SIDES = ("left", "right")


class Limb(NamedTuple):
    """One link of the tree; parents come before their children."""

    name: str  # the link's name, with the prefix "left_" or "right_" for two arms
    link: Link  # mirrored on the right side
    parent: int  # index into the list, -1: the platform
    offset: tuple[float, float, float]  # m, its joint in the parent's frame
    side: int  # its arm: 0 left or only, 1 right, -1 both (the passive link)
    servo: int  # index into `list_servos`, -1: fixed or passive


def list_limbs(robot: Robot) -> list[Limb]:
    """Return all links, parents first; empty without an arm."""
    arm, out = robot.arm, []
    if arm is None:
        return []
    base = -1
    mount = (arm.mount_x_m, arm.mount_y_m, arm.mount_z_m)
    if robot.pendulum is not None:
        link = robot.pendulum
        place = (link.x_m or 0.0, link.y_m or 0.0, link.z_m or 0.0)
        out.append(Limb("pendulum", link, -1, place, -1, -1))
        base, end = 0, end_of(link)
        # the shoulders are at the end of the passive link; the mount's height is on the platform
        mount = (end[0], mount[1], end[2])
    servo = 0
    for side, links in enumerate(arm.chains):
        sign = -1.0 if side else 1.0
        prefix = f"{SIDES[side]}_" if arm.sides == 2 else ""
        spread = 0.5 * arm.separation_m if arm.sides == 2 else 0.0
        first = len(out)
        names = list(links)
        for i, (name, given) in enumerate(links.items()):
            mirrored = bool(side) and given.side == "both"
            link = _mirror(given) if mirrored else given
            if side and arm.encoders == "left":
                link = link.model_copy(update={"deflection_encoder": False})
            parent_name = given.parent or (names[i - 1] if i else "platform")
            if parent_name == "platform":
                parent, default = base, (mount[0], sign * (mount[1] + spread), mount[2])
            else:
                parent = first + names.index(parent_name)
                default = end_of(links[parent_name])
            flip = sign if mirrored else 1.0
            place = (
                default[0] if given.x_m is None else given.x_m,
                default[1] if given.y_m is None else flip * given.y_m,
                default[2] if given.z_m is None else given.z_m,
            )
            driven = link.joint != "fixed" and not link.passive
            out.append(Limb(prefix + name, link, parent, place, side, servo if driven else -1))
            servo += driven
    return out


def list_way(limbs: list[Limb], i: int) -> list[int]:
    """Return the indices of link `i` and of the links that carry it, back to the platform."""
    out = []
    while i >= 0:
        out.append(i)
        i = limbs[i].parent
    return out


def list_joints(robot: Robot) -> list[Limb]:
    """Return the links with a movable joint, in the order of q."""
    return [limb for limb in list_limbs(robot) if limb.link.joint != "fixed"]


def list_servos(robot: Robot) -> list[tuple[str, Servo]]:
    """Return (name, servo) of every servo, in the order of their joints."""
    if robot.arm is None:
        return []
    servos = robot.arm.servos
    if robot.arm.sides == 1:
        return list(servos.items())
    return [
        (f"{side}_{name}", servo)
        for side in SIDES
        for name, servo in servos.items()
        if servo.side in ("both", side)
    ]


def list_grippers(robot: Robot) -> list[str]:
    """Return the hands that are grippers; an arm may end in the probe instead."""
    if robot.arm is None or robot.arm.hand.kind != "gripper":
        return []
    sides = {limb.name: limb.side for limb in list_limbs(robot)}
    probed = -1 if robot.probe is None else sides.get(robot.probe.on or "", 0)
    return [SIDES[side] for side in range(robot.arm.sides) if side != probed]


def takes_torque(robot: Robot) -> bool:
    """Return whether the arm's servos are commanded by torques."""
    return any(servo.mode == "torque" for _, servo in list_servos(robot))


def turn_of(link: Link) -> NDArray[np.float64]:
    """Return R_PL (3, 3): the link's frame in its parent's, with the joint at zero."""
    if not link.is_turned:
        return np.eye(3)
    roll, pitch, yaw = (math.radians(x) for x in (link.roll_deg, link.pitch_deg, link.yaw_deg))
    return rot_z(yaw) @ rot_y(pitch) @ rot_x(roll)


def end_of(link: Link) -> tuple[float, float, float]:
    """Return the end of a link (m) in its own frame."""
    return (link.length_m, 0.0, 0.0) if link.along == "x" else (0.0, 0.0, -link.length_m)


def _mirror(link: Link) -> Link:
    """Return the mirror image in the plane y = 0 of a link and its joint."""
    update: dict[str, float | None] = {
        name: -getattr(link, name)
        for name in ("roll_deg", "yaw_deg", "com_y_m", "inertia_xy_kgm2", "inertia_yz_kgm2")
        if getattr(link, name)
    }
    if (link.joint == "slide") == (link.axis == "y"):
        update |= _flip(link, "m" if link.joint == "slide" else "deg")
    return link.model_copy(update=update) if update else link


def _flip(link: Link, unit: str) -> dict[str, float | None]:
    """Return the joint's limits and postures with the opposite sign."""
    ends = {"joint_min": "joint_max", "joint_max": "joint_min"}
    return {
        f"{name}_{unit}": -getattr(link, f"{ends.get(name, name)}_{unit}")
        for name in ("joint_min", "joint_max", "folded", "working")
    }
