"""The arms program's end of the gateway: sessions, operations, and control.

A sender opens a session with the operation `connect`; the answer contains a random number that all
later packets of both sides carry. Recorded packets of an earlier session are therefore invalid, and
a session belongs to one address. The sender of accepted commands is in control until it has been
silent for two seconds; other sessions receive the state only.
"""

from __future__ import annotations

import math
import secrets
import socket
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from skywright.links.radio import COMMAND, STATE
from skywright.links.udp.codec import Packet, encode
from skywright.links.udp.packets import CODES, MAX_SIZE, RESULTS
from skywright.links.udp.receiver import Arrived, Receiver, read_packet

PEERS = 8
"""Most simultaneous sessions."""
PENDING = 32
"""Most sessions that were answered and not yet used."""
SILENT_S = 10.0  # s of silence after which nothing is sent to a session
LEASE_S = 2.0  # s for which a sender stays in control after its last command
AT_ONCE = 1000  # datagrams per read: bounds the time of a tick under a flood of datagrams
KIND_BYTE = 5  # of a packet

Address = tuple[str, int]


class Carrier(Protocol):
    """One direction of a radio link (links/radio.py)."""

    def send(self, t: float, priority: int, size: int, item: Any) -> None:
        """Queue an item of `size` bytes at `t` (s)."""

    def receive(self, t: float) -> list[Any]:
        """Return the items that have arrived by `t` (s)."""


class Operation(NamedTuple):
    """A request for a task, from the session in control."""

    code: int
    number: int


class Peer:
    """A session."""

    def __init__(self, address: Address, session: int, counts: Counter[str], now: float) -> None:
        self.address, self.session, self.heard = address, session, now
        self.receiver = Receiver(session, counts, to_arms=True)
        self.sequence = 0
        self.answered = (0, 0)  # newest operation and its result


