"""Pose of a bar in both hooks, from the hands and from the marker on it (Suarez 2020, (29), (30)).

It runs every 20 ms while a bar is controlled. It is compiled by its signature, before the flight.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import mat_vec, norm
from skywright.core.scratch import local
from skywright.core.user_code import njit

VEC, MAT = "float64[::1]", "float64[:, ::1]"
LEAST = 1e-9  # least divisor: hands at one position give no NaN
OFF = 7
"""Number of correction parameters of the bar's pose: (3,) m of its handle, (3,) of its direction,
and the angle (rad) of its rotation about its own axis."""


class BarPose(NamedTuple):
    """Estimated frame O of the bar (models/things/peg.py)."""

    p: Array  # (3,) m
    R: Array  # (3, 3)


@helper
def _find_pitch(R: Any) -> float:
    """Return the rotation (rad) of a bar R (3, 3) about its own axis, from its level suspension."""
    return math.atan2(-R[2, 0], R[0, 0] * R[1, 1] - R[1, 0] * R[0, 1])


@helper
def _fill_attitude(n: Any, pitch: float, R: Any) -> None:
    """Fill R (3, 3) with the attitude of a bar along n (3,), rotated about it by `pitch` (rad)."""
    length = max(norm(n), LEAST)
    n0, n1, n2 = n[0] / length, n[1] / length, n[2] / length
    across = max(math.sqrt(n0 * n0 + n1 * n1), LEAST)
    x0, x1 = n1 / across, -n0 / across  # horizontal: y cross the vertical
    z0, z1, z2 = x1 * n2, -x0 * n2, x0 * n1 - x1 * n0
    c, s = math.cos(pitch), math.sin(pitch)
    R[0, 0], R[1, 0], R[2, 0] = c * x0 - s * z0, c * x1 - s * z1, -s * z2
    R[0, 1], R[1, 1], R[2, 1] = n0, n1, n2
    R[0, 2], R[1, 2], R[2, 2] = s * x0 + c * z0, s * x1 + c * z1, c * z2


@njit(
    f"void({MAT}, {MAT}, {VEC}, {VEC}, {VEC}, {MAT}, float64, {VEC}, {VEC}, {MAT})",
    cache=True, error_model="numpy",
)  # fmt: skip
def locate_bar(
    hands: Any, R_WB: Any, cradle: Any, handle: Any, p_tool: Any, R_tool: Any, share: float,
    off: Any, p: Any, R: Any,
) -> None:  # fmt: skip
    """Fill p (3,) m and R (3, 3) with the pose of the bar that `hands` (2, 3) m hold.

    (29) and (30) give the middle and the direction of a handle that lies in the cradles, `cradle`
    (3,) m from the hands in a level frame with the heading of `R_WB`. `off` (7,) is the correction
    of this pose. It is updated by `share` of its difference to the marker's measurement: the pose
    `p_tool` (3,) m, `R_tool` (3, 3) of the bar, whose `handle` (3,) m is in frame O.
    """
    n, middle = local(3), local(3)
    heading = math.atan2(R_WB[1, 0], R_WB[0, 0])
    c, s = math.cos(heading), math.sin(heading)
    middle[0], middle[1] = c * cradle[0] - s * cradle[1], s * cradle[0] + c * cradle[1]
    middle[2] = cradle[2]
    for a in range(3):
        n[a] = hands[0, a] - hands[1, a]
        middle[a] += 0.5 * (hands[0, a] + hands[1, a])
    width = max(norm(n), LEAST)
    for a in range(3):
        n[a] /= width
    if share > 0.0:
        mat_vec(R_tool, handle, p)
        for a in range(3):
            off[a] += share * (p_tool[a] + p[a] - middle[a] - off[a])
            off[3 + a] += share * (R_tool[a, 1] - n[a] - off[3 + a])
        off[6] += share * (_find_pitch(R_tool) - off[6])
    for a in range(3):
        n[a] += off[3 + a]
    _fill_attitude(n, off[6], R)
    mat_vec(R, handle, p)
    for a in range(3):
        p[a] = middle[a] + off[a] - p[a]


@njit(
    f"void({VEC}, {VEC}, {VEC}, {VEC}, {VEC}, {MAT}, float64, {VEC}, {VEC}, {VEC})",
    cache=True, error_model="numpy",
)  # fmt: skip
def average_error(
    p_goal: Any, n_goal: Any, point_O: Any, handle: Any, p: Any, R: Any, share: float,
    error: Any, turn: Any, p_handle: Any,
) -> None:  # fmt: skip
    """Update the filtered errors of a bar at p (3,) m, R (3, 3) relative to its goal.

    A first-order filter with the gain `share` applies to `error` (3,) m from the bar's `point_O`
    (3,) m to `p_goal` (3,) m, `turn` (3,) from its direction to `n_goal` (3,), and the position
    `p_handle` (3,) m of its `handle`.
    """
    point, held = local(3), local(3)  # from frame O, in W
    mat_vec(R, point_O, point)
    mat_vec(R, handle, held)
    for a in range(3):
        error[a] += share * (p_goal[a] - p[a] - point[a] - error[a])
        turn[a] += share * (n_goal[a] - R[a, 1] - turn[a])
        p_handle[a] += share * (p[a] + held[a] - p_handle[a])


def build_attitude(n: Array, pitch: float) -> Array:
    """Return R_WO (3, 3) of a bar along n (3,), rotated about it by `pitch` (rad)."""
    R = np.empty((3, 3))
    _fill_attitude(n, pitch, R)
    return R
