"""The recorder: copies fields of records into samples; components declare the fields."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Record
from skywright.core.rotations import rot_to_quat
from skywright.errors import InputError
from skywright.recordings.columns import Column
from skywright.vehicle.bus import Allocated, Clock, Estimate, Reference, Setpoint, WrenchCommand
from skywright.vehicle.component import Component, Recorded, helper, integers, table, words
from skywright.vehicle.link_ends import name_near
from skywright.vehicle.plant import MISSION_TICK, SAMPLE_RATE
from skywright.vehicle.setpoints import Place, check_limits

SAMPLES = 256
"""Rows between deliveries."""
SAMPLES_A_TICK = 16
"""More than one mission tick can write, also a long one."""
MISSION_SAMPLES = math.ceil(SAMPLE_RATE * MISSION_TICK)
"""The most that a mission tick of MISSION_TICK writes."""
MAX_ITEMS = 64
MOVE = 5
"""Numbers of a move: source's address, byte in the row, words, 1 for a rotation, stride in bytes to
the next row of a batch."""


class Recorder(Component):
    """Writes a row of samples at SAMPLE_RATE; the vehicle takes them before the buffer is full.

    A vehicle records only the columns of its own components.
    """

    slot, side = "record", "plant"

    class Me(Record):
        rows: int  # address of the samples
        row_bytes: int
        n: int  # rows written
        moves: int  # address of (n_moves, MOVE)
        n_moves: int

    columns = (
        Recorded("t", Clock, "t", "s", "simulated time from the start of the run"),
        Recorded("phase", Clock, "phase", "", "index into the run's phases"),
        Recorded("est_p_WB", Estimate, "p_WB", "m", "platform, estimated"),
        Recorded("est_q_WB", Estimate, "R_WB", "", "platform, estimated attitude", rotation=True),
        Recorded("est_v_WB", Estimate, "v_WB", "m/s", "estimated"),
        Recorded("est_w_WB_B", Estimate, "w_WB_B", "rad/s", "estimated"),
        Recorded("est_p_WT", Estimate, "p_WT", "m", "tip, estimated"),
        Recorded("est_f_ext_W", Estimate, "f_ext_W", "N", "external force, estimated"),
        Recorded("ref_p_WB", Reference, "p_WB", "m", "platform, nominal"),
        Recorded("ref_q_WB", Reference, "R_WB", "", "platform, nominal attitude", rotation=True),
        Recorded("ref_q", Reference, "q", "rad", "arm joints, nominal", per="joint"),
        Recorded(
            "ref_p_WT", Reference, "p_WT", "m", "desired tip; inside the surface during contact"
        ),
        Recorded("ref_q_WT", Reference, "R_WT", "", "desired tip, attitude", rotation=True),
        Recorded("cmd_f_B", WrenchCommand, "f_B", "N", "rotor force commanded by the law"),
        Recorded("cmd_t_B", WrenchCommand, "t_B", "N m", "rotor torque commanded by the law"),
        Recorded("cmd_qd", WrenchCommand, "qd", "rad/s", "commanded joint speeds", per="joint"),
        Recorded(
            "saturated", Allocated, "saturated", "", "1: the allocation did not realise the command"
        ),
    )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Allocate the samples, and list the copies."""
        index = context.scene.places
        counts = {
            "joint": context.scene.n_joints, "rotor": len(context.rotors.thrust_min),
            "hand": len(index.hand_sites), "object": len(index.object_qpos),
        }  # fmt: skip
        self.recorded: dict[str, Recorded] = {}
        self.setpoints: dict[str, Place] = {}
        sources: list[NDArray[Any]] = []
        fields: list[Any] = []
        owners: dict[str, str] = {}
        others = [c for c in context.components if c is not self]
        for component in (self, *others):
            several = sum(type(c) is type(component) for c in others) > 1
            check_limits(
                component, [c.name for c in component.columns if issubclass(c.source, Setpoint)]
            )
            for column in component.columns:
                key = (column.source, component.name)
                key = key if key in context.records else (column.source, "")
                found = context.records.get(key)
                if found is None or column.item >= counts.get(column.per, MAX_ITEMS):
                    continue
                name = f"{component.name}_{column.name}" if several else column.name
                if name in owners:
                    raise InputError(
                        f"components {owners[name]!r} and {component.name!r} have a column of the "
                        f"same name {name!r}: rename one"
                    )
                owners[name] = component.name
                self.recorded[name] = column
                if issubclass(column.source, Setpoint):
                    near = context.records.get((key[0], name_near(key[1])), found)
                    at = find_source(near, column, counts.get(column.per))
                    if at.ndim > 1 or at.dtype.kind != "f":
                        raise InputError(
                            f"component {component.name!r}: {name!r} shows a field of "
                            f"{at.dtype.name}, shape {at.shape}; a Setpoint has floats and rows "
                            "of them"
                        )
                    if at.size:  # per hand, of a robot without hands: nothing to set
                        self.setpoints[name] = Place(at, column, component)
                    found = near if component.side == "robot" else found
                source = find_source(found, column, counts.get(column.per))
                check_shape(component.name, name, column, source.shape)
                sources.append(source)
                shape = (4,) if column.rotation else source.shape
                fields.append((name, source.dtype.str, shape))
        self.dtype = np.dtype(fields)
        self._rows = np.zeros(SAMPLES, self.dtype)
        self._newest = np.zeros(1, self.dtype)  # when the rows were last taken
        moves = [
            (s.ctypes.data, self.dtype.fields[f[0]][1], s.size, c.rotation, 0)  # type: ignore[index]
            for s, f, c in zip(sources, fields, self.recorded.values(), strict=True)
            if s.size
        ]
        me.rows, me.row_bytes = context.keep(self._rows), self.dtype.itemsize
        me.moves, me.n_moves = context.keep(np.array(moves, np.int64)), len(moves)
        self._me = me

    def get_period(self, step: str, context: Any) -> float:
        """Return the sample period (s)."""
        return 1.0 / SAMPLE_RATE

    @property
    def is_full(self) -> bool:
        """Whether there is no room for another mission tick."""
        return int(self._me.n) > SAMPLES - SAMPLES_A_TICK

    def count_free_ticks(self) -> int:
        """Return after how many mission ticks of MISSION_TICK it may be full."""
        return max(SAMPLES - SAMPLES_A_TICK - int(self._me.n), 0) // MISSION_SAMPLES

    @property
    def last(self) -> NDArray[Any]:
        """The newest row, (1,)."""
        n = int(self._me.n)
        return self._rows[n - 1 : n] if n else self._newest

    def list_columns(self) -> tuple[Column, ...]:
        """Return the columns in their order, as a recording describes them."""
        return tuple(
            Column(n, self.dtype[n].shape, self.dtype[n].base.str, c.unit, c.meaning)
            for n, c in self.recorded.items()
        )

    def take(self) -> NDArray[Any]:
        """Return a copy of the rows written so far, and clear the buffer."""
        n, self._me.n = int(self._me.n), 0
        self._newest = self._rows[n - 1 : n].copy() if n else self._newest
        raw = self._rows.view(np.uint8)[: n * self.dtype.itemsize]
        return raw.copy().view(self.dtype)  # as bytes: NumPy copies rows field by field

    def save(self) -> Any:
        """Return a copy of the newest row."""
        return self.last.copy()

    def restore(self, saved: Any) -> None:
        """Discard the rows that were not taken; the newest row is the saved one."""
        self._me.n, self._newest = 0, saved.copy()

    @staticmethod
    def step(me: Me) -> None:
        copy_row(me.moves, me.n_moves, me.rows + me.n * me.row_bytes, 0)
        me.n += 1

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one for every vehicle."""
        yield cls("recorder")


def find_source(record: NDArray[Any], column: Recorded, count: int | None) -> NDArray[Any]:
    """Return the part of a (1,) record array that a column shows, as a contiguous view."""
    fields = record.dtype.names or ()
    if column.field not in fields:
        raise InputError(
            f"column {column.name!r}: its record has no field {column.field!r}; "
            f"valid: {', '.join(fields)}"
        )
    found: NDArray[Any] = record[column.field][0:1]
    if column.item >= 0:
        if found.ndim < 2 or column.item >= found.shape[1]:
            raise InputError(
                f"column {column.name!r}: item {column.item} of {column.field!r}, which has the "
                f"shape {found.shape[1:]}"
            )
        found = found[:, column.item]
    elif count is not None:
        found = found[:, :count]
    out = found.reshape(found.shape[1:])
    assert out.size == 0 or np.shares_memory(out, record)
    return out


def check_shape(owner: str, name: str, column: Recorded, shape: tuple[int, ...]) -> None:
    """Raise InputError if the samples cannot hold a field of this shape as a column."""
    told = f"component {owner!r}: column {name!r} shows {column.field!r} of the shape {shape}"
    if column.rotation and shape != (3, 3):
        raise InputError(f"{told} as a rotation; valid: (3, 3)")
    if len(shape) > 1 and not column.rotation:
        raise InputError(
            f"{told}; valid: one number, or one row of numbers: declare the field as "
            f"Annotated[Array, {math.prod(shape)}], or, for a rotation matrix, the column with "
            "rotation=True"
        )


@helper
def copy_row(moves: int, n: int, row: int, k: int) -> None:
    """Fill the row at an address by `n` moves; of batches with their row `k`."""
    given = integers(moves, MOVE * n)
    for m in range(0, MOVE * n, MOVE):
        source, target = given[m] + k * given[m + 4], row + given[m + 1]
        if given[m + 3]:
            rot_to_quat(table(source, 3, 3), words(target, 4))
        else:
            copy_words(source, target, given[m + 2])


@helper
def copy_words(source: int, target: int, n: int) -> None:
    """Copy `n` 8-byte words between addresses."""
    a, b = integers(source, n), integers(target, n)
    for k in range(n):
        b[k] = a[k]
