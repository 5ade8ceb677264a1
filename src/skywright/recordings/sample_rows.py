"""Samples as rows of ROS 2 messages: byte offset of each column in a message.

The messages of one sample form one row of fixed layout. To encode a batch, each column is written
to its place in all rows at once. Decoding reads each column from all rows at once.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.recordings.cdr import Column as Place
from skywright.recordings.cdr import Layout, build_layout, read_layout
from skywright.recordings.columns import Topic
from skywright.recordings.mcap_file import build_message_header
from skywright.recordings.messages import definition

BATCH = 256  # samples; largest number that is encoded at once


class _Fill(NamedTuple):
    """A column of the samples and its place in a row."""

    place: str
    column: str
    quaternion: bool


class Rows(NamedTuple):
    """All messages of one sample, one after the other, as one row of bytes.

    `buffer` contains BATCH copies of the template. It is reused: only its numbers change.
    """

    dtype: np.dtype[Any]
    buffer: NDArray[Any]
    offsets: dict[int, NDArray[np.uint64]]  # channel -> offsets of its records in BATCH rows
    headers: list[str]  # places of log and publish time
    stamps: list[str]
    fills: list[_Fill]

    def encode(self, samples: NDArray[Any], ns: NDArray[Any]) -> NDArray[Any]:
        """Return the message records of at most BATCH samples as a view of `buffer`."""
        rows = self.buffer[: len(samples)]
        for name in self.headers:
            rows[name] = ns[:, None]
        stamp = compute_stamp(ns)
        for name in self.stamps:
            rows[name] = stamp
        for place, column, quaternion in self.fills:
            target, values = rows[place], samples[column]
            if quaternion:
                target[:, :3], target[:, 3] = values[:, 1:], values[:, 0]
            else:
                target[...] = values
        return rows.view(np.uint8)


def build_rows(topics: Sequence[tuple[int, Topic]], samples: np.dtype[Any]) -> Rows:
    """Return the row layout: one MCAP record for each (channel, topic), one after the other.

    Raises InputError for a column that does not fit into the field of its message.
    """
    template = bytearray()
    names: list[str] = []
    formats: list[Any] = []
    places: list[int] = []
    starts: dict[int, int] = {}
    headers: list[str] = []
    stamps: list[str] = []
    fills: list[_Fill] = []

    def add(name: str, format: Any, place: int) -> str:
        names.append(name)
        formats.append(format)
        places.append(place)
        return name

    for channel, topic in topics:
        layout = build_topic_layout(topic)
        header = build_message_header(channel, len(layout.template), 0)
        starts[channel] = len(template)
        body = len(template) + len(header)
        headers.append(add(f"{topic.name} log_time", ("<u8", (2,)), body - 16))
        template += header + layout.template
        for path, place in layout.leaves.items():
            if path.endswith("stamp"):
                stamps.append(add(f"{topic.name} {path}", place.format, body + place.offset))
        for path, column in topic.fields.items():
            place, shape = layout.column(path), samples[column].shape
            if math.prod(shape) > place.length:
                raise InputError(
                    f"topic {topic.name!r}: column {column!r} has {math.prod(shape)} numbers, "
                    f"the field {path!r} of {topic.kind} has {place.length}"
                )
            name = f"{topic.name} {path}"
            add(name, _format(place, shape), body + place.offset)
            fills.append(_Fill(name, column, layout.is_quaternion(path)))
    dtype = np.dtype(
        {"names": names, "formats": formats, "offsets": places, "itemsize": len(template)}
    )
    buffer = np.frombuffer(bytearray(template * BATCH), dtype)
    first = np.arange(BATCH, dtype=np.uint64) * np.uint64(dtype.itemsize)
    offsets = {channel: first + np.uint64(at) for channel, at in starts.items()}
    return Rows(dtype, buffer, offsets, headers, stamps, fills)


def _format(place: Place, shape: tuple[int, ...]) -> Any:
    return (place.format, shape) if shape else place.format


def build_topic_layout(topic: Topic) -> Layout:
    """Return the layout of a topic's message. NUL, which ends a CDR string, is cut from texts."""
    texts = {path: text.replace("\0", "") for path, text in topic.texts.items()}
    texts.setdefault("header.frame_id", topic.frame)
    layout = build_layout(topic.kind, definition(topic.kind, topic.types), texts, topic.lengths)
    return layout._replace(template=_fill(layout, topic.numbers))


