"""Compile the flight loop in a separate process, in parallel with planning.

The first run on a machine compiles planner and flight loop. Each takes about twenty seconds and one
core, so a second process compiles the loop into numba's cache while the first one plans.
"""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skywright.description.loader import Description


def is_compiled() -> bool:
    """Whether numba's cache contains the compiled schedule of this source."""
    from skywright.vehicle.schedule import run_ticks

    return is_cached(run_ticks)


def is_cached(function: Any) -> bool:
    """Whether a numba function is compiled, in memory or on disk."""
    if function.signatures:
        return True
    try:  # numba's own check: its version, and the time stamp of the source
        return bool(function._cache._cache_file._load_index())
    except AttributeError:  # another version of numba: whether any file exists
        folder = Path(function.stats.cache_path or ".")
        return any(folder.glob(f"*.{function.__name__}-*.nbi"))


def start_warm_up(description: Description[Any]) -> subprocess.Popen[bytes]:
    """Start compiling the flight loop in the background; wait for the process before the flight."""
    process = subprocess.Popen(
        [sys.executable, "-m", "skywright.run.compile_loop"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdin is not None
    with contextlib.suppress(OSError), process.stdin:
        pickle.dump(description, process.stdin)
    return process
