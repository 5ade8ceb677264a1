"""Frames of MAVLink messages: the world NED (x north, y east, z down), the body FRD.

Inside the package W is ENU and B is FLU; only messages use NED and FRD.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_from_rot, rot_from_quat
from skywright.models.vectors import compute_cross

Array = NDArray[np.float64]

NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Its own inverse."""
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])
"""Its own inverse."""
GLOBAL_FRAMES, RELATIVE_FRAMES = (0, 5), (3, 6)
"""MAV_FRAME with altitudes above sea level, and above home. Others, such as above the terrain, are
refused."""


def swap_world(v: Array) -> Array:
    """Convert a vector (3,) from W to NED, or back."""
    return np.array([v[1], v[0], -v[2]])


def swap_body(v: Array) -> Array:
    """Convert a vector (3,) from B (FLU) to FRD, or back."""
    return np.array([v[0], -v[1], -v[2]])


def to_ned_quaternion(R_WB: Array) -> Array:
    """Return the attitude (4,) wxyz of FRD in NED."""
    return quat_from_rot(NED_FROM_ENU @ R_WB @ FRD_FROM_FLU)


def from_ned_quaternion(q: Array) -> Array | None:
    """Return R_WB of a quaternion (4,) wxyz of FRD in NED; None if it is no rotation."""
    size = float(np.linalg.norm(q))
    if not 0.9 < size < 1.1:
        return None
    return np.asarray(NED_FROM_ENU @ rot_from_quat(np.asarray(q) / size) @ FRD_FROM_FLU)


def swap_heading(yaw: float) -> float:
    """Convert a heading (rad) from north clockwise to one from east counter-clockwise, or back."""
    return math.remainder(0.5 * math.pi - yaw, 2.0 * math.pi)


def find_heading(R_WB: Array) -> float:
    """Return the heading (rad) in W of an attitude."""
    return math.atan2(R_WB[1, 0], R_WB[0, 0])


def find_height(altitude: float, frame: int | None, sea_level: float, home: float) -> float:
    """Return the height z (m) in W of an altitude (m) in a MAV_FRAME.

    `sea_level` (m) is the altitude of the origin of W, `home` (m) the height z of home in W.
    """
    return home + altitude if frame in RELATIVE_FRAMES else altitude - sea_level


def move_point(p: Array, v: Array, R_WB: Array, w_WB_B: Array, r_B: Array) -> tuple[Array, Array]:
    """Return position (3,) m and velocity (3,) m/s in W of another point of the same body.

    The other point is r_B (3,) m, in B, away from the one with position p and velocity v.
    """
    return p + R_WB @ r_B, v + R_WB @ compute_cross(w_WB_B, r_B)
