"""A conversation with a simulated robot over MAVLink, without sockets and without waiting."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common

import skywright
from skywright.links.mavlink.endpoint import Endpoint, Url
from skywright.links.mavlink.serve import Service
from skywright.links.mavlink.stream import MavlinkStream
from skywright.vehicle.commands import State

ME = ("127.0.0.1", 14550)
ACCEPTED = 0


class MemoryWire:
    """A socket whose datagrams stay in this process."""

    def __init__(self) -> None:
        self.inbox: deque[tuple[bytes, Any]] = deque()
        self.sent: deque[tuple[bytes, Any]] = deque(maxlen=20_000)

    def receive(self) -> tuple[bytes, Any] | None:
        return self.inbox.popleft() if self.inbox else None

    def send(self, data: bytes, address: Any) -> None:
        self.sent.append((data, address))

    def close(self) -> None:
        self.inbox.clear()


class Talk:
    """A ground station or an offboard program: sends, ticks the robot, keeps what it says."""

    def __init__(self, description: Any, backend: Any, system: int = 255) -> None:
        self.wire = MemoryWire()
        self.endpoint = Endpoint(Url("udpin", "127.0.0.1", 14550), 1, 1, self.wire)
        self.said: list[str] = []
        self.service = Service(
            description, [self.endpoint], self.said.append, float("inf"), backend=backend
        )
        self.stream, self._heard = MavlinkStream(system, 190), MavlinkStream()
        self.messages: list[Any] = []
        self.stream_of: Callable[[], Any] | None = None
        self._beat()

    def _beat(self) -> None:
        self._beat_at = time.monotonic()
        self.send(common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    @property
    def vehicle(self) -> Any:
        return self.service.vehicle

    @property
    def estimate(self) -> Any:
        return self.vehicle.backend.estimate

    def send(self, message: Any) -> None:
        self.wire.inbox.append((self.stream.pack(message), ME))

    def tick(self, seconds: float = 0.02) -> None:
        """Fly for a time; a stream goes on at 20 Hz."""
        for k in range(round(seconds / 0.02)):
            if time.monotonic() - self._beat_at > 2.0:  # on a loaded machine: 10 s are silence
                self._beat()
            if self.stream_of is not None and k % 2 == 0:
                self.send(self.stream_of())
            self.service.tick()
            while self.wire.sent:
                self.messages += self._heard.feed(self.wire.sent.popleft()[0])

    def until(self, condition: Callable[[], bool], limit: float = 30.0) -> None:
        end = self.vehicle.t + limit
        while not condition():
            assert self.vehicle.t < end, f"not within {limit} s: {self.said[-5:]}"
            self.tick()

    def take(self, kind: str) -> list[Any]:
        """Return the messages of a kind that have come, and forget all."""
        found = [m for m in self.messages if m.get_type() == kind]
        self.messages = []
        return found

    def last(self, kind: str) -> Any:
        return next(m for m in reversed(self.messages) if m.get_type() == kind)

    def command(self, number: int, *p: float) -> int:
        """Send a COMMAND_LONG; returns the result of its acknowledgement."""
        self.messages = []
        self.send(
            common.MAVLink_command_long_message(1, 1, number, 0, *[*p, *[0.0] * (7 - len(p))])
        )
        self.tick()
        (ack,) = [m for m in self.messages if m.get_type() == "COMMAND_ACK"]
        assert (ack.command, ack.target_system) == (number, self.stream._ids[0])
        return int(ack.result)

    def mode(self) -> tuple[int, int]:
        """Return the main and sub mode of the last heartbeat."""
        self.tick(1.1)
        custom = self.last("HEARTBEAT").custom_mode
        return custom >> 16 & 0xFF, custom >> 24

    def text(self) -> str:
        return "".join(  # long ones come in pieces
            m.text if isinstance(m.text, str) else m.text.decode()
            for m in self.messages
            if m.get_type() == "STATUSTEXT"
        )


def local(p: Any = None, v: Any = None, yaw: float | None = None) -> Any:
    """Return a set-point in W (ENU), as message 84."""
    mask, nan = 0x1C0 | 0x800, [0.0, 0.0, 0.0]
    if p is None:
        mask |= 0x7
    if v is None:
        mask |= 0x38
    if yaw is None:
        mask |= 0x400
    x, y, z = nan if p is None else (p[1], p[0], -p[2])
    vx, vy, vz = nan if v is None else (v[1], v[0], -v[2])
    heading = 0.0 if yaw is None else 0.5 * np.pi - yaw
    return common.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, mask, x, y, z, vx, vy, vz, 0, 0, 0, heading, 0
    )


def build(robot: str) -> Any:
    """Return description, vehicle and its saved state of a robot in a world with an origin."""
    description = skywright.load(
        "waypoints", robot=robot, sets={"world.origin.latitude_deg": 47.0,
                                        "world.origin.longitude_deg": 8.0}
    )  # fmt: skip
    backend = skywright.build_vehicle(description)
    return description, backend, backend.save()


def begin(built: Any) -> Talk:
    """Return a conversation with the vehicle of `build` in its saved state on the ground."""
    description, backend, ground = built
    backend.restore(ground)
    backend.limits = backend.limits._replace(speed=description.robot.control.speed_max_mps)
    talk = Talk(description, backend)
    talk.until(lambda: talk.service.settled)
    talk.tick(0.5)
    return talk


def fly(talk: Talk, height: float = 1.5) -> Talk:
    """Arm and rise."""
    assert talk.command(400, 1.0) == ACCEPTED
    nan = math.nan
    assert talk.command(22, 0, 0, 0, nan, nan, nan, height + 0.0) == ACCEPTED
    talk.until(lambda: talk.vehicle.state == State.FLYING_AUTO)
    return talk
