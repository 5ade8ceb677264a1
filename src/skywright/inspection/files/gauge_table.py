"""Read readings from a table of a gauge or another program: CSV or Parquet with a header.

`columns` maps names and units of the table, and `lag_s` shifts the values relative to the probe's
positions. A table that `skywright records --csv` wrote reads back with quantity, unit and origin.
"""

from __future__ import annotations

import math
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.core.bounded import LARGEST_TABLE
from skywright.errors import InputError
from skywright.inspection.history.database import parse_stamp
from skywright.inspection.history.entries import Reading
from skywright.recordings.text_table import (
    Cells,
    check_repeated,
    check_widths,
    convert_commas,
    find_columns,
    list_foreign,
    list_names,
    parse_columns,
    plain_name,
    plain_unit,
    read_cells,
    read_number,
    split_unit,
)

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2, "in": 0.0254}
TIMES = {"s": 1.0, "ms": 1e-3, "min": 60.0}
UTC_COLUMN = "utc"
"""Unit of a column that holds only absolute times, in ISO 8601."""
COLUMNS: dict[str, tuple[str, ...]] = {
    "t": (*TIMES, UTC_COLUMN), "value": (*LENGTHS,), "u95": (*LENGTHS,), "x": (*LENGTHS,),
    "y": (*LENGTHS,), "z": (*LENGTHS,), "place_u95": (*LENGTHS,), "spot": (), "accepted": (),
    "reason": (), "quantity": (), "unit": (), "origin": (),
}  # fmt: skip
"""Columns, and the units of each. Without a stated unit, times are in s and places in m. A value or
u95 takes its unit from the column `unit`; a column given by `--columns` without a unit is in mm if
there is no such column."""
NAMES = {
    "thickness": "value", "time": "t", "date": "t", "datetime": "t", "timestamp": "t",
}  # fmt: skip
"""Further names of columns. A time of such a name without a unit is absolute."""
NUMBERS = ("t", "value", "u95", "x", "y", "z", "place_u95")
"""Columns whose numbers may have decimal commas."""
OWNERS = ("asset", "component")
"""Columns that are not read; each must have one value."""
QUANTITIES = {
    "thickness": ("mm", LENGTHS), "coating": ("mm", LENGTHS), "force": ("N", {"n": 1.0}),
}  # fmt: skip
"""Quantities of readings: the unit in which they are stored, and the units that are read."""
YES, NO = ("1", "true", "yes", "accepted"), ("0", "false", "no", "refused")
ORIGINS = {"": False, "measured": False, "simulated": True}
LARGEST_MM = 1000.0
"""mm; a larger thickness is a code of the gauge or an error of the unit."""
LONGEST_DAYS = 30.0
"""Days, largest time relative to the start; seconds since 1970 exceed it."""
CLOCK = 1e-6
"""s, resolution of times."""
YEARS = (1900, 2100)
"""First and last valid year of a measurement."""


class Row(NamedTuple):
    """A reading with its time and the number of its row."""

    time: datetime
    reading: Reading
    number: int
    simulated: bool


class GaugeTable(NamedTuple):
    """The readings of a table, and notes on what was ignored or converted."""

    rows: list[Row]
    notes: tuple[str, ...]


class _Table(NamedTuple):
    path: Path
    header: list[str]
    rows: list[tuple[int, list[str]]]  # (number, cells)
    places: dict[str, tuple[int, str]]  # {column: (index, unit)}

    def text(self, k: int, what: str) -> str:
        """Return a stripped cell; "" if the table has no such column."""
        return self.rows[k][1][self.places[what][0]].strip() if what in self.places else ""

    def number(self, k: int, what: str, needed: bool = False, low: float = -math.inf) -> float:
        """Return the number in a cell, NaN for an empty one; raises InputError below `low`."""
        text = self.text(k, what)
        if not text and not needed:
            return math.nan
        value = read_number(text)
        if not math.isfinite(value):
            raise self.refuse(k, what, "a number")
        if value < low:
            raise self.refuse(k, what, f"{low:g} or more")
        return value

    def refuse(self, k: int, what: str, valid: str) -> InputError:
        """Return the error of a cell."""
        number, cells = self.rows[k]
        at = self.places[what][0]
        return InputError(
            f"{self.path}: row {number}: {self.header[at]} is {cells[at][:30]!r}; valid: {valid}"
        )


