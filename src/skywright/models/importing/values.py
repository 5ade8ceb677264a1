"""Numbers of a robot file under way, each with its source, and questions for those that lack."""

from __future__ import annotations

from typing import Any, NamedTuple

PLACEHOLDER = 99.0
"""N m: servos of flying arms are weaker; files write 100 or 1000 where nobody measured."""


class Value(NamedTuple):
    """A number, text or list of a robot file, and where it comes from."""

    value: Any
    source: str = ""  # "": a choice, no number
    note: str = ""
    range: tuple[float, float] | None = None


class Question(NamedTuple):
    """What the file does not say and a robot file must."""

    key: str  # dotted, from the root `robot`
    text: str
    guess: Any
    range: tuple[float, float] | None


def imported(value: Any, note: str) -> Value:
    """Return a value that the file has; `note` says where."""
    return Value(value, "imported", note)
