"""Values of JSON files that a program wrote and anybody may have changed: read by their type."""

import math
from typing import Any

LONGEST = 60  # characters of a wrong value in a message


def read_real(value: Any, what: str) -> float:
    """Return a finite number; raises ValueError for everything else."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            real = float(value)
        except OverflowError:
            real = math.inf
        if math.isfinite(real):
            return real
    raise ValueError(f"{what} is {_show(value)}; valid: a finite number")


def read_count(value: Any, what: str) -> int:
    """Return a whole number from 0 on; raises ValueError for everything else."""
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**63:
        return value
    raise ValueError(f"{what} is {_show(value)}; valid: a whole number from 0 on")


def read_words(value: Any, what: str) -> str:
    """Return a text; raises ValueError for everything else."""
    if isinstance(value, str):
        return value
    raise ValueError(f"{what} is {_show(value)}; valid: a text")


def read_table(value: Any, what: str) -> dict[str, Any]:
    """Return a table; raises ValueError for everything else."""
    if isinstance(value, dict):
        return value
    raise ValueError(f"{what} is {_show(value)}; valid: a table")


def read_list(value: Any, what: str) -> list[Any]:
    """Return a list; raises ValueError for everything else."""
    if isinstance(value, list):
        return value
    raise ValueError(f"{what} is {_show(value)}; valid: a list")


def _show(value: Any) -> str:
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value) if abs(value) < 10**18 else "a number of more than 18 digits"
    if isinstance(value, dict | list):
        return f"a {'table' if isinstance(value, dict) else 'list'} of {len(value)} entries"
    text = repr(value[:LONGEST] if isinstance(value, str) else value)
    return text[:LONGEST]