def load_readings(
    path: Path, start: datetime, columns: str | None = None, lag_s: float = 0.0
) -> GaugeTable:
    """Read the readings of a table; a table without a column "quantity" holds thickness.

    Numbers in the column t are times since `start`, which is in UTC; ISO 8601 times are absolute.
    A value belongs to the position of the probe `lag_s` before the value was recorded; positions
    are interpolated over time. A row whose position the table's times do not cover is a refused
    reading at the first or last position, and a thickness that is not above 0 and at most
    LARGEST_MM is a refused reading, each with that reason. Raises InputError in one line, with the
    row, if the table has no values, no units or no places (or spots), if two columns give the same
    quantity, if a cell is not valid, if the table repeats its rows as a block, if the rows have
    several assets or components, or if the lag is not shorter than the time span of the file.
    """
    given = parse_columns(columns, COLUMNS) if columns else {}
    header, rows, delimiter = _load_cells(path)
    notes = check_repeated(path, rows)
    places = _find_columns(path, header, given)
    numeric = [places[what][0] for what in NUMBERS if what in places]
    if convert_commas(path, [cells for _, cells in rows], delimiter, numeric):
        notes.append("decimal commas read as decimal points")
    used = {k for k, _ in places.values()}
    ignored = [n for k, n in enumerate(header) if k not in used and plain_name(n) not in OWNERS]
    if ignored:
        notes.append(f"columns ignored: {list_names(ignored)}")
    table = _Table(path, header, rows, places)
    _check_owner(table)
    count = range(len(rows))
    times = [_read_time(table, k, start) for k in count]
    points = [[_read_length(table, k, axis) for k in count] for axis in "xyz"]
    lost = [False] * len(rows)
    if lag_s:
        points, lost = _shift(table, times, points, lag_s, start)
    read = [
        _read_row(table, k, times[k], (points[0][k], points[1][k], points[2][k])) for k in count
    ]
    for k in (k for k in count if lost[k] and read[k].reading.accepted):
        reason = f"the table has no position at the time of this value minus --lag {lag_s:g}"
        refused = read[k].reading._replace(accepted=False, reason=reason)
        read[k] = read[k]._replace(reading=refused)
    other = _list_other_units(table)
    if other:
        header_unit = header[places["unit"][0]]
        notes.append(f"texts ignored in the column {header_unit}: {list_names(other)}")
    return GaugeTable(read, tuple(notes))


def _list_other_units(table: _Table) -> list[str]:
    """Return the texts of the column `unit` that are not the unit of the values' header.

    `_find_factor` has refused the known units among them.
    """
    unit = table.places["value"][1]
    if not unit:  # the column states it
        return []
    texts = dict.fromkeys(table.text(k, "unit") for k in range(len(table.rows)))
    return [text for text in texts if text and plain_unit(text) != unit]


def _read_row(table: _Table, k: int, t: datetime, p: tuple[float, float, float]) -> Row:
    number = table.rows[k][0]
    quantity = table.text(k, "quantity").lower() or "thickness"
    if quantity not in QUANTITIES:
        raise table.refuse(k, "quantity", ", ".join(QUANTITIES))
    unit, _ = QUANTITIES[quantity]
    value = table.number(k, "value") * _find_factor(table, k, "value", quantity)
    u95 = table.number(k, "u95", low=0.0) * _find_factor(table, k, "u95", quantity)
    accepted = not math.isnan(value)
    if "accepted" in table.places:
        plain = table.text(k, "accepted").lower()
        if plain not in (*YES, *NO):
            raise table.refuse(k, "accepted", "1 or 0")
        if plain in YES and not accepted:
            raise InputError(f"{table.path}: row {number}: accepted without a value")
        accepted = plain in YES
    reason = table.text(k, "reason")
    if accepted and quantity == "thickness" and not 0.0 < value <= LARGEST_MM:
        accepted = False
        reason = f"{value:g} mm is no thickness; valid: above 0, at most {LARGEST_MM:g} mm"
    reason = reason or ("" if accepted else "refused by the gauge, no reason given")
    spot = table.text(k, "spot")
    if not spot and not {"x", "y", "z"} <= set(table.places):
        raise table.refuse(k, "spot", "a name, because the table has no x, y and z")
    origin = table.text(k, "origin").lower()
    if origin not in ORIGINS:
        raise table.refuse(k, "origin", "SIMULATED or measured")
    place_u95 = _read_length(table, k, "place_u95", low=0.0)
    return Row(t, Reading(
        quantity, _known(value), unit, _known(u95), *p,
        _known(place_u95), accepted, reason, spot, f"{table.path.name}#{number}",
    ), number, ORIGINS[origin])  # fmt: skip


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _read_length(table: _Table, k: int, what: str, low: float = -math.inf) -> float:
    """Return a length in m: for a coordinate 0 without a column, otherwise NaN."""
    axis = what in "xyz"
    if what not in table.places:
        return 0.0 if axis else math.nan
    factor = LENGTHS[table.places[what][1] or "m"]
    return table.number(k, what, needed=axis, low=low) * factor


