"""Packets of HerkuleX DRS-0101 and DRS-0201 servos.

    FF FF | size | id | command | checksum 1 | checksum 2 | data

`size` counts all bytes. Checksum 1 is the exclusive or of size, id, command and data without its
lowest bit, checksum 2 its complement without it. An answer has the command plus 0x40, and its data
end with status error and status detail. Reconstructed from public drivers (cesarvandevelde/
HerkulexServo, gbip/drs_0x01); the packets printed in robot-mitya/herkulex-servo are test vectors.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

HEADER = b"\xff\xff"
SIZE_MIN, SIZE_MAX = 7, 223
BROADCAST = 0xFE
IDS = range(0xFE)
EEP_WRITE, EEP_READ, RAM_WRITE, RAM_READ, I_JOG, S_JOG, STAT, ROLLBACK, REBOOT = range(1, 10)
COMMANDS = range(1, 10)
ANSWER = 0x40
ACK_POLICY, STATUS, TORQUE, VOLTAGE, TEMPERATURE, POSITION = 0x01, 0x30, 0x34, 0x36, 0x37, 0x3A
"""Addresses in RAM."""
TORQUE_FREE, TORQUE_BRAKE, TORQUE_ON = 0x00, 0x40, 0x60
TICK_S = 0.0112
"""s, of play times."""
TICKS_MAX = 254
COUNT_DEG, CENTRE, COUNTS_MAX = 0.325, 512, 1023
LOWEST, HIGHEST = 21, 1002
"""Counts of the operating range, 159.6 deg to each side."""
SERVOS_MAX = 53
"""Servos in one packet of S_JOG (4 bytes each); I_JOG takes 43 (5 bytes each)."""
ERRORS = {
    0x01: "supply voltage out of range", 0x02: "position out of range", 0x04: "too hot",
    0x08: "a packet that it did not understand", 0x10: "overload", 0x20: "driver fault",
    0x40: "its EEPROM is damaged",
}  # fmt: skip
"""Bits of the status error."""
INVALID_PACKET = 0x08
"""The bit that concerns the wire: a disturbed byte sets it, the servo itself works."""
MOVING, IN_PLACE, BAD_CHECKSUM, BAD_COMMAND, BAD_RANGE, GARBAGE, MOTOR_ON = (
    1, 2, 4, 8, 16, 32, 64,
)  # fmt: skip
"""Bits of the status detail."""
DATA_CAUSES = {
    "checksum": "a packet whose checksum is wrong",
    "size": "a header with an impossible size",
    "garbage": "bytes that belong to no packet",
}


class Packet(NamedTuple):
    """A packet in either direction."""

    servo: int
    command: int
    data: bytes


class Jog(NamedTuple):
    """Motion command of a servo; `counts` is its position goal."""

    servo: int
    counts: int
    ticks: int = 0  # play time, of I_JOG


def compute_checksums(size: int, servo: int, command: int, data: bytes) -> tuple[int, int]:
    """Return checksums 1 and 2."""
    value = size ^ servo ^ command
    for byte in data:
        value ^= byte
    first = value & 0xFE
    return first, ~first & 0xFE


def pack(packet: Packet) -> bytes:
    """Return the bytes of a packet; raises ValueError if a value does not fit."""
    size = SIZE_MIN + len(packet.data)
    if size > SIZE_MAX:
        raise ValueError(f"{len(packet.data)} bytes of data; valid: up to {SIZE_MAX - SIZE_MIN}")
    first, second = compute_checksums(size, *packet)
    return HEADER + bytes([size, packet.servo, packet.command, first, second]) + packet.data


def pack_read(servo: int, address: int, length: int) -> bytes:
    """Return the request for `length` bytes of RAM from `address`."""
    return pack(Packet(servo, RAM_READ, bytes([address, length])))


def pack_write(servo: int, address: int, data: bytes) -> bytes:
    """Return the packet that writes to RAM."""
    return pack(Packet(servo, RAM_WRITE, bytes([address, len(data)]) + data))


def pack_s_jog(ticks: int, jogs: Sequence[Jog]) -> bytes:
    """Return one packet for several servos that move in the same time."""
    if len(jogs) > SERVOS_MAX:
        raise ValueError(f"{len(jogs)} servos; valid: up to {SERVOS_MAX}")
    data = bytes([_check_ticks(ticks)])
    for jog in jogs:
        data += bytes([jog.counts & 0xFF, jog.counts >> 8, 0, jog.servo])
    return pack(Packet(BROADCAST, S_JOG, data))


def pack_i_jog(jogs: Sequence[Jog]) -> bytes:
    """Return one packet for several servos with individual play times."""
    data = b""
    for jog in jogs:
        data += bytes([jog.counts & 0xFF, jog.counts >> 8, 0, jog.servo, _check_ticks(jog.ticks)])
    return pack(Packet(BROADCAST, I_JOG, data))


def _check_ticks(ticks: int) -> int:
    if not 0 <= ticks <= TICKS_MAX:
        raise ValueError(f"play time of {ticks} ticks; valid: 0 to {TICKS_MAX}")
    return ticks


def to_ticks(seconds: float) -> int:
    """Return a play time in ticks, the largest below `seconds`, at least one."""
    return min(max(int(seconds / TICK_S), 1), TICKS_MAX)


def to_counts(angle: float) -> int:
    """Return the goal nearest to an angle (rad), within the operating range."""
    return min(max(CENTRE + round(math.degrees(angle) / COUNT_DEG), LOWEST), HIGHEST)


def to_angle(counts: int) -> float:
    """Return the angle (rad) of a position."""
    return math.radians((counts - CENTRE) * COUNT_DEG)


def describe_error(error: int) -> str:
    """Return the causes of a status error as text, or ""."""
    return ", ".join(says for bit, says in ERRORS.items() if error & bit)


class PacketParser:
    """Finds packets in a stream of bytes; invalid data are counted and dropped."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._rest = b""

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that `data` completes; an incomplete packet is kept."""
        self._rest += data
        found: list[Packet] = []
        while True:
            at = self._rest.find(HEADER)
            if at < 0:
                keep = 1 if self._rest.endswith(b"\xff") else 0
                self._drop(len(self._rest) - keep, "garbage")
                return found
            self._drop(at, "garbage")
            rest = self._rest
            if len(rest) < SIZE_MIN:
                return found
            size = rest[2]
            if not SIZE_MIN <= size <= SIZE_MAX:
                self.counts["size"] += 1
                self._rest = rest[1:]
                continue
            if len(rest) < size:
                return found
            packet = Packet(rest[3], rest[4], rest[7:size])
            if compute_checksums(size, *packet) != (rest[5], rest[6]):
                self.counts["checksum"] += 1
                self._rest = rest[1:]  # a header may begin inside the rejected bytes
                continue
            self.counts["accepted"] += 1
            self._rest = rest[size:]
            found.append(packet)

    def reset(self) -> None:
        """Discard an incomplete packet."""
        self._drop(len(self._rest), "garbage")

    def _drop(self, n: int, cause: str) -> None:
        if n:
            self.counts[cause] += n
            self._rest = self._rest[n:]
