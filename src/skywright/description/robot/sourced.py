"""Numbers of a robot that need a source: those that state something about this robot."""

from __future__ import annotations

import re

from skywright.core.keys import iterate_leaves
from skywright.core.spec import Source
from skywright.core.toml_files import iterate_numbers
from skywright.description.robot.limbs import list_servos
from skywright.description.robot.spec import Robot

NEUTRAL = re.compile(
    r"robot\.(platform|pendulum|arm\.links\.\w+|arm\.\w+)"
    r"\.((roll|pitch|yaw)_deg|(folded|working)_m|inertia_(xy|xz|yz)_kgm2)"
)
"""Keys whose zero states nothing: frames that are not turned, slides that are none, principal
axes."""


def list_needing_source(robot: Robot) -> list[str]:
    """Return the dotted keys of all numbers that state something about this robot."""
    return [
        key
        for key, value in iterate_leaves(robot, "robot")
        if value is not None
        and not isinstance(value, str | bool)
        and list(iterate_numbers(value))
        and applies(robot, key)
        and not (value == 0.0 and NEUTRAL.match(key))
    ]


def list_unsourced(robot: Robot, sources: dict[str, Source]) -> list[str]:
    """Return the dotted keys of the numbers that need a source and have none."""
    return [key for key in list_needing_source(robot) if key not in sources]


def applies(robot: Robot, key: str) -> bool:
    """Whether a number states something about this robot, such as a key of a part that it has."""
    part, _, leaf = key.rpartition(".")
    name = part.rpartition(".")[2]
    arm = robot.arm
    if leaf in ("loop_separation", "phase_margin_deg", "swing_damping"):
        return robot.control.law == "cascade"
    if leaf == "motion_sensitivity":  # off
        return False
    if leaf == "drag_coefficient":
        return arm is not None and arm.drag_coefficient > 0.0
    if leaf in ("torque_bandwidth_rad_s", "deflection_bandwidth_rad_s", "hand_speed_max_mps"):
        return any(servo.mode == "position" for _, servo in list_servos(robot))
    if arm is None or part.startswith("robot.control"):
        return not key.startswith("robot.control.law")
    if part == "robot.arm":
        return arm.sides == 2 if leaf == "separation_m" else leaf not in ("sides", "mount_y_m")
    if part == "robot.arm.hand":
        hand = arm.hand
        if leaf in ("pivot_m", "open_deg", "closed_deg"):
            return hand.kind == "gripper" and hand.finger == "turn"
        if leaf in ("stroke_m", "grip_speed_mps", "grip_force_n"):
            return hand.kind == "gripper"
        return hand.mass_kg > 0.0 and not (hand.kind == "ball" and "hook" in leaf)
    if name in arm.servos:
        other = {"velocity": ("position_", "command_", "resolution_", "backlash_"),
                 "position": ("velocity_",),
                 "torque": ("position_", "command_", "resolution_", "backlash_")}  # fmt: skip
        if leaf == "friction_nm" and arm.servos[name].friction_nm == 0.0:
            return False
        return not leaf.startswith(other[arm.servos[name].mode])
    link = robot.pendulum if part == "robot.pendulum" else arm.links.get(name)
    if link is None:
        return True
    if leaf.startswith("lateral_"):
        return link.lateral_stiffness_nm_per_rad is not None
    if leaf in ("damping_nms_per_rad", "friction_nm"):
        return link.passive
    if leaf.startswith("flex_"):
        ratio = leaf == "flex_damping_ratio" and link.flex_damping_nms_per_rad is not None
        hard = leaf == "flex_hardening" and link.flex_linear_deg is None
        return link.flex_stiffness_nm_per_rad is not None and not ratio and not hard
    return True
