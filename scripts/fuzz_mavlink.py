"""Send junk to both ends of MAVLink: `python scripts/fuzz_mavlink.py [PACKETS] [SEED]`.

Half goes to a simulated robot (`serve --mavlink`), half to the companion's receiver (`run --backend
mavlink:URL`). An eighth are valid packets of any message of the dialect, with any numbers; the
others are random bytes, valid packets with changed bytes, cut, lengthened, repeated or joined, and
packets of MAVLink 1. The robot flies a tick every 400 packets; its state must stay finite. Prints
counts by cause, the time, and the peak memory after a tenth of the packets and at the end. A result
is in benchmarks/mavlink-fuzz.txt.
"""

from __future__ import annotations

import random
import resource
import struct
import sys
import time
from collections import deque
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common

import skywright
from skywright.links.mavlink.endpoint import PEERS, Endpoint, Url
from skywright.links.mavlink.heard import Heard
from skywright.links.mavlink.serve import Service

WAYS = ("good", "random", "bytes", "cut", "longer", "repeated", "joined", "version 1")
CLASSES = list(common.mavlink_map.values())
EAGER = [
    c for c in CLASSES
    if c.msgname in {
        "COMMAND_LONG", "COMMAND_INT", "SET_MODE", "PARAM_SET", "PARAM_REQUEST_READ",
        "PARAM_REQUEST_LIST", "MISSION_COUNT", "MISSION_REQUEST_INT", "MANUAL_CONTROL", "TIMESYNC",
        "SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET",
        "FILE_TRANSFER_PROTOCOL", "PING", "HEARTBEAT", "LOCAL_POSITION_NED", "ATTITUDE_QUATERNION",
        "STATUSTEXT", "GPS_GLOBAL_ORIGIN", "COMMAND_ACK", "ESTIMATOR_STATUS",
    }
]  # fmt: skip
"""Messages that one of the ends processes: half of the valid ones."""
LIMITS = {
    "uint8_t": (0, 2**8), "uint16_t": (0, 2**16), "uint32_t": (0, 2**32), "uint64_t": (0, 2**64),
    "int8_t": (-(2**7), 2**7), "int16_t": (-(2**15), 2**15), "int32_t": (-(2**31), 2**31),
    "int64_t": (-(2**63), 2**63),
}  # fmt: skip
NUMBERS = (0.0, 1.0, -1.0, 6.0, 1e-30, 3e38, float("nan"), float("inf"), -float("inf"))


class Memory:
    """A socket whose datagrams stay in this process."""

    def __init__(self) -> None:
        self.inbox: deque[tuple[bytes, Any]] = deque()
        self.sent = 0

    def receive(self) -> tuple[bytes, Any] | None:
        return self.inbox.popleft() if self.inbox else None

    def send(self, data: bytes, address: Any) -> None:
        self.sent += 1

    def close(self) -> None:
        self.inbox.clear()


def draw_number(rng: random.Random, kind: str) -> Any:
    """Return a number of a field's kind: extremes, small ones, or any bits."""
    if kind in LIMITS:
        low, high = LIMITS[kind]
        return rng.choice((low, high - 1, 0, 1, rng.randrange(low, high), rng.randrange(0, 100)))
    if rng.random() < 0.5:
        return rng.choice(NUMBERS)
    if rng.random() < 0.5:
        return rng.uniform(-3.0, 3.0)
    return struct.unpack("<f", rng.randbytes(4))[0]


def draw_message(rng: random.Random) -> Any:
    """Return any message with any numbers; targets are mostly the right ones."""
    cls = rng.choice(EAGER if rng.random() < 0.5 else CLASSES)
    values: list[Any] = []
    for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
        length = cls.array_lengths[cls.ordered_fieldnames.index(name)]
        if kind == "char":
            values.append(rng.randbytes(max(length, 1)))
        elif name in ("target_system", "target_component") and rng.random() < 0.9:
            values.append(1)
        elif name == "command" and length <= 1 and rng.random() < 0.9:
            known = (16, 20, 21, 22, 176, 178, 179, 192, 300, 400, 510, 511, 512, 520)
            values.append(rng.choice(known))
        elif length > 1:
            values.append([draw_number(rng, kind) for _ in range(length)])
        else:
            values.append(draw_number(rng, kind))
    return cls(*values)


