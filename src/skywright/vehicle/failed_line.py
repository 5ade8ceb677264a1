"""The line where a step raised."""

from __future__ import annotations

import traceback

import numpy as np

from skywright.core.user_files import is_user_module
from skywright.vehicle.assembly import Assembly

NO_LINE = "set compiled = False to see the line"
"""In place of a line."""


def find_line(assembly: Assembly, row: int, error: BaseException) -> str:
    """Return `file:line` where a compiled step raised `error`, for errors without a place.

    The row runs once more in plain Python, and all records are then restored. A built-in step
    does not run: it may write to memory outside the records. Returns "" for it, and NO_LINE if no
    exception of the same type is raised.
    """
    if type(assembly.steps[row].component).__module__.startswith("skywright."):
        return ""
    saved = assembly.arena.copy()
    try:
        with np.errstate(all="ignore"):  # as in compiled code
            assembly.run_python(row)
    except (Exception, SystemExit) as found:
        return name_line(found) if type(found) is type(error) else NO_LINE
    finally:
        assembly.arena[:] = saved
    return NO_LINE


def name_line(error: BaseException) -> str:
    """Return `file:line` of the last frame in a user's file, else of the last frame."""
    frames = list(traceback.walk_tb(error.__traceback__))
    own = [f for f in frames if is_user_module(f[0].f_globals.get("__name__", ""))]
    frame, line = (own or frames)[-1]
    return f"{frame.f_code.co_filename}:{line}"
