"""Samples as rows of ROS 2 messages: where each field of SAMPLE stands in the bytes of a message.

The messages of one sample make one row of fixed layout. A batch is encoded by writing each field
into the same place of all rows at once.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.cdr import Column, Layout, build_layout
from skywright.core.mcap_file import build_message_header
from skywright.core.messages import EVENTS, TF_CHILDREN, Topic, definition
from skywright.core.types import SAMPLE

BATCH = 256  # samples; the most that is encoded at once
QUATERNIONS = frozenset(name for name in SAMPLE.names or () if "q_W" in name)
"""Fields that are wxyz in a sample and xyzw in a message."""


class _Fill(NamedTuple):
    """Which field of SAMPLE goes to which column of a row; `length` entries of it (0: a scalar)."""

    column: str
    field: str
    length: int


class Rows(NamedTuple):
    """All messages of one sample, one after the other, as one row of bytes.

    `buffer` holds rows of the template and is reused: only the numbers in it change.
    """

    dtype: np.dtype[Any]
    buffer: NDArray[Any]
    offsets: list[int]  # of each topic's message record
    headers: list[str]  # columns of log and publish time
    stamps: list[str]
    fills: list[_Fill]

    def encode(self, samples: NDArray[Any], ns: NDArray[Any]) -> NDArray[Any]:
        """Return the message records of at most len(buffer) samples: a view of the buffer."""
        rows = self.buffer[: len(samples)]
        for name in self.headers:
            rows[name] = ns[:, None]
        stamp = compute_stamp(ns)
        for name in self.stamps:
            rows[name] = stamp
        for name, field, length in self.fills:
            column, values = rows[name], samples[field]
            if field in QUATERNIONS:
                column[:, :3], column[:, 3] = values[:, 1:], values[:, 0]
            else:
                column[...] = values[:, :length] if length else values
        return rows.view(np.uint8)


def build_rows(joint_names: Sequence[str], n_rotors: int, topics: Sequence[Topic]) -> Rows:
    """Lay out the messages of the topics one behind the other, each as an MCAP record."""
    template = bytearray()
    names: list[str] = []
    formats: list[Any] = []
    places: list[int] = []
    offsets: list[int] = []
    headers: list[str] = []
    stamps: list[str] = []
    fills: list[_Fill] = []

    def add(name: str, format: Any, place: int) -> str:
        names.append(name)
        formats.append(format)
        places.append(place)
        return name

    for channel, topic in enumerate(topics, 1):
        layout = build_topic_layout(topic, joint_names, n_rotors)
        header = build_message_header(channel, len(layout.template), 0)
        start = len(template)
        body = start + len(header)
        offsets.append(start)
        headers.append(add(f"{topic.name} log_time", ("<u8", (2,)), body - 16))
        template += header + layout.template
        for path, column in layout.leaves.items():
            if path.endswith("stamp"):
                name = add(f"{topic.name} {path}", column.format, body + column.offset)
                stamps.append(name)
        for path, (field, column) in _bound_columns(topic, layout).items():
            name = add(f"{topic.name} {path}", _format(field, column), body + column.offset)
            fills.append(_Fill(name, field, column.length if SAMPLE[field].shape else 0))
    dtype = np.dtype(
        {"names": names, "formats": formats, "offsets": places, "itemsize": len(template)}
    )
    buffer = np.frombuffer(bytearray(template * BATCH), dtype)
    return Rows(dtype, buffer, offsets, headers, stamps, fills)


def build_message_dtype(topic: Topic, layout: Layout) -> np.dtype[Any]:
    """Return the type of one message with the fields that hold fields of SAMPLE, by path."""
    bound = _bound_columns(topic, layout)
    return np.dtype(
        {
            "names": list(bound),
            "formats": [_format(field, column) for field, column in bound.values()],
            "offsets": [column.offset for _, column in bound.values()],
            "itemsize": len(layout.template),
        }
    )


def _bound_columns(topic: Topic, layout: Layout) -> dict[str, tuple[str, Column]]:
    """Return the field of SAMPLE and its place for each path; empty sequences have none."""
    empty = [p for p in topic.lengths if p in topic.fields and f"{p}[0]" not in layout.leaves]
    return {p: (f, layout.column(p)) for p, f in topic.fields.items() if p not in empty}


def _format(field: str, column: Column) -> Any:
    return (column.format, (column.length,)) if SAMPLE[field].shape else column.format


def build_topic_layout(topic: Topic, joint_names: Sequence[str], n_rotors: int) -> Layout:
    """Lay out a message of a topic for a robot with these joints and rotors."""
    counts = {"joints": len(joint_names), "rotors": n_rotors}
    lengths = {path: counts[what] for path, what in topic.lengths.items()}
    texts = {"header.frame_id": topic.frame}
    if "name" in lengths:
        texts |= {f"name[{i}]": name for i, name in enumerate(joint_names)}
    if topic.derived:  # the transforms
        children = TF_CHILDREN
        lengths["transforms"] = len(children)
        for i, child in enumerate(children):
            texts[f"transforms[{i}].header.frame_id"] = topic.frame
            texts[f"transforms[{i}].child_frame_id"] = child
    layout = build_layout(topic.kind, definition(topic.kind), texts, lengths)
    if not topic.derived:
        return layout
    template = bytearray(layout.template)
    last = len(TF_CHILDREN) - 1  # its axes are those of map: the rotation is constant
    w = layout.column(f"transforms[{last}].transform.rotation.w")
    struct.pack_into("<d", template, w.offset, 1.0)
    return layout._replace(template=bytes(template))


def build_log_layout(text: str) -> Layout:
    """Lay out an event's message; CDR ends a text with NUL, so that it holds none."""
    kind = EVENTS.kind
    texts = {"name": "skywright", "msg": text.replace("\0", "")}
    return build_layout(kind, definition(kind), texts, {})


def compute_stamp(ns: NDArray[Any]) -> NDArray[Any]:
    """Return seconds + nanoseconds * 2^32 (core/cdr.py: STAMP)."""
    second = np.uint64(1_000_000_000)
    return (ns // second) | ((ns % second) << np.uint64(32))
