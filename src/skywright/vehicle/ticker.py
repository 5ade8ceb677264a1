"""Running an assembly: whole mission ticks in one compiled call, or row by row from Python."""

from __future__ import annotations

import math
import time
from fractions import Fraction
from typing import Any, Protocol

from skywright.errors import SimulationError
from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Component
from skywright.vehicle.failed_line import find_line, name_line
from skywright.vehicle.native import read_error
from skywright.vehicle.schedule import MOST_CALLS, end_control, is_due, run_rows, run_ticks

Stretch = tuple[int, int]
"""Rows first to last - 1, which run in one call; last is -1 for a row in plain Python."""


class StepFailed(SimulationError):
    """A robot-side step raised, returned a number that is not finite, or did not return."""

    def __init__(self, says: str, component: Component | None = None) -> None:
        """`component` is the one that failed; None: the control law."""
        super().__init__(says)
        self.component = component


class TickCount:
    """Control ticks of a vehicle's next mission tick.

    The value that is set may be a fraction, such as 2.5 for 20 ms at 125 Hz. The number then varies
    between the integers beside it, so that its mean is the fraction.
    """

    def __set__(self, vehicle: Any, value: float) -> None:
        vehicle.__dict__["_per_tick"] = Fraction(value).limit_denominator(MOST_CALLS)

    def __get__(self, vehicle: Any, owner: type | None = None) -> int:
        per: Fraction = vehicle.__dict__["_per_tick"]
        if per.denominator == 1:
            return per.numerator
        now = int(vehicle.assembly.get(Clock)["tick"])
        end = math.ceil((now // per + 1) * per)
        return max(end - now, math.floor(per))


class Physics(Protocol):
    """The functions and data that a tick steps."""

    model_address: int
    data_address: int

    def step(self, n: int) -> None:
        """Advance by n physics steps."""


class Ticker:
    """Runs the schedule of an assembly over a physics simulation."""

    def __init__(self, assembly: Assembly, physics: Physics, n_steps: int) -> None:
        self.assembly, self.physics, self.n_steps = assembly, physics, n_steps
        self._at = int(assembly.rows.ctypes.data)
        self._clock_at = assembly.address(Clock)
        # one-element arrays: reading them costs less than fields of a record
        clock = assembly.records[Clock, ""]
        self._tick, self._t, self._fired = clock["tick"], clock["t"], clock["fired"]
        self._fast, self._stop, self._error = clock["fast"], clock["stop"], clock["error"]
        self._failed, self._running = clock["failed"], clock["running"]
        self.since: float | None = None  # of time.monotonic(), while a mission tick runs
        self.stuck = ""  # message of the time limit that interrupts a step
        self._python_row = -1
        slow = assembly.list_python_rows()
        n_control, n_all = assembly.n_control, len(assembly.rows)
        self._control = list_stretches(0, n_control, slow)
        self._after_step = list_stretches(n_control, n_all, slow)

    def run(self, n: int, interactive: bool) -> None:
        """Run up to `n` control ticks; a fired guard ends the run.

        Raises SimulationError with the name of the component if a step raises: StepFailed if it is
        a robot-side component.
        """
        self._stop[0] = 0
        self.since = time.monotonic()
        try:
            if interactive:
                self._run_interactive(n)
            else:
                run_ticks(*self.build_call(n))
        finally:
            self.since = None
        self.check()

    def build_call(self, n: int) -> tuple[int, ...]:
        """Return the arguments of `run_ticks` for `n` control ticks."""
        a, physics = self.assembly, self.physics
        return (
            self._at, a.n_control, len(a.rows), self._clock_at, physics.model_address,
            physics.data_address, n, self.n_steps,
        )  # fmt: skip

    def check(self) -> None:
        """Raise the error of a step that raised in compiled code."""
        if not self._error[0]:
            return
        error, place = read_error(int(self._error[0]))
        self._error[0], row = 0, int(self._failed[0])
        if not place:  # numba states none for its own exceptions, such as that of an index
            self._python_row, self.since = row, time.monotonic()  # the time limit applies
            try:
                place = find_line(self.assembly, row, error)
            finally:
                self._python_row, self.since, self.stuck = -1, None, ""
        raise self._explain(row, error, place)

    def _run_interactive(self, n: int) -> None:
        for _ in range(n):
            if self._run_stretches(self._control):
                return
            end_control(self._clock_at)
            for _ in range(self.n_steps):
                self.physics.step(1)
                if self._run_stretches(self._after_step):
                    return
                self._fast[0] += 1
            if self._fired[0]:
                return

    def _run_stretches(self, stretches: list[Stretch]) -> bool:
        """Run the rows that are due; returns True if the tick must end at once."""
        for first, last in stretches:
            if last >= 0:
                if run_rows(self._at, first, last, self._clock_at):
                    return True
                continue
            row = self.assembly.rows[first]
            if not is_due(self._tick[0], row["every"], row["calls"], row["phase"]):
                continue
            self._python_row = first
            try:
                self.assembly.run_python(first)
            except (Exception, SystemExit) as error:
                if self.stuck:
                    says, self.stuck = self.stuck, ""
                    raise self._fail(first, says) from error
                raise self._explain(first, error, name_line(error)) from error
            self._python_row = -1
            if self._stop[0]:
                return True
        return False

    @property
    def t(self) -> float:
        """Mission time (s)."""
        return float(self._t[0])

    def find_running(self) -> tuple[str, bool]:
        """Return the label of the component that runs now, and whether it is plain Python."""
        python = self._python_row >= 0
        row = self._python_row if python else int(self._running[0])
        return self.assembly.steps[row].label, python

    def _explain(self, row: int, error: BaseException, place: str) -> SimulationError:
        label = self.assembly.steps[row].label
        at = f" ({place})" if place else ""
        return self._fail(row, f"component {label} raised at t = {self.t:.3f} s: {error!r}{at}")

    def _fail(self, row: int, says: str) -> SimulationError:
        component = self.assembly.steps[row].component
        return SimulationError(says) if component.side == "plant" else StepFailed(says, component)


def list_stretches(first: int, last: int, slow: list[int]) -> list[Stretch]:
    """Split the rows from `first` to before `last` at those that run as plain Python."""
    out: list[Stretch] = []
    for i in [row for row in slow if first <= row < last]:
        if i > first:
            out.append((first, i))
        out.append((i, -1))
        first = i + 1
    return [*out, (first, last)] if last > first else out
