"""The socket that PX4 connects to: one autopilot at a time, with reports of its silence.

PX4 is the client: it retries until the simulator listens, and never reconnects after the connection
breaks. A new connection is therefore a restarted PX4.
"""

from __future__ import annotations

import errno
import select
import socket
import time
from collections.abc import Callable
from typing import Any

from skywright.core.interrupt import check_interrupt
from skywright.errors import InputError
from skywright.links.mavlink.stream import CAUSES as PACKETS
from skywright.links.mavlink.stream import MavlinkStream
from skywright.links.px4.lockstep import CAUSES as ANSWERS
from skywright.links.px4.lockstep import Lockstep
from skywright.links.sitl.fly import AutopilotFailed

PORT = 4560
"""TCP port of PX4's first instance; instance N uses 4560 + N."""
STALL_S = 2.0
"""s without an answer after which this is reported."""
VERSION_MAX = 20
"""Packets of MAVLink 1 without one of MAVLink 2 after which the run ends."""
CHUNK = 4096  # bytes per read
SENSE_S = 0.05  # s between checks for interrupts while waiting


class Px4Server:
    """Sends samples to PX4 and waits for its answers."""

    def __init__(
        self, n_rotors: int, host: str, port: int, *, patience_s: float,
        say: Callable[[str], None],
    ) -> None:  # fmt: skip
        """`patience_s` is the time limit (s) of an answer; `say` receives the events.

        Raises InputError if the port is in use or the host has no address.
        """
        self.lockstep = Lockstep(n_rotors)
        self.stream = MavlinkStream()
        self.patience_s, self.say = patience_s, say
        self._peer: socket.socket | None = None
        self._listener = _listen(host, port)
        self.port = int(self._listener.getsockname()[1])
        self._versions = 0

    @property
    def connected(self) -> bool:
        """Whether an autopilot is connected."""
        return self._peer is not None

    def wait_for_connection(self, timeout_s: float) -> bool:
        """Wait until an autopilot connects; False after `timeout_s`."""
        end = time.monotonic() + timeout_s
        while not self.connected:
            check_interrupt()
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            select.select([self._listener], [], [], min(left, SENSE_S))
            self._accept()
        return True

    def exchange(self, t: float, messages: list[Any]) -> None:
        """Send the messages of the plant's time `t` (s), and wait for an answer if one is due.

        Raises AutopilotFailed if none arrives in time, or if the other end is not a PX4 in
        lockstep.
        """
        self._accept()
        if self._peer is None:
            return
        self.lockstep.send(t)
        if not self._send(b"".join(self.stream.pack(m) for m in messages)):
            return
        start, said = time.monotonic(), False
        while True:
            wait = self.lockstep.is_waiting
            self._receive(SENSE_S if wait else 0.0)
            if not wait or not self.lockstep.is_waiting:
                return
            self._accept()
            waited = time.monotonic() - start
            if waited > STALL_S and not said:
                said = True
                self.say(f"t = {t:.3f} s: PX4 does not answer; time stands still")
            if waited > self.patience_s:
                raise AutopilotFailed(
                    f"PX4 did not answer for {self.patience_s:g} s at t = {t:.3f} s; it is stopped "
                    "in a debugger, or hangs"
                )
            check_interrupt()

    def close(self) -> None:
        """Close both sockets."""
        self._drop("")
        self._listener.close()

    def _accept(self) -> None:
        try:
            peer, address = self._listener.accept()
        except (BlockingIOError, InterruptedError, ConnectionError):
            return
        if self._peer is not None:
            self._receive(0.0)  # the old connection may have ended unnoticed
        if self._peer is not None:
            peer.close()
            self.say(f"a second autopilot at {address[0]} was refused: one is connected")
            return
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer, self._versions = peer, 0
        counts = self.stream.counts
        self.stream = MavlinkStream()
        self.stream.counts = counts
        self.lockstep.connect()
        self.say("PX4 is connected")

    def _drop(self, why: str) -> None:
        if self._peer is None:
            return
        self._peer.close()
        self._peer = None
        self.lockstep.disconnect()
        if why:
            self.say(why)

    def _send(self, data: bytes) -> bool:
        """Send all of `data`; return False if the connection broke."""
        end = time.monotonic() + self.patience_s
        while data and self._peer is not None:
            check_interrupt()
            try:
                data = data[self._peer.send(data) :]
            except (BlockingIOError, InterruptedError):
                if time.monotonic() > end:
                    raise AutopilotFailed(
                        f"PX4 read nothing for {self.patience_s:g} s; it hangs"
                    ) from None
                select.select([], [self._peer], [], SENSE_S)
            except OSError:
                self._drop("PX4 has gone: the rotors stop")
        return self._peer is not None

    def _receive(self, timeout_s: float) -> None:
        """Read received data; wait for them up to `timeout_s`."""
        if self._peer is None:
            return
        if timeout_s > 0.0:
            select.select([self._peer], [], [], timeout_s)
        try:
            data = self._peer.recv(CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if not data:
            self._drop("PX4 has gone: the rotors stop")
            return
        before = self.stream.counts["version"]
        for message in self.stream.feed(data):
            self._versions = -1
            self.lockstep.take(message)
        self._check(self.stream.counts["version"] - before)

    def _check(self, versions: int) -> None:
        """Raise AutopilotFailed if the other end is not a PX4 in lockstep."""
        if self._versions >= 0:
            self._versions += versions
            if self._versions >= VERSION_MAX:
                self._drop("")
                raise AutopilotFailed(
                    "the autopilot speaks MAVLink 1; set MAV_PROTO_VER to 2 in PX4"
                )
        if self.lockstep.trouble:
            says = self.lockstep.trouble
            self._drop("")
            raise AutopilotFailed(f"not a PX4 in lockstep: {says}")

    def describe_refused(self) -> list[str]:
        """Return one line for each cause of refused data."""
        found, causes = self.stream.counts + self.lockstep.counts, {**PACKETS, **ANSWERS}
        return [f"{found[c]} refused: {says}" for c, says in causes.items() if found[c]]


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens without blocking; raises InputError if that fails."""
    try:
        listener = socket.create_server((host, port), backlog=2)
    except OSError as error:
        taken = error.errno == errno.EADDRINUSE
        why = "another simulator listens there" if taken else error.strerror or str(error)
        raise InputError(
            f"TCP port {port} on {host}: {why}; choose a free port for PX4's simulator"
        ) from None
    listener.setblocking(False)
    return listener
