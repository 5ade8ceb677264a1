"""The MSP requests (version 1) of a flight: state, attitude, version.

A frame is `$M`, direction, size, command, payload and the exclusive or of the last three.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

VARIANT, VERSION, ATTITUDE, STATUS = 2, 3, 108, 150
REQUEST, ANSWER, REFUSED = b"<", b">", b"!"
ARM_BIT, ANGLE_BIT = 0, 1
"""Bits of the active modes."""
REASONS = (
    "no gyroscope", "failsafe", "no radio signal", "the arm switch was on at the start",
    "failsafe switch", "runaway take-off", "crash", "the throttle is not low",
    "tilted by more than small_angle", "it has started just now", "no pre-arm", "overload",
    "the gyroscope is being calibrated: the robot moves, or its noise exceeds "
    "gyro_calib_noise_limit", "the command line is in use", "its menu is in use",
    "its menu is in use", "MSP forbids it", "paralysed", "GPS rescue has no fix",
    "rescue switch", "motor telemetry", "a restart is required", "motor protocol",
    "the accelerometer is not calibrated", "motor protocol", "crash-flip switch",
    "altitude-hold switch", "position-hold switch", "the arm switch was on while it was refused",
)  # fmt: skip
"""Reasons of an arming refusal, by bit of the flags."""


class Frame(NamedTuple):
    """A message of the flight controller: command number and payload."""

    command: int
    payload: bytes


class Status(NamedTuple):
    """State of Betaflight."""

    cycle_us: int  # of its loop
    armed: bool
    angle: bool  # ANGLE mode
    refusals: tuple[str, ...]  # why it would not arm


def pack_request(command: int, payload: bytes = b"") -> bytes:
    """Return the frame of a request."""
    return _pack(REQUEST, command, payload)


def pack_answer(command: int, payload: bytes, direction: bytes = ANSWER) -> bytes:
    """Return the frame of an answer, as the autopilot sends it."""
    return _pack(direction, command, payload)


def _pack(direction: bytes, command: int, payload: bytes) -> bytes:
    body = bytes([len(payload), command]) + payload
    return b"$M" + direction + body + bytes([_compute_checksum(body)])


def _compute_checksum(body: bytes) -> int:
    value = 0
    for byte in body:
        value ^= byte
    return value


class MspParser:
    """Finds frames in a stream of bytes; invalid data are counted and dropped."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Return the answers that `data` completes; keeps at most one frame's bytes."""
        self._rest += data
        while True:
            at = self._rest.find(b"$M")
            if at < 0:
                keep = 1 if self._rest.endswith(b"$") else 0
                self.counts["garbage"] += len(self._rest) - keep
                self._rest = self._rest[len(self._rest) - keep :]
                return
            self.counts["garbage"] += at
            self._rest = self._rest[at:]
            if len(self._rest) < 6:
                return
            size = self._rest[3]
            if len(self._rest) < 6 + size:
                return
            body = self._rest[3 : 5 + size]
            sound = self._rest[5 + size] == _compute_checksum(body)
            direction = self._rest[2:3]
            if not sound or direction not in (ANSWER, REFUSED):
                self.counts["checksum" if not sound else "garbage"] += 1
                self._rest = self._rest[2:]
                continue
            self._rest = self._rest[6 + size :]
            if direction == ANSWER:
                self.counts["accepted"] += 1
                yield Frame(body[1], body[2:])
            else:
                self.counts["refused"] += 1


def parse_status(payload: bytes) -> Status | None:
    """Return the state of MSP_STATUS_EX; None if it is too short."""
    if len(payload) < 16:
        return None
    cycle, modes = struct.unpack_from("<H4xI", payload)
    more = 16 + (payload[15] & 0x0F)  # further modes
    if len(payload) < more + 5:
        return None
    flags = struct.unpack_from("<I", payload, more + 1)[0]
    names = [says for bit, says in enumerate(REASONS) if flags >> bit & 1]
    armed, angle = bool(modes >> ARM_BIT & 1), bool(modes >> ANGLE_BIT & 1)
    return Status(cycle, armed, angle, tuple(dict.fromkeys(names)))


def parse_attitude(payload: bytes) -> tuple[float, float, float] | None:
    """Return roll, pitch (nose down), heading (clockwise from north) in degrees."""
    if len(payload) < 6:
        return None
    roll, pitch, heading = struct.unpack_from("<3h", payload)
    return 0.1 * roll, 0.1 * pitch, float(heading)
