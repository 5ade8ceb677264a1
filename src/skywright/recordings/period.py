"""Interval between the samples of a recording."""

import numpy as np
from numpy.typing import ArrayLike

GAP = 2.5
"""Intervals longer than this multiple of the median are gaps."""


def compute_period(t: ArrayLike) -> float:
    """Return the mean interval (s) of sample times (n,) s, without gaps; 0 for fewer than two.

    Samples at 100 Hz alternate between 8 and 12 ms if the control period is 4 ms.
    """
    steps = np.diff(np.asarray(t, float))
    if not len(steps):
        return 0.0
    return float(np.mean(steps[steps <= GAP * np.median(steps)]))
