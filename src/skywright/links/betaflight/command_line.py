"""Betaflight's command line over TCP: sends settings, receives errors and the version.

`#` without a line feed opens it. It does not answer while the robot is armed. `save` ends the
process, which its owner must start again.
"""

from __future__ import annotations

import re
import select
import socket
import time

from skywright.core.interrupt import check_interrupt
from skywright.errors import InputError, SimulationError

PROMPT = b"\n# "
QUIET_S = 0.03  # s without more bytes that confirm a prompt: comments begin with the same character
ANSWER_S = 3.0
"""s, time limit of an answer."""
OPEN_S, AGAIN_S = 10.0, 1.0
"""s, time limit to open it, and time between attempts."""
MOST_BYTES = 65536  # of an answer
FAULT = re.compile(r"###\s*ERROR[^#]*###")


class NoCommandLine(SimulationError):
    """The command line does not answer."""


def connect(host: str, port: int, timeout_s: float) -> socket.socket | None:
    """Connect within `timeout_s`; None if no program listens."""
    end = time.monotonic() + timeout_s
    while True:
        check_interrupt()
        try:
            peer = socket.create_connection((host, port), 1.0)
        except OSError:
            if time.monotonic() > end:
                return None
            time.sleep(0.05)
            continue
        peer.setblocking(False)
        return peer


class CommandLine:
    """One session; the caller owns the connection."""

    def __init__(self, peer: socket.socket) -> None:
        self._peer = peer

    def open(self) -> str:
        """Open the command line; return the firmware's version line."""
        end = time.monotonic() + OPEN_S
        while True:  # input during the boot is lost
            check_interrupt()
            self._peer.sendall(b"#")
            if self._is_answered():
                break
            if time.monotonic() > end:
                raise NoCommandLine(f"Betaflight's command line does not open within {OPEN_S:g} s")
        self._peer.sendall(b"\n")  # ends the comment that a second "#" has begun
        self._read("a line feed", ANSWER_S)
        text = self.ask("version")
        found = re.search(r"#?\s*(Betaflight[^\r\n]*)", text)
        if found is None:
            raise NoCommandLine(
                f"the command line answers {text.strip()[:60]!r}; this is not Betaflight"
            )
        return found.group(1).strip()

    def ask(self, line: str) -> str:
        """Send a line; return the answer. Raises InputError for a refused line."""
        self._peer.sendall(line.encode("ascii") + b"\n")
        text = self._read(line, ANSWER_S)
        fault = FAULT.search(text)
        if fault is not None:
            says = fault.group(0).strip("# ")
            raise InputError(
                f"Betaflight refuses {line!r}: {says}; settings are those of release 4.6"
            )
        return text

    def save(self) -> None:
        """Save the settings; the process and the connection end."""
        self._peer.sendall(b"save\n")
        end = time.monotonic() + ANSWER_S
        while time.monotonic() < end:
            check_interrupt()
            if select.select([self._peer], [], [], 0.05)[0]:
                try:
                    if not self._peer.recv(4096):
                        return
                except OSError:
                    return

    def _is_answered(self) -> bool:
        return bool(select.select([self._peer], [], [], AGAIN_S)[0])

    def _read(self, line: str, timeout_s: float) -> str:
        data, end = b"", time.monotonic() + timeout_s
        while True:
            check_interrupt()
            if data.endswith(PROMPT) and not select.select([self._peer], [], [], QUIET_S)[0]:
                return data.decode("ascii", errors="replace")
            if time.monotonic() > end or len(data) > MOST_BYTES:
                raise NoCommandLine(
                    f"Betaflight's command line does not answer {line!r} within {timeout_s:g} s; "
                    "is it armed, or is another program connected?"
                )
            if not select.select([self._peer], [], [], 0.05)[0]:
                continue
            try:
                more = self._peer.recv(4096)
            except OSError:
                more = b""
            if not more:
                raise NoCommandLine(
                    "Betaflight closed its command line; another program is connected to it"
                )
            data += more
