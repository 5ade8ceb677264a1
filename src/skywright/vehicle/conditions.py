"""Conditions of a command other than the state, checked when it is given."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skywright.description.mission.safety import Fence
from skywright.description.robot.limbs import SIDES, list_grippers
from skywright.errors import InputError
from skywright.vehicle.arms.ports import ArmModel, HandForce, Marker
from skywright.vehicle.commands import Need
from skywright.vehicle.interface import Backend

Array = NDArray[np.float64]

ARM_NEEDS = (
    Need.ARMS, Need.HANDS, Need.FORCE_SENSING, Need.GRASPING, Need.MARKER, Need.TOUCH,
)  # fmt: skip
FELT_N = 0.3  # N, of a hand that rests on something
FRESH_S = 0.5  # s, age of the newest fix with which a robot counts as localised
TILT_MAX, SPEED_SHARE, ROOM = math.radians(40.0), 2.0, 0.2
"""What `recover_from_manual` takes over: tilt (rad), speed over the limit, room below (m)."""


def find_lack(
    need: Need, b: Backend, fence: Fence | None, goal: Array | None, hand: int = 0
) -> str:
    """Return why a condition is not met, "" if it is; `goal` (3,) m is the command's goal."""
    if need == Need.ESTIMATE and not (b.localised and b.fix_age <= FRESH_S):
        age = f"the last position is {b.fix_age:.2f} s old, limit {FRESH_S:g} s"
        return age if b.localised else "the estimator has no position"
    if need == Need.FENCE and fence is not None and goal is not None:
        return fence.explain(goal.tolist())
    if need == Need.FREE_LINK and b.arc is not None and b.estimate["p_WB"][2] < b.arc.top:
        return f"the link is not free of the ground below {b.arc.top:.2f} m"
    if need in ARM_NEEDS:
        return find_arms_lack(need, b, hand)
    return find_unholdable(b) if need == Need.HOLDABLE else ""


def find_arms_lack(need: Need, b: Backend, hand: int = 0) -> str:
    """Return why a condition of the arms is not met, "" if it is."""
    if need == Need.ARMS:
        return "" if "arms" in b.offers else "the vehicle offers no arms"
    if need == Need.GRASPING and list_grippers(b.robot):
        return "" if "gripper" in b.offers else "the back end does not move the gripper"
    if "hands" not in b.offers or not b.look(ArmModel).chain:
        return "the vehicle offers no hands: compliant arms with pitch, roll, yaw and elbow"
    sensed = b.look(ArmModel).sensed[: b.n_joints]
    if need in (Need.FORCE_SENSING, Need.GRASPING) and not np.any(sensed):
        return "no joint measures its deflection (deflection_encoder = true)"
    if need == Need.MARKER:
        try:
            b.look(Marker)
        except InputError:
            return "nothing measures a marker: a camera or motion capture of one is needed"
    if need == Need.TOUCH:
        felt = float(np.linalg.norm(b.look(HandForce).f_WH[hand]))
        if felt < FELT_N:
            return f"the {SIDES[hand]} hand feels {felt:.2f} N, at least {FELT_N:g} N required"
    return ""


def find_unholdable(b: Backend) -> str:
    """Return why the position loops cannot take over from a pilot now, "" where they can."""
    est = b.estimate
    tilt, v = math.acos(min(max(est["R_WB"][2, 2], -1.0), 1.0)), est["v_WB"]
    speed, limit = float(np.linalg.norm(v)), SPEED_SHARE * b.limits.speed
    if tilt > TILT_MAX:
        return f"tilt {math.degrees(tilt):.0f} deg, limit {math.degrees(TILT_MAX):.0f} deg"
    if speed > limit:
        return f"speed {speed:.1f} m/s, limit {limit:.1f} m/s"
    height = float(est["p_WB"][2]) - b.robot.platform.gear_height_m
    braked = 0.5 * speed * max(-float(v[2]), 0.0) / b.limits.acceleration
    if height - braked < ROOM:
        return (
            f"the robot is {height:.2f} m above the ground and needs {braked + ROOM:.2f} m to "
            "brake: land by hand"
        )
    return ""