def draw_packet(rng: random.Random, sender: Any, good: deque[bytes]) -> bytes:
    """Return a valid or an invalid packet."""
    way = rng.choice(WAYS) if good else "good"
    if way in ("good", "version 1"):
        try:
            message = draw_message(rng)
            data: bytes = message.pack(sender, force_mavlink1=way == "version 1")
        except (struct.error, OverflowError):  # a number out of the range of its field
            return rng.randbytes(20)
        sender.seq = (sender.seq + 1) % 256
        if way == "good":
            good.append(data)
        return data
    if way == "random":
        return rng.randbytes(rng.randrange(0, 300))
    data = rng.choice(good)
    if way == "bytes":
        changed = bytearray(data)
        for _ in range(rng.randint(1, 4)):
            changed[rng.randrange(len(changed))] = rng.randrange(256)
        return bytes(changed)
    if way == "cut":
        return data[: rng.randrange(len(data))]
    if way == "longer":
        return data + rng.randbytes(rng.randrange(1, 40))
    return data + rng.choice(good) if way == "joined" else data


def measure_memory() -> float:
    """Return the peak memory (MB) of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def fuzz(packets: int, seed: int = 1, robot: str = "hexarotor") -> dict[str, Any]:
    """Return counts, time (s) and memory of `packets` of junk; raises if an end raises."""
    rng, wire, ear = random.Random(seed), Memory(), Memory()
    endpoint = Endpoint(Url("udpin", "127.0.0.1", 1), 1, 1, wire)
    listener = Endpoint(Url("udpin", "127.0.0.1", 2), 1, 191, ear)
    service = Service(skywright.load("waypoints", robot=robot), [endpoint], speed=float("inf"))
    heard, sender, good = Heard(), common.MAVLink(None, 1, 1), deque[bytes](maxlen=200)
    while not service.settled:
        service.tick()
    begin, ticks, early = time.perf_counter(), 0, 0.0
    for k in range(packets):
        address = ("127.0.0.1", rng.randrange(1, 30) if rng.random() < 0.01 else 1)
        (wire if k % 2 else ear).inbox.append((draw_packet(rng, sender, good), address))
        if k % 400 != 399:
            continue
        for message, _ in listener.poll():
            heard.take(message, 1e-3 * k)
        service.tick()
        ticks += 1
        if early == 0.0 and k > packets // 10:
            early = measure_memory()
        estimate = service.vehicle.backend.estimate
        assert np.isfinite(estimate["p_WB"]).all() and np.isfinite(heard.p).all()
        assert np.isfinite(heard.R_WB).all() and np.isfinite(heard.v).all()
    server = service.server
    assert len(endpoint.peers) <= PEERS and len(server._lists) <= 16 and len(server._told) <= 100
    assert len(heard.acks) <= 20 and len(heard.texts) <= 20
    counts = endpoint.counts + listener.counts + server.counts
    return {
        "counts": dict(sorted(counts.items())), "ticks": ticks, "answers": wire.sent,
        "seconds": time.perf_counter() - begin, "MB after a tenth": early,
        "MB at the end": measure_memory(),
    }  # fmt: skip


def main() -> None:
    """Print the result of a run."""
    packets = int(float(sys.argv[1])) if len(sys.argv) > 1 else 20_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    found = fuzz(packets, seed)
    print(f"packets: {packets}, seed {seed}")
    for name, value in found.pop("counts").items():
        print(f"  {name}: {value}")
    for name, value in found.items():
        print(f"{name}: {value:.0f}" if isinstance(value, float) else f"{name}: {value}")


if __name__ == "__main__":
    main()
