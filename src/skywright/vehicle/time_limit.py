"""A step that never returns is stopped: a user's law may hold an endless loop."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from skywright.errors import SimulationError
from skywright.vehicle.ticker import Ticker

POLL = 0.2  # s


class StepTooLong(SimulationError):
    """A step did not return."""


@contextmanager
def watch(ticker: Ticker, on_stuck: Callable[[str], None], limit: float) -> Iterator[None]:
    """Watch the mission ticks that run in the block.

    A step in plain Python is interrupted: StepTooLong rises out of it. Compiled code cannot be:
    `on_stuck` is called with what to say, from another thread, while the step still runs; it has to
    save what was recorded and end the process. Does nothing while a debugger traces.
    """
    done = threading.Event()
    thread_id = threading.get_ident()

    def poll() -> None:
        while not done.wait(POLL):
            since = ticker.since
            if since is None or time.monotonic() - since < limit or sys.gettrace() is not None:
                continue
            label, python = ticker.find_running()
            says = (
                f"component {label} did not return within {limit:g} s at t = {ticker.t:.3f} "
                "s: check it for an endless loop"
            )
            if not python:
                on_stuck(says)
                return
            ticker.stuck = says
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(thread_id), ctypes.py_object(StepTooLong)
            )
            done.wait(limit)  # once; the exception rises at the next line of Python

    thread = threading.Thread(target=poll, name="time limit", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
