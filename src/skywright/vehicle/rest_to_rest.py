"""Rest-to-rest motion: the quintic that generated reference tables are made of."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROW_PERIOD = 0.02  # s, between rows of a generated table


def quintic(u: Array) -> tuple[Array, Array, Array]:
    """Return s, ds/du, d2s/du2 of the rest-to-rest quintic on u in 0..1."""
    s = u**3 * (10 - 15 * u + 6 * u**2)
    return s, 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u)


def duration(distance: float, speed: float, acceleration: float) -> float:
    """Shortest rest-to-rest quintic time (s) within a speed and an acceleration."""
    return max(1.875 * distance / speed, math.sqrt(5.7735 * distance / acceleration), ROW_PERIOD)
