"""A companion and a simulated robot that talk by MAVLink, in one process and on one clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from skywright.links.mavlink import companion as companion_module
from skywright.links.mavlink.companion import MavlinkVehicle
from skywright.links.mavlink.endpoint import Endpoint, Url
from skywright.links.mavlink.link import VehicleLink
from skywright.links.mavlink.serve import Service
from skywright.run import backends

TICK = 0.02


class Cable:
    """One way of a wire: delay (s), and a rule that loses what is sent at a time (s)."""

    def __init__(self, clock: PairClock) -> None:
        self.clock, self.delay = clock, 0.0
        self.lost: Callable[[float], bool] = lambda t: False
        self.queue: deque[tuple[float, bytes]] = deque()

    def put(self, data: bytes) -> None:
        t = self.clock.t
        if not self.lost(t):
            self.queue.append((t + self.delay, data))

    def get(self) -> bytes | None:
        if self.queue and self.queue[0][0] <= self.clock.t + 1e-9:
            return self.queue.popleft()[1]
        return None


class Ends:
    """One end of two cables: what links/mavlink/endpoint.py calls a wire."""

    def __init__(self, out: Cable, back: Cable) -> None:
        self.out, self.back = out, back

    def receive(self) -> tuple[bytes, Any] | None:
        data = self.back.get()
        return None if data is None else (data, ("127.0.0.1", 1))

    def send(self, data: bytes, address: Any) -> None:
        self.out.put(data)

    def close(self) -> None:
        self.out.queue.clear()


class PairClock:
    """Time that passes while the companion waits: the robot flies, and the link is served."""

    threaded = False

    def __init__(self) -> None:
        self.t = 100.0
        self.step: Callable[[], None] = lambda: None
        self._rest = 0.0

    def now(self) -> float:
        return self.t

    def sleep(self, seconds: float) -> None:
        self._rest += seconds
        while self._rest >= TICK - 1e-9:
            self._rest -= TICK
            self.t += TICK
            self.step()


class Pair:
    """A robot that is served, and the back end that flies it."""

    def __init__(self, description: Any, backend: Any) -> None:
        self.clock = PairClock()
        self.up, self.down = Cable(self.clock), Cable(self.clock)
        url = Url("udpout", "127.0.0.1", 14540)
        self.said: list[str] = []
        self.description, self.backend = description, backend
        self.ended = False
        self.slow, self._steps = 1, 0  # ticks of the companion's clock in one of the robot's
        self._serve(url)
        self.link: VehicleLink | None = None
        self.on_tick: Callable[[Pair], None] = lambda _: None
        self.clock.step = self._step

    def _serve(self, url: Url) -> None:
        end = Endpoint(url, 1, 1, Ends(self.down, self.up))
        self.service = Service(
            self.description, [end], self.said.append, float("inf"), backend=self.backend
        )

    def restart(self, saved: Any) -> None:
        """The autopilot starts again: its memory and its clock begin anew."""
        self.backend.restore(saved)
        self._serve(Url("udpout", "127.0.0.1", 14540))

    def _step(self) -> None:
        self.on_tick(self)
        self._steps += 1
        if self._steps % self.slow == 0:
            self.service.tick()
        if self.link is not None:
            self.link.step()

    def open(self, address: str) -> Callable[..., MavlinkVehicle]:
        """What backends.choose_backend returns for `mavlink:ADDRESS`."""

        def connect(url: Url, clock: Any) -> VehicleLink:
            wired = Endpoint(url, 1, 191, Ends(self.up, self.down))
            self.link = VehicleLink(wired, self.clock)
            return self.link

        return companion_module.open_backend(address, self.clock, connect)


def plug(monkeypatch: Any, pair: Pair) -> None:
    """Let `backend="mavlink:..."` reach the pair."""

    class Module:
        open_backend = staticmethod(pair.open)
        check_backend = staticmethod(companion_module.check_backend)

    monkeypatch.setattr(backends, "import_module", lambda name: Module)
