"""One tick of the motion of a bar in both hooks: joints that turn it, velocity of the platform.

Compiled by their signatures, before the flight: they run every 20 ms.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import mat_vec, norm
from skywright.core.scratch import local
from skywright.core.user_code import njit
from skywright.missions.bar_insertion.bar_pose import LEAST, MAT, VEC
from skywright.models.arm_inverse_kinematics import ArmChain, solve_arm
from skywright.vehicle.plant import MISSION_TICK

LEAD_RATE = 0.5
"""1/s, at which the bar approaches its goal: half of the platform's own position loop."""
LEAD_SPEED = 0.04  # m/s
JOINT_SPEED = 0.4  # rad/s, of joints that return to their pose


class HookArms(NamedTuple):
    """The arms (left, right) that hold a bar, as arrays."""

    lengths: Array  # (2, 2) m, of upper arm and forearm
    shoulders: Array  # (2, 3) m, in B
    q_min: Array  # (2, 4) rad
    q_max: Array
    near: Array  # (2, 4) rad, joints of the grip, which select the branch
    first: Any  # (2,), indices of the first joints in q


def build_hook_arms(chains: tuple[ArmChain, ArmChain], q: Array) -> HookArms:
    """Return the arms with the joints `q` (n,) rad of their grip."""
    first = np.array([c.first for c in chains])
    return HookArms(
        np.array([[c.upper, c.fore] for c in chains]),
        np.array([c.p_shoulder for c in chains]),
        np.array([c.q_min for c in chains]),
        np.array([c.q_max for c in chains]),
        np.array([q[i : i + 4] for i in first]),
        first,
    )


ARMS = f"{MAT}, {MAT}, {MAT}, {MAT}, {MAT}, int64[::1]"


@njit(f"void({VEC}, {VEC}, float64, {ARMS}, {VEC})", cache=True, error_model="numpy")
def hold_bar(
    n: Any, middle: Any, width: float, lengths: Any, shoulders: Any, q_min: Any, q_max: Any,
    near: Any, first: Any, q: Any,
) -> None:  # fmt: skip
    """Fill joints in q that hold a bar along n (3,), its centre at `middle` (3,) m.

    Both are in a frame at the origin of B with its heading; the hands are `width` (m) apart:
    inverse of (29), (30).
    """
    goal, reached = local(3), local(3)
    half = 0.5 * width / max(norm(n), LEAST)
    for side in range(2):
        for a in range(3):
            goal[a] = middle[a] + half * n[a] - shoulders[side, a]
        i = first[side]
        solve_arm(
            lengths[side, 0], lengths[side, 1], goal, 0.0, near[side], q_min[side], q_max[side],
            q[i : i + 4], reached,
        )  # fmt: skip
        half = -half


@njit(
    f"void({VEC}, {MAT}, {VEC}, float64, {ARMS}, {VEC}, {VEC}, {VEC})",
    cache=True, error_model="numpy",
)  # fmt: skip
def turn_bar(
    turn: Any, R_WB: Any, middle: Any, width: float, lengths: Any, shoulders: Any, q_min: Any,
    q_max: Any, near: Any, first: Any, q_rest: Any, n: Any, q: Any,
) -> None:  # fmt: skip
    """Update the direction n (3,) of the bar by one tick, and the joints q (n,) that hold it.

    n, in a frame with the heading of `R_WB`, follows the error `turn` (3,) in W. The joints move at
    up to JOINT_SPEED to the offset `q_rest` (n,) from the inverse kinematics.
    """
    heading = math.atan2(R_WB[1, 0], R_WB[0, 0])
    c, s = math.cos(heading), math.sin(heading)
    share = MISSION_TICK * LEAD_RATE
    n[0] += share * (c * turn[0] + s * turn[1])
    n[1] += share * (c * turn[1] - s * turn[0])
    n[2] += share * turn[2]
    length = max(norm(n), LEAST)
    for a in range(3):
        n[a] /= length
    goal = np.zeros(len(q))
    hold_bar(n, middle, width, lengths, shoulders, q_min, q_max, near, first, goal)
    most = MISSION_TICK * JOINT_SPEED
    for i in range(len(q)):
        q[i] += min(max(q_rest[i] + goal[i] - q[i], -most), most)


@helper
def _limit(v: Any) -> None:
    """Reduce a velocity v (3,) to LEAD_SPEED."""
    share = min(1.0, LEAD_SPEED / max(norm(v), LEAST))
    for a in range(3):
        v[a] *= share


@njit(f"void({VEC}, {MAT}, {VEC}, {VEC}, {VEC})", cache=True, error_model="numpy")
def find_stretch(p_handle: Any, R_WB: Any, p_WB: Any, middle: Any, away: Any) -> None:
    """Fill `away` (3,) m: from a handle held at `middle` (3,) m in B to its position in W."""
    mat_vec(R_WB, middle, away)
    for a in range(3):
        away[a] = p_handle[a] - away[a] - p_WB[a]


@njit(
    f"void({VEC}, {VEC}, float64, boolean, {VEC}, {VEC})", cache=True, error_model="numpy"
)  # fmt: skip
def lead_platform(error: Any, away: Any, settle: float, in_hole: bool, hang: Any, v: Any) -> None:
    """Fill the platform's velocity v (3,) m/s towards the error (3,) m of the bar.

    `away` (3,) m is the offset of the bar from the arms' pose of the grip, and `hang` its mean
    while the bar is freely suspended, updated by the share `settle`. With `in_hole` the platform
    also follows the bar across.
    """
    for a in range(3):
        v[a] = LEAD_RATE * error[a]
    _limit(v)
    for a in range(2 if in_hole else 0):
        v[a] += LEAD_RATE * (away[a] - hang[a])
    for a in range(3):
        hang[a] += settle * (away[a] - hang[a])
