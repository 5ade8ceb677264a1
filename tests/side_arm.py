"""A robot whose arm's first link reaches its propellers."""

from __future__ import annotations

from skywright.description.robot.arm import Arm
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot


def build_side_arm(folded_deg: float = 90.0) -> Robot:
    """A hexarotor with an arm of one long link beside its hub, below two propellers."""
    link = {"length_m": 0.5, "mass_kg": 0.1, "joint_min_deg": -180.0, "joint_max_deg": 180.0}
    link |= {"folded_deg": folded_deg, "working_deg": 90.0}
    arm = {
        "mount_y_m": 0.16, "mount_z_m": -0.12, "links": {"link1": link},
        "servos": {"servo1": {"stall_torque_nm": 3.0, "no_load_speed_rad_s": 4.0}},
    }  # fmt: skip
    return load_robot("hexarotor")[0].model_copy(update={"arm": Arm.model_validate(arm)})
