"""Filter for decoded packets: order, age, and counts of dropped ones.

The two clocks need not agree. The age of a packet is (arrival - stamp) less the smallest (arrival -
stamp) of the last minute: the delay beyond the shortest one. Old minima are discarded because
clocks drift; a constant delay that lasts longer than that is not detected.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import NamedTuple

from skywright.links.udp.codec import Packet, Rejected, decode

WINDOW_S = 30.0  # s; the minimum covers the last 30 to 60 s

CAUSES = {
    "oversized": "longer than the longest packet",
    "short": "shorter than header and tag",
    "magic": "does not begin with SKYW",
    "version": "of another version of the table",
    "kind": "of an unknown kind, or of one that goes the other way",
    "size": "its length is not that of its kind",
    "tag": "tampered with, or sealed with another key",
    "value": "holds a number that is not finite or out of range",
    "session": "of another session, or of a sender who has none",
    "replayed": "its sequence number or its time does not grow",
    "old": "older than its kind may be",
    "controller": "another sender is in control",
}
"""Cause of a dropped datagram -> description."""


class Arrived(NamedTuple):
    """An accepted packet."""

    packet: Packet
    age: float  # s, at arrival
    arrival: float  # s, by the receiver's clock


class Ages:
    """Ages of packets by their stamps."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self.window_s = window_s
        self._until = -math.inf
        self._before = self._now = math.inf  # smallest differences of two windows

    def measure(self, arrival: float, stamp: float) -> float:
        """Return the age (s) of a packet that arrives at `arrival` with `stamp` (s)."""
        if arrival >= self._until:
            skipped = arrival >= self._until + self.window_s
            self._before = math.inf if skipped else self._now
            self._now, self._until = math.inf, arrival + self.window_s
        self._now = min(self._now, arrival - stamp)
        return arrival - stamp - min(self._now, self._before)


class Receiver:
    """Filter for one sender: packets must be new and in order, by kind."""

    def __init__(self, session: int, counts: Counter[str], *, to_arms: bool) -> None:
        """`counts` counts dropped packets; `to_arms` is the direction of the packets."""
        self.session, self.counts, self.to_arms = session, counts, to_arms
        self._ages = Ages()
        self._last: dict[int, tuple[int, int]] = {}  # kind -> sequence, stamp

    def take(self, packet: Packet, arrival: float) -> Arrived | None:
        """Return an accepted packet that arrived at `arrival` (s), or count the cause of its
        refusal."""
        cause = self._find_cause(packet)
        if cause is None:
            self._last[packet.kind.number] = (packet.sequence, packet.time_us)
            age = self._ages.measure(arrival, 1e-6 * packet.time_us)
            if age <= packet.kind.old_s:
                self.counts["accepted"] += 1
                return Arrived(packet, age, arrival)
            cause = "old"
        self.counts[cause] += 1
        return None

    def _find_cause(self, packet: Packet) -> str | None:
        if packet.kind.to_arms != self.to_arms:
            return "kind"
        if packet.session != self.session:
            return "session"
        sequence, stamp = self._last.get(packet.kind.number, (-1, -1))
        if packet.sequence <= sequence or packet.time_us < stamp:
            return "replayed"
        return None


def read_packet(data: bytes, key: bytes, counts: Counter[str]) -> Packet | None:
    """Decode a datagram, or count the cause for which it is invalid."""
    packet = decode(data, key)
    if isinstance(packet, Rejected):
        counts[packet.cause] += 1
        return None
    return packet
