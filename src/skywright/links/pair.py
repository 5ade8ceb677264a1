"""Datagrams over a pair of local sockets between a flight and a process that it has beside it.

The pair is made by the one that starts the other; no other program can connect to it. Sending never
waits: what does not fit is dropped. Words are one JSON object each, with its kind in "k".
"""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Iterator
from typing import Any

LARGEST = 60_000  # bytes of a datagram
AT_ONCE = 500  # datagrams that are read in one go


def build_pair() -> tuple[socket.socket, socket.socket]:
    """Return the two ends; each neither waits when it sends nor when it reads."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    for end in ends:
        prepare(end)
    return ends


def prepare(end: socket.socket) -> None:
    """Set an end up: large enough for frames, and never waiting."""
    end.setblocking(False)
    for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
        end.setsockopt(socket.SOL_SOCKET, option, 1 << 18)


def send(end: socket.socket, data: bytes) -> bool:
    """Send a datagram; returns whether it was taken."""
    try:
        return end.send(data) == len(data)
    except OSError:  # full, or nobody there any more
        return False


def say(end: socket.socket, kind: str, **more: Any) -> bool:
    """Send a JSON object of a kind; returns whether it was taken."""
    data = json.dumps({"k": kind, **more}, allow_nan=False).encode()
    return len(data) <= LARGEST and send(end, data)


def receive(end: socket.socket) -> Iterator[bytes]:
    """Return the datagrams that have come."""
    for _ in range(AT_ONCE):
        try:
            data = end.recv(LARGEST + 1)
        except OSError:  # nothing more, or the other end is gone
            return
        if not data:
            return
        yield data


def parse(data: bytes | str) -> dict[str, Any] | None:
    """Return the object of a message with its kind in "k"; None where it is none."""
    try:
        found = json.loads(data, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, dict) or not isinstance(found.get("k"), str):
        return None
    return found


def _refuse(text: str) -> Any:
    raise ValueError(f"{text} is no number")


def read_number(value: Any, low: float, high: float) -> float | None:
    """Return a finite number within limits; None where it is none. A truth value is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) and low <= number <= high else None
