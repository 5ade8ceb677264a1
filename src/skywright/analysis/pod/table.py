"""Inspections of known flaws as a table: one row per inspection, in a delimited text file."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.core.bounded import read_bytes
from skywright.errors import InputError
from skywright.recordings.text_table import decode, read_number, split_row

UNITS = ("m", "mm", "um", "in", "mil")
NAMES = {
    "size": ("a", "size", "depth", "length"),
    "hit": ("hit", "found", "detected"),
    "signal": ("ahat", "a_hat", "signal", "amplitude", "response"),
    "contact": ("contact",),
    "flaw": ("flaw", "flaw_id", "target"),
}
"""Accepted column names of each quantity, without case and without a unit suffix."""
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
            {name: pick_text(cells) for name, cells in self.others.items()},
        )  # fmt: skip


def load_inspections(path: Path, columns: str | None = None) -> Inspections:
    """Read a table with a header; `columns` as "size=Depth[mm],hit=Found" names other headers.

    Raises InputError, in one line with the row, for a cell that is not a number, and for a table
    without sizes, or without hits and signals. No row is dropped silently, because that would
    change the probability.
    """
    text = decode(read_bytes(path, MAX_BYTES))
    lines = [
        (number, line) for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]  # fmt: skip
    if "\0" in text or not lines:
        what = "is not a text file" if "\0" in text else "the file is empty"
        raise InputError(f"{path}: {what}; valid: a table with a header and rows of numbers")
    given = parse_columns(columns) if columns else {}
    header, delimiter = _split_header(lines[0][1])
    places, unit = _find_columns(path, header, given)
    rows = []
    for number, line in lines[1:]:
        cells = split_row(line, delimiter)
        if len(cells) != len(header):
            raise InputError(
                f"{path}: row {number} has {len(cells)} cells; the header has {len(header)}"
            )
        rows.append((number, cells))
    if not rows:
        raise InputError(f"{path}: the table has a header and no rows")

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
        size, unit, numbers("hit"), numbers("signal"), numbers("contact"), flaw, others
    )


def parse_columns(text: str) -> dict[str, tuple[str, str]]:
    """Parse "size=Depth[mm],hit=Found" to {what: (name in the file, unit)}."""
    found: dict[str, tuple[str, str]] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\w+)\s*=\s*([^\[\]]+?)\s*(?:\[\s*(\w*)\s*\])?\s*", part)
        what, name, unit = match.groups() if match else (part.strip()[:40], "", None)
        if not match or what not in NAMES:
            raise InputError(
                f"--columns: {what!r}; valid: WHAT=NAME[UNIT],... with one of {', '.join(NAMES)}"
            )
        if unit and (what != "size" or unit not in UNITS):
            raise InputError(
                f"--columns: {what} in {unit!r}; only size has a unit: {', '.join(UNITS)}"
            )
        found[what] = (name.strip().lower(), unit or "")
    return found


def _split_header(line: str) -> tuple[list[str], str]:
    best = max(",;\t ", key=lambda d: (len(split_row(line, d)), d == ","))
    return split_row(line, best), best


def _strip_unit(name: str) -> tuple[str, str]:
    """Split "Depth_mm", "depth [mm]" or "depth (mm)" to ("depth", "mm")."""
    match = re.fullmatch(r"(.*?)[\s_]*[\[(_]?\s*(" + "|".join(UNITS) + r")[\])]?", name.lower())
    if match and re.search(r"[\s_\[(]", name):
        return match.group(1).strip(), match.group(2)
    return name.lower().strip(), ""


def _find_columns(
    path: Path, header: Sequence[str], given: dict[str, tuple[str, str]]
) -> tuple[dict[str, int], str]:
    """Return ({what: column}, unit of the size)."""
    plain = [name.lower() for name in header]
    shown = ", ".join(name[:30] or "(empty)" for name in header[:12])
    places, unit = {}, ""
    for what, (name, stated) in given.items():
        if name not in plain:
            raise InputError(f"{path}: --columns: no column {name!r}; found: {shown}")
        places[what] = plain.index(name)
        if what == "size":
            unit = stated or _strip_unit(header[places[what]])[1]
    taken = {places[what] for what in places}
    for what, names in NAMES.items():
        if what in places:
            continue
        fits = [
            i for i, name in enumerate(header)
            if i not in taken and (_strip_unit(name)[0] if what == "size" else plain[i]) in names
        ]  # fmt: skip
        if len(fits) > 1:
            raise InputError(
                f"{path}: {len(fits)} columns give the {what}: "
                f"{', '.join(header[i] for i in fits)}; choose one with --columns {what}=NAME"
            )
        if fits:
            places[what] = fits[0]
            if what == "size":
                unit = _strip_unit(header[fits[0]])[1]
    if "size" not in places or not {"hit", "signal"} & set(places):
        lacking = "size" if "size" not in places else "hit or signal"
        accepted = " or ".join("/".join(NAMES[w]) for w in lacking.split(" or "))
        raise InputError(
            f"{path}: no column gives the {lacking}; found: {shown}; valid: {accepted}, or "
            "--columns size=NAME[mm],hit=NAME"
        )
    return places, unit


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
