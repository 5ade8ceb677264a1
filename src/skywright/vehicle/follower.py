"""The present reference: rows of a plan, interpolated in each tick.

A row (core/types.py: REFERENCE) contains the fields of several records: Reference of the bus, and
blocks that components own, such as Press. Each field is interpolated into the record that has it,
by the rule in the record's `rules`; the default is linear.
"""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import table, words
from skywright.core.record import Integers, Record, Vec3
from skywright.core.rotations import orthonormalise
from skywright.core.types import HOLD, HOLD_END, LINEAR, REFERENCE, ROTATION
from skywright.core.user_code import njit
from skywright.errors import InputError
from skywright.vehicle.bus import Clock, Reference
from skywright.vehicle.component import Component, Out, ReferenceBlock, helper
from skywright.vehicle.recorder import copy_words

MAX_RULES = 64


class Press(ReferenceBlock):
    """Reference of a pressing probe with a force sensor, and of docking feet in contact."""

    rules: ClassVar[dict[str, int]] = {"press": HOLD, "docked": HOLD}

    press: float  # 1: the arm controls the force; 0: it controls its joints
    force: float  # N, desired force of the tip along the probe's axis
    docked: float  # 1: feet in contact with the structure; the platform's integrals are held
    f_feet_B: Vec3  # N, planned force of the structure on the docking feet
    t_feet_B: Vec3  # N m, about the origin of B


class Rule(NamedTuple):
    """Consecutive words of a row with one target and one rule."""

    first: int
    last: int
    rule: int
    target: int  # address


def list_rules(records: dict[Any, NDArray[Any]]) -> list[Rule]:
    """Return the targets and rules of the fields of a row, in (1,) arrays by (class, name).

    Fields that no record has are omitted; contiguous fields with the same rule are merged.
    """
    owners = [(k[0], v) for k, v in records.items() if _is_told(k[0])]
    out: list[Rule] = []
    for name in REFERENCE.names or ():
        owner = next(((r, v) for r, v in owners if name in r.dtype.fields), None)
        if owner is None or name == "t":
            continue
        record, view = owner
        kind, at = REFERENCE.fields[name][:2]  # type: ignore[index]
        rule = record.rules.get(name, LINEAR)
        target = view.ctypes.data + record.dtype.fields[name][1]
        first, last = at // 8, (at + kind.itemsize) // 8
        before = out[-1] if out else None
        if (
            before is not None
            and rule == before.rule != ROTATION
            and before.last == first
            and before.target + 8 * (before.last - before.first) == target
        ):
            out[-1] = before._replace(last=last)
        else:
            out.append(Rule(first, last, rule, target))
    return out


def check_field(record: type[Record], name: str, known: Container[str]) -> None:
    """Raise InputError for a field that no row fills; `known` are those of other records."""
    where = f"{record.__qualname__}.{name}"
    names = REFERENCE.names or ()
    if name not in names:
        raise InputError(f"{where}: a row has no such field; valid: {', '.join(names)}")
    if name in known:
        raise InputError(f"{where}: another record has this field of the reference")
    found, wanted = record.dtype[name], REFERENCE[name]
    if found != wanted:
        raise InputError(f"{where} is {found}; valid: {wanted}, as in a row")


def _is_told(record: type[Record]) -> bool:
    return record is Reference or issubclass(record, ReferenceBlock)


def copy_row(row: Any) -> Any:
    """Return a copy of a REFERENCE row as a 0-dimensional array.

    NumPy's `np.array(row)` returns a view, not a copy, if `row` is an element of an array, and
    `row.copy()` of a structured row copies field by field, which is slow.
    """
    return np.frombuffer(bytearray(row.tobytes()), row.dtype).reshape(())


class RowNow:
    """The present REFERENCE row: `row["p_WB"]` is read without a copy."""

    __slots__ = ("_follower",)

    def __init__(self, follower: Follower) -> None:
        self._follower = follower

    def __getitem__(self, name: str) -> Any:
        field = self._follower.fields.get(name)
        return self._follower.first[name] if field is None else field[0]

    def place(self, name: str) -> memoryview | None:
        """Return the memory of a field, for `.tolist()`; None if no record has the field."""
        field = self._follower.fields.get(name)
        return None if field is None else memoryview(field.reshape(field.shape[1:]))


