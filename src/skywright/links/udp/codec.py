"""Encoding and decoding of the packets in packets.py."""

from __future__ import annotations

import hmac
import math
import struct
from typing import Any, NamedTuple

from skywright.links.udp.packets import (
    HEADER,
    KINDS,
    MAGIC,
    MAX_SIZE,
    TAG,
    TYPES,
    VERSION,
    Field,
    Kind,
    find_kind,
    get_size,
)

Value = float | int | bytes | tuple[float, ...] | tuple[int, ...]


class Packet(NamedTuple):
    """A received packet; `values` contains the body by the names of its fields."""

    kind: Kind
    session: int
    sequence: int
    time_us: int
    values: dict[str, Any]


class Rejected(NamedTuple):
    """Why bytes are not a valid packet: the name of a cause."""

    cause: str


def _build_struct(fields: tuple[Field, ...]) -> struct.Struct:
    letters = [TYPES[f.type][0] for f in fields]
    counts = [f.length for f in fields]
    return struct.Struct("<" + "".join(f"{n}{x}" for n, x in zip(counts, letters, strict=True)))


HEAD = _build_struct(HEADER)
BODIES = {kind.number: _build_struct(kind.fields) for kind in KINDS}
BY_NUMBER = {kind.number: kind for kind in KINDS}
SIZES = {kind.number: get_size(kind) for kind in KINDS}


def encode(
    name: str, session: int, sequence: int, time_us: int, values: dict[str, Any], key: bytes = b""
) -> bytes:
    """Return the packet of the kind `name`; fields missing in `values` are zero.

    Arrays may be shorter than their field. Raises ValueError on an unknown field, a number out of
    range, or too long an array.
    """
    kind = find_kind(name)
    unknown = set(values) - {f.name for f in kind.fields}
    if unknown:
        raise ValueError(f"{name}: unknown fields {sorted(unknown)}")
    numbers: list[Any] = []
    for f in kind.fields:
        numbers += _list_numbers(name, f, values.get(f.name, b"" if f.type == "char" else 0))
    try:
        data = HEAD.pack(
            MAGIC, VERSION, kind.number, SIZES[kind.number], session, sequence, time_us
        ) + BODIES[kind.number].pack(*numbers)
    except (struct.error, OverflowError) as error:
        raise ValueError(f"{name}: {error}") from None
    return data + compute_tag(data, key)


def _list_numbers(name: str, f: Field, value: Any) -> list[Any]:
    if f.type == "char":
        return [value[: f.length] if isinstance(value, bytes) else str(value).encode()[: f.length]]
    given = [value] if f.length == 1 else [] if isinstance(value, int) else list(value)
    if len(given) > f.length:
        raise ValueError(f"{name}.{f.name}: {len(given)} values; at most {f.length}")
    numbers = [float(x) if f.type[0] == "f" else int(x) for x in given]
    if not all(abs(x) <= f.limit and math.isfinite(x) for x in numbers):
        raise ValueError(f"{name}.{f.name} is not within {f.limit:g} or not finite")
    return numbers + [0] * (f.length - len(numbers))


def compute_tag(data: bytes, key: bytes) -> bytes:
    """Return the tag (16 bytes) of header and body; zeros without a key."""
    return hmac.digest(key, data, "sha256")[:TAG] if key else bytes(TAG)


def decode(data: bytes, key: bytes = b"") -> Packet | Rejected:
    """Return the packet, or the cause for which the bytes are invalid.

    The tag is checked before the body is read.
    """
    if len(data) > MAX_SIZE:
        return Rejected("oversized")
    if len(data) < HEAD.size + TAG:
        return Rejected("short")
    magic, version, number, size, session, sequence, time_us = HEAD.unpack_from(data)
    if magic != MAGIC:
        return Rejected("magic")
    if version != VERSION:
        return Rejected("version")
    if number not in BY_NUMBER:
        return Rejected("kind")
    if size != len(data) or size != SIZES[number]:
        return Rejected("size")
    if not hmac.compare_digest(compute_tag(data[:-TAG], key), data[-TAG:]):
        return Rejected("tag")
    kind = BY_NUMBER[number]
    values = _read_values(kind, BODIES[number].unpack_from(data, HEAD.size))
    if values is None:
        return Rejected("value")
    return Packet(kind, session, sequence, time_us, values)


def _read_values(kind: Kind, numbers: tuple[Any, ...]) -> dict[str, Any] | None:
    """Return the fields by name; None if one is not finite or out of range."""
    values: dict[str, Any] = {}
    at = 0
    for f in kind.fields:
        if f.type == "char":
            values[f.name] = numbers[at].rstrip(b"\0").decode("ascii", "replace")
            at += 1
            continue
        part = numbers[at : at + f.length]
        at += f.length
        if f.type[0] == "f" or f.limit < math.inf:
            for x in part:
                if not abs(x) <= f.limit or x in (math.inf, -math.inf):  # also false for NaN
                    return None
        values[f.name] = part[0] if f.length == 1 else part
    return values
