"""Forwards commands from the middleware to the flight, and answers back."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from skywright.links.broadcast.table import OLD_S
from skywright.links.pair import say
from skywright.links.udp.receiver import Ages

SENDERS_MAX = 64  # most senders with known clocks
HELD_S = 10.0  # s after a call for which its sender counts as watching


class Caller:
    """Forwards commands to the flight, and its answers to the callers."""

    def __init__(self, end: socket.socket) -> None:
        self._end, self._number = end, 0
        self._waiting: dict[int, Callable[[bool, str], None]] = {}
        self._lock = threading.Lock()  # calls come from threads of the middleware
        self._ages: dict[bytes, Ages] = {}  # by sender: their clocks differ
        self.last_s = -HELD_S
        """Wall time of the last call."""

    def call(self, name: str, args: dict[str, Any], answer: Callable[[bool, str], None]) -> None:
        """Send a request to the flight; `answer` is called with success and text."""
        with self._lock:
            self._number += 1
            number = self._number
            self._waiting[number] = answer
            self.last_s = time.monotonic()
        if not say(self._end, "call", id=number, name=name, args=args, at=time.monotonic()):
            self.answer(number, False, f"{name} refused: the flight does not take commands now")

    def stream(self, name: str, args: dict[str, Any], stamp_s: float, sender: bytes) -> bool:
        """Forward a message of a stream unless it is old; `stamp_s` is the sender's time."""
        now = time.monotonic()
        with self._lock:
            self.last_s = now
            if sender not in self._ages and len(self._ages) >= SENDERS_MAX:
                del self._ages[next(iter(self._ages))]
            if self._ages.setdefault(sender, Ages()).measure(now, stamp_s) > OLD_S:
                return False
        return say(self._end, "call", id=0, name=name, args=args, at=now)

    def answer(self, number: int, ok: bool, says: str) -> None:
        """Forward an answer of the flight to the caller."""
        with self._lock:
            reply = self._waiting.pop(number, None)
        if reply is not None:
            reply(ok, says)

    def end(self) -> None:
        """Answer all pending calls: the flight is over."""
        for number in list(self._waiting):
            self.answer(number, False, "the flight is over")
