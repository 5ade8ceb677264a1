"""Raw samples of sensors: each recorded at its own time, at the rate of its sensor.

Samples are copied at the sensor, before a link delays or loses them, into buffers that the vehicle
empties between mission ticks.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Record
from skywright.core.types import IMU_BATCH
from skywright.recordings.columns import Column, Stream, Topic, build_dtype
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Component, Streamed, integers, words
from skywright.vehicle.link import BATCH, get_rule
from skywright.vehicle.link_ends import name_near
from skywright.vehicle.recorder import copy_row

ROWS = 2048
"""Rows of a stream between deliveries: two seconds at 1 kHz."""
ROWS_A_TICK = 16 * IMU_BATCH
"""More than one mission tick can write."""
ENTRY = 8
"""Numbers of a stream in the table: source's address, 1 for a batch, word of its time (-1: none),
rows' address, bytes a row, rows written, address of the moves, moves."""
WRITTEN = 5


class Buffer(NamedTuple):
    """A stream and its rows."""

    stream: Stream
    rows: NDArray[Any]


class StreamRecorder(Component):
    """Writes a row for every sample of every stream that the vehicle's components declare."""

    slot, side = "link", "plant"

    class Me(Record):
        n: int
        table: int  # address of (n, ENTRY)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Allocate the rows, and list the copies."""
        self.buffers: list[Buffer] = []
        entries = []
        for component in context.components:
            for streamed in component.streams:
                source = _find_source(context.records, streamed, component.name)
                if source is not None:
                    entries.append(self._add(component.name, streamed, source, context))
        self._table = np.array(entries, np.int64).reshape(-1, ENTRY)
        self._written = self._table[:, WRITTEN]
        me.n, me.table = len(entries), context.keep(self._table)

    def _add(self, name: str, streamed: Streamed, source: NDArray[Any], context: Any) -> list[int]:
        """Create the buffer of a stream; returns its entry in the table."""
        fields, record = dict(source.dtype.fields or {}), streamed.columns[0].source
        batch = get_rule(record) == BATCH
        columns, moves = [Column("t", unit="s", meaning="of the sample")], []
        for c in streamed.columns:
            part = source[c.field][0]
            part = part[0] if batch else part
            size = int(np.size(part))
            at = build_dtype(columns).itemsize
            moves.append([
                source.ctypes.data + fields[c.field][1], at, size, int(c.rotation),
                8 * size if batch else 0,
            ])  # fmt: skip
            shape = (4,) if c.rotation else np.shape(part)
            columns.append(Column(c.name, shape, part.dtype.str, c.unit, c.meaning))
        parts = [name] + ([streamed.name] if streamed.name else [])
        topic = "/sensors/" + "/".join(re.sub(r"\W", "_", part) for part in parts)
        stream = Stream(_build_topic(topic, streamed, columns), tuple(columns))
        rows = np.zeros(ROWS, build_dtype(columns))
        self.buffers.append(Buffer(stream, rows))
        time = fields["t"][1] // 8 if "t" in fields else -1
        return [
            source.ctypes.data, int(batch), time, context.keep(rows), rows.dtype.itemsize, 0,
            context.keep(np.array(moves, np.int64)), len(moves),
        ]  # fmt: skip

    @property
    def is_full(self) -> bool:
        """Whether there is no space for another mission tick."""
        return max(self._written.tolist(), default=0) > ROWS - ROWS_A_TICK

    def take(self) -> list[tuple[str, NDArray[Any]]]:
        """Return (topic, rows) written so far, as copies, and clear the buffers."""
        written = self._written.tolist()
        self._written[:] = 0
        return [
            (b.stream.topic.name, b.rows[:n].copy())
            for b, n in zip(self.buffers, written, strict=True)
            if n
        ]

    @staticmethod
    def step(me: Me, clock: Clock) -> None:
        for s in range(me.n):
            entry = integers(me.table + 8 * ENTRY * s, ENTRY)
            source, n, t = entry[0], 1, clock.t
            if entry[1]:
                n = integers(source, 2)[1]
            elif words(source, 1)[0] == 0.0:
                continue
            if entry[2] >= 0:
                t = words(source + 8 * entry[2], 1)[0]
            for k in range(n):
                if entry[5] < ROWS:
                    row = entry[3] + entry[4] * entry[5]
                    words(row, 1)[0] = t - (n - 1 - k) * clock.h
                    copy_row(entry[6], entry[7], row, k)
                    entry[5] += 1


def _find_source(
    records: dict[Any, NDArray[Any]], streamed: Streamed, name: str
) -> NDArray[Any] | None:
    """Return the (1,) record that a component fills: on its side of a link."""
    record = streamed.columns[0].source
    names = (name_near(name), name_near(""), name, "")
    return next((records[record, n] for n in names if (record, n) in records), None)


def _build_topic(name: str, streamed: Streamed, columns: list[Column]) -> Topic:
    """Return the topic of a stream, with its own type if none is named."""
    if streamed.kind:
        return Topic(
            name, streamed.kind, streamed.frame, dict(streamed.paths), numbers=streamed.numbers
        )
    parts = re.split(r"\W|_", name.removeprefix("/sensors/"))
    kind = "skywright_msgs/" + "".join(part.title() for part in parts)
    text = "std_msgs/Header header" + "".join(
        f"\nfloat64{f'[{int(np.prod(c.shape))}]' if c.shape else ''} {c.name}" for c in columns[1:]
    )
    paths = {c.name: c.name for c in columns[1:]}
    return Topic(name, kind, streamed.frame, paths, types={kind: text})
