"""Pacing by the wall clock, or by a multiple of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

BEHIND_S = 0.5
"""s, default of the largest delay that is caught up."""


class Pace:
    """Waits until the wall clock, times a factor, has reached simulated time."""

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
        behind_s: float = BEHIND_S,
    ) -> None:
        """`behind_s` (s) is the largest delay that is caught up; larger ones are dropped."""
        self._behind_s = behind_s
        self._clock, self._sleep = clock, sleep
        self._start, self._t0, self._factor = 0.0, 0.0, 0.0

    def wait(self, t: float, factor: float) -> None:
        """Wait for simulated time `t` (s) at `factor` of real time; infinite: do not wait."""
        if math.isinf(factor):
            self._factor = factor
            return
        now = self._clock()
        if factor != self._factor or now - self._due(t) > self._behind_s:
            self._start, self._t0, self._factor = now, t, factor
        left = self._due(t) - now
        if left > 0.0:
            self._sleep(left)

    def _due(self, t: float) -> float:
        return self._start + (t - self._t0) / max(self._factor, 1e-9)
