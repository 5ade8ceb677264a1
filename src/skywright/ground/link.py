"""Messages between station and simulation over a pair of local sockets (links/pair.py).

Frames are binary (`pack_frame`), all other messages are one JSON object with its kind in "k".
Messages that do not fit are dropped, so important ones are repeated (the status, twice a second).
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.links.pair import read_number

HEADER = struct.Struct("<4sIddHHfI")
"""Magic, sequence, mission time (s), wall time (s), phase, flags, lateness (ms), spare."""
MAGIC = b"SKY1"
PAUSED, STICK, ASKED = 1, 2, 4
"""Flags: the flight is paused; the stick moves the robot; the mission requests an operator."""
SILENT_S = 3.0
"""s without a message after which the other side counts as disconnected."""
SPEEDS = (0.1, 20.0)
"""Least and largest speed that a page may ask for, 1 in real time."""
SPEED_FASTEST = 0.0
"""Speed that stands for "as fast as possible"."""


def read_flight(value: Any) -> list[float] | None:
    """Return a pilot's four axes from -1 to 1, zero by default; None if they are invalid."""
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
