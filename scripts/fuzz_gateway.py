"""Send junk to a receiver of the gateway: `python scripts/fuzz_gateway.py [PACKETS] [SEED]`.

A tenth are valid packets; the others are random bytes, valid packets with a changed bit, repeated,
cut, lengthened, sealed with another key, of another session, or with a wrong time stamp. Prints the
counts by cause, the time and the growth of Python's memory. The result of 1e6 packets is in
benchmarks/gateway-fuzz.txt.
"""

from __future__ import annotations

import random
import struct
import sys
import time
import tracemalloc
from collections import deque
from typing import Any

from skywright.links.udp.codec import encode
from skywright.links.udp.packets import CODES, KINDS
from skywright.links.udp.server import PEERS, PENDING, Server

KEY, OTHER = b"k" * 32, b"o" * 32
WAYS = (
    "good", "random", "bit", "repeated", "cut", "longer", "other key", "other session", "stamp",
    "connect",
)  # fmt: skip


class Memory:
    """A socket whose datagrams stay in this process."""

    def __init__(self) -> None:
        self.inbox: deque[tuple[bytes, tuple[str, int]]] = deque()
        self.sent: deque[tuple[bytes, tuple[str, int]]] = deque(maxlen=10)

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        if not self.inbox:
            raise BlockingIOError
        data, address = self.inbox.popleft()
        return data[:size], address

    def sendto(self, data: bytes, address: tuple[str, int]) -> None:
        self.sent.append((data, address))

    def getsockname(self) -> tuple[str, int]:
        return ("127.0.0.1", 9)


def fuzz(packets: int, seed: int = 1) -> dict[str, Any]:
    """Return counts, time (s) and memory growth (bytes) of `packets`; raises if the server
    raises."""
    rng, wire, now = random.Random(seed), Memory(), [100.0]
    server = Server(wire, KEY, clock=lambda: now[0])  # type: ignore[arg-type]
    server.offered = frozenset(code for code, _ in CODES.values())
    me = ("127.0.0.1", 1000)
    hello = encode("operation", 0, 1, 1, {"operation": 1, "code": CODES["connect"][0]}, KEY)

    def connect() -> int:
        wire.inbox.append((hello, me))
        server.poll()
        return int(struct.unpack_from("<I", wire.sent[-1][0], 8)[0])

    session = connect()
    names = [kind.name for kind in KINDS]
    good, commands = hello, 0
    tracemalloc.start()
    begin, before = time.perf_counter(), tracemalloc.get_traced_memory()[0]
    for k in range(2, packets + 2):
        now[0] += 1e-3
        if k % 1000 == 0:  # a wrong stamp or a disconnection may have ended the session
            session = connect()
        way, address, stamp = rng.choice(WAYS), me, int(1e6 * now[0])
        if way in ("good", "other key", "other session", "stamp"):
            name = rng.choice(names)
            values = {"code": rng.randrange(20), "operation": k} if name == "operation" else {}
            data = encode(
                name,
                rng.randrange(2**32) if way == "other session" else session,
                k,
                rng.randrange(2**64) if way == "stamp" and k % 997 == 0 else stamp,
                values,
                OTHER if way == "other key" else KEY,
            )
            good = data if way == "good" else good
        elif way == "random":
            data = rng.randbytes(rng.randrange(0, 600))
        elif way == "bit":
            at = rng.randrange(len(good))
            data = good[:at] + bytes([good[at] ^ 1 << rng.randrange(8)]) + good[at + 1 :]
        elif way == "cut":
            data = good[: rng.randrange(len(good))]
        elif way == "longer":
            data = good + rng.randbytes(rng.randrange(1, 500))
        elif way == "connect":
            data, address = hello, ("127.0.0.1", rng.randrange(1024, 65536))
        else:
            data = good
        wire.inbox.append((data, address))
        commands += len(server.poll())
        assert len(server.peers) <= PEERS and len(server._pending) <= PENDING
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    return {
        "packets": packets, "commands": commands, "seconds": time.perf_counter() - begin,
        "grown_bytes": grown, "counts": dict(sorted(server.counts.items())),
    }  # fmt: skip


if __name__ == "__main__":
    n = int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000
    found = fuzz(n, int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    print(f"packets {found['packets']}, commands accepted {found['commands']}")
    print(f"memory grown {found['grown_bytes'] / 1000:.1f} kB")
    for cause, count in found["counts"].items():
        print(f"{count:9d} {cause}")
    print(f"({found['seconds']:.0f} s, with memory traced)", file=sys.stderr)
