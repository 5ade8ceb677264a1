"""Rest-to-rest motion: the quintic polynomial of generated reference tables."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROW_PERIOD = 0.02  # s, between rows of a generated table


def quintic(u: Array) -> tuple[Array, Array, Array]:
    """Return s, ds/du, d2s/du2 of the rest-to-rest quintic on u in 0..1."""
    s = u**3 * (10 - 15 * u + 6 * u**2)
    return s, 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u)


def duration(distance: float, speed: float, acceleration: float) -> float:
    """Return the shortest time (s) of a rest-to-rest quintic within a speed and an acceleration."""
    return max(1.875 * distance / speed, math.sqrt(5.7735 * distance / acceleration), ROW_PERIOD)


class Straight(NamedTuple):
    """A rest-to-rest move along a straight line."""

    table: NDArray[Any]  # (n,) of REFERENCE: time, p_WB, v_WB, a_WB filled, the rest as given
    u: Array  # (n,) share of the time
    s: Array  # (n,) share of the distance, then its rates (1/s, 1/s^2)
    ds: Array
    dds: Array


def build_straight(start: Any, end: Any, delta: Array, total: float) -> Straight:
    """Move the REFERENCE row `start` by `delta` (3,) m in `total` s, rounded up to whole rows.

    Rows are copies of `end` except for time, position and its derivatives.
    """
    n = max(math.ceil(total / ROW_PERIOD), 1)
    total = n * ROW_PERIOD
    u = np.linspace(0.0, 1.0, n + 1)
    s, ds, dds = quintic(u)
    table = np.repeat(end[None], n + 1)
    table["t"] = u * total
    table["p_WB"] = start["p_WB"] + s[:, None] * delta
    table["v_WB"] = ds[:, None] * delta / total
    table["a_WB"] = dds[:, None] * delta / total**2
    return Straight(table, u, s, ds / total, dds / total**2)
