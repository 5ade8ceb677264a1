"""Endpoints of MAVLink: `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT`,
`serial:DEVICE:BAUD`.

`udpin` listens and answers its senders, `udpout` sends first, `tcp` connects. No function blocks or
raises on received data, and memory is bounded.
"""

from __future__ import annotations

import ipaddress
import os
import socket
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

from skywright.errors import InputError
from skywright.links.mavlink.stream import MavlinkStream

KINDS = ("udpin", "udpout", "tcp", "serial")
AT_ONCE = 200  # datagrams per read: bounds the time of a tick under a flood of datagrams
PEERS = 8
"""Most senders that an endpoint answers."""
SILENT_S = 10.0  # s of silence after which a sender of `udpin` receives nothing more
SIZE = 2048
RETRY_S = 1.0  # s between attempts to connect


class Url(NamedTuple):
    """Kind and address of an endpoint."""

    kind: str
    host: str  # of serial: the device
    port: int  # of serial: the baud rate

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"

    @property
    def is_local(self) -> bool:
        """Whether it is reachable from this computer only."""
        if self.kind == "serial":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"


def parse_url(text: str, option: str = "--mavlink") -> Url:
    """Return an endpoint; raises InputError, which names the option, for an invalid one."""
    valid = "udpin:[HOST:]PORT, udpout:[HOST:]PORT, tcp:[HOST:]PORT, serial:DEVICE[:BAUD]"
    kind, _, rest = str(text).partition(":")
    rest = rest.removeprefix("//")
    host, _, last = rest.rpartition(":")
    if kind == "serial" and rest:
        device, baud = (host, last) if host and last.isdecimal() else (rest, "57600")
        if not (len(baud) < 8 and int(baud) > 0):
            raise InputError(f"{option} {text!r}: baud {baud[:20]}; valid: such as 57600 or 921600")
        return Url(kind, device, int(baud))
    port = int(last) if last.isdecimal() and len(last) < 6 else 0
    if kind not in KINDS or not 0 < port < 65536:
        raise InputError(f"{option} {text!r} is no MAVLink address; valid: {valid}")
    return Url(kind, host or "127.0.0.1", port)


class Peer:
    """The other end of a connection."""

    def __init__(
        self, address: Any, system: int, component: int, now: float, counts: Counter[str]
    ) -> None:
        self.address, self.heard = address, now
        self.stream = MavlinkStream(system, component)
        self.stream.counts = counts  # all peers of an endpoint are counted together


class Wire(Protocol):
    """Bytes in both directions; undelivered bytes are lost."""

    def receive(self) -> tuple[bytes, Any] | None:
        """Return received bytes and their sender, or None."""

    def send(self, data: bytes, address: Any) -> None:
        """Send."""

    def close(self) -> None:
        """Close."""


class Endpoint:
    """An open endpoint: messages from and to all its peers."""

    def __init__(self, url: Url, system: int, component: int, wire: Wire | None = None) -> None:
        """Open it; raises InputError if that fails. `wire` replaces the connection in tests."""
        self.url, self.ids = url, (system, component)
        self.counts: Counter[str] = Counter()
        place = url if wire is not None else _resolve(url)
        self.wire: Wire = wire or _open(place)
        self.peers: dict[Any, Peer] = {}
        if url.kind != "udpin":
            first = (place.host, place.port)
            self.peers[first] = Peer(first, system, component, time.monotonic(), self.counts)
            self._fixed: Any = first
        else:
            self._fixed = None

    def poll(self) -> Iterator[tuple[Any, Peer]]:
        """Yield received messages, each with its sender."""
        now = time.monotonic()
        for _ in range(AT_ONCE):
            found = self.wire.receive()
            if found is None:
                return
            data, address = found
            fixed = self._fixed is not None
            peer = self.peers.get(self._fixed if fixed else address)
            peer = peer or Peer(address, *self.ids, now, self.counts)
            messages = list(peer.stream.feed(data))
            if not messages:  # a sender of anything else neither moves nor becomes a peer
                continue
            if self.url.kind == "udpout":
                peer.address = address  # the answer may come from another port
            elif not fixed and not self._keep(address, peer, now):
                self.counts["peers"] += 1
                continue
            peer.heard = now
            for message in messages:
                yield message, peer

    def _keep(self, address: Any, peer: Peer, now: float) -> bool:
        """Store a new peer in place of silent ones; return False if there are too many."""
        if address in self.peers:
            return True
        for other in [a for a, p in self.peers.items() if now - p.heard > SILENT_S]:
            del self.peers[other]
        if len(self.peers) >= PEERS:
            return False
        self.peers[address] = peer
        return True

    def send(self, message: Any, peer: Peer | None = None) -> None:
        """Send a message to a peer, or to all peers."""
        now = time.monotonic()
        for one in [peer] if peer is not None else list(self.peers.values()):
            if self._fixed is None and now - one.heard > SILENT_S:
                continue
            self.wire.send(one.stream.pack(message), one.address)

    def close(self) -> None:
        """Close it."""
        self.wire.close()


