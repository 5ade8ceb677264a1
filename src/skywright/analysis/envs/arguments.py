"""Checks of the arguments of environments."""

from __future__ import annotations

import operator
from typing import Any

from skywright.errors import InputError


def read_whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """Return a whole number, also one of NumPy's. Raises InputError for others and booleans."""
    valid = f"a whole number from {least}" if most is None else f"{least} to {most}"
    try:
        whole = operator.index(value)
    except TypeError:
        whole = least - 1
    if isinstance(value, bool) or whole < least or (most is not None and whole > most):
        raise InputError(f"{name} = {value!r}; valid: {valid}")
    return whole
