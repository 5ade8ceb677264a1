"""Arguments of commands: numbers that are finite, or one clear line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skywright.errors import InputError

Array = NDArray[np.float64]
LARGEST = 1000.0  # m, as in world files, m/s, N


def check_number(name: str, value: Any, most: float = math.inf) -> float:
    """Return a finite number of size up to `most`; raises InputError naming the argument."""
    try:
        out = float(value)
    except (TypeError, ValueError):
        out = math.nan
    if not math.isfinite(out):
        raise InputError(f"{name} = {value!r}; valid: a finite number")
    if abs(out) > most:
        raise InputError(f"{name} = {out:g}; valid: within +-{most:g}")
    return out


def check_positive(name: str, value: Any) -> float:
    """Return a finite number above 0; raises InputError naming the argument."""
    out = check_number(name, value)
    if out <= 0.0:
        raise InputError(f"{name} = {out:g}; valid: a number above 0")
    return out


def check_bounded(name: str, value: ArrayLike) -> Array:
    """Return a place, velocity or force (3,) in SI units up to LARGEST; raises InputError."""
    out = check_vector(name, value)
    if np.max(np.abs(out)) > LARGEST:
        raise InputError(f"{name} = {value!r}; valid: 3 numbers within +-{LARGEST:g}")
    return out


def check_vector(name: str, value: ArrayLike | None, n: int = 3) -> Array:
    """Return n finite numbers (n,); raises InputError naming the argument."""
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        out = np.zeros(0)
    if out.shape != (n,) or not np.all(np.isfinite(out)):
        valid = f"{n} finite numbers" if n > 1 else "a list of one finite number"
        raise InputError(f"{name} = {value!r}; valid: {valid}")
    return out
