"""Waiting in tests: for a condition, or by a clock that the test itself moves."""

from __future__ import annotations

import time
from collections.abc import Callable


def wait_for(what: Callable[[], object], seconds: float = 300.0, every: float = 0.02) -> None:
    """Poll every `every` seconds until `what` is true; fail the test after `seconds`.

    The limit only ends a test that would hang: a loaded machine, or code that must be compiled
    first, may take minutes.
    """
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, f"waited {seconds:g} s in vain"
        time.sleep(every)


class Clock:
    """Stands in for the module `time`: it moves when somebody sleeps, however busy the machine.

    `then` is called after each sleep with the time (s) since the clock was made.
    """

    def __init__(self, then: Callable[[float], None] = lambda t: None) -> None:
        self.t, self.then = 0.0, then

    def perf_counter(self) -> float:
        return 1000.0 + self.t

    def sleep(self, seconds: float) -> None:
        self.t += seconds
        self.then(self.t)
