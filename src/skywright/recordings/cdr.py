"""Fixed byte layout of a ROS 2 message, computed from its definition.

ROS 2 messages are serialised in CDR (OMG's Common Data Representation, little endian, XCDR version
1): a header of 4 bytes, then the fields in order. Each primitive is aligned to its own size,
counted from the end of the header. Strings and sequences begin with their length. If all strings
and the lengths of all sequences are fixed, every number has a fixed offset. A message is then a
template of bytes, into which NumPy writes the numbers of many messages column by column.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

HEADER = b"\x00\x01\x00\x00"
"""CDR header: little endian, no options."""

PRIMITIVES = {
    "bool": "<u1", "byte": "<u1", "char": "<u1", "uint8": "<u1", "int8": "<i1", "uint16": "<u2",
    "int16": "<i2", "uint32": "<u4", "int32": "<i4", "uint64": "<u8", "int64": "<i8",
    "float32": "<f4", "float64": "<f8",
}  # fmt: skip

STAMP = "builtin_interfaces/Time"
"""Seconds (int32) and nanoseconds (uint32), written as one number: seconds + nanoseconds * 2^32.
The number is aligned to 4 bytes, like its two parts."""


class Field(NamedTuple):
    """A field of a message definition; `array`: None (no array), fixed length, or -1 (sequence)."""

    kind: str
    name: str
    array: int | None


class Column(NamedTuple):
    """Location of a value in each message: NumPy format, number of values, byte offset."""

    format: str
    length: int
    offset: int


class Layout(NamedTuple):
    """Layout of a message with fixed strings and lengths.

    `template` contains the bytes of the message, with zeros for numbers. `leaves` maps the path of
    every number (such as `pose.position.x` or `position[0]`) to its location in `template`, in
    order.
    """

    template: bytes
    leaves: Mapping[str, Column]

    def column(self, path: str) -> Column:
        """Return the location of a number, or of all numbers below `path` (one block of one type).

        Raises ValueError if there is no such block.
        """
        if path in self.leaves:
            return self.leaves[path]
        below = [c for p, c in self.leaves.items() if p.startswith((path + ".", path + "["))]
        if not below:
            raise ValueError(f"no field {path}")
        first = below[0]
        size = int(first.format[2:])
        for i, column in enumerate(below):
            if column != (first.format, 1, first.offset + i * size):
                raise ValueError(f"{path} is no block")
        return Column(first.format, len(below), first.offset)

    def holds(self, path: str) -> bool:
        """Whether there is a number at or below `path`."""
        below = (path + ".", path + "[")
        return path in self.leaves or any(p.startswith(below) for p in self.leaves)

    def is_quaternion(self, path: str) -> bool:
        """Whether `path` is a quaternion: x, y, z, w and no other field."""
        below = [p.removeprefix(path) for p in self.leaves if p.startswith(path + ".")]
        return below == [".x", ".y", ".z", ".w"]


@lru_cache(maxsize=256)  # a recording has the same ones in many topics
def parse_definition(kind: str, text: str) -> Mapping[str, Sequence[Field]]:
    """Parse a `ros2msg` schema: the type itself, then `MSG: name` sections after lines of `=`.

    Return the fields of every type by its name (`pkg/Type`). Constants and comments are skipped.
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
    """Return the layout of a message of type `kind` (`pkg/Type`).

    `texts` maps the path of a string (`header.frame_id`, `name[0]`) to its text (default: empty).
    `lengths` maps the path of a sequence to its length (default: 0).
    """
    return _build_layout(kind, definition, tuple(texts.items()), tuple(lengths.items()))


@lru_cache(maxsize=512)  # every recording of a robot has the same topics
def _build_layout(
    kind: str, definition: str, texts: tuple[tuple[str, str], ...],
    lengths: tuple[tuple[str, int], ...],
) -> Layout:  # fmt: skip
    text_of, length_of = dict(texts), dict(lengths)
    return _lay_out(
        kind,
        definition,
        lambda path, at: text_of.get(path, "").encode() + b"\0",
        lambda path, at: length_of.get(path, 0),
    )


def read_layout(kind: str, definition: str, message: bytes) -> Layout:
    """Return the layout of an existing message, with its strings and lengths of sequences.

    Raises ValueError, KeyError, RecursionError or struct.error if the message does not match the
    definition.
    """

    def count(path: str, at: int) -> int:
        (n,) = struct.unpack_from("<I", message, at)
        if n > len(message):
            raise ValueError(f"{path}: {n} entries in {len(message)} bytes")
        return int(n)

    def read_text(path: str, at: int) -> bytes:
        return message[at + 4 : at + 4 + count(path, at)]

    layout = _lay_out(kind, definition, read_text, count)
    if len(layout.template) != len(message):
        raise ValueError(f"{len(message)} bytes, {len(layout.template)} expected")
    return layout


def _lay_out(
    kind: str,
    definition: str,
    give_text: Callable[[str, int], bytes],
    give_count: Callable[[str, int], int],
) -> Layout:
    """Return the layout of a message of type `kind`.

    `give_text` returns the bytes of a string (with its final NUL) and `give_count` the length of a
    sequence. Both receive the path and the byte offset of the length in the message.
    """
    types = parse_definition(kind, definition)
    body = bytearray()
    leaves: dict[str, Column] = {}

    def align(size: int) -> None:
        body.extend(bytes(-len(body) % size))

    def put(kind: str, path: str) -> None:
        if kind == "string":
            align(4)
            text = give_text(path, len(HEADER) + len(body))
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
            align(4)
            count = give_count(path, len(HEADER) + len(body))
            body.extend(struct.pack("<I", count))
        for i in range(count):
            put(field.kind, f"{path}[{i}]")

    put(kind, "")
    return Layout(HEADER + bytes(body), leaves)
