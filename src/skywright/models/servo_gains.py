"""Inertia that an arm's servos drive, and their gains."""

import numpy as np

from skywright.description.robot.arm import Servo
from skywright.description.robot.limbs import list_limbs, list_servos
from skywright.description.robot.spec import Robot
from skywright.models.part_masses import link_com
from skywright.models.rigid_body import find_tip

STIFF_SERVO = 10.0
"""Bandwidth of a position servo's inner loop over 1/T_s (Suarez 2020, 17)."""


def compute_inertia_beyond(robot: Robot, index: int) -> float:
    """Return the inertia (kg m^2) beyond link `index` about its joint, arms stretched.

    For a slide, return the mass (kg) that it moves.
    """
    limbs = list_limbs(robot)
    assert robot.arm is not None
    tip, hand = find_tip(robot, limbs), robot.arm.hand
    sides = {x.side for x in limbs if x.side >= 0}
    ends = [max(n for n, x in enumerate(limbs) if x.side == side) for side in sides]
    slides = limbs[index].link.joint == "slide"
    total = moved = 0.0
    reach = {index: 0.0}  # distance of a link's joint from joint `index`
    for i in range(index, len(limbs)):
        link, parent = limbs[i].link, limbs[i].parent
        if i != index:
            if parent not in reach:
                continue  # a link of another branch
            reach[i] = reach[parent] + float(np.linalg.norm(limbs[i].offset))
        start = reach[i]
        com = 0.5 * link.length_m if link.com_m is None else link.com_m
        if link.has_com_vector:
            com = float(np.linalg.norm(link_com(link)))
        mass = link.mass_kg
        total += link.mass_kg * (link.length_m**2 / 12 + (start + com) ** 2)
        if robot.probe is not None and i == tip:
            middle = start + link.length_m + 0.5 * robot.probe.length_m
            mass += robot.probe.mass_kg
            total += robot.probe.mass_kg * middle**2
        elif i in ends and not (robot.probe is not None and limbs[i].side == limbs[tip].side):
            mass += hand.mass_kg
            total += hand.mass_kg * (start + link.length_m + hand.length_m) ** 2
        moved += mass
    return moved if slides else total


def compute_servo_gains(
    robot: Robot, index: int, servo: Servo | None = None
) -> tuple[float, float]:
    """Return (kp N m/rad, kv N m s/rad) of servo `index`: a PD around the commanded angle.

    `servo` replaces the servo of the robot file, as in the plant.

    The PD is critically damped for the inertia that the motor drives, which is its own if a spring
    carries the link. Velocity servos: bandwidth 1/T, around the integrated command (torque servos:
    while they are stuck). Position servos: ten times faster than T_s; a lag of the rest of T_s
    precedes the command.
    """
    limbs = list_limbs(robot)
    at = next(i for i, limb in enumerate(limbs) if limb.servo == index)
    servo = servo or list_servos(robot)[index][1]
    inertia = servo.armature_kgm2
    if servo.mode != "position":
        inertia += compute_inertia_beyond(robot, at)
        w = 1.0 / servo.velocity_time_constant_s
    else:
        if limbs[at].link.flex_stiffness_nm_per_rad is None:
            inertia += compute_inertia_beyond(robot, at)
        w = STIFF_SERVO / servo.position_time_constant_s
    return inertia * w * w, 2.0 * inertia * w


def compute_servo_lag(servo: Servo) -> float:
    """Return the lag (s) before a position servo's inner loop, whose own lag is 2 / bandwidth;
    their sum is T_s."""
    return servo.position_time_constant_s * (1.0 - 2.0 / STIFF_SERVO)
