"""Timing side by side: cases take turns, so that a busy machine slows all of them alike.

What runs in this process is timed by its processor time. On an idle machine that is the wall time;
on a busy one the time that others had is not in it.
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
    """Call each case once a round and collect the seconds that it returns.

    A first round warms up and is dropped. Every other round runs backwards, so that a slow drift
    of the clock cancels. The garbage collector rests meanwhile, as it does in `timeit`.
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
    """Return the ratio of each round; its median is robust where a ratio of sums is not."""
    return [a / b for a, b in zip(above, below, strict=True)]


def read_rss() -> float:
    """Return the resident memory of this process (MB); raises OSError where /proc is missing.

    What is free is given back to the system first, so that growth means memory in use: the C
    library keeps freed blocks, and how many is chance.
    """
    gc.collect()
    with suppress(AttributeError):  # another C library than GNU's
        ctypes.CDLL(None).malloc_trim(0)
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1e3
    raise OSError("/proc/self/status has no VmRSS")
