"""What station and simulation say to each other: datagrams over a pair of local sockets.

Frames are binary (`pack_frame`), everything else is one JSON object with its kind in "k". The pair
is made by the one that starts the other; no other program can connect to it. Sending never waits:
what does not fit is dropped, so whatever must arrive is told again (the status, twice a second).
"""

from __future__ import annotations

import json
import math
import socket
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADER = struct.Struct("<4sIddHHfI")
"""Magic, sequence, mission time (s), wall time (s), phase, flags, lateness (ms), spare."""
MAGIC = b"SKY1"
PAUSED, STICK, ASKED = 1, 2, 4
"""Flags: the flight is paused; the stick moves the robot; the mission asks for an operator."""
LARGEST = 60_000  # bytes of a datagram
AT_ONCE = 500  # datagrams that are read in one go
SILENT_S = 3.0
"""s without a word after which the other side counts as gone."""


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


def read_flight(value: Any) -> list[float] | None:
    """Return a pilot's four axes from -1 to 1, at rest where none are given; None: no such."""
    if value is None:
        return [0.0, 0.0, 0.0, 0.0]
    if not isinstance(value, list) or len(value) != 4:
        return None
    axes = [read_number(x, -1.0, 1.0) for x in value]
    return None if None in axes else [x for x in axes if x is not None]


def pack_frame(
    seq: int, t: float, wall: float, phase: int, flags: int, late_ms: float,
    row: NDArray[np.float32],
) -> bytes:  # fmt: skip
    """Return a frame's datagram: header, then the numbers of reports/frames.py."""
    return HEADER.pack(MAGIC, seq & 0xFFFFFFFF, t, wall, phase, flags, late_ms, 0) + row.tobytes()


def is_frame(data: bytes) -> bool:
    """Whether a datagram is a frame."""
    return len(data) >= HEADER.size and data[:4] == MAGIC
