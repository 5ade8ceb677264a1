"""Inspections of known flaws as a table: one row per inspection, in a delimited text file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.errors import InputError
from skywright.recordings.text_table import (
    convert_commas,
    find_columns,
    list_names,
    parse_columns,
    read_cells,
    read_number,
    split_unit,
)

UNITS = ("m", "mm", "um", "in", "mil")
NAMES = {
    "size": ("a", "size", "depth", "length"),
    "hit": ("hit", "found", "detected"),
    "signal": ("ahat", "a_hat", "signal", "amplitude", "response"),
    "contact": ("contact",),
    "flaw": ("flaw", "flaw_id", "target"),
}
"""Accepted column names of each quantity, without case and without a unit suffix."""
COLUMNS = {what: UNITS if what == "size" else () for what in NAMES}
"""What a column can hold, with its units."""
YES, NO = ("1", "1.0", "true", "yes", "hit"), ("0", "0.0", "false", "no", "miss")
MAX_BYTES = 100_000_000


class Inspections(NamedTuple):
    """One row per inspection; size 0 is a site without a flaw."""

    size: Array  # (n,)
    unit: str  # of the size, "" if the file does not state it
    hit: Array | None  # (n,) 0 or 1
    signal: Array | None  # (n,)
    contact: Array | None  # (n,) 0 or 1: the probe was in contact at the flaw
    flaw: tuple[str, ...] | None  # name of the flaw; rows with one name are passes over one flaw
    others: dict[str, tuple[str, ...]]  # further columns, as text
    notes: tuple[str, ...] = ()  # on cells that were converted

    def select(self, kept: Mask) -> Inspections:
        """Return the rows (n,) where `kept` is true."""
        at = np.flatnonzero(kept)

        def pick(column: Array | None) -> Array | None:
            return None if column is None else column[at]

        def pick_text(column: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(column[i] for i in at)

        return Inspections(
            self.size[at], self.unit, pick(self.hit), pick(self.signal), pick(self.contact),
            None if self.flaw is None else pick_text(self.flaw),
            {name: pick_text(cells) for name, cells in self.others.items()}, self.notes,
        )  # fmt: skip


def load_inspections(path: Path, columns: str | None = None) -> Inspections:
    """Read a table with a header; `columns` as "size=Depth[mm],hit=Found" names other headers.

    Raises InputError, in one line with the row, for a cell that is not a number, and for a table
    without sizes, or without hits and signals. No row is dropped silently, because that would
    change the probability.
    """
    given = parse_columns(columns, COLUMNS) if columns else {}
    header, rows, delimiter = read_cells(path, MAX_BYTES)
    places, unit = _find_columns(path, header, given)
    numeric = [index for what, index in places.items() if what != "flaw"]
    table = [cells for _, cells in rows]
    further = []
    if not any("." in cells[k] for cells in table for k in numeric):  # else , is no decimal sign
        further = [
            k for k in range(len(header))
            if k not in places.values() and _has_decimal_commas([cells[k] for cells in table])
        ]  # fmt: skip
    notes = []
    if convert_commas(path, table, delimiter, [*numeric, *further]):
        notes.append("decimal commas read as decimal points")

    def numbers(what: str) -> Array | None:
        if what not in places:
            return None
        read = _read_flag if what in ("hit", "contact") else _read_finite
        at = places[what]
        return np.array([read(path, number, header[at], cells[at]) for number, cells in rows])

    size = numbers("size")
    assert size is not None
    if np.any(size < 0):
        at = int(np.argmax(size < 0))
        raise InputError(
            f"{path}: row {rows[at][0]}: size {size[at]:g}; valid: above 0, or 0 for a site "
            "without a flaw"
        )
    used = set(places.values())
    others = {
        name: tuple(cells[i] for _, cells in rows)
        for i, name in enumerate(header) if i not in used
    }  # fmt: skip
    flaw = None
    if "flaw" in places:
        flaw = tuple(cells[places["flaw"]] for _, cells in rows)
    return Inspections(
        size, unit, numbers("hit"), numbers("signal"), numbers("contact"), flaw, others,
        tuple(notes),
    )  # fmt: skip


def _has_decimal_commas(cells: Sequence[str]) -> bool:
    """Return whether the cells of a further column, which may hold names or dates, are numbers with
    decimal commas; some may be empty."""
    filled = [cell for cell in cells if cell]
    return any("," in cell for cell in filled) and all(
        "." not in cell and math.isfinite(read_number(cell.replace(",", "."))) for cell in filled
    )


def _find_columns(
    path: Path, header: Sequence[str], given: dict[str, tuple[str, str]]
) -> tuple[dict[str, int], str]:
    """Return ({what: column}, unit of the size)."""
    shown = list_names(header)
    found = find_columns(path, header, given, COLUMNS)
    taken = {index for index, _ in found.values()}
    for what, names in NAMES.items():
        if what in found:
            continue
        split = [split_unit(name, COLUMNS[what]) for name in header]
        fits = [k for k, (name, _) in enumerate(split) if k not in taken and name in names]
        if len(fits) > 1:
            raise InputError(
                f"{path}: {len(fits)} columns give the {what}: "
                f"{', '.join(header[k] for k in fits)}; choose one with --columns {what}=NAME"
            )
        if fits:
            found[what] = fits[0], split[fits[0]][1]
    if "size" not in found or not {"hit", "signal"} & set(found):
        lacking = "size" if "size" not in found else "hit or signal"
        accepted = " or ".join("/".join(NAMES[w]) for w in lacking.split(" or "))
        raise InputError(
            f"{path}: no column gives the {lacking}; found: {shown}; valid: {accepted}, or "
            "--columns size=NAME[mm],hit=NAME"
        )
    return {what: index for what, (index, _) in found.items()}, found["size"][1]


def _read_finite(path: Path, row: int, name: str, cell: str) -> float:
    value = read_number(cell)
    if not math.isfinite(value):
        raise InputError(f"{path}: row {row}: {name} is {cell[:30]!r}; valid: a finite number")
    return value


def _read_flag(path: Path, row: int, name: str, cell: str) -> float:
    plain = cell.strip().lower()
    if plain in YES or plain in NO:
        return float(plain in YES)
    raise InputError(f"{path}: row {row}: {name} is {cell[:30]!r}; valid: 1 or 0, yes or no")
