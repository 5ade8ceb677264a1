"""Datagrams over a pair of local sockets between a flight and its child process.

The process that starts the other creates the pair; no other program can connect to it. Sending
never blocks: datagrams that do not fit are dropped. A message is one JSON object with its kind in
"k".
"""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Iterator
from typing import Any

LARGEST = 60_000  # bytes, largest datagram
AT_ONCE = 500  # datagrams per read


def build_pair() -> tuple[socket.socket, socket.socket]:
    """Return the two ends, both non-blocking."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    for end in ends:
        prepare(end)
    return ends


def prepare(end: socket.socket) -> None:
    """Configure an end: buffers large enough for frames, non-blocking."""
    end.setblocking(False)
    for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
        end.setsockopt(socket.SOL_SOCKET, option, 1 << 18)


def send(end: socket.socket, data: bytes) -> bool:
    """Send a datagram; return whether it was accepted."""
    try:
        return end.send(data) == len(data)
    except OSError:  # full, or the other end is closed
        return False


def say(end: socket.socket, kind: str, **more: Any) -> bool:
    """Send a JSON object of a kind; return whether it was accepted."""
    data = json.dumps({"k": kind, **more}, allow_nan=False).encode()
    return len(data) <= LARGEST and send(end, data)


def receive(end: socket.socket) -> Iterator[bytes]:
    """Return the received datagrams."""
    for _ in range(AT_ONCE):
        try:
            data = end.recv(LARGEST + 1)
        except OSError:  # no more data, or the other end is closed
            return
        if not data:
            return
        yield data


def parse(data: bytes | str) -> dict[str, Any] | None:
    """Return the object of a message with its kind in "k"; None if it is invalid."""
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
    """Return a finite number within limits; None if it is invalid or a boolean."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) and low <= number <= high else None