def _fill(layout: Layout, values: Mapping[str, float]) -> bytes:
    """Return a layout's template with the numbers `values` by path."""
    body = bytearray(layout.template)
    for path, value in values.items():
        place = layout.leaves[path]
        end = place.offset + int(place.format[2:])
        body[place.offset : end] = np.array(value, place.format).tobytes()
    return bytes(body)


def build_message(topic: Topic, ns: int, values: Mapping[str, float] | None = None) -> bytes:
    """Return one message of a topic with all stamps at `ns` and the numbers `values` by path."""
    layout = build_topic_layout(topic)
    stamp = int(compute_stamp(np.array([ns], np.uint64))[0])
    filled = {p: stamp for p in layout.leaves if p.endswith("stamp")} | dict(values or {})
    return _fill(layout, filled)


def read_rows(
    kind: str,
    text: str,
    fields: Mapping[str, str],
    messages: Sequence[bytes],
    stamped: bool = False,
) -> dict[str, NDArray[Any]]:
    """Decode messages of one type, defined by `text`; return the columns of `fields` by name.

    A column has the shape (n,) for a number and (n, k) for a block; quaternions are wxyz. A path
    without numbers, such as an empty sequence, gives (n, 0). `stamped` adds `t` (s), the first
    stamp of each message. Raises the exceptions of `read_layout`, and ValueError if messages differ
    in size.
    """
    layout = read_layout(kind, text, messages[0]) if messages else build_layout(kind, text, {}, {})
    size = len(layout.template)
    if any(len(m) != size for m in messages):
        raise ValueError("messages of different sizes")
    places = {path: layout.column(path) for path in fields if layout.holds(path)}
    stamps = [p for p in layout.leaves if p.endswith("stamp")] if stamped else []
    places |= {path: layout.leaves[path] for path in stamps[:1]}
    dtype = np.dtype(
        {
            "names": list(places),
            "formats": [
                _format(place, () if path in layout.leaves else (place.length,))
                for path, place in places.items()
            ],
            "offsets": [place.offset for place in places.values()],
            "itemsize": size,
        }
    )
    rows = np.frombuffer(b"".join(messages), dtype)
    found: dict[str, NDArray[Any]] = {c: np.zeros((len(rows), 0)) for c in fields.values()}
    for path in stamps[:1]:
        values = rows[path]
        seconds, rest = values & np.uint64(0xFFFFFFFF), values >> np.uint64(32)
        found["t"] = (seconds * np.uint64(10**9) + rest) / 1e9
    for path in fields.keys() & places.keys():
        values = rows[path]
        found[fields[path]] = values[:, [3, 0, 1, 2]] if layout.is_quaternion(path) else values
    return found


def read_log(message: bytes) -> tuple[float, str]:
    """Return time (s) and text of a Log message.

    The time is rounded once: 5.76 is read back as 5.76. Raises struct.error or UnicodeDecodeError
    if the message is damaged.
    """
    sec, nanosec = struct.unpack_from("<iI", message, 4)
    at = 16  # CDR header 4, stamp 8, level 1, alignment 3
    (length,) = struct.unpack_from("<I", message, at)
    at += 4 + length
    at += -at % 4
    (length,) = struct.unpack_from("<I", message, at)
    return (sec * 10**9 + nanosec) / 1e9, message[at + 4 : at + 3 + length].decode()


def compute_stamp(ns: NDArray[Any]) -> NDArray[Any]:
    """Return seconds + nanoseconds * 2^32 (recordings/cdr.py: STAMP)."""
    second = np.uint64(1_000_000_000)
    return (ns // second) | ((ns % second) << np.uint64(32))
