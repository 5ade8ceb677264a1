"""Checks of the arguments of commands, with an InputError of one line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skywright.errors import InputError

Array = NDArray[np.float64]
LARGEST = 1000.0  # m, as in world files, m/s, N
MOST_TURNS = 4


def check_number(name: str, value: Any, most: float = math.inf) -> float:
    """Return a finite number of magnitude up to `most`; raise InputError with its name."""
    try:
        out = float(value)
    except (TypeError, ValueError):
        out = math.nan
    if not math.isfinite(out):
        raise InputError(f"{name} = {value!r}; valid: a finite number")
    if abs(out) > most:
        raise InputError(f"{name} = {out:g}; valid: within +-{most:g}")
    return out


def check_heading(yaw: float) -> float:
    """Return a heading (rad) of up to MOST_TURNS turns: beyond them it would be in degrees."""
    if abs(yaw) > MOST_TURNS * math.tau:
        raise InputError(f"yaw = {yaw:g} rad: over {MOST_TURNS} turns; give rad, not degrees")
    return yaw


def check_positive(name: str, value: Any) -> float:
    """Return a finite number above 0; raise InputError with the argument's name."""
    out = check_number(name, value)
    if out <= 0.0:
        raise InputError(f"{name} = {out:g}; valid: a number above 0")
    return out


def check_seed(value: Any) -> None:
    """Raise InputError if a value is neither a seed of random numbers nor None."""
    if value is None:
        return
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 0:
        raise InputError(f"seed = {value!r}; valid: a whole number from 0")


def check_bounded(name: str, value: ArrayLike) -> Array:
    """Return a position, velocity or force (3,) in SI units up to LARGEST; raise InputError."""
    out = check_vector(name, value)
    if np.max(np.abs(out)) > LARGEST:
        raise InputError(f"{name} = {value!r}; valid: 3 numbers within +-{LARGEST:g}")
    return out


def check_vector(name: str, value: ArrayLike | None, n: int = 3) -> Array:
    """Return n finite numbers (n,); raise InputError with the argument's name."""
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        out = np.zeros(0)
    if out.shape != (n,) or not np.all(np.isfinite(out)):
        valid = f"{n} finite numbers" if n > 1 else "a list of one finite number"
        raise InputError(f"{name} = {value!r}; valid: {valid}")
    return out
