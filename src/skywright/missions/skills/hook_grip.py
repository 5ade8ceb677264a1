"""Posture in which two arms with hooks hold a handle, and the check of the robots that can."""

import math

import numpy as np

from skywright.core.rotations import rot_y
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.missions.skills.tool_handling import DROP, LOW, Grip
from skywright.models.arm_inverse_kinematics import build_arm_chain, compute_arm_ik, has_arm_chain
from skywright.models.compliant_arms import find_hands, is_compliant
from skywright.models.rigid_body import build_body_model, posture
from skywright.models.things._handled import Handled

FORE = math.radians(65.0)
"""Angle of the forearm from straight down, handle in the cradle: forearm and hook both slope
towards the handle, by 30 and 60 deg, even while the springs deflect by up to 20 deg."""
CLEAR = 0.09  # m, from the landing gear to the handle's axis


def check_hooks(robot: Robot, mission: str) -> None:
    """Raise InputError if a robot does not have two compliant arms with hooks on its platform."""
    check_hands_free(robot, mission)
    if not is_compliant(robot) or not has_arm_chain(robot) or robot.arm is None:
        raise InputError(
            f"robot {robot.name!r} has no compliant arms of pitch, roll, yaw and elbow: "
            f"{mission} requires two, see bimanual"
        )
    if robot.arm.sides != 2 or robot.arm.hand.kind != "hook":
        raise InputError(
            f"robot {robot.name!r} requires two arms with hooks: robot.arm.sides = 2 and "
            "robot.arm.hand.kind = 'hook'"
        )
    if robot.pendulum is not None:
        raise InputError(
            f"robot {robot.name!r} has its arms on a passive joint: a load in front of it "
            f"would swing the link back; {mission} requires arms on the platform, see "
            "bimanual"
        )


def compute_hooks_apart(robot: Robot) -> float:
    """Return the distance (m) of the hooks of a grip, in which both arms hang from the shoulders
    without roll and yaw."""
    left, right = (build_arm_chain(robot, side).p_shoulder for side in range(2))
    return float(left[1] - right[1])


def check_hands_free(robot: Robot, mission: str) -> None:
    """Raise InputError if one of two arms ends in the probe instead of a hand."""
    if robot.probe is not None and robot.arm is not None and robot.arm.sides == 2:
        end = robot.probe.on or "its left arm"
        raise InputError(
            f"robot {robot.name!r} has a probe instead of a hand on {end}: {mission} requires two "
            "hands, so the robot must have no [robot.probe]"
        )


def build_grip(robot: Robot, tool: Handled, gravity: float) -> Grip:
    """Return the grip of the handle of a tool or a bar, which just clears the landing gear."""
    assert robot.arm is not None
    model = build_body_model(robot, gravity)
    chain = build_arm_chain(robot)
    gear = robot.platform.gear_radius_m * math.sqrt(0.5)  # legs at 45 deg
    ahead = gear + CLEAR - float(chain.p_shoulder[0]) - chain.fore * math.sin(FORE)
    lean = math.asin(min(max(ahead / chain.upper, 0.0), 0.9))
    q = posture(robot, "working")
    for side in range(2):
        first = build_arm_chain(robot, side).first
        q[first : first + 4] = [-lean, 0.0, 0.0, lean - FORE]
    hands = find_hands(model, q)
    R = rot_y(-FORE)  # of the forearm, which points along -z at zero angles
    hook, back = R[:, 0], R[:, 2]
    reach = 0.5 * tool.handle_diameter_m + robot.arm.hand.radius_m
    mouth = (hook + back) / math.sqrt(2.0)
    q_low = np.array(q)
    for side in range(2):
        arm = build_arm_chain(robot, side)
        here = slice(arm.first, arm.first + 4)
        found = compute_arm_ik(
            arm, hands[side] - arm.p_shoulder - LOW * mouth + [0.0, 0.0, DROP], near=q[here]
        )
        q_low[here] = found.q
    handle = np.array(tool.list_frames()["handle"].p, dtype=float)
    return Grip(q, q_low, hands, reach * (hook + back), mouth, handle)


def compute_entry(robot: Robot, grip: Grip) -> tuple[float, float]:
    """Return the limits (m) between which hooks can pass beside the handle of a grip.

    First the largest offset beside the handle with which they pass around it on their way up, then
    the height relative to their place (negative) below which their tips do not reach it.
    """
    assert robot.arm is not None
    reach = float(np.linalg.norm(grip.cradle)) / math.sqrt(2.0)  # radii of handle and hook
    R = rot_y(-FORE)
    tip = (robot.arm.hand.hook_length_m - reach) * R[:, 0] - reach * R[:, 2]  # from the handle
    return float(tip[0]) - reach, -float(tip[2]) - reach
