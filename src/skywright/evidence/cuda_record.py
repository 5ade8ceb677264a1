"""What a flight changes: between two mission ticks by Python code, and in single control ticks."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.follower import Follower
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.schedule import end_control, run_rows
from skywright.vehicle.simulated import SimulatedVehicle

Words = NDArray[np.int64]


class Change(NamedTuple):
    """What Python code changed before the control tick `tick`."""

    tick: int
    at: Words  # (k,) indices of the changed words of the image
    value: Words  # (k,) their new values
    drawn: list[tuple[int, NDArray[np.float64]]]  # (block of random numbers, new rows)


class Tick(NamedTuple):
    """Images (n,) before and after the control rows of a tick, and its random numbers."""

    before: Words
    after: Words
    drawn: list[NDArray[np.float64]]  # a row of each block


class FlightRecorder:
    """Observes a flight and records it up to a time.

    The image (n,) of a vehicle is all its `arrays` in words of 8 bytes: its records, MuJoCo's
    arrays, and the arrays whose addresses components keep.
    """

    def __init__(self, seconds: float, samples: int) -> None:
        """Record up to `seconds` (s) of the flight, with about `samples` single ticks.

        Without samples (0) only the time of the control ticks is measured: the copies of a recorded
        flight displace its data from the processor's cache.
        """
        self.seconds, self.n = seconds, 0
        self.every = max(int(seconds / MISSION_TICK / samples), 1) if samples else 0  # ticks
        self.changes, self.ticks = list[Change](), list[Tick]()
        self.tables = list[NDArray[Any]]()  # rows of plans that the follower tracked
        self.path = list[list[float]]()  # t (s) and true position (m) after each mission tick
        self.spent_s, self.ticks_timed = 0.0, 0  # wall time of that number of control ticks

    def on_supervisor(self, supervisor: Any) -> None:
        """Record the state before the flight, and all calls of the schedule from then on.

        Raises InputError for a vehicle with steps in plain Python.
        """
        self.vehicle: SimulatedVehicle = supervisor.vehicle
        a = self.assembly = self.vehicle.assembly
        python = [a.steps[i].label for i in a.list_python_rows()]
        if python:
            raise InputError(f"steps in plain Python do not run on a GPU: {', '.join(python)}")
        self.follower, sim = self.vehicle.find(Follower), self.vehicle.sim
        fixed = {"eq_active": sim.data.eq_active, "geom_contype": sim.scene.model.geom_contype}
        kept = {f"kept {i}": x for i, x in enumerate(a.alive) if isinstance(x, np.ndarray)}
        self.arrays = {"arena": a.arena, **sim.arrays, **fixed, **kept}
        self.drawn = [np.zeros((0, 0))] * len(a._drawn)
        self.first = self.start = self.last = self.take()
        self.changed = np.zeros(len(self.first), bool)  # words that differed once from the first
        self._run, self.vehicle.ticker.run = self.vehicle.ticker.run, self.run

    def on_plan(self, plan: Any, description: Any) -> None:
        """Nothing is observed."""

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Record time and true position."""
        self.path.append([t, *vehicle.assembly.get(Truth)["p_WB"]])

    def close(self) -> None:
        """Nothing is open."""

    def take(self) -> Words:
        """Return the present image (n,)."""
        return np.concatenate([view_words(x) for x in self.arrays.values()])

    def slices(self) -> dict[str, slice]:
        """Return where each of the arrays is in the image."""
        ends = np.cumsum([len(view_words(x)) for x in self.arrays.values()])
        return {
            name: slice(end - len(view_words(x)), end)
            for (name, x), end in zip(self.arrays.items(), ends.tolist(), strict=True)
        }

    def run(self, n: int, interactive: bool) -> None:
        """Run `n` control ticks as the ticker does, and record or time them."""
        if self.every == 0 and self.vehicle.t < self.seconds:
            begin = time.perf_counter()
            self._run(n, interactive)
            self.spent_s += time.perf_counter() - begin
            self.ticks_timed += n
            return
        if not any(self.follower._rows is x for x in self.tables):
            self.tables.append(self.follower._rows)
        if self.vehicle.t >= self.seconds:
            self._run(n, interactive)
            return
        self._record_change()
        clock, every = self.assembly.get(Clock), int(self.assembly.rows["every"].max())
        if self.n % self.every == 0 and clock["tick"] % every == 0:
            clock["stop"] = 0
            n = n - 1 if self._record_tick() else 0
        self.n += 1
        if n:
            self._run(n, interactive)
        self.last = self.take()
        self.changed |= self.last != self.first

    def _record_change(self) -> None:
        a, drawn = self.assembly, list[tuple[int, NDArray[np.float64]]]()
        for i, rows in enumerate(a._drawn):
            if rows is not self.drawn[i]:
                drawn.append((i, rows))
                self.drawn[i] = rows
        now = self.take()
        at = np.flatnonzero(now != self.last)
        if not self.changes:
            self.start = now
        self.changed[at] = True
        self.changes.append(Change(int(a.get(Clock)["tick"]), at, now[at], drawn))

    def _record_tick(self) -> bool:
        """Run and record a control tick; return whether the mission tick goes on after it."""
        a, clock = self.assembly, self.assembly.get(Clock)
        at, clock_at, before = int(a.rows.ctypes.data), a.address(Clock), self.take()
        draws = [
            rows[int(clock["fast" if b.fast else "block"])].copy() if len(rows) else rows
            for b, rows in zip(a._blocks, a._drawn, strict=True)
        ]
        if run_rows(at, 0, a.n_control, clock_at):
            return False
        self.ticks.append(Tick(before, self.take(), draws))
        end_control(clock_at)
        for _ in range(self.vehicle.n_steps):
            self.vehicle.sim.step(1)
            if run_rows(at, a.n_control, len(a.rows), clock_at):
                return False
            clock["fast"] += 1
        return not clock["fired"]


def view_words(array: NDArray[Any]) -> Words:
    """Return an array as words of 8 bytes, padded with zeros."""
    raw = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
    return np.pad(raw, (0, -len(raw) % 8)).view(np.int64)
