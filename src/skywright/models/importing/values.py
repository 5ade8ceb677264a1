"""Numbers of a robot file in construction, each with its source, and questions for missing ones."""

from __future__ import annotations

from typing import Any, NamedTuple

PLACEHOLDER = 99.0
"""N m: servos of flying arms are weaker; files contain 100 or 1000 if nobody measured."""


class Value(NamedTuple):
    """A number, text or list of a robot file, and its source."""

    value: Any
    source: str = ""  # "": a choice, not a number
    note: str = ""
    range: tuple[float, float] | None = None


class Question(NamedTuple):
    """A value that a robot file requires and the source file lacks."""

    key: str  # dotted, from the root `robot`
    text: str
    guess: Any
    range: tuple[float, float] | None


def imported(value: Any, note: str) -> Value:
    """Return a value of the file; `note` states where it was found."""
    return Value(value, "imported", note)