def _find_factor(table: _Table, k: int, what: str, quantity: str) -> float:
    """Return the factor from the unit of a value or u95 to the unit in which it is stored."""
    if what not in table.places or not table.text(k, what):
        return math.nan  # a lost value needs no unit
    stored, units = QUANTITIES[quantity]
    unit, cell = table.places[what][1], plain_unit(table.text(k, "unit"))
    if not unit and cell not in units:
        raise table.refuse(k, "unit", f"{', '.join(units)} ({quantity})")
    if unit and unit not in units:
        raise table.refuse(k, "quantity", f"a length, because {what} is in {unit}")
    # the column may hold the units of a plant instead, such as CDU-2
    known = cell in units or cell in list_foreign(units)
    if unit and what == "value" and known and cell != unit:
        raise table.refuse(k, "unit", f"{unit}, which the header or --columns states")
    return units[unit or cell] / units[stored.lower()]


def _read_time(table: _Table, k: int, start: datetime) -> datetime:
    if "t" not in table.places:
        return start
    text, unit = table.text(k, "t"), table.places["t"][1]
    seconds = read_number(text)
    if unit == UTC_COLUMN and math.isfinite(seconds):
        header = table.header[table.places["t"][0]]
        named = split_unit(header, (UTC_COLUMN,))[1]  # --columns must not contradict it
        seconds_by = "the header t_s" if named else f"--columns t={_cut_unit(header)}[s]"
        raise InputError(
            f"{table.path}: row {table.rows[k][0]}: {text[:40]!r} is no time; valid: ISO 8601, "
            f"or {seconds_by} for times since --measured"
        )
    seconds *= TIMES.get(unit or "s", math.nan)
    if not math.isfinite(seconds):
        t = parse_stamp(text, f"{table.path}: row {table.rows[k][0]}")
    elif abs(seconds) <= 86400.0 * LONGEST_DAYS:
        t = start + timedelta(seconds=seconds)
    else:
        raise table.refuse(
            k, "t", f"at most {LONGEST_DAYS:g} days from --measured, or ISO 8601 for another date"
        )
    if not YEARS[0] <= t.year <= YEARS[1]:
        raise table.refuse(k, "t", f"a year from {YEARS[0]} to {YEARS[1]}")
    return t


def _check_owner(table: _Table) -> None:
    """Raise InputError if the rows have several assets or several components."""
    plain = [plain_name(cell) for cell in table.header]
    for name in OWNERS:
        at = plain.index(name) if name in plain else -1
        found = sorted({cells[at].strip() for _, cells in table.rows}) if at >= 0 else []
        if len(found) > 1:
            raise InputError(
                f"{table.path}: the column {name} has {len(found)} values ("
                f"{', '.join(x[:20] or '(empty)' for x in found[:5])}); valid: one, because all "
                "rows are stored for one component; split the table"
            )


