"""Timing in turns: cases alternate, so that a busy machine slows all of them alike.

Work in this process is timed by its processor time. On an idle machine that equals the wall time;
on a busy one it excludes the time of other processes.
"""

import ctypes
import gc
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

Seconds = list[float]

read_clock = time.process_time


def interleave(cases: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, Seconds]:
    """Call each case once per round and collect the returned times (s).

    The first round is a warm-up and discarded. Every other round runs backwards, so that a slow
    drift of the clock cancels. The garbage collector is disabled, as in `timeit`.
    """
    times: dict[str, Seconds] = {name: [] for name in cases}
    names = list(cases)
    gc.collect()
    gc.disable()
    try:
        for i in range(rounds + 1):
            for name in names if i % 2 else reversed(names):
                times[name].append(cases[name]())
    finally:
        gc.enable()
    return {name: values[1:] for name, values in times.items()}


def compute_ratios(above: Seconds, below: Seconds) -> list[float]:
    """Return the ratio of each round; its median is more robust than a ratio of sums."""
    return [a / b for a, b in zip(above, below, strict=True)]


def read_rss() -> float:
    """Return the resident memory of this process (MB). Raises OSError without /proc.

    Free memory is returned to the system first, so that growth means memory in use: the C library
    keeps a varying number of freed blocks.
    """
    gc.collect()
    with suppress(AttributeError):  # a C library other than GNU's
        ctypes.CDLL(None).malloc_trim(0)
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1e3
    raise OSError("/proc/self/status has no VmRSS")