def _resolve(url: Url) -> Url:
    """Return an endpoint with a numeric host address: no name is resolved in flight."""
    if url.kind == "serial":
        return url
    try:
        return url._replace(host=socket.gethostbyname(url.host))
    except (OSError, UnicodeError):
        raise InputError(
            f"{url}: the host {url.host!r} has no address; valid: a known name, or an IPv4 address"
        ) from None


def _open(url: Url) -> Wire:
    if url.kind == "serial":
        return SerialWire(url)
    return TcpWire(url) if url.kind == "tcp" else UdpWire(url)


class UdpWire:
    """Datagrams."""

    def __init__(self, url: Url) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            bound = (url.host, url.port) if url.kind == "udpin" else ("", 0)
            if url.kind == "udpout" and url.is_local:
                bound = ("127.0.0.1", 0)
            self._socket.bind(bound)
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"{url}: {error.strerror or error}; valid: a free port of this computer"
            ) from None
        self._socket.setblocking(False)

    def receive(self) -> tuple[bytes, Any] | None:
        """Return a datagram."""
        while True:
            try:
                return self._socket.recvfrom(SIZE)
            except (BlockingIOError, InterruptedError):
                return None
            except ConnectionError:  # a closed port at the other end
                continue
            except OSError:
                return None

    def send(self, data: bytes, address: Any) -> None:
        """Send a datagram; it may be lost."""
        try:
            self._socket.sendto(data, address)
        except OSError:
            return

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def send_whole(write: Callable[[bytes], int | None], rest: bytes, data: bytes) -> bytes:
    """Write the rest of a packet, then the packet `data`; return the rest of what was begun.

    A packet is sent completely or not at all: `data` is dropped while an earlier packet is
    incomplete, or if no byte of it fits. `write` returns the number of bytes that it has sent.
    """
    if rest:
        rest = rest[write(rest) or 0 :]
        if rest:
            return rest
    sent = write(data) or 0
    return data[sent:] if sent else b""


class TcpWire:
    """A TCP connection that reconnects after a failure."""

    def __init__(self, url: Url) -> None:
        self._url, self._next = url, 0.0
        self._socket: socket.socket | None = None
        self._rest = b""  # of a packet that was sent in part
        if self._connect(0.5) is None:
            raise InputError(f"{url}: nothing listens there")

    def _connect(self, longest: float = 0.05) -> socket.socket | None:
        """Connect if a retry is due; blocks for `longest` (s) if the host does not answer."""
        now = time.monotonic()
        if self._socket is None and now >= self._next:
            self._next = now + RETRY_S
            try:
                made = socket.create_connection((self._url.host, self._url.port), longest)
            except OSError:
                return None
            made.setblocking(False)
            made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket = made
        return self._socket

    def receive(self) -> tuple[bytes, Any] | None:
        """Return bytes."""
        s = self._connect()
        if s is None:
            return None
        try:
            data = s.recv(SIZE)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            data = b""
        if not data:
            self._drop()
            return None
        return data, (self._url.host, self._url.port)

    def send(self, data: bytes, address: Any) -> None:
        """Send a packet; one that does not fit is dropped as a whole."""
        s = self._connect()
        if s is None:
            return

        def write(part: bytes) -> int:
            try:
                return s.send(part)
            except (BlockingIOError, InterruptedError):
                return 0

        try:
            self._rest = send_whole(write, self._rest, data)
        except OSError:
            self._drop()

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket, self._rest = None, b""

    def close(self) -> None:
        """Close the connection."""
        self._drop()


class SerialWire:
    """A serial port, by pyserial."""

    def __init__(self, url: Url) -> None:
        try:
            import serial
        except ImportError:
            raise InputError(f"{url} requires pyserial: pip install 'skywright[serial]'") from None
        try:
            self._port = serial.Serial(
                url.host, url.port, timeout=0, write_timeout=0, exclusive=True
            )
        except (OSError, ValueError) as error:
            raise InputError(f"{url}: {error}") from None
        self._failed: tuple[type[Exception], ...] = (OSError, serial.SerialException)
        self._name = (url.host, url.port)
        self._rest = b""  # of a packet that was sent in part

    def receive(self) -> tuple[bytes, Any] | None:
        """Return bytes."""
        try:
            data = self._port.read(SIZE)
        except self._failed:
            return None
        return (bytes(data), self._name) if data else None

    def send(self, data: bytes, address: Any) -> None:
        """Send a packet; one that does not fit is dropped as a whole."""
        try:
            self._rest = send_whole(self._write, self._rest, data)
        except self._failed:
            self._rest = b""

    def _write(self, data: bytes) -> int:
        """Write what fits; pyserial's write waits for room even if its time-out is 0."""
        try:
            return os.write(self._port.fileno(), data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Close the port."""
        self._port.close()
