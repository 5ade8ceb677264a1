"""Emulated DRS servos on a pseudo-terminal, for tests and rehearsals.

Each servo has its RAM, a shaft that moves to its goal in its play time at no more than its no-load
speed, torque that is off after the start, status bits, and its acknowledgement policy. As with the
real servos, status bits report noise, a wrong checksum, an unknown command and an address out of
range, and are kept until they are cleared.
The load of a shaft is not modelled.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from skywright.links.servo_bus.protocol import (
    ACK_POLICY,
    ANSWER,
    BAD_CHECKSUM,
    BAD_COMMAND,
    BAD_RANGE,
    BROADCAST,
    CENTRE,
    COMMANDS,
    COUNT_DEG,
    GARBAGE,
    I_JOG,
    IN_PLACE,
    INVALID_PACKET,
    MOTOR_ON,
    MOVING,
    POSITION,
    RAM_READ,
    RAM_WRITE,
    REBOOT,
    S_JOG,
    STAT,
    STATUS,
    TICK_S,
    TORQUE,
    TORQUE_ON,
    VOLTAGE,
    Packet,
    PacketParser,
    pack,
)

RAM_SIZE = 74
SPEED_COUNTS = 60.0 / 0.147 / COUNT_DEG
"""counts/s without load, of the DRS-0201 (0.147 s for 60 deg)."""
OVERLOAD = 0x10
SUPPLY_RAW, TEMPERATURE_RAW = 100, 120  # 7.4 V, and a sensor's value at rest
NOISE = {"checksum": BAD_CHECKSUM, "size": GARBAGE, "garbage": GARBAGE}
"""Bit of the status detail for a cause that the parser counts."""
WRITABLE = {ACK_POLICY, *range(0, 48), STATUS, STATUS + 1, TORQUE, TORQUE + 1}


@dataclass
class EmulatedServo:
    """One servo."""

    servo: int
    now: float = CENTRE  # counts
    goal: float = CENTRE
    rate: float = 0.0  # counts/s towards the goal
    silent: bool = False  # sends no answers
    stuck: bool = False  # the shaft does not turn: overload
    corrupt: int = 0  # number of answers with a wrong checksum
    ram: bytearray = field(default_factory=lambda: bytearray(RAM_SIZE))

    def __post_init__(self) -> None:
        self.reboot()

    def reboot(self) -> None:
        """Reset RAM to its start values: torque off, answers to read requests."""
        self.ram[:] = bytes(RAM_SIZE)
        self.ram[0], self.ram[ACK_POLICY] = self.servo, 1
        self.ram[VOLTAGE], self.ram[VOLTAGE + 1] = SUPPLY_RAW, TEMPERATURE_RAW
        self.goal, self.rate = self.now, 0.0

    @property
    def on(self) -> bool:
        """Whether torque is on."""
        return self.ram[TORQUE] == TORQUE_ON

    def advance(self, dt: float) -> None:
        """Move the shaft for `dt` s."""
        if self.on and self.stuck and abs(self.goal - self.now) > 1.0:
            self.ram[STATUS] |= OVERLOAD
            self.ram[TORQUE] = 0  # by its torque policy
        if not self.on:
            return
        reach = min(self.rate, SPEED_COUNTS) * dt
        if not self.stuck:
            self.now += min(max(self.goal - self.now, -reach), reach)

    def jog(self, counts: int, ticks: int) -> None:
        """Accept a goal; without torque, or with an error, it is ignored."""
        if not self.on or self.ram[STATUS] & OVERLOAD:
            return
        self.goal = float(counts)
        self.rate = abs(self.goal - self.now) / max(ticks * TICK_S, 1e-3)

    def refuse(self, detail: int) -> None:
        """Report an invalid packet, with its bit of the status detail."""
        self.ram[STATUS] |= INVALID_PACKET
        self.ram[STATUS + 1] |= detail

    def build_detail(self) -> int:
        """Return the status detail."""
        there = abs(self.goal - self.now) < 1.0
        return self.ram[STATUS + 1] | (MOTOR_ON if self.on else 0) | (IN_PLACE if there else MOVING)

    def answer(self, packet: Packet) -> bytes | None:
        """Process a packet for this servo; return the answer, if its policy requires one."""
        command, data, error = packet.command, packet.data, 0
        reply = b""
        if command not in COMMANDS:
            error = BAD_COMMAND
        elif command == RAM_READ and len(data) == 2 and sum(data) <= RAM_SIZE:
            raw = round(self.now)
            self.ram[POSITION : POSITION + 2] = bytes([raw & 0xFF, raw >> 8])
            reply = data + bytes(self.ram[data[0] : sum(data)])
        elif command == RAM_WRITE and len(data) >= 2 and len(data) == 2 + data[1]:
            places = range(data[0], data[0] + data[1])
            if not all(p in WRITABLE for p in places):
                error = BAD_RANGE
            else:
                self._write(data[0], data[2:])
        elif command in (RAM_READ, RAM_WRITE):
            error = BAD_RANGE
        elif command == REBOOT:
            self.reboot()
            return None
        if error:
            self.refuse(error)
        policy, reads = self.ram[ACK_POLICY], command in (RAM_READ, STAT)
        if self.silent or packet.servo == BROADCAST or policy == 0 or (policy == 1 and not reads):
            return None
        status = bytes([self.ram[STATUS], self.build_detail()])
        out = bytearray(pack(Packet(self.servo, command | ANSWER, reply + status)))
        if self.corrupt:
            self.corrupt -= 1
            out[5] ^= 0x02
        return bytes(out)

    def _write(self, address: int, data: bytes) -> None:
        before = self.on
        self.ram[address : address + len(data)] = data
        if self.on and not before:  # it holds its current position
            self.goal, self.rate = self.now, 0.0


class Emulator(threading.Thread):
    """Serves servos on a pseudo-terminal; a program opens `path` as its serial port."""

    def __init__(self, ids: list[int], clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__(daemon=True, name="servo emulator")
        import pty
        import tty

        self.servos = {i: EmulatedServo(i) for i in ids}
        self.lock = threading.Lock()
        self._clock, self._ending = clock, threading.Event()
        self._parser = PacketParser()
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._t = clock()

    def run(self) -> None:
        """Answer until `stop`."""
        import select

        while not self._ending.is_set():
            if not select.select([self._master], [], [], 0.005)[0]:
                continue
            with suppress(OSError):
                data = os.read(self._master, 4096)
                for answer in self.feed(data):
                    os.write(self._master, answer)

    def stop(self) -> None:
        """Stop the thread and close the terminal."""
        self._ending.set()
        if self.is_alive():
            self.join(2.0)
        os.close(self._master)
        os.close(self._slave)

    def feed(self, data: bytes) -> list[bytes]:
        """Process bytes of the bus; return the answers."""
        with self.lock:
            now = self._clock()
            for servo in self.servos.values():
                servo.advance(now - self._t)
            self._t = now
            before = self._parser.counts.copy()
            packets, answers = self._parser.feed(data), list[bytes]()
            for cause in NOISE.keys() & (self._parser.counts - before).keys():
                for servo in self.servos.values():  # all hear the wire
                    servo.refuse(NOISE[cause])
            for packet in packets:
                answers += self._take(packet)
            return answers

    def _take(self, packet: Packet) -> list[bytes]:
        if packet.command == S_JOG and packet.data and len(packet.data) % 4 == 1:
            for k in range(1, len(packet.data), 4):
                self._jog(packet.data[k : k + 4], packet.data[0])
            return []
        if packet.command == I_JOG and packet.data and len(packet.data) % 5 == 0:
            for k in range(0, len(packet.data), 5):
                self._jog(packet.data[k : k + 4], packet.data[k + 4])
            return []
        heard = [s for s in self.servos.values() if packet.servo in (s.servo, BROADCAST)]
        found = [s.answer(packet) for s in heard]
        return [a for a in found if a is not None]

    def _jog(self, entry: bytes, ticks: int) -> None:
        servo = self.servos.get(entry[3])
        if servo is not None:
            servo.jog((entry[0] | entry[1] << 8) & 0x3FF, ticks)

    def read_angle(self, servo: int) -> float:
        """Return the current angle (rad) of a shaft."""
        with self.lock:
            return math.radians((self.servos[servo].now - CENTRE) * COUNT_DEG)
