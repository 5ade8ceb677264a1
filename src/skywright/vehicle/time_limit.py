"""Time limit that stops a step which never returns, e.g. an endless loop in a user's law."""

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
    """Apply a time limit (s) to the mission ticks in the block.

    A step in plain Python is interrupted with StepTooLong. Compiled code cannot be interrupted:
    another thread calls `on_stuck` with the message while the step still runs. `on_stuck` must save
    the recording and end the process. The limit has no effect while a debugger traces.
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
            done.wait(limit)  # once: the exception is raised at the next Python instruction

    thread = threading.Thread(target=poll, name="time limit", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