class Server:
    """Receives commands and sends states; never blocks, and its memory is bounded."""

    def __init__(
        self,
        opened: socket.socket,
        key: bytes = b"",
        *,
        up: Carrier | None = None,
        down: Carrier | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`up` and `down` are the radio directions to and from the arms; `clock` returns s."""
        self.counts: Counter[str] = Counter()
        self.peers: dict[Address, Peer] = {}
        self.offered: frozenset[int] = frozenset()
        """Codes of the operations that the flight currently offers."""
        self.accepted = 0
        """Number of the newest accepted request."""
        self._socket, self._key, self._up, self._down = opened, key, up, down
        self._clock = clock
        self._pending: dict[Address, Peer] = {}
        self._controller: Address | None = None
        self._lease = 0.0
        self._led = -math.inf  # s, newest packet of the session in control
        self.port = int(opened.getsockname()[1])

    def poll(self) -> list[Arrived | Operation]:
        """Return the received commands: sticks, joint references, operations."""
        now, found = self._clock(), list[Arrived | Operation]()
        for _ in range(AT_ONCE):
            try:
                data, address = self._socket.recvfrom(MAX_SIZE + 1)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:  # a closed port at the other end
                continue
            if self._up is None:
                self._add(found, self._take(data, address, now))
            else:
                self._up.send(now, COMMAND, len(data), (data, address))
        if self._up is not None:
            for data, address in self._up.receive(now):
                self._add(found, self._take(data, address, now))
        self._flush(now)
        return found

    @staticmethod
    def _add(found: list[Arrived | Operation], command: Arrived | Operation | None) -> None:
        if command is not None:
            found.append(command)

    def publish(self, name: str, values: dict[str, Any]) -> None:
        """Send a packet to every session that is not silent."""
        now = self._clock()
        for peer in list(self.peers.values()):
            if now - peer.heard < SILENT_S:
                self._send(peer, name, values, STATE)
        self._flush(now)

    @property
    def watched(self) -> bool:
        """Whether any session is open."""
        now = self._clock()
        return any(now - peer.heard < SILENT_S for peer in self.peers.values())

    @property
    def led(self) -> bool:
        """Whether a session has taken control and is not silent."""
        return self._clock() - self._led < SILENT_S

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()

    # --- received packets ----------------------------------------------------------------------

    def _take(self, data: bytes, address: Address, now: float) -> Arrived | Operation | None:
        packet = read_packet(data, self._key, self.counts)
        if packet is None:
            return None
        if packet.session == 0:
            self._connect(packet, address, now)
            return None
        peer = self._find_peer(packet, address)
        if peer is None:
            self.counts["session"] += 1
            return None
        arrived = peer.receiver.take(packet, now)
        if arrived is None:
            return None
        peer.heard = now
        if self._controller == address:
            self._led = now
        if self.peers.get(address) is not peer and not self._establish(peer, now):
            return None
        if packet.kind.name == "operation":
            return self._operate(peer, packet, now)
        if not self._controls(address, now):
            self.counts["controller"] += 1
            return None
        return arrived

    def _find_peer(self, packet: Packet, address: Address) -> Peer | None:
        for peer in (self.peers.get(address), self._pending.get(address)):
            if peer is not None and peer.session == packet.session:
                return peer
        return None

    def _connect(self, packet: Packet, address: Address, now: float) -> None:
        """Answer a request for a session; a replayed request opens none.

        The session begins with the first packet that carries its number.
        """
        if packet.kind.name != "operation" or packet.values["code"] != CODES["connect"][0]:
            self.counts["session"] += 1
            return
        peer = self._pending.pop(address, None)
        if peer is None or packet.values["operation"] != peer.answered[0]:
            peer = Peer(address, secrets.randbelow(2**32 - 1) + 1, self.counts, now)
            peer.answered = (packet.values["operation"], 0)
        self._pending[address] = peer
        while len(self._pending) > PENDING:
            del self._pending[next(iter(self._pending))]
        self.counts["accepted"] += 1
        self._acknowledge(peer, packet, "accepted", peer.session)

    def _establish(self, peer: Peer, now: float) -> bool:
        """Begin a session; return False if there are too many."""
        self._pending.pop(peer.address, None)
        if peer.address not in self.peers and len(self.peers) >= PEERS:
            gone = [a for a, p in self.peers.items() if now - p.heard > SILENT_S]
            if not gone:
                self.counts["session"] += 1
                return False
            del self.peers[gone[0]]
        if self._controller == peer.address:  # the client was restarted
            self._controller = None
        self.peers[peer.address] = peer
        return True

    def _controls(self, address: Address, now: float) -> bool:
        """Whether a sender is in control; takes control if it is free."""
        if self._controller not in (None, address) and now < self._lease:
            return False
        self._controller, self._lease, self._led = address, now + LEASE_S, now
        return True

    def _operate(self, peer: Peer, packet: Packet, now: float) -> Operation | None:
        number, code = packet.values["operation"], packet.values["code"]
        last, result = peer.answered
        if number == last:  # repeated: the acknowledgement was lost
            self._acknowledge(peer, packet, _name(result))
            return None
        if number < last:
            self.counts["replayed"] += 1
            return None
        operation = None
        if code == CODES["alive"][0]:
            says = "accepted"
        elif code == CODES["disconnect"][0]:
            says = "accepted"
            self.peers.pop(peer.address, None)
            if self._controller == peer.address:
                self._controller, self._led = None, -math.inf
        elif code not in self.offered:
            says = "unavailable"
        elif not self._controls(peer.address, now):
            says = "not in control"
        else:
            says, operation, self.accepted = "accepted", Operation(code, number), number
        peer.answered = (number, RESULTS[says][0])
        self._acknowledge(peer, packet, says)
        return operation

    # --- sent packets ------------------------------------------------------------------------

    def _acknowledge(self, peer: Peer, packet: Packet, says: str, session: int = 0) -> None:
        values = {
            "operation": packet.values["operation"], "code": packet.values["code"],
            "result": RESULTS[says][0], "opened": session, "echo_us": packet.time_us,
        }  # fmt: skip
        self._send(peer, "acknowledgement", values, COMMAND)

    def _send(self, peer: Peer, name: str, values: dict[str, Any], priority: int) -> None:
        peer.sequence += 1
        now = self._clock()
        data = encode(name, peer.session, peer.sequence, int(1e6 * now), values, self._key)
        if self._down is None:
            self._transmit(data, peer.address)
        else:
            self._down.send(now, priority, len(data), (data, peer.address))

    def _flush(self, now: float) -> None:
        if self._down is not None:
            for data, address in self._down.receive(now):
                self._transmit(data, address)

    def _transmit(self, data: bytes, address: Address) -> None:
        try:
            self._socket.sendto(data, address)
        except OSError:  # lost for this receiver only: the next one may arrive
            self.counts["unsent"] += 1


def _name(result: int) -> str:
    return next(name for name, (number, _) in RESULTS.items() if number == result)
