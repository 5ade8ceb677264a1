"""Fixed byte layout of a ROS 2 message, from its definition.

ROS 2 messages travel in CDR (OMG's Common Data Representation, little endian, XCDR version 1):
a header of 4 bytes, then the fields in order, each primitive aligned to its own size counted from
behind the header, strings and sequences led by their length. Once the texts and the lengths of
the sequences are fixed, every number has a fixed place: a message is a template of bytes with
holes, and NumPy fills the holes of many messages column by column.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import NamedTuple

HEADER = b"\x00\x01\x00\x00"
"""CDR header: little endian, no options."""

PRIMITIVES = {
    "uint8": "<u1",
    "byte": "<u1",
    "int32": "<i4",
    "uint32": "<u4",
    "int64": "<i8",
    "float64": "<f8",
}

STAMP = "builtin_interfaces/Time"
"""Seconds (int32) and nanoseconds (uint32): laid out as one number, seconds + nanoseconds * 2^32,
which a column fills at once. It is aligned to 4 bytes, as its two parts are."""


class Field(NamedTuple):
    """A field of a message definition; `array` is None, a fixed length, or -1 for a sequence."""

    kind: str
    name: str
    array: int | None


class Column(NamedTuple):
    """Where a value stands in each message: NumPy format, how many of it, byte offset."""

    format: str
    length: int
    offset: int


class Layout(NamedTuple):
    """A message with fixed texts and lengths: its bytes with zeros for numbers, and their places.

    `leaves` maps the path of every number (such as `pose.position.x` or `position[0]`) to its
    place in `template`, in order.
    """

    template: bytes
    leaves: dict[str, Column]

    def column(self, path: str) -> Column:
        """Return the place of a number, or of all numbers below `path` (one block of one type)."""
        if path in self.leaves:
            return self.leaves[path]
        below = [c for p, c in self.leaves.items() if p.startswith((path + ".", path + "["))]
        assert below, f"no field {path}"
        first = below[0]
        size = int(first.format[2:])
        for i, column in enumerate(below):
            assert column == (first.format, 1, first.offset + i * size), f"{path} is no block"
        return Column(first.format, len(below), first.offset)


def parse_definition(kind: str, text: str) -> dict[str, list[Field]]:
    """Parse a `ros2msg` schema: the type itself, then `MSG: name` sections behind lines of `=`.

    Returns the fields of every type by its name (`pkg/Type`); constants and comments are skipped.
    """
    types: dict[str, list[Field]] = {}
    fields = types.setdefault(kind, [])
    for raw in text.splitlines():
        line = raw.partition("#")[0].strip()
        if not line or line.startswith("==="):
            continue
        if line.startswith("MSG: "):
            fields = types.setdefault(line[5:].strip(), [])
            continue
        if "=" in line:
            continue
        kind_text, name = line.split()
        base, bracket, length = kind_text.partition("[")
        array = None if not bracket else -1 if length == "]" else int(length[:-1])
        fields.append(Field(base, name, array))
    return types


def build_layout(
    kind: str, definition: str, texts: Mapping[str, str], lengths: Mapping[str, int]
) -> Layout:
    """Lay out a message of type `kind` (`pkg/Type`).

    `texts` gives every string by its path (`header.frame_id`, `name[0]`; empty where missing),
    `lengths` the length of every sequence by its path (0 where missing).
    """
    types = parse_definition(kind, definition)
    body = bytearray()
    leaves: dict[str, Column] = {}

    def align(size: int) -> None:
        body.extend(bytes(-len(body) % size))

    def put(kind: str, path: str) -> None:
        if kind == "string":
            text = texts.get(path, "").encode() + b"\0"
            align(4)
            body.extend(struct.pack("<I", len(text)) + text)
        elif kind in PRIMITIVES or kind == STAMP:
            format, alignment = (
                ("<u8", 4) if kind == STAMP else (PRIMITIVES[kind], int(PRIMITIVES[kind][2:]))
            )
            align(alignment)
            leaves[path] = Column(format, 1, len(HEADER) + len(body))
            body.extend(bytes(int(format[2:])))
        else:
            for field in types[kind]:
                put_field(field, f"{path}.{field.name}" if path else field.name)

    def put_field(field: Field, path: str) -> None:
        if field.array is None:
            put(field.kind, path)
            return
        count = field.array
        if count < 0:
            count = lengths.get(path, 0)
            align(4)
            body.extend(struct.pack("<I", count))
        for i in range(count):
            put(field.kind, f"{path}[{i}]")

    put(kind, "")
    return Layout(HEADER + bytes(body), leaves)
