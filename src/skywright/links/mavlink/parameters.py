"""Parameters of a simulated robot over MAVLink, under PX4's names.

Those of the robot (geometry, motor curve, gains) are read-only; few can be set. PX4 sends the bytes
of an INT32 in the float of PARAM_VALUE.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

INT32, REAL32 = 6, 9
"""MAV_PARAM_TYPE."""


class Settable(NamedTuple):
    """A parameter that can be set, within limits."""

    name: str
    value: float
    low: float
    high: float


class Parameters:
    """Names and values, in a fixed order."""

    def __init__(self, fixed: Sequence[tuple[str, int | float]], settable: Sequence[Settable]):
        """`fixed` are names and values, `settable` floats with limits."""
        self._settable = {p.name: p for p in settable}
        self._values: dict[str, int | float] = {p.name: float(p.value) for p in settable}
        self._values |= {name: value for name, value in fixed if name not in self._values}
        self.names = sorted(self._values)

    def __getitem__(self, name: str) -> int | float:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def set(self, name: str, value: float) -> str:
        """Set a parameter; return why this failed, or ""."""
        entry = self._settable.get(name)
        if entry is None:
            return f"{name} cannot be set"
        if not (math.isfinite(value) and entry.low <= value <= entry.high):
            return f"{name} = {value:g}; valid: {entry.low:g} to {entry.high:g}"
        self._values[name] = value
        return ""

    def build(self, dialect: Any, name: str) -> Any:
        """Return the PARAM_VALUE of a parameter."""
        value = self._values[name]
        whole = isinstance(value, int)
        number = struct.unpack("<f", struct.pack("<i", value))[0] if whole else float(value)
        return dialect.MAVLink_param_value_message(
            name.encode(), number, INT32 if whole else REAL32, len(self.names),
            self.names.index(name),
        )  # fmt: skip

    def list_messages(self, dialect: Any) -> Iterator[Any]:
        """Yield the PARAM_VALUE of every parameter."""
        for name in self.names:
            yield self.build(dialect, name)


def read_name(message: Any) -> str:
    """Return the name in PARAM_REQUEST_READ or PARAM_SET; "" if it is invalid."""
    raw = message.param_id
    data = raw.encode("latin-1", "replace") if isinstance(raw, str) else bytes(raw)
    return data.split(b"\0")[0].decode("ascii", "replace")


def read_value(message: Any) -> float:
    """Return the number in PARAM_SET, by its type; NaN for another type."""
    if message.param_type == INT32:
        try:
            return float(struct.unpack("<i", struct.pack("<f", message.param_value))[0])
        except (OverflowError, struct.error):
            return math.nan
    return float(message.param_value) if message.param_type == REAL32 else math.nan
