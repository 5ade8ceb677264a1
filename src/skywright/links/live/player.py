"""Plays recorded samples at their recorded pace."""

from __future__ import annotations

import math
import os
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from heapq import merge
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.interrupt import check_interrupt
from skywright.errors import InputError
from skywright.links.live.odometry import pack_odometry
from skywright.links.live.packets import (
    LINES,
    NAME_MAX,
    Sample,
    check_name,
    format_line,
    pack_pose,
)
from skywright.links.live.receiver import split_serial
from skywright.links.mavlink.stream import MavlinkStream, load_dialect
from skywright.links.servo_bus.bus import Port, open_port
from skywright.links.udp.address import parse_address

Array = NDArray[np.float64]

T_MAX = 1e13
"""s, limit of the microseconds in ODOMETRY (64 bits)."""
SYSTEMS_MAX = 255  # largest system id


class Track(NamedTuple):
    """Samples of one stream, in order of time."""

    kind: str  # "position", "pose", "SKYEC" or "SKYFT"
    name: str
    t: Array  # (n,) s
    values: Array  # (n, k)
    source: str = ""
    """Name of the clock of `t`; tracks of one source share it."""


class Target:
    """Destination of samples: udp:HOST:PORT, mavlink:HOST:PORT or serial:PORT[:BAUD]."""

    def __init__(self, address: str) -> None:
        """Raises InputError for anything else."""
        kind = address.partition(":")[0]
        self.kind = kind
        self._socket: socket.socket | None = None
        self._serial: Port | None = None
        self._mavlink: dict[str, MavlinkStream] | None = None
        if kind == "serial":
            self._serial = open_port(*split_serial(address, "--to"), "--to")
        elif kind in ("udp", "mavlink"):
            try:
                self._place = parse_address("udp" + address[len(kind) :], "--to")
            except InputError as error:
                raise InputError(str(error).replace("udp:", f"{kind}:")) from None
            if kind == "mavlink":
                load_dialect()  # fails early if it is not installed
                self._mavlink = {}
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        else:
            raise InputError(
                f"--to {address[:80]!r}; valid: udp:[HOST:]PORT, mavlink:[HOST:]PORT, "
                "serial:PORT[:BAUD]"
            )

    def takes(self, kind: str) -> bool:
        """Whether samples of a kind can be sent there."""
        if self.kind == "serial":
            return kind in LINES
        return kind == "pose" if self.kind == "mavlink" else True

    def send(self, sample: Sample) -> None:
        """Send one sample; UDP may lose it. Raises InputError if a serial port refuses it."""
        if self._mavlink is not None:  # one system per stream: the message has no name
            if sample.name not in self._mavlink:
                self._mavlink[sample.name] = MavlinkStream(1 + len(self._mavlink))
            data = pack_odometry(self._mavlink[sample.name], sample)
        else:
            data = format_line(sample) if sample.kind in LINES else pack_pose(sample)
        if self._serial is not None:
            try:
                self._serial.write(data)
            except OSError as error:
                raise InputError(f"--to serial: cannot write to the port: {error}") from None
            return
        assert self._socket is not None
        try:
            self._socket.sendto(data, self._place)
        except OSError:  # no program listens
            return

    def close(self) -> None:
        """Close it."""
        if self._socket is not None:
            self._socket.close()
        if self._serial is not None:
            self._serial.close()


def make_name(text: str) -> str:
    """Return a valid stream name that resembles `text`."""
    kept = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in text)
    kept = kept[:NAME_MAX]
    return kept if check_name(kept) else ("_" + kept)[:NAME_MAX]


def list_samples(tracks: Sequence[Track]) -> Iterator[tuple[float, Sample]]:
    """Return all samples with the time (s) at which each is due, in order.

    The first sample of each source is due at 0: clocks of different sources are unrelated.
    """
    first = int.from_bytes(os.urandom(3), "little")
    sources = {track.source for track in tracks}
    clocks = {source: first + k for k, source in enumerate(sorted(sources))}
    starts = {s: min(float(tr.t[0]) for tr in tracks if tr.source == s) for s in sources}

    def follow(track: Track) -> Iterator[tuple[float, Sample]]:
        clock, start = clocks[track.source], starts[track.source]
        for i in range(len(track.t)):
            t = float(track.t[i])
            values = tuple(float(v) for v in track.values[i])
            yield t - start, Sample(track.kind, track.name, clock, i, t, values)

    return merge(*(follow(track) for track in tracks), key=lambda pair: pair[0])


def play(
    tracks: Sequence[Track], target: Target, speed: float = 1.0,
    clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep,
) -> dict[str, int]:  # fmt: skip
    """Send tracks at `speed` times real time; return the number of samples sent per track.

    Raises InputError if the target accepts none of them, or if two have the same name.
    """
    taken = [track for track in tracks if target.takes(track.kind) and len(track.t)]
    if not taken:
        names = ", ".join(f"{track.name} ({track.kind})" for track in tracks) or "nothing"
        raise InputError(f"--to {target.kind}: takes none of {names}")
    sent = dict.fromkeys((track.name for track in taken), 0)
    if len(sent) < len(taken):
        names = ", ".join(f"{track.name} of {track.source}" for track in taken)
        raise InputError(f"play: two streams have one name ({names}); play them one by one")
    if target.kind == "mavlink" and len(taken) > SYSTEMS_MAX:
        raise InputError(f"--to mavlink: {len(taken)} streams; valid: up to {SYSTEMS_MAX}")
    for track in taken if target.kind == "mavlink" else ():
        first, last = float(track.t[0]), float(track.t[-1])
        if not 0.0 <= first <= last < T_MAX:
            raise InputError(
                f"--to mavlink: {track.source or track.name}: times from {first:g} to {last:g} s; "
                f"valid in ODOMETRY: 0 to {T_MAX:g} s (--to udp takes all)"
            )
    begin = clock()
    for due, sample in list_samples(taken):
        check_interrupt()
        if math.isfinite(speed):
            left = begin + due / speed - clock()
            while left > 0.0:
                sleep(min(left, 0.1))
                check_interrupt()
                left = begin + due / speed - clock()
        target.send(sample)
        sent[sample.name] += 1
    return sent
