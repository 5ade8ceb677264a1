"""A byte stream of MAVLink 2 in both directions, by pymavlink.

pymavlink is an optional dependency. Invalid data are counted by cause and dropped; no input raises,
and memory is bounded.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

from skywright.errors import InputError

CAUSES = {
    "checksum": "a packet whose checksum is wrong, or whose definition differs",
    "version": "a packet of MAVLink 1",
    "unknown": "a message that the dialect common does not have",
    "garbage": "bytes that belong to no packet",
}
"""Cause of dropped bytes or messages -> description."""
MAVLINK_1 = 0xFE
"""First byte of a packet of MAVLink 1."""


def load_dialect() -> Any:
    """Import the dialect "common"; raises InputError if pymavlink is not installed."""
    try:
        from pymavlink.dialects.v20 import common
    except ImportError:
        raise InputError("MAVLink requires pymavlink: pip install 'skywright[mavlink]'") from None
    return common


class MavlinkStream:
    """Packets of one connection: bytes to messages, and messages to bytes."""

    def __init__(self, system: int = 1, component: int = 1) -> None:
        """`system` and `component` are the ids of sent packets. Raises as load_dialect."""
        self.dialect = load_dialect()
        self.counts: Counter[str] = Counter()
        self._ids = (system, component)
        self._restart()
        self._sender = self.dialect.MAVLink(None, system, component)

    def _restart(self) -> None:
        self._parser = self.dialect.MAVLink(None, *self._ids)
        self._parser.robust_parsing = True

    def feed(self, data: bytes) -> list[Any]:
        """Return the messages that `data` completes; count invalid data."""
        try:
            found = self._parser.parse_buffer(data) or []
        except Exception:  # an error of the library on invalid bytes
            self.counts["garbage"] += 1
            self._restart()
            return []
        return [m for m in found if self._accept(m)]

    def _accept(self, message: Any) -> bool:
        cause = _find_cause(message)
        self.counts[cause or "accepted"] += 1
        return cause is None

    def pack(self, message: Any) -> bytes:
        """Return the packet of a message of the dialect."""
        sender = self._sender
        data: bytes = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        return data


def _find_cause(message: Any) -> str | None:
    kind = message.get_type()
    if kind == "BAD_DATA":
        return "checksum" if "CRC" in str(message.reason) else "garbage"
    if kind.startswith("UNKNOWN"):
        return "unknown"
    return "version" if message.get_msgbuf()[0] == MAVLINK_1 else None


def is_finite(message: Any, *fields: str) -> bool:
    """Whether all numbers of the named fields of a message are finite."""
    return all(math.isfinite(x) for name in fields for x in _list_numbers(getattr(message, name)))


def _list_numbers(value: Any) -> Iterator[float]:
    if isinstance(value, list | tuple):
        for x in value:
            yield float(x)
    else:
        yield float(value)
