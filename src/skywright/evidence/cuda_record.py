"""What a flight changes: between two mission ticks by Python code, and in single control ticks."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.follower import Follower
from skywright.vehicle.schedule import end_control, run_rows
from skywright.vehicle.simulated import SimulatedVehicle

Words = NDArray[np.int64]


class Change(NamedTuple):
    """What Python code changed before the control tick `tick`."""

    tick: int
    before: Words  # image at the end of the last tick
    after: Words
    drawn: list[tuple[int, NDArray[np.float64]]]  # (block of random numbers, new rows)


class Tick(NamedTuple):
    """Images before and after the control rows of a tick, and its rows of random numbers."""

    before: Words
    after: Words
    drawn: list[NDArray[np.float64]]


class FlightRecorder:
    """Observes a flight: records what Python code changes, and single ticks."""

    def __init__(self, seconds: float, every: int) -> None:
        """Record changes up to `seconds`, and each `every`-th mission tick."""
        self.seconds, self.every, self.n = seconds, every, 0
        self.changes, self.ticks = list[Change](), list[Tick]()
        self.tables = list[NDArray[Any]]()  # of the follower
        self.path = list[list[float]]()  # rows of on_tick
        self.spent_s, self.ticks_timed = 0.0, 0  # of control ticks of this flight

    def on_supervisor(self, supervisor: Any) -> None:
        """Record the state before the flight, and all calls of the schedule from then on."""
        self.vehicle: SimulatedVehicle = supervisor.vehicle
        a = self.assembly = self.vehicle.assembly
        self.follower = self.vehicle.find(Follower)
        kept = [x for x in a.alive if isinstance(x, np.ndarray)]
        moving = {"arena": a.arena, **self.vehicle.sim.arrays}
        self.arrays = {**moving, **{f"kept {i}": x for i, x in enumerate(kept)}}
        self.drawn = [np.zeros((0, 0))] * len(a._drawn)
        self.first = self.last = self.take()
        self._run, self.vehicle.ticker.run = self.vehicle.ticker.run, self.run

    def on_plan(self, plan: Any, description: Any) -> None:
        """Nothing is observed."""

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Keep time and true position."""
        self.path.append([t, *vehicle.assembly.get(Truth)["p_WB"]])

    def close(self) -> None:
        """Nothing is open."""

    def take(self) -> Words:
        """Return the image of all arrays, in words of 8 bytes."""
        return np.concatenate([view_words(x) for x in self.arrays.values()])

    def run(self, n: int, interactive: bool) -> None:
        """Run `n` control ticks as the ticker does; record first what has changed."""
        if not any(self.follower._rows is x for x in self.tables):
            self.tables.append(self.follower._rows)
        if self.vehicle.t < self.seconds:
            self._record_change()
        if self.n % self.every == 0:
            self._record_tick()
            n -= 1
        self.n += 1
        begin = time.perf_counter()
        self._run(n, interactive)
        self.spent_s += time.perf_counter() - begin
        self.ticks_timed += n
        if self.vehicle.t < self.seconds:
            self.last = self.take()

    def _record_change(self) -> None:
        a, drawn = self.assembly, list[tuple[int, NDArray[np.float64]]]()
        for i, rows in enumerate(a._drawn):
            if rows is not self.drawn[i]:
                drawn.append((i, rows))
                self.drawn[i] = rows
        now = self.take()
        self.changes.append(Change(int(a.get(Clock)["tick"]), self.last, now, drawn))

    def _record_tick(self) -> None:
        a, clock = self.assembly, self.assembly.get(Clock)
        at, clock_at, before = int(a.rows.ctypes.data), a.address(Clock), self.take()
        draws = [
            rows[int(clock["fast" if b.fast else "block"])].copy() if len(rows) else rows
            for b, rows in zip(a._blocks, a._drawn, strict=True)
        ]
        run_rows(at, 0, a.n_control, clock_at)
        self.ticks.append(Tick(before, self.take(), draws))
        end_control(clock_at)
        for _ in range(self.vehicle.n_steps):
            self.vehicle.sim.step(1)
            run_rows(at, a.n_control, len(a.rows), clock_at)
            clock["fast"] += 1


def view_words(array: NDArray[Any]) -> Words:
    """Return an array as words of 8 bytes, padded with zeros."""
    raw = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
    return np.pad(raw, (0, -len(raw) % 8)).view(np.int64)
