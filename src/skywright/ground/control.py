"""The page in control, and the age of its messages.

One page controls at a time, and others watch. Control is taken explicitly, also from another page.
It is a lease: a page that is silent for LEASE_S loses it. The age of a message comes from its time
stamp, not from its arrival: after a stall of a browser old messages arrive in a burst, and each of
them would appear fresh.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from skywright.links.udp.receiver import Ages
from skywright.run.operator import STILL, Stick

LEASE_S = 2.0
"""s without a message after which control is released."""
LET_GO_S = 0.25
"""s of age beyond which a stick counts as released."""
HOLD_S = 1.0
"""s without a fresh stick after which the robot holds, and the page reports it."""
WINDOW_S = 15.0
"""s; the smallest delay is that of the last 15 to 30 s: clocks drift."""


class Control:
    """The lease of one controller among many watchers."""

    def __init__(self) -> None:
        self.who: str | None = None
        self.seen = -math.inf
        self.seq = -1
        self.ages = Ages(WINDOW_S)

    def take(self, who: str, now: float) -> None:
        """Give control to `who`, also from another page."""
        self.who, self.seen, self.seq, self.ages = who, now, -1, Ages(WINDOW_S)

    def release(self, who: str) -> bool:
        """Release control; return whether `who` had it."""
        if self.who != who:
            return False
        self.who, self.seq = None, -1
        return True

    def hear(self, who: str, now: float) -> bool:
        """Record a message of `who`; return whether it has control."""
        if self.who != who:
            return False
        self.seen = now
        return True

    def forgive(self, late: float) -> None:
        """Extend the lease by a time (s) for which the station itself stalled: messages wait
        unread."""
        self.seen += max(late, 0.0)

    def expire(self, now: float) -> bool:
        """Release control if its holder is silent; return whether that happened."""
        if self.who is None or now - self.seen <= LEASE_S:
            return False
        self.who, self.seq = None, -1
        return True

    def judge(self, who: str, seq: int, stamp: float, now: float) -> float | None:
        """Return the age (s) of a stick message; None if it must be ignored.

        Only a controller's message with an increasing sequence and an age below LET_GO_S counts.
        """
        if self.who != who or seq <= self.seq:
            return None
        self.seq = seq
        age = self.ages.measure(now, stamp)
        return age if age < LET_GO_S else None


class Told(NamedTuple):
    """A stick as sent to the simulation."""

    seq: int
    at: float  # s, time of the stick on the common monotonic clock
    stick: Stick


class StickJudge:
    """Checks sticks again on the robot's side, because the station can stall, too."""

    def __init__(self) -> None:
        self._last: Told | None = None
        self._seq = -1
        self.dropped = 0

    def hear(self, told: Told, now: float) -> bool:
        """Accept a stick; one that is out of order or too old is dropped."""
        if told.seq <= self._seq or not 0.0 <= now - told.at < LET_GO_S:
            self.dropped += 1
            return False
        self._seq, self._last = told.seq, told
        return True

    def forget(self) -> None:
        """Reset the sequence: another page controls."""
        self._last, self._seq = None, -1

    def age(self, now: float) -> float:
        """Age (s) of the last stick; infinite before the first."""
        return math.inf if self._last is None else now - self._last.at

    def read(self, now: float) -> Stick:
        """Return the current stick: zero if it is too old."""
        if self._last is None or self.age(now) >= LET_GO_S:
            return STILL
        return self._last.stick