class Follower(Component):
    """Fills Reference and its blocks from the tracked rows."""

    slot = "reference"

    class Me(Record):
        rows: int  # address of the table
        n: int
        width: int  # words of a row
        t0: float  # s, mission time at which the table starts
        cursor: int
        n_rules: int
        rules: Annotated[Integers, MAX_RULES, 4]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has it."""
        yield cls("reference")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the records that the rows fill."""
        self._me = me
        told = [(r, view) for (r, _), view in context.records.items() if _is_told(r)]
        self.fields = dict[str, Any]()
        for r, view in told:
            for name in r.dtype.names:
                check_field(r, name, self.fields)
                self.fields[name] = view[name]
        rules = list_rules(context.records)
        me.width, me.n_rules = REFERENCE.itemsize // 8, len(rules)
        me.rules[: len(rules)] = rules
        self._rules = me.rules[: len(rules)]
        ref = context.records[Reference, ""][0]
        ref["R_WB"] = ref["R_WT"] = ref["R_WS"] = np.eye(3)

    def track(self, rows: NDArray[Any], t: float) -> None:
        """Follow `rows` (REFERENCE, C-contiguous) from mission time `t` (s) on.

        The first row is the present reference until the next tick.
        """
        assert rows.flags.c_contiguous
        self._rows, me = rows, self._me
        me.rows, me.n, me.t0, me.cursor = rows.ctypes.data, len(rows), t, 0
        copy_fields(self._rules, me.rows, False)
        self.fields["t"][0] = rows["t"][0]

    def delay(self, seconds: float) -> None:
        """Delay the rows by a time (s)."""
        self._me.t0 += seconds

    @property
    def first(self) -> Any:
        """The first row of the table, with the values of fields that no record has."""
        return self._rows[0]

    def read_row(self) -> Any:
        """Return the present REFERENCE row."""
        row = copy_row(self._rows[0])
        copy_fields(self._rules, row.ctypes.data, True)
        row["t"] = self.fields["t"][0]
        return row[()]

    def save(self) -> Any:
        """Return the tracked rows; their progress is in the record."""
        return self._rows

    def restore(self, saved: Any) -> None:
        """Restore the reference to the tracked rows; those of a copied state are elsewhere."""
        self._rows, self._me.rows = saved, saved.ctypes.data

    @staticmethod
    def step(me: Me, clock: Clock, ref: Out[Reference]) -> None:
        t, n = clock.t - me.t0, me.n
        rows = table(me.rows, n, me.width)
        i = me.cursor
        while i < n - 2 and rows[i + 1, 0] <= t:
            i += 1
        me.cursor = i
        lo, hi = rows[i], rows[min(i + 1, n - 1)]
        span = hi[0] - lo[0]
        u = 0.0 if span <= 0.0 else min(max((t - lo[0]) / span, 0.0), 1.0)
        for r in range(me.n_rules):
            interpolate(me.rules[r], lo, hi, u)
        ref.t = clock.t


@njit(cache=True, error_model="numpy")
def copy_fields(rules: Any, row: int, back: bool) -> None:
    """Copy the row at an address to the targets of the rules, or with `back` from them."""
    for r in range(len(rules)):
        here, there, n = row + 8 * rules[r, 0], rules[r, 3], rules[r, 1] - rules[r, 0]
        if back:
            copy_words(there, here, n)
        else:
            copy_words(here, there, n)


@helper
def interpolate(rule: Any, lo: Any, hi: Any, u: float) -> None:
    """Write the words of a rule, interpolated at `u` (0 to 1) from row `lo` to `hi`."""
    first, n = rule[0], rule[1] - rule[0]
    out = words(rule[3], n)
    if rule[2] == HOLD or (rule[2] == HOLD_END and u < 1.0):
        for k in range(n):
            out[k] = lo[first + k]
    elif rule[2] == HOLD_END:
        for k in range(n):
            out[k] = hi[first + k]
    else:
        w = 1.0 - u
        for k in range(n):
            out[k] = w * lo[first + k] + u * hi[first + k]
    if rule[2] == ROTATION:
        orthonormalise(table(rule[3], 3, 3))
