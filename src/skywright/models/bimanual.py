"""Two hands as one: bar, squeeze, un-plugging, and an arm as a position sensor.

Suarez 2020, section V-E, (29)-(33). Points are in one common frame, here W (the paper mixes the
frames of earth and arm in (32)).
"""

from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError


class Bar(NamedTuple):
    """Centre p (3,) m and unit direction n (3,), from the right hand to the left."""

    p: Array
    n: Array


def compute_bar(p_left: Array, p_right: Array) -> Bar:
    """Return the bar between two hands: (29), (30); InputError for hands at the same position."""
    between = np.asarray(p_left, dtype=float) - np.asarray(p_right, dtype=float)
    length = float(np.linalg.norm(between))
    if length < 1e-9:
        raise InputError(
            "both hands are at the same position: the direction of the bar is undefined"
        )
    return Bar(0.5 * (np.asarray(p_left) + np.asarray(p_right)), between / length)


def compute_bar_hands(bar: Bar, width: float) -> tuple[Array, Array]:
    """Return the points (left, right) that hold a bar, `width` (m) apart: inverse of (29), (30)."""
    n = np.asarray(bar.n, dtype=float)
    length = float(np.linalg.norm(n))
    if length < 1e-9 or width <= 0.0:
        raise InputError(
            f"a bar requires a direction and a width above 0, got n = {n.tolist()}, width "
            f"= {width:g}"
        )
    half = 0.5 * width * n / length
    return np.asarray(bar.p) + half, np.asarray(bar.p) - half


def compute_squeeze(force: float, p_left: Array, p_right: Array) -> tuple[Array, Array]:
    """Return the forces (N) of (left, right) that squeeze with `force` (N): (32)."""
    n = compute_bar(p_left, p_right).n
    return -force * n, force * n


def is_unplugged(p_grasp: Array, p_hand: Array, threshold: float) -> bool:
    """Whether a hand is more than `threshold` (m) away from its grasp point: (33)."""
    away = np.asarray(p_grasp, dtype=float) - np.asarray(p_hand, dtype=float)
    return float(np.linalg.norm(away)) > threshold


def estimate_platform(p_W_grasp: Array, R_WB: Array, p_BH: Array) -> Array:
    """Return p_WB (3,) m of a platform whose hand holds a fixed point.

    One arm as position sensor: p_WB = p_W_grasp - R_WB FK(q), with the estimated attitude R_WB of
    the platform and p_BH from joint and deflection encoders (`Hands.p_BH`).
    """
    return np.asarray(p_W_grasp) - np.asarray(R_WB) @ np.asarray(p_BH)
