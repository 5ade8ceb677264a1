"""Formats of live streams: pose packets (binary, UDP) and instrument lines (text, UDP or serial).

Version 1. Numbers of a pose packet are little-endian; `crc` is zlib's CRC-32 of all bytes before
it. A line is `$KIND,1,NAME,CLOCK,SEQUENCE,TIME,VALUES...*HH` and a line feed; HH is the exclusive
or of the characters between `$` and `*`, in hexadecimal. `clock` identifies the clock of `t`:
streams with the same number share it, and a restarted sender uses a new number.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAGIC, VERSION = b"SKYP", 1
POSITION, POSE = 1, 2
LAYOUT = struct.Struct("<4sBBHIId16s3d4d")
CRC = struct.Struct("<I")
SIZE = LAYOUT.size + CRC.size
NAME_MAX = 16
SEQUENCES = 1 << 32
POSITION_MAX = 1e8  # m
LINES = {"SKYEC": ("re", "im"), "SKYFT": ("fx", "fy", "fz", "tx", "ty", "tz")}
"""Kind of a line -> its values: eddy current in the instrument's units; N and N m."""
LINE_MAX = 400  # characters
CAUSES = {
    "size": "a datagram that is no pose packet, line or MAVLink packet",
    "version": "a pose packet or line of another version",
    "crc": "a pose packet or line whose checksum is wrong",
    "fields": "a line with other fields than its kind has",
    "numbers": "values that are not finite, or a quaternion whose norm is not 1",
    "frame": "an ODOMETRY message in another frame than NED with FRD",
    "extra": "MAVLink, which requires pymavlink: pip install 'skywright[mavlink]'",
    "old": "a sample that came before, or is older than the newest",
    "clock": "a sample whose time goes back, or that a later sample proves wrong",
    "streams": "a stream beyond the number that is kept",
}
"""Cause of a refusal -> description."""


class Sample(NamedTuple):
    """One value of a stream."""

    kind: str  # "position", "pose", "SKYEC" or "SKYFT"
    name: str
    clock: int
    sequence: int
    t: float  # s, on the sender's clock
    values: tuple[float, ...]  # x, y, z (m) and qw, qx, qy, qz; or those of LINES


class Refused(Exception):
    """Bytes that are not a valid sample; the message is the cause."""


def check_name(name: str) -> bool:
    """Whether a name is valid for a stream: letters, digits, `-`, `_`, as in file names."""
    return 0 < len(name) <= NAME_MAX and name.isascii() and name.replace("-", "_").isidentifier()


def pack_pose(sample: Sample) -> bytes:
    """Return the packet of a position or pose; raises ValueError for another kind of sample."""
    turned = sample.kind == "pose"
    if not check_name(sample.name) or len(sample.values) != (7 if turned else 3):
        raise ValueError(f"{sample.name!r} is no name, or has {len(sample.values)} values")
    q = sample.values[3:] if turned else (0.0, 0.0, 0.0, 0.0)
    data = LAYOUT.pack(
        MAGIC, VERSION, POSE if turned else POSITION, 0, sample.sequence % SEQUENCES,
        sample.clock % SEQUENCES, sample.t, sample.name.encode("ascii"), *sample.values[:3], *q,
    )  # fmt: skip
    return data + CRC.pack(zlib.crc32(data))


def parse_pose(data: bytes) -> Sample:
    """Return the sample of a packet; raises Refused."""
    if len(data) < 5 or data[:4] != MAGIC:
        raise Refused("size")
    if data[4] != VERSION:
        raise Refused("version")
    if len(data) != SIZE:
        raise Refused("size")
    if CRC.unpack(data[LAYOUT.size :])[0] != zlib.crc32(data[: LAYOUT.size]):
        raise Refused("crc")
    _, _, kind, _, sequence, clock, t, raw, *values = LAYOUT.unpack(data[: LAYOUT.size])
    name = raw.rstrip(b"\0").decode("ascii", errors="replace")
    if kind not in (POSITION, POSE) or not check_name(name):
        raise Refused("fields")
    kept = tuple(values if kind == POSE else values[:3])
    _check_numbers((t, *kept))
    if kind == POSE and not 0.99 < math.sqrt(sum(x * x for x in kept[3:])) < 1.01:
        raise Refused("numbers")
    if any(abs(x) > POSITION_MAX for x in kept[:3]):
        raise Refused("numbers")
    return Sample("pose" if kind == POSE else "position", name, clock, sequence, t, kept)


def format_line(sample: Sample) -> bytes:
    """Return the line of an instrument's sample; raises ValueError for another kind of sample."""
    if len(sample.values) != len(LINES.get(sample.kind, ())) or not check_name(sample.name):
        raise ValueError(f"{sample.kind!r} is no kind of line, or {sample.name!r} is no name")
    head = f"{sample.kind},{VERSION},{sample.name},{sample.clock},{sample.sequence}"
    body = ",".join([head, repr(float(sample.t)), *(repr(float(v)) for v in sample.values)])
    return f"${body}*{_compute_checksum(body):02X}\n".encode("ascii")


def parse_line(line: bytes) -> Sample:
    """Return the sample of a line; raises Refused."""
    text = line.strip().decode("ascii", errors="replace")
    if not text.startswith("$SKY") or len(text) > LINE_MAX:
        raise Refused("size")
    body, star, told = text[1:].rpartition("*")
    if not star or len(told) != 2 or told.upper() != f"{_compute_checksum(body):02X}":
        raise Refused("crc")
    kind, *fields = body.split(",")
    if len(fields) < 1 or fields[0] != str(VERSION):
        raise Refused("version")
    if kind not in LINES or len(fields) != 5 + len(LINES[kind]) or not check_name(fields[1]):
        raise Refused("fields")
    try:
        clock, sequence = int(fields[2]), int(fields[3])
        numbers = tuple(float(x) for x in fields[4:])
    except ValueError:
        raise Refused("numbers") from None
    _check_numbers(numbers)
    if not (0 <= clock < SEQUENCES and 0 <= sequence < SEQUENCES):
        raise Refused("numbers")
    return Sample(kind, fields[1], clock, sequence, numbers[0], numbers[1:])


class LineSplitter:
    """Splits a stream of bytes, such as from a serial port, into lines."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Return the lines that `data` completes; a line without an end is cut at LINE_MAX."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LINE_MAX:
            lines, self._rest = [*lines, self._rest], b""
        yield from (line for line in lines if line.strip())


def _check_numbers(values: tuple[float, ...]) -> None:
    if not all(math.isfinite(x) for x in values):
        raise Refused("numbers")


def _compute_checksum(body: str) -> int:
    value = 0
    for byte in body.encode("ascii", errors="replace"):
        value ^= byte
    return value
