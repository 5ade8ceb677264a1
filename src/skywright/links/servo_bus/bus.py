"""The servo bus: requests, answers, time-outs, torque, goals and positions."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from skywright.errors import InputError, SimulationError
from skywright.links.servo_bus.protocol import (
    ACK_POLICY,
    ANSWER,
    BROADCAST,
    DATA_CAUSES,
    IDS,
    INVALID_PACKET,
    MOTOR_ON,
    POSITION,
    RAM_READ,
    REBOOT,
    STAT,
    STATUS,
    TORQUE,
    TORQUE_FREE,
    TORQUE_ON,
    VOLTAGE,
    Jog,
    Packet,
    PacketParser,
    describe_error,
    pack,
    pack_i_jog,
    pack_read,
    pack_s_jog,
    pack_write,
)

BAUD = 115200
BAUDS = (57600, 115200, 200000, 250000, 400000, 500000, 666666)
ANSWER_S = 0.012
"""s, time limit of an answer in addition to its bytes: a USB converter adds up to 8 ms."""
ATTEMPTS = 2
MORE_CAUSES = {
    "timeout": "requests without an answer in time",
    "stranger": "answers to no request",
    "length": "answers of another length than that asked for",
    "disturbed": "readings of a servo that had received a packet it did not understand",
}


class ServoSilent(SimulationError):
    """A servo does not answer."""


class Port(Protocol):
    """The interface of a serial port that the bus uses; serial.Serial has it."""

    timeout: float | None

    def write(self, data: bytes, /) -> Any:
        """Send bytes."""

    def read(self, size: int = 1, /) -> bytes:
        """Return up to `size` bytes that arrive within the timeout."""

    def close(self) -> None:
        """Close it."""


class ServoStatus(NamedTuple):
    """Status of a servo."""

    error: int
    detail: int

    @property
    def torque(self) -> bool:
        """Whether its motor is on."""
        return bool(self.detail & MOTOR_ON)

    @property
    def faults(self) -> int:
        """Its errors, without that of a disturbed packet."""
        return self.error & ~INVALID_PACKET

    @property
    def says(self) -> str:
        """Its errors as text, or ""."""
        return describe_error(self.error)


class ServoBus:
    """Requests on one port; not thread-safe."""

    def __init__(
        self, port: Port, baud: int = BAUD, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._port, self._baud, self._clock = port, baud, clock
        self._parser = PacketParser()
        self.counts: Counter[str] = Counter()

    def close(self) -> None:
        """Close the port; the servos keep their last commands."""
        self._port.close()

    # --- without an answer -------------------------------------------------------------------

    def acknowledge_reads_only(self) -> None:
        """Set all servos to answer read requests only."""
        self._port.write(pack_write(BROADCAST, ACK_POLICY, b"\x01"))

    def set_torque(self, on: bool, servo: int = BROADCAST) -> None:
        """Switch motors on or off."""
        self._port.write(pack_write(servo, TORQUE, bytes([TORQUE_ON if on else TORQUE_FREE])))

    def clear_errors(self, servo: int = BROADCAST) -> None:
        """Clear status error and detail; a persistent cause sets them again."""
        self._port.write(pack_write(servo, STATUS, b"\x00\x00"))

    def reboot(self, servo: int) -> None:
        """Restart a servo: torque off, RAM loaded from its EEPROM."""
        self._port.write(pack(Packet(servo, REBOOT, b"")))

    def jog_together(self, ticks: int, jogs: Sequence[Jog]) -> None:
        """Move servos to their goals in the same play time (S_JOG)."""
        self._port.write(pack_s_jog(ticks, jogs))

    def jog_each(self, jogs: Sequence[Jog]) -> None:
        """Move servos to their goals, each in its play time (I_JOG)."""
        self._port.write(pack_i_jog(jogs))

    # --- with an answer ----------------------------------------------------------------------

    def read_ram(self, servo: int, address: int, length: int) -> tuple[bytes, ServoStatus]:
        """Return `length` bytes of RAM and the status; raises ServoSilent without an answer."""
        request = pack_read(servo, address, length)
        for _ in range(ATTEMPTS):
            answer = self._ask(request, servo, RAM_READ, length + 4)
            if answer is None:
                continue
            data = answer.data
            if len(data) != length + 4 or data[0] != address or data[1] != length:
                self.counts["length"] += 1
                continue
            return data[2:-2], ServoStatus(data[-2], data[-1])
        raise ServoSilent(f"servo {servo} does not answer")

    def read_position(self, servo: int) -> tuple[int, ServoStatus]:
        """Return the position in counts and the status."""
        data, status = self.read_ram(servo, POSITION, 2)
        return (data[0] | data[1] << 8) & 0x3FF, status

    def read_supply(self, servo: int) -> tuple[float, float]:
        """Return the supply voltage (V) and the temperature (raw units of the sensor)."""
        data, _ = self.read_ram(servo, VOLTAGE, 2)
        return 0.074 * data[0], float(data[1])

    def read_status(self, servo: int) -> ServoStatus:
        """Return the status (STAT)."""
        for _ in range(ATTEMPTS):
            answer = self._ask(pack(Packet(servo, STAT, b"")), servo, STAT, 2)
            if answer is not None and len(answer.data) == 2:
                return ServoStatus(answer.data[0], answer.data[1])
        raise ServoSilent(f"servo {servo} does not answer")

    def find_servos(self, ids: Sequence[int] = IDS) -> list[int]:
        """Return the ids that answer."""
        found = []
        for servo in ids:
            if self._ask(pack(Packet(servo, STAT, b"")), servo, STAT, 2) is not None:
                found.append(servo)
        return found

    def _ask(self, request: bytes, servo: int, command: int, n: int) -> Packet | None:
        """Send a request; return its answer, or None after the time limit."""
        self._parser.reset()
        self._port.write(request)
        wire = 10.0 * (len(request) + 7 + n) / self._baud
        end = self._clock() + wire + ANSWER_S
        while (left := end - self._clock()) > 0.0:
            self._port.timeout = left
            for packet in self._parser.feed(self._port.read(1) + self._read_waiting()):
                if packet.servo == servo and packet.command == command + ANSWER:
                    return packet
                self.counts["stranger"] += 1
        self.counts["timeout"] += 1
        return None

    def _read_waiting(self) -> bytes:
        waiting = int(getattr(self._port, "in_waiting", 0))
        return self._port.read(waiting) if waiting else b""

    def describe_refused(self) -> list[str]:
        """Return one line for each cause of dropped data."""
        found, causes = self.counts + self._parser.counts, {**DATA_CAUSES, **MORE_CAUSES}
        return [f"{found[c]}: {says}" for c, says in causes.items() if found[c]]


def open_bus(text: str, option: str = "--servos") -> ServoBus:
    """Open `serial:PORT` or `serial:PORT:BAUD`; raises InputError that names `option`."""
    kind, _, rest = text.partition(":")
    path, _, baud = rest.rpartition(":")
    if not (baud.isascii() and baud.isdigit()):
        path, baud = rest, str(BAUD)
    if kind != "serial" or not path or int(baud) not in BAUDS:
        rates = ", ".join(str(b) for b in BAUDS)
        raise InputError(
            f"{option} {text[:80]!r}; valid: serial:PORT or serial:PORT:BAUD, BAUD {rates}"
        )
    return ServoBus(open_port(path, int(baud), option), int(baud))


def open_port(path: str, baud: int, option: str) -> Port:
    """Open a serial port by pyserial; raises InputError that names `option`."""
    try:
        import serial
    except ImportError:
        raise InputError("serial ports require pyserial: pip install 'skywright[serial]'") from None
    try:
        port: Port = serial.Serial(path, baud, timeout=ANSWER_S, write_timeout=1.0, exclusive=True)
    except (OSError, ValueError) as error:
        raise InputError(f"{option}: cannot open {path}: {error}") from None
    return port
