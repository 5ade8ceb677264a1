"""The links of a robot as one list: passive link, then the arm, or both arms of a mirrored pair.

A robot file describes one arm. With `arm.sides = 2` the right one is its mirror image in the plane
y = 0: offsets change the sign of y, joints about x and z that of their angles.
"""

from __future__ import annotations

from typing import NamedTuple

from skywright.description.robot.arm import Link, Servo
from skywright.description.robot.spec import Robot

SIDES = ("left", "right")


class Limb(NamedTuple):
    """One link of the tree; parents come before their children."""

    name: str  # the link's name; "left_" or "right_" before it where there are two arms
    link: Link  # mirrored on the right side
    parent: int  # index into the list, -1: the platform
    offset: tuple[float, float, float]  # m, its joint in the parent's frame
    side: int  # hand that it leads to: 0 left or only, 1 right, -1 both (the passive link)
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
        # the shoulders sit at the end of the passive link; the mount's height is on the platform
        mount = (end[0], mount[1], end[2])
    servo = 0
    for side in range(arm.sides):
        sign = -1.0 if side else 1.0
        prefix = f"{SIDES[side]}_" if arm.sides == 2 else ""
        spread = 0.5 * arm.separation_m if arm.sides == 2 else 0.0
        first = len(out)
        names = list(arm.links)
        for i, (name, given) in enumerate(arm.links.items()):
            link = _mirror(given) if side else given
            if side and arm.encoders == "left":
                link = link.model_copy(update={"deflection_encoder": False})
            parent_name = given.parent or (names[i - 1] if i else "platform")
            if parent_name == "platform":
                parent, default = base, (mount[0], mount[1] + spread, mount[2])
            else:
                parent = first + names.index(parent_name)
                default = end_of(arm.links[parent_name])
            at = [
                d if g is None else g
                for d, g in zip(default, (given.x_m, given.y_m, given.z_m), strict=True)
            ]
            driven = link.joint != "fixed" and not link.passive
            out.append(
                Limb(
                    prefix + name, link, parent, (at[0], sign * at[1], at[2]), side,
                    servo if driven else -1,
                )
            )  # fmt: skip
            servo += driven
    return out


def list_joints(robot: Robot) -> list[Limb]:
    """Return the links whose joint moves, in the order of q."""
    return [limb for limb in list_limbs(robot) if limb.link.joint != "fixed"]


def list_servos(robot: Robot) -> list[tuple[str, Servo]]:
    """Return (name, servo) of every servo, in the order of their joints."""
    if robot.arm is None:
        return []
    servos = robot.arm.servos
    if robot.arm.sides == 1:
        return list(servos.items())
    return [(f"{side}_{name}", servo) for side in SIDES for name, servo in servos.items()]


def takes_torque(robot: Robot) -> bool:
    """Whether the arm's servos take torques."""
    return any(servo.mode == "torque" for _, servo in list_servos(robot))


def end_of(link: Link) -> tuple[float, float, float]:
    """Return the end of a link (m) in its own frame."""
    return (link.length_m, 0.0, 0.0) if link.along == "x" else (0.0, 0.0, -link.length_m)


def _mirror(link: Link) -> Link:
    """Return the mirror image in the plane y = 0 of a link's joint."""
    if link.axis == "y" or link.joint == "slide":
        return link
    return link.model_copy(
        update={
            "joint_min_deg": -link.joint_max_deg,
            "joint_max_deg": -link.joint_min_deg,
            "folded_deg": -link.folded_deg,
            "working_deg": -link.working_deg,
        }
    )
