"""The radio link between operator and robot: delay, jitter, loss and bandwidth.

Each direction has one transmitter. It sends one packet at a time, which takes its size over the
bandwidth. Of the queued packets, commands are sent first, then states, then video, each kind in
order. A transmission is not interrupted. A sent packet takes `delay_s` plus normal jitter and
arrives after earlier ones of its kind, or is lost with a fixed probability. Queues are short: the
newest state and the newest picture replace queued ones.
"""

from __future__ import annotations

import heapq
import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from skywright.core.streams import build_stream
from skywright.description.world.radio import Radio

COMMAND, STATE, VIDEO = range(3)
"""Priorities, highest first."""
DEPTH = (64, 8, 1)
"""Length of the queue by priority: the oldest packet is dropped."""
OVERHEAD = 28  # bytes, headers of IP and UDP
BLOCK = 256  # packets per block of random draws


class Waiting(NamedTuple):
    """A packet before it is sent."""

    t: float  # s, queued
    size: int  # bytes
    item: Any


class Way:
    """One direction of the link. The same seed and packets give the same arrivals."""

    def __init__(self, radio: Radio, seed: int, name: str) -> None:
        """`seed` is the run's, `name` that of the direction: each has its own random stream."""
        self.radio = radio
        self.lost = 0
        """Number of packets lost in transmission."""
        self.dropped = 0
        """Number of packets dropped from a queue for newer ones."""
        self._rng = build_stream(seed, "radio", name)
        self._draws = np.zeros((0, 2))
        self._waiting: tuple[deque[Waiting], ...] = (deque(), deque(), deque())
        self._under_way: list[tuple[float, int, Any]] = []  # arrival, number, item
        self._free = -math.inf  # s, end of the current transmission
        self._last = [-math.inf] * 3  # s, newest arrival of each priority
        self._sent = 0

    def send(self, t: float, priority: int, size: int, item: Any) -> None:
        """Queue an item of `size` bytes at `t` (s), which must not decrease."""
        self._transmit(t)
        queue = self._waiting[priority]
        if len(queue) >= DEPTH[priority]:
            queue.popleft()
            self.dropped += 1
        queue.append(Waiting(t, size + OVERHEAD, item))

    def receive(self, t: float) -> list[Any]:
        """Return the items that have arrived by `t` (s), in the order of arrival."""
        self._transmit(t)
        found = []
        while self._under_way and self._under_way[0][0] <= t:
            found.append(heapq.heappop(self._under_way)[2])
        return found

    def _transmit(self, t: float) -> None:
        """Transmit the packets whose transmission begins before `t` (s)."""
        while any(self._waiting):
            earliest = min(queue[0].t for queue in self._waiting if queue)
            start = max(self._free, earliest)
            if start > t:
                return
            priority = next(p for p, q in enumerate(self._waiting) if q and q[0].t <= start)
            packet = self._waiting[priority].popleft()
            rate = self.radio.bandwidth_kbps
            self._free = start + (0.0 if rate is None else 8e-3 * packet.size / rate)
            self._fly(priority, packet.item)

    def _fly(self, priority: int, item: Any) -> None:
        uniform, normal = self._draw()
        if uniform < self.radio.loss_fraction:
            self.lost += 1
            return
        delay = max(self.radio.delay_s + self.radio.jitter_s * normal, 0.0)
        arrival = max(self._free + delay, self._last[priority])
        self._last[priority] = arrival
        self._sent += 1
        heapq.heappush(self._under_way, (arrival, self._sent, item))

    def _draw(self) -> tuple[float, float]:
        if not len(self._draws):
            uniform = self._rng.uniform(size=BLOCK)
            self._draws = np.stack([uniform, self._rng.standard_normal(BLOCK)], axis=1)
        (u, n), self._draws = self._draws[0], self._draws[1:]
        return float(u), float(n)


def build_ways(radio: Radio, seed: int) -> tuple[Way, Way] | None:
    """Return the directions up to the robot and down to the operator; None without a radio."""
    if not radio.present:
        return None
    return Way(radio, seed, "up"), Way(radio, seed, "down")
