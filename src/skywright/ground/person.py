"""A person at a stick: simulated time follows the wall clock."""

from __future__ import annotations

import time

import numpy as np

from skywright.run.operator import STILL, Sight, Stick

STALE_S = 0.5  # s of wall time without a message after which the stick counts as released
PATIENCE_S = 60.0
"""s of wall time without a message after which the operator counts as absent. Time for which the
flight stood still, such as a pause, does not count."""


class Person:
    """A person at a stick: simulated time waits for the wall clock."""

    stale_s = STALE_S

    def __init__(self) -> None:
        self._start = 0.0  # wall time at which the operator took over
        self._heard = -np.inf  # wall time
        self._present = -np.inf  # wall time, moved on with the flight's pauses
        self._stick = STILL

    def read(self, t: float, sight: Sight) -> Stick | None:
        """Wait until the wall clock reaches `t`; return the stick, zero if released or lost."""
        now = time.perf_counter()
        if t == 0.0:
            if not self.begin():
                return None
            self._start = self._present = now = time.perf_counter()
        late = now - self._start - t
        if late > STALE_S:  # the computer is slower, or the view was paused
            self._start += late
            self._present += late
        elif late < 0.0:
            time.sleep(-late)
        self.listen()
        now = time.perf_counter()
        self._present = max(self._present, self._heard)
        if now - self._present > PATIENCE_S:
            return None
        return self._stick if now - self._heard < self.stale_s else STILL

    def hear(self, stick: Stick) -> None:
        """Store the current stick."""
        self._stick, self._heard = stick, time.perf_counter()

    def begin(self) -> bool:
        """Ask the operator to take over; return whether an operator is present."""
        return True

    def listen(self) -> None:
        """Store the messages received since the last call."""

    def close(self) -> None:
        """Stop listening."""
