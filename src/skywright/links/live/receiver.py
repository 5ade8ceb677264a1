"""Receiver of live streams: order, age, and counts of refused samples.

The offset of a sender's clock is its smallest delay: age = (arrival - t) - the smallest of (arrival
- t) within the last FORGET_S. No common clock is needed, and clock drift is tracked. Only the
newest sample of a stream is used. A sample that is older than STALE_S when it arrives is counted
and written to files, but never becomes the newest. The same holds for a single sample whose time is
ahead of its clock: a wrong time does not change the offset.
"""

from __future__ import annotations

import math
import socket
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

from skywright.errors import InputError
from skywright.links.live.odometry import ODOMETRY, OdometrySenders, parse_odometry
from skywright.links.live.packets import (
    CAUSES,
    MAGIC,
    SEQUENCES,
    LineSplitter,
    Refused,
    Sample,
    parse_line,
    parse_pose,
)
from skywright.links.mavlink.stream import CAUSES as MAVLINK_CAUSES
from skywright.links.mavlink.stream import MavlinkStream
from skywright.links.servo_bus.bus import BAUD, BAUDS, Port, open_port
from skywright.links.udp.address import parse_address

STALE_S = 0.25
FORGET_S, BUCKET_S = 30.0, 1.0
"""s of validity of a clock's smallest delay, and its resolution."""
AHEAD_S = 1.0
"""s by which the smallest delay may fall at once; a larger step counts from its second time."""
STREAMS_MAX, CLOCKS_MAX = 64, 64
AT_ONCE = 256  # datagrams per poll
MAVLINK_2 = 0xFD
BUFFER = 1 << 22
"""Bytes of the socket's receive buffer, for times when a busy computer does not read it."""


class Arrived(NamedTuple):
    """A sample and its time of arrival."""

    sample: Sample
    arrival: float  # s, monotonic
    age: float  # s, at arrival; negative: its time is ahead of its clock by more than AHEAD_S


class DelayClock:
    """Smallest (arrival - t) of one sender's clock, of the last FORGET_S."""

    def __init__(self) -> None:
        self._buckets: deque[tuple[float, float]] = deque()  # bucket's time, smallest difference
        self._ahead = math.inf  # s, time of the last sample if it was ahead of the clock

    def take(self, t: float, arrival: float) -> float:
        """Add a sample; return its age (s) on arrival.

        The first of consecutive samples that are ahead of the clock by more than AHEAD_S does not
        change the offset, nor do others with the same time: their ages are negative.
        """
        difference, at = arrival - t, math.floor(arrival / BUCKET_S)
        ahead = bool(self._buckets) and difference < self.offset - AHEAD_S
        if ahead and not t > self._ahead:  # the streams of one frame have the same time
            self._ahead = t
            return difference - self.offset
        self._ahead = math.inf
        if self._buckets and self._buckets[-1][0] == at:
            if difference < self._buckets[-1][1]:
                self._buckets[-1] = (at, difference)
        else:
            self._buckets.append((at, difference))
        while self._buckets[0][0] < at - FORGET_S / BUCKET_S:
            self._buckets.popleft()
        return difference - self.offset

    @property
    def offset(self) -> float:
        """Local clock minus the sender's (s), including the smallest delay."""
        return min(d for _, d in self._buckets)


class Stream:
    """A stream: one name of one kind."""

    def __init__(self, kind: str, name: str) -> None:
        self.kind, self.name = kind, name
        self.newest: Arrived | None = None
        """The newest sample that was fresh at arrival."""
        self.count = self.stale = self.restarts = self.lost = 0
        self._last: Sample | None = None

    def take(self, sample: Sample, arrival: float, delay: DelayClock) -> Arrived:
        """Add a sample that arrived at `arrival` (s); `delay` is that of its clock.

        Raises Refused for one that is not new; `delay` then remains as it is.
        """
        last = self._last
        if last is not None and sample.clock != last.clock:
            self.restarts += 1
            last = None
        elif last is not None:
            ahead = (sample.sequence - last.sequence) % SEQUENCES
            if not 0 < ahead < SEQUENCES // 2:
                raise Refused("old")
            if sample.t < last.t:
                raise Refused("clock")
            self.lost += ahead - 1
        age = delay.take(sample.t, arrival)
        self._last = sample
        if age < 0.0:  # a wrong time: later ones are compared with the last right one
            self._last = sample._replace(t=-math.inf if last is None else last.t)
        self.count += 1
        arrived = Arrived(sample, arrival, age)
        if age > STALE_S:
            self.stale += 1
        elif age >= 0.0:
            self.newest = arrived
        return arrived