def _load_cells(path: Path) -> Cells:
    """Return the text of a table; cells of Parquet count as delimited by commas."""
    if path.suffix.lower() != ".parquet":
        return read_cells(path, LARGEST_TABLE)
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError("Parquet needs pyarrow: pip install 'skywright[parquet]'") from None
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        table = pyarrow.parquet.read_table(path).to_pydict()
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(f"{path}: is no complete Parquet file: {str(error)[:80]}") from None
    columns = [["" if v is None else str(v) for v in cells] for cells in table.values()]
    rows = list(enumerate((list(cells) for cells in zip(*columns, strict=True)), 1))
    check_widths(path, list(table), rows)
    return Cells(list(table), rows, ",")


def _cut_unit(name: str) -> str:
    """Return a column's name up to its unit in brackets."""
    return re.split(r"[\[(]", name)[0].strip()


def _match(name: str) -> tuple[str, str]:
    """Return the (column, unit) that a header states; ("", "") if it states none."""
    stem, unit = split_unit(name, {unit for units in COLUMNS.values() for unit in units})
    what = NAMES.get(stem, stem)
    if what == "t" and stem != "t":
        unit = unit or UTC_COLUMN
    return (what, unit) if unit in ("", *COLUMNS.get(what, ())) and what in COLUMNS else ("", "")


def _find_columns(
    path: Path, header: list[str], given: dict[str, tuple[str, str]]
) -> dict[str, tuple[int, str]]:
    """Return {column: (index, unit)}.

    An empty unit means: the table's column `unit` states it, row by row.
    """
    shown = list_names(header)
    found = find_columns(path, header, given, COLUMNS)
    used = {k for k, _ in found.values()}
    for k, name in enumerate(header):
        what, unit = _match(name)
        if not what or what in given or k in used:
            continue
        if what in found:
            raise InputError(
                f"{path}: two columns give {what}: {header[found[what][0]]}, {header[k]}; valid: "
                f"one; select it with --columns {what}=NAME[UNIT]"
            )
        found[what] = (k, unit)
    for what in (what for what in NUMBERS if what not in found):
        for name in (name for k, name in enumerate(header) if k not in used):
            stem, foreign = split_unit(name, list_foreign(COLUMNS[what]))
            if foreign and NAMES.get(stem, stem) == what:
                raise InputError(
                    f"{path}: the column {name} states {foreign}; valid units: "
                    + ", ".join(COLUMNS[what])
                )
    if "value" not in found:
        raise InputError(
            f"{path}: no column gives the value; found: {shown}; valid: thickness_mm, value_mm, or "
            "--columns value=NAME[mm]"
        )
    if not {"x", "y", "z"} <= set(found) and "spot" not in found:
        raise InputError(
            f"{path}: no column gives the place; found: {shown}; valid: x_m, y_m and z_m, or spot"
        )
    for what in ("value", "u95"):
        k, unit = found.get(what, (-1, "mm"))
        if unit or "unit" in found:
            continue
        if what not in given:
            raise InputError(
                f"{path}: the column {header[k]} has no unit; valid: {what}_mm, a column unit, or "
                f"--columns {what}={_cut_unit(header[k])}[mm] (units: {', '.join(LENGTHS)})"
            )
        found[what] = (k, "mm")
    return found


def _shift(
    table: _Table, times: list[datetime], points: list[list[float]], lag_s: float, start: datetime
) -> tuple[list[list[float]], list[bool]]:
    """Return the positions (3 lists, m) of the probe `lag_s` before each row.

    The second value states for each row whether this time is outside the table; the position is
    then the first or last one.
    """
    if not {"x", "y", "z"} & set(table.places):
        raise InputError(f"--lag {lag_s:g}: {table.path} has no x, y or z; valid: without --lag")
    t = np.array([(x - start).total_seconds() for x in times])
    if not abs(lag_s) < float(np.ptp(t)):
        raise InputError(
            f"--lag {lag_s:g}: the times of {table.path} span {float(np.ptp(t)):g} s; valid: less"
        )
    if np.any(np.diff(t) <= 0):
        raise InputError(f"{table.path}: --lag requires a column t with increasing times")
    at = t - lag_s
    lost = (at < t[0] - CLOCK) | (at > t[-1] + CLOCK)
    return [np.interp(at, t, axis).tolist() for axis in points], lost.tolist()
