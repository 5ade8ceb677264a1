"""The tick: executes the rows of a schedule. It is independent of components and compiled once.

A row is a step: the addresses of its machine code and of its ports. Random numbers are ports with a
moving address: the base plus the clock's row of the block times a stride.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numba import carray
from numpy.typing import NDArray

from skywright.core.compiled import helper
from skywright.core.pointers import as_pointer
from skywright.core.user_code import njit
from skywright.vehicle.bus import Clock
from skywright.vehicle.native import MAX_PORTS, call_step
from skywright.vehicle.physics import step_physics

ROW = np.dtype(
    [
        ("function", np.int64),  # address; 0: plain Python
        ("n", np.int64),  # ports
        ("ports", np.int64, MAX_PORTS),  # addresses
        ("n_draws", np.int64),  # number of ports with a moving address
        ("draw_port", np.int64, MAX_PORTS),
        ("draw_base", np.int64, MAX_PORTS),  # address of the block
        ("draw_stride", np.int64, MAX_PORTS),  # bytes per row of the block
        ("every", np.int64),  # control ticks in which it is called `calls` times, evenly
        ("calls", np.int64),
        ("phase", np.int64),  # of the calls: see `is_due`
        ("fast", np.int64),  # 1: called after each physics step
    ]
)
CALL = 8
"""Numbers of a call of `run_ticks`: its arguments, in their order."""
MOST_CALLS = 1000
"""Largest `calls` of a row: bounds the error of its mean interval."""
CLOCK = Clock.dtype
_SIZE, _PORTS = ROW.itemsize, ROW.fields["ports"][1]  # type: ignore[index]


def count_calls(period: float, dt: float) -> tuple[int, int]:
    """Return (every, calls): `calls` in `every` control ticks of `dt` s have a mean interval of
    `period` s; each tick if the period is not longer."""
    found = Fraction(max(period / dt, 1.0)).limit_denominator(MOST_CALLS)
    return found.numerator, found.denominator


@helper
def is_due(tick: int, every: int, calls: int, phase: int) -> bool:
    """Return whether a row is called in a control tick: the first at or after each multiple of its
    period."""
    return phase <= tick * calls % every < phase + calls


@njit(cache=True, error_model="numpy", nogil=True)
def run_rows(at: int, first: int, last: int, clock_at: int) -> bool:
    """Run the rows first to last - 1 that are due; returns True if the tick must end at once.

    `at` is the address of the rows, `clock_at` that of the clock.
    """
    rows, clock = carray(as_pointer(at), last, ROW), carray(as_pointer(clock_at), 1, CLOCK)[0]
    for r in range(first, last):
        row = rows[r]
        if row.every != 1 and not is_due(clock.tick, row.every, row.calls, row.phase):
            continue
        clock.running = r
        index = clock.fast if row.fast else clock.block
        for i in range(row.n_draws):
            row.ports[row.draw_port[i]] = row.draw_base[i] + index * row.draw_stride[i]
        error = call_step(row.function, at + r * _SIZE + _PORTS, row.n)
        if error != 0:
            clock.error, clock.failed = error, r
            return True
        if clock.stop:
            return True
    return False


@njit(cache=True, error_model="numpy")
def repeat_row(at: int, row: int, clock_at: int, n: int) -> None:
    """Call a row `n` times, to measure its run time."""
    for _ in range(n):
        run_rows(at, row, row + 1, clock_at)


@njit(cache=True, error_model="numpy", nogil=True)
def run_ticks(
    at: int, n_control: int, n_all: int, clock_at: int, model: int, data: int, n: int, n_steps: int
) -> None:
    """Run up to `n` control ticks of `n_steps` physics steps each; a fired guard ends the run."""
    clock = carray(as_pointer(clock_at), 1, CLOCK)[0]
    for _ in range(n):
        if run_rows(at, 0, n_control, clock_at):
            return
        end_control(clock_at)
        for _ in range(n_steps):
            step_physics(model, data, 1)
            if run_rows(at, n_control, n_all, clock_at):
                return
            clock.fast += 1
        if clock.fired:
            return


@njit(cache=True, error_model="numpy", nogil=True)
def run_mission_tick(call: NDArray[np.int64]) -> int:
    """Run a mission tick; return the guards that fired, -1 if it failed. `call` is (CALL,).

    The mask selects no guard: only those fire that always do, and end the tick early.
    """
    clock = carray(as_pointer(call[3]), 1, CLOCK)[0]
    clock.mask = clock.fired = clock.stop = 0
    run_ticks(call[0], call[1], call[2], call[3], call[4], call[5], call[6], call[7])
    return -1 if clock.stop or clock.error else clock.fired


@njit(cache=True, error_model="numpy", nogil=True)
def end_control(clock_at: int) -> None:
    """Advance the clock by a control tick."""
    clock = carray(as_pointer(clock_at), 1, CLOCK)[0]
    clock.tick += 1
    clock.block += 1
    clock.t = clock.tick * clock.dt