class LiveReceiver:
    """Receives pose packets, MAVLink ODOMETRY and lines on one UDP port or serial port."""

    def __init__(
        self, address: str, option: str = "receive", clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`address` is udp:PORT, udp:HOST:PORT, serial:PORT or serial:PORT:BAUD.

        Raises InputError that names `option`.
        """
        self.streams: dict[tuple[str, str], Stream] = {}
        self.counts: Counter[str] = Counter()
        self.clocks: dict[int, DelayClock] = {}
        self._clock = clock
        self._socket: socket.socket | None = None
        self._serial: Port | None = None
        self._splitter = LineSplitter()
        self._mavlink: MavlinkStream | None = None
        self._senders = OdometrySenders()
        self.port = 0
        self.failure = ""
        """Why reception has ended, such as a failed serial port, or ""."""
        if address.startswith("serial:"):
            path, baud = split_serial(address, option)
            self._serial = open_port(path, baud, option)
            self._serial.timeout = 0.0
            return
        place = parse_address(address, option)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(place)
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"{option} {address}: cannot listen on this address: {error.strerror or error}"
            ) from None
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])

    def close(self) -> None:
        """Stop listening."""
        if self._socket is not None:
            self._socket.close()
        if self._serial is not None:
            self._serial.close()

    def poll(self) -> list[Arrived]:
        """Return the samples of all streams since the last call, in the order of arrival."""
        found: list[Arrived] = []
        if self._serial is not None:
            try:
                data = self._serial.read(65536)
            except OSError as error:
                self.failure = f"the serial port has failed: {error}"
                return found
            for line in self._splitter.feed(data):
                self._take(lambda line=line: parse_line(line), found)  # type: ignore[misc]
            return found
        assert self._socket is not None
        for _ in range(AT_ONCE):
            try:
                data = self._socket.recv(4096)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:
                continue
            self.feed(data, found)
        return found

    def feed(self, data: bytes, found: list[Arrived]) -> None:
        """Process one datagram; its samples are appended to `found`."""
        if data[:4] == MAGIC:
            self._take(lambda: parse_pose(data), found)
        elif data[:1] == bytes([MAVLINK_2]):
            self._feed_mavlink(data, found)
        elif data[:1] == b"$":
            for line in data.splitlines():
                if line.strip():
                    self._take(lambda line=line: parse_line(line), found)  # type: ignore[misc]
        else:
            self.counts["size"] += 1

    def _feed_mavlink(self, data: bytes, found: list[Arrived]) -> None:
        if self._mavlink is None:
            try:
                self._mavlink = MavlinkStream()
            except InputError:  # invalid data must not end a recording
                self.counts["extra"] += 1
                return
        for message in self._mavlink.feed(data):
            if message.get_msgId() == ODOMETRY:
                self._take(lambda m=message: self._senders.number(parse_odometry(m)), found)  # type: ignore[misc]

    def _take(self, parse: Callable[[], Sample], found: list[Arrived]) -> None:
        try:
            found.append(self._accept(parse()))
        except Refused as refused:
            self.counts[str(refused)] += 1

    def _accept(self, sample: Sample) -> Arrived:
        arrival, key = self._clock(), (sample.kind, sample.name)
        if key not in self.streams:
            if len(self.streams) >= STREAMS_MAX:
                raise Refused("streams")
            self.streams[key] = Stream(*key)
        if sample.clock not in self.clocks and len(self.clocks) >= CLOCKS_MAX:
            self.clocks.pop(next(iter(self.clocks)))
        delay = self.clocks.setdefault(sample.clock, DelayClock())
        return self.streams[key].take(sample, arrival, delay)

    def find(self, name: str) -> Stream | None:
        """Return the stream of a name."""
        return next((s for (_, n), s in self.streams.items() if n == name), None)

    def measure_age(self, stream: Stream) -> float:
        """Return the age (s) of a stream's newest sample; infinite without one."""
        if stream.newest is None:
            return math.inf
        return stream.newest.age + self._clock() - stream.newest.arrival

    def describe_refused(self) -> list[str]:
        """Return one line for each cause of refused data."""
        lines = [
            f"{self.counts[c]} refused: {says}" for c, says in CAUSES.items() if self.counts[c]
        ]
        if self._mavlink is not None:
            found = self._mavlink.counts
            lines += [
                f"{found[c]} refused: {says}" for c, says in MAVLINK_CAUSES.items() if found[c]
            ]
        return lines


def split_serial(address: str, option: str) -> tuple[str, int]:
    """Return path and baud of serial:PORT or serial:PORT:BAUD; raises InputError."""
    rest = address.removeprefix("serial:")
    path, _, baud = rest.rpartition(":")
    if not (path and baud.isascii() and baud.isdigit()):
        path, baud = rest, str(BAUD)
    if not path or int(baud) not in BAUDS:
        rates = ", ".join(str(b) for b in BAUDS)
        raise InputError(f"{option} {address[:80]!r}; valid: serial:PORT[:BAUD], BAUD {rates}")
    return path, int(baud)
