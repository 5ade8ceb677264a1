"""A peer for the simulator's side of Betaflight's SITL target (4.6): ports, command line, MSP.

It behaves as documented and flies by a small mixer of its own, so that the rules can be tested;
figures of flights count only with the real firmware. Ports are free ones: the firmware's are fixed.
"""

from __future__ import annotations

import select
import socket
import struct
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from skywright.links.betaflight import msp
from skywright.links.betaflight.link import Ports
from skywright.links.betaflight.packets import OUTPUTS, STATE, STICKS


@dataclass
class Wrong:
    """What goes wrong, by the number of the state packet since arming."""

    silent: dict[int, float] = field(default_factory=dict)  # s without outputs
    vanish: int = -1  # the process ends
    disarm: int = -1
    junk: set[int] = field(default_factory=set)  # datagrams that are no outputs
    nan: set[int] = field(default_factory=set)
    count: int = 0  # another number of motors, 0: that of the mixer
    refuses: str = ""  # a line that the command line does not know
    never_arms: int = 0  # flags that stay


class BetaflightPeer(threading.Thread):
    """Serves one set-up and one flight."""

    def __init__(self, wrong: Wrong | None = None) -> None:
        super().__init__(daemon=True)
        self.wrong = wrong or Wrong()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.command_port = int(self.listener.getsockname()[1])
        self.state, self.sticks = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in "ab")
        for s in (self.state, self.sticks):
            s.bind(("127.0.0.1", 0))
            s.setblocking(False)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            s.bind(("127.0.0.1", 0))
            outputs = int(s.getsockname()[1])
        self.ports = Ports(outputs, self.state.getsockname()[1], self.sticks.getsockname()[1])
        self.lines: list[str] = []
        self.mixer: dict[int, list[float]] = {}
        self.settings: dict[str, str] = {}
        self.states: list[tuple[float, ...]] = []
        self.channels: tuple[int, ...] = (1500,) * 16
        self.armed = self.angle = False
        self.since = 0
        self.ending = threading.Event()
        self.failure = ""

    def run(self) -> None:
        """Serve until stopped."""
        self.listener.settimeout(0.2)
        with suppress(OSError):
            while not self.ending.is_set():
                try:
                    peer, _ = self.listener.accept()
                except TimeoutError:
                    continue
                with peer:
                    self._serve(peer)

    def stop(self) -> None:
        """End it."""
        self.ending.set()
        self.join(5.0)
        for s in (self.listener, self.state, self.sticks):
            s.close()

    def _serve(self, peer: socket.socket) -> None:
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        line, in_line, waiting = b"", False, b""
        while not self.ending.is_set():
            data, ready = b"", select.select([peer, self.state], [], [], 0.005)[0]
            if peer in ready:
                data = peer.recv(4096)
                if not data:
                    return
            if data.startswith(b"#") and not in_line:
                in_line, data = True, data[1:]
                peer.sendall(b"\r\nEntering CLI Mode, type 'exit' or 'save' to return\r\n\r\n# ")
            if in_line:
                line += data
                while b"\n" in line:
                    text, line = line.split(b"\n", 1)
                    if not self._answer_line(peer, text.decode()):
                        return
                continue
            waiting = self._answer_msp(peer, waiting + data)
            if not self._fly():
                return

    def _answer_line(self, peer: socket.socket, text: str) -> bool:
        self.lines.append(text)
        answer = ""
        if text == "version":
            answer = "# Betaflight / SITL (SITL) 4.6.0 peer MSP API: 1.47\r\n"
        elif text == "save":
            return False
        elif self.wrong.refuses and text.startswith(self.wrong.refuses):
            answer = f"###ERROR IN set: INVALID NAME: {text}###\r\n"
        elif text.startswith("mmix ") and "reset" not in text:
            i, *row = text.split()[1:]
            self.mixer[int(i)] = [float(x) for x in row]
        elif text.startswith("set "):
            name, value = text[4:].split(" = ")
            self.settings[name] = value
        peer.sendall(f"{text}\r\n{answer}\r\n# ".encode())
        return True

    def _answer_msp(self, peer: socket.socket, data: bytes) -> bytes:
        while len(data) >= 6 and data[:3] == b"$M<":
            size, command = data[3], data[4]
            data = data[6 + size :]
            if command == msp.STATUS:
                flags = self.wrong.never_arms
                modes = self.armed | self.angle << 1
                payload = struct.pack(
                    "<HHHIBHBBBBIB", 125, 0, 33, modes, 0, 0, 4, 0, 0, 29, flags, 0
                )
                peer.sendall(msp.pack_answer(command, payload))
            elif command == msp.ATTITUDE:
                peer.sendall(msp.pack_answer(command, struct.pack("<3h", 0, 0, 0)))
        return data

    def _fly(self) -> bool:
        """Answer each state by one packet of outputs; False where the process ends."""
        with suppress(BlockingIOError):
            while True:
                self.channels = STICKS.unpack(self.sticks.recv(100))[1:]
        wanted = self.channels[4] > 1700 and self.channels[5] > 1700
        if wanted and not self.armed and not self.wrong.never_arms and self.channels[2] < 1050:
            self.armed, self.since = True, 0
        if not wanted:
            self.armed = False
        data = b""
        with suppress(BlockingIOError):  # the newest: a loop that is late does not fall behind
            while True:
                data = self.state.recv(256)
        if not data:
            return True
        state = STATE.unpack(data)
        self.states.append(state)
        if self.armed:
            self.since += 1
            if self.since == self.wrong.vanish:
                return False
            if self.since == self.wrong.disarm:
                self.wrong.never_arms, self.armed = 1 << 6, False
            if self.since in self.wrong.silent:
                time.sleep(self.wrong.silent.pop(self.since))
        command = self._mix(state) if self.armed else np.zeros(len(self.mixer))
        values = [1000.0 + 1000.0 * c for c in command] + [0.0] * (16 - len(command))
        if self.since in self.wrong.nan:
            values[0] = float("nan")
        packet = OUTPUTS.pack(self.wrong.count or len(command), *values)
        at = ("127.0.0.1", self.ports.outputs)
        if self.since in self.wrong.junk:
            self._out.sendto(b"junk", at)
        self._out.sendto(packet, at)
        return True

    def _mix(self, state: tuple[float, ...]) -> np.ndarray:
        """ANGLE mode in short: attitude and rate feedback, and the settings' mixer."""
        w = np.array(state[1:4]) * [1, -1, -1]  # FLU
        qw, qx, qy, qz = state[7:11]
        qy, qz = -qy, -qz
        roll = np.arctan2(2 * (qw * qx + qy * qz), 1 - 2 * (qx**2 + qy**2))
        pitch = np.arcsin(np.clip(2 * (qw * qy - qz * qx), -1, 1))
        limit = np.radians(float(self.settings["angle_limit"]))
        stick = (np.array(self.channels[:4]) - 1500) / 500
        rate = np.array([6 * (stick[0] * limit - roll), 6 * (stick[1] * limit - pitch),
                         -stick[3] * np.radians(100)])  # fmt: skip
        torque = np.array([0.15, 0.15, 0.4]) * (rate - w)
        low = int(self.settings["min_check"])
        throttle = max(self.channels[2] - low, 0) / (2000 - low)
        idle = 1e-4 * float(self.settings["motor_idle"])
        mix = np.array([self.mixer[i] for i in range(len(self.mixer))])
        add = mix[:, 1:] @ (torque * [1, 1, -1]) if throttle > 0 else 0.0
        return np.clip(idle + (1 - idle) * (throttle * mix[:, 0] + add), idle, 1.0)
