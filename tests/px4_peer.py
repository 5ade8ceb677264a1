"""A peer for the simulator's side of PX4's protocol: what simulator_mavlink of release 1.14 does.

It speaks the protocol and flies nothing: figures of flights count only with a real autopilot. What
it does is in the source of that module: it connects and retries, asks for the truth every 5 ms,
sets its clock by HIL_SENSOR, boots for some samples, then answers each sample with one
HIL_ACTUATOR_CONTROLS that carries its clock, zeros while disarmed. It refuses to arm without
sensors that are alive.
"""

from __future__ import annotations

import socket
import threading
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common

BOOT_SAMPLES = 15
ARMED = 128


@dataclass
class Misbehaviour:
    """What goes wrong, by the number of the sample (from 0)."""

    drop: set[int] = field(default_factory=set)  # no answer
    twice: set[int] = field(default_factory=set)  # the answer is sent two times
    late: set[int] = field(default_factory=set)  # the answer of the sample before comes again
    nan: set[int] = field(default_factory=set)  # a command is not a number
    junk: set[int] = field(default_factory=set)  # bytes that are no packet come before it
    stall: dict[int, float] = field(default_factory=dict)  # s of silence before the answer
    vanish: int = -1  # the connection breaks here
    jump_us: dict[int, int] = field(default_factory=dict)  # from here on its clock is off
    version_1: bool = False  # it speaks MAVLink 1
    lockstep: bool = True  # it was built with lockstep


class Px4Peer(threading.Thread):
    """Connects to a simulator and answers; `command` is what armed motors are told."""

    def __init__(
        self, port: int, wrong: Misbehaviour | None = None, command: Any = (), samples: int = 10**9
    ) -> None:
        """`command` is (n,) or a function of the newest HIL_SENSOR; ends after `samples`."""
        super().__init__(daemon=True)
        self.port, self.wrong, self.command = port, wrong or Misbehaviour(), command
        self.samples, self.seen, self.messages = samples, 0, Counter[str]()
        self.newest: dict[str, Any] = {}
        self.times: list[int] = []
        self.waited = 0  # samples that came before the last one was answered: lockstep is broken
        self.armed = False
        self.refusals: list[str] = []
        self._mags: list[tuple[float, ...]] = []
        self._pressures: list[float] = []
        self._mav = common.MAVLink(None, 1, 1)
        self._parser = common.MAVLink(None)
        self._ending = threading.Event()
        self.socket: socket.socket | None = None

    def run(self) -> None:
        """Connect, with retries, and serve until the connection ends."""
        while not self._ending.is_set():
            try:
                self.socket = socket.create_connection(("127.0.0.1", self.port), 5.0)
                break
            except OSError:
                time.sleep(0.005)
        if self.socket is None:
            return
        with suppress(OSError), self.socket:
            self._serve(self.socket)

    def stop(self) -> None:
        """End it as a killed process ends."""
        self._ending.set()
        if self.socket is not None:
            with suppress(OSError):
                self.socket.shutdown(socket.SHUT_RDWR)

    def _serve(self, s: socket.socket) -> None:
        self._send(s, common.MAVLink_command_long_message(0, 0, 511, 0, 115, 5e3, 0, 0, 0, 0, 0))
        self._send(s, common.MAVLink_heartbeat_message(0, 12, 0, 0, 0, 3))
        s.settimeout(0.2)
        while not self._ending.is_set() and self.seen < self.samples:
            try:
                data = s.recv(2048)
            except TimeoutError:
                continue
            if not data:
                return
            sensors = 0
            for m in self._parser.parse_buffer(data) or []:
                self.messages[m.get_type()] += 1
                self.newest[m.get_type()] = m
                if m.get_type() == "HIL_SENSOR" and m.id == 0:
                    sensors += 1
                    if not self._take_sample(s, m):
                        return
            if self.seen > BOOT_SAMPLES + 10:
                self.waited += max(sensors - 1, 0)

    def _take_sample(self, s: socket.socket, m: Any) -> bool:
        k, wrong = self.seen, self.wrong
        self.seen += 1
        self.times.append(m.time_usec)
        if m.fields_updated & 0x1C0 == 0x1C0:
            self._mags = [*self._mags[-9:], (m.xmag, m.ymag, m.zmag)]
        if m.fields_updated & 0x1A00 == 0x1A00:
            self._pressures = [*self._pressures[-9:], m.abs_pressure]
        if k < BOOT_SAMPLES:
            return True
        if k == wrong.vanish:
            return False
        if k in wrong.stall:
            time.sleep(wrong.stall[k])
        if k in wrong.junk:
            s.sendall(b"\xfd\x30\x00garbage" + bytes(range(200)))
        if k in wrong.drop:
            return True
        clock = m.time_usec + sum(j for at, j in wrong.jump_us.items() if k >= at)
        if k in wrong.late:
            self._answer(s, self.times[-2], m)
        self._answer(s, clock, m, nan=k in wrong.nan)
        if k in wrong.twice:
            self._answer(s, clock, m)
        return True

    def _answer(self, s: socket.socket, clock: int, m: Any, nan: bool = False) -> None:
        controls = np.zeros(16)
        if self.armed:
            told = self.command(self) if callable(self.command) else self.command
            controls[: len(told)] = told
        if nan:
            controls[0] = np.nan
        mode = 1 | (ARMED if self.armed else 0)
        flags = 1 if self.wrong.lockstep else 0
        self._send(s, common.MAVLink_hil_actuator_controls_message(clock, controls, mode, flags))

    def arm(self) -> bool:
        """Arm, or note why not, as PX4's preflight checks do."""
        why = []
        if len(set(self._mags)) < 5:
            why.append("magnetometer stale")
        if len(set(self._pressures)) < 5:
            why.append("barometer stale")
        placed = self.messages["ODOMETRY"] + self.messages["HIL_GPS"]
        if placed < 5:
            why.append("no position")
        sensor = self.newest.get("HIL_SENSOR")
        if sensor is None or not 9.0 < -sensor.zacc < 10.6:
            why.append("accelerometer inconsistent with rest")
        self.refusals = why
        self.armed = not why
        return self.armed

    def _send(self, s: socket.socket, message: Any) -> None:
        data = message.pack(self._mav, force_mavlink1=self.wrong.version_1)
        self._mav.seq = (self._mav.seq + 1) % 256
        s.sendall(data)
