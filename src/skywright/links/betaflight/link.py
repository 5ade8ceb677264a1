"""The sockets to one Betaflight: sends state and sticks, receives outputs, reads its state by MSP.

Betaflight answers each state packet with one packet of outputs after the next run of its loop. A
broken MSP connection means that the process has ended.
"""

from __future__ import annotations

import errno
import socket
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from skywright.core.interrupt import check_interrupt
from skywright.errors import InputError
from skywright.links.betaflight import msp
from skywright.links.betaflight.packets import (
    CAUSES,
    OUTPUTS_PORT,
    STATE_PORT,
    STICKS_PORT,
    parse_outputs,
)

Array = NDArray[np.float64]

ASK_S = 0.05
"""s between requests for its state."""
AT_ONCE = 64  # datagrams per read
REFUSALS_MAX = 50
"""Refused outputs in a row that end the flight."""
MSP_CAUSES = {
    "checksum": "an MSP frame whose checksum is wrong",
    "garbage": "bytes that belong to no MSP frame",
    "refused": "a request that Betaflight refused",
}


class Ports:
    """Address of Betaflight; its ports are compiled into it, tests use others."""

    def __init__(self, outputs: int = OUTPUTS_PORT, state: int = STATE_PORT,
                 sticks: int = STICKS_PORT) -> None:  # fmt: skip
        self.outputs, self.state, self.sticks = outputs, state, sticks


class BetaflightLink:
    """Datagrams and MSP of a flight."""

    def __init__(
        self, n: int, host: str, ports: Ports, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`n` motors. Raises InputError if the port of the outputs is in use."""
        self.n, self._clock = n, clock
        self.counts: Counter[str] = Counter()
        self.status: msp.Status | None = None
        self.attitude: tuple[float, float, float] | None = None  # deg
        self.gone = False
        """Whether its process has ended."""
        self.command = np.zeros(n)
        """Shares (n,) of the rotors' full speeds, from the newest outputs."""
        self._heard = -np.inf
        self._refused = 0
        self._cause = ""
        self._asked = -np.inf
        self._told = -np.inf  # time of its last state report
        self._peer: socket.socket | None = None
        self._parser = msp.MspParser()
        self._host, self._ports = host, ports
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._in.bind((host, ports.outputs))
        except OSError as error:
            self.close()
            taken = error.errno == errno.EADDRINUSE
            why = "another simulator listens there" if taken else error.strerror or str(error)
            raise InputError(
                f"UDP port {ports.outputs} on {host}: {why}; Betaflight's ports are fixed, so one "
                "instance runs on a computer"
            ) from None
        self._in.setblocking(False)

    def attach(self, peer: socket.socket) -> None:
        """Set the connection for MSP."""
        self.detach()
        self._peer, self._parser, self.gone = peer, msp.MspParser(), False
        self.status = self.attitude = None
        self._told = self._clock()

    def detach(self) -> None:
        """Close the connection for MSP."""
        if self._peer is not None:
            self._peer.close()
            self._peer = None

    def close(self) -> None:
        """Close all sockets."""
        self.detach()
        self._out.close()
        self._in.close()

    def send(self, state: bytes, sticks: bytes | None) -> None:
        """Send a state, and sticks if they are due; a datagram that fails is lost."""
        for data, port in ((state, self._ports.state), (sticks, self._ports.sticks)):
            if data is not None:
                try:
                    self._out.sendto(data, (self._host, port))
                except OSError:
                    self.counts["unsent"] += 1

    def poll(self) -> None:
        """Process received data, and request its state if that is due."""
        now = self._clock()
        for _ in range(AT_ONCE):
            try:
                data = self._in.recv(256)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                continue
            self._take(data, now)
        self._poll_msp(now)

    def _take(self, data: bytes, now: float) -> None:
        found = parse_outputs(data, self.n)
        if isinstance(found, str):
            self.counts[found] += 1
            self._refused += 1
            self._cause = found
            return
        self.counts["outputs"] += 1
        self._refused = 0
        self.command, self._heard = found, now

    def _poll_msp(self, now: float) -> None:
        if self._peer is None:
            return
        try:
            data = self._peer.recv(4096)
            if not data:
                raise ConnectionError
            for frame in self._parser.feed(data):
                self._take_frame(frame)
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            self.detach()
            self.gone = True
            return
        if now - self._asked >= ASK_S:
            self._asked = now
            with suppress(
                OSError
            ):  # its queue is full, or it has ended, which the next read detects
                self._peer.send(msp.pack_request(msp.STATUS) + msp.pack_request(msp.ATTITUDE))

    def _take_frame(self, frame: msp.Frame) -> None:
        if frame.command == msp.STATUS:
            self.status, self._told = msp.parse_status(frame.payload) or self.status, self._clock()
        elif frame.command == msp.ATTITUDE:
            self.attitude = msp.parse_attitude(frame.payload) or self.attitude

    @property
    def silence_s(self) -> float:
        """Time (s) since the newest outputs; infinite before the first."""
        return float(self._clock() - self._heard)

    @property
    def untold_s(self) -> float:
        """Time (s) since its last state report by MSP."""
        return float(self._clock() - self._told)

    @property
    def trouble(self) -> str:
        """Return why the flight must end, or ""."""
        if self._refused < REFUSALS_MAX:
            return ""
        return f"{self._refused} packets in a row were refused: {CAUSES[self._cause]}"

    def describe_refused(self) -> list[str]:
        """Return one line for each cause of refused data."""
        found, causes = self.counts + self._parser.counts, {**CAUSES, **MSP_CAUSES}
        return [f"{found[c]} refused: {says}" for c, says in causes.items() if found[c]]


def wait(seconds: float) -> None:
    """Sleep, and check for interrupts."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        check_interrupt()
        time.sleep(min(0.05, max(end - time.monotonic(), 0.0)))
