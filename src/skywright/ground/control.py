"""Who controls, and how old what the controller sends is.

One page controls at a time, and others watch. Control is taken explicitly, also from another page.
It is a lease: a page that is not heard for LEASE_S loses it. The age of a message comes from the
time stamp inside it, not from its arrival: after a stall of a browser old messages arrive in a
burst, and each of them would look fresh.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from skywright.run.operator import STILL, Stick

LEASE_S = 2.0
"""s without a word after which control falls free."""
LET_GO_S = 0.25
"""s of age from which a stick counts as let go."""
HOLD_S = 1.0
"""s without a fresh stick after which the robot holds, and the page says so."""
FORGET_S = 30.0
"""s within which the smallest delay counts: clocks drift."""


class Age:
    """Age (s) of stamped messages by the smallest delay seen; two clocks need not agree."""

    def __init__(self) -> None:
        self._least: list[tuple[float, float]] = []  # (arrival, delay), both rising

    def take(self, stamp: float, arrival: float) -> float:
        """Return the age of a message with `stamp` (s, sender's clock) at `arrival` (s, ours)."""
        delay = arrival - stamp
        least = [(t, d) for t, d in self._least if arrival - t <= FORGET_S and d < delay]
        self._least = [*least, (arrival, delay)][-64:]
        return delay - self._least[0][1]


class Control:
    """The lease of one controller among many watchers."""

    def __init__(self) -> None:
        self.who: str | None = None
        self.seen = -math.inf
        self.seq = -1
        self.age = Age()

    def take(self, who: str, now: float) -> None:
        """Give control to `who`, whoever had it."""
        self.who, self.seen, self.seq, self.age = who, now, -1, Age()

    def release(self, who: str) -> bool:
        """Let go of control; returns whether `who` had it."""
        if self.who != who:
            return False
        self.who, self.seq = None, -1
        return True

    def hear(self, who: str, now: float) -> bool:
        """Note that `who` is there; returns whether it has control."""
        if self.who != who:
            return False
        self.seen = now
        return True

    def forgive(self, late: float) -> None:
        """Take off a time (s) for which the station itself stood: what came then waits unread."""
        self.seen += max(late, 0.0)

    def expire(self, now: float) -> bool:
        """Let control fall free where its holder is silent; returns whether it did."""
        if self.who is None or now - self.seen <= LEASE_S:
            return False
        self.who, self.seq = None, -1
        return True

    def judge(self, who: str, seq: int, stamp: float, now: float) -> float | None:
        """Return the age (s) of a stick's message; None where it must not be followed.

        Followed is a controller's message whose sequence grows and that is younger than LET_GO_S.
        """
        if self.who != who or seq <= self.seq:
            return None
        self.seq = seq
        age = self.age.take(stamp, now)
        return age if age < LET_GO_S else None


class Told(NamedTuple):
    """A stick as the simulation was told it."""

    seq: int
    at: float  # s, the common monotonic clock, when it was true
    stick: Stick


class StickJudge:
    """Judges sticks again where the robot is: the station can stall as well."""

    def __init__(self) -> None:
        self._last: Told | None = None
        self._seq = -1
        self.dropped = 0

    def hear(self, told: Told, now: float) -> bool:
        """Take a stick; one that is out of order or too old is dropped."""
        if told.seq <= self._seq or not 0.0 <= now - told.at < LET_GO_S:
            self.dropped += 1
            return False
        self._seq, self._last = told.seq, told
        return True

    def forget(self) -> None:
        """Another page controls: its sequence begins anew."""
        self._last, self._seq = None, -1

    def age(self, now: float) -> float:
        """Age (s) of what was heard last; infinite before."""
        return math.inf if self._last is None else now - self._last.at

    def read(self, now: float) -> Stick:
        """Return the stick now: at rest once it is too old."""
        if self._last is None or self.age(now) >= LET_GO_S:
            return STILL
        return self._last.stick
