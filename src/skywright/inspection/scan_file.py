"""Read an instrument's scan file: delimited text with a header, in the variants that loggers write.

Columns are t_s, re, im, x_m, y_m, z_m in any order. The suffix is the unit; other units are
converted (t_ms, x_mm ...). Optional orientation of the probe: qw, qx, qy, qz (of the tip frame, z
along the probe) or ax, ay, az (the probe's axis). Notes list what was dropped or repaired.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.bounded import read_bytes
from skywright.errors import InputError
from skywright.recordings.text_table import (
    convert_commas,
    decode,
    find_columns,
    list_names,
    match_columns,
    parse_columns,
    read_number,
    split_row,
)

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "in": 0.0254}
SIGNAL = ("re", "im")
QUATERNION = ("qw", "qx", "qy", "qz")
AXIS = ("ax", "ay", "az")
REQUIRED = ("t_s", "re", "im", "x_m", "y_m", "z_m")
MAX_BYTES = 500_000_000
MIN_ROWS = 30
MAX_DROPPED = 0.5
GAP_TIME = 0.5
"""s; a longer pause in the recording gives a note."""
UNITS: dict[str, dict[str, float]] = {
    "t": TIME_UNITS, "re": {}, "im": {}, "x": LENGTH_UNITS, "y": LENGTH_UNITS, "z": LENGTH_UNITS,
    **{name: {} for name in (*QUATERNION, *AXIS)},
}  # fmt: skip
"""Quantities of a scan, with their units; without a unit the first one holds."""
_LIMITS = {"t": 1e11, "re": 1e12, "im": 1e12, "x": 1e5, "y": 1e5, "z": 1e5}


class Scan(NamedTuple):
    """A cleaned scan in order of time without NaN (rows of the axis may be NaN)."""

    t: Array  # (n,) s, strictly increasing
    ec: Array  # (n, 2) instrument units
    p_WT: Array  # (n, 3) m
    axis_W: Array | None  # (n, 3) unit, the probe's axis, pointing out of the robot
    notes: tuple[str, ...]


def _quantity(name: str) -> tuple[str, float] | None:
    """Return (quantity, factor to SI) of a column name, or None if the name is unknown."""
    stem, _, unit = name.partition("_")
    if name in SIGNAL or name in QUATERNION or name in AXIS:
        return name, 1.0
    if stem == "t" and unit in TIME_UNITS:
        return "t", TIME_UNITS[unit]
    if stem in ("x", "y", "z") and unit in LENGTH_UNITS:
        return stem, LENGTH_UNITS[unit]
    return None


def _rename(header: list[str], given: Mapping[str, tuple[str, str]]) -> list[str]:
    """Return the names of the columns, with standard names for those that --columns selects.

    Other columns of the same quantities are put in parentheses, so that they are not read.
    """
    names = [f"({n})" if n.partition("_")[0] in given else n for n in header]
    for quantity, (name, stated) in given.items():
        valid = UNITS[quantity]
        for index, unit in match_columns(header, name, stated, valid):
            names[index] = f"{quantity}_{unit or next(iter(valid))}" if valid else quantity
    return names


def _read_header(
    path: Path, line: str, given: Mapping[str, tuple[str, str]]
) -> tuple[str, dict[str, tuple[int, float]], int, list[str]]:
    """Return (delimiter, {quantity: (column, factor)}, number of columns, notes).

    Raises InputError if a column is missing, or if two columns give the same quantity.
    """
    best: tuple[int, str] = (-1, ",")
    for delimiter in (",", ";", "\t", " "):
        names = _rename([cell.lower() for cell in split_row(line, delimiter)], given)
        best = max(best, (sum(_quantity(n) is not None for n in names), delimiter))
    header = [cell.lower() for cell in split_row(line, best[1])]
    names = _rename(header, given)
    find_columns(path, header, given, UNITS)
    columns: dict[str, tuple[int, float]] = {}
    ignored = []
    for index, name in enumerate(names):
        found = _quantity(name)
        if found is None:
            ignored.append(name)
        elif found[0] in columns:
            raise InputError(
                f"{path}: two columns give {found[0]}; found: {', '.join(names)[:200]}"
            )
        else:
            columns[found[0]] = (index, found[1])
    for wanted in REQUIRED:
        if wanted.partition("_")[0] in columns:
            continue
        raise InputError(
            f"{path}: column {wanted} is missing; found: {list_names(names)}"
            + f"; valid: {', '.join(REQUIRED)} (other units by suffix: t_ms, x_mm ...), "
            "or --columns t=NAME[ms],x=NAME[mm],..."
        )
    notes = []
    if ignored:
        notes.append(f"columns ignored: {list_names(ignored, 8)}")
    return best[1], columns, len(names), notes


def _read_rows(
    path: Path, lines: list[str], delimiter: str, width: int, used: list[int], notes: list[str]
) -> Array:
    """Return the numbers (rows, columns), NaN for a cell that is not a number; appends to `notes`.

    Raises InputError if more than half of the rows have a wrong number of cells, or if numbers
    contain both , and . (decimal commas are read if the delimiter is not a comma).
    """
    rows, ragged = [], 0
    for line in lines:
        cells = split_row(line, delimiter)
        while len(cells) > width and not cells[-1]:
            cells.pop()  # a trailing delimiter
        if len(cells) != width:
            ragged += 1
        else:
            rows.append(cells)
    if ragged > MAX_DROPPED * len(lines):
        hint = " (decimal commas need another delimiter)" if delimiter == "," else ""
        raise InputError(
            f"{path}: {ragged} of {len(lines)} rows do not have the header's {width} cells{hint}"
        )
    if ragged:
        notes.append(f"{ragged} rows with a wrong number of cells dropped")
    if convert_commas(path, rows, delimiter, used):
        notes.append("decimal commas read as decimal points")
    if not rows:
        return np.empty((0, width))
    return np.array([[read_number(cell) for cell in row] for row in rows])


def _build_axis(table: Array, columns: dict[str, tuple[int, float]]) -> Array | None:
    if all(name in columns for name in AXIS):
        axis = table[:, [columns[name][0] for name in AXIS]]
    elif all(name in columns for name in QUATERNION):
        w, x, y, z = (table[:, columns[name][0]] for name in QUATERNION)
        with np.errstate(all="ignore"):
            axis = np.stack(
                [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=1
            )
    else:
        return None
    with np.errstate(all="ignore"):
        norm = np.linalg.norm(axis, axis=1, keepdims=True)
        unit = axis / np.where((norm > 1e-6) & (norm < 1e6), norm, np.nan)
    return np.asarray(unit)


def load_scan(path: Path, columns: str | None = None) -> Scan:
    """Read and clean a scan file; `columns` has the format of `parse_columns`.

    Rows with NaN or text, ragged rows and rows with a duplicate time (the first is kept) are
    dropped with a note. Unordered times are sorted with a note. Raises InputError, in one line, if
    the file has no header, lacks a column, loses more than half of its rows, or has fewer than
    MIN_ROWS usable rows.
    """
    path = Path(path)
    text = decode(read_bytes(path, MAX_BYTES, "split the file"))
    if "\0" in text:
        raise InputError(f"{path}: is not a text file; valid: delimited text with a header")
    lines = [
        x for x in text.splitlines() if x.strip() and not x.lstrip().startswith(("#", "%", "//"))
    ]
    if not lines:
        raise InputError(f"{path}: the file is empty; valid: a header and rows of numbers")
    given = parse_columns(columns, UNITS) if columns else {}
    delimiter, places, width, notes = _read_header(path, lines[0], given)
    total = len(lines) - 1
    used = [index for index, _ in places.values()]
    table = _read_rows(path, lines[1:], delimiter, width, used, notes)

    data = {name: table[:, places[name][0]] * places[name][1] for name in _LIMITS}
    with np.errstate(invalid="ignore"):
        valid = np.all([np.abs(data[name]) < limit for name, limit in _LIMITS.items()], axis=0)
    bad = int(np.count_nonzero(~valid))
    if bad:
        notes.append(f"{bad} rows without a usable number in every column dropped")
    kept = int(np.count_nonzero(valid))
    if kept < MIN_ROWS or kept < (1 - MAX_DROPPED) * total:
        raise InputError(
            f"{path}: {kept} of {total} rows are usable; valid: at least {MIN_ROWS} and half of "
            "them with a number in every column"
        )
    order = np.flatnonzero(valid)
    t = data["t"][order]
    if np.any(np.diff(t) < 0):
        notes.append("times were not in order: rows sorted by time")
        order = order[np.argsort(t, kind="stable")]
        t = data["t"][order]
    first = np.concatenate([[True], np.diff(t) > 0])
    if not first.all():
        notes.append(f"{np.count_nonzero(~first)} rows with a duplicate time dropped")
        order, t = order[first], t[first]
    if len(order) < MIN_ROWS:
        raise InputError(f"{path}: {len(order)} different times; valid: at least {MIN_ROWS}")
    step = np.diff(t)
    gaps = step[step > max(GAP_TIME, 10 * float(np.median(step)))]
    if gaps.size:
        notes.append(f"{gaps.size} gaps in time, the longest {gaps.max():.3g} s")
    axis = _build_axis(table, places)
    if axis is not None and not np.any(np.isfinite(axis[order])):
        axis = None
        notes.append("orientation columns contain no direction: ignored")
    elif axis is None and any(name in places for name in (*QUATERNION, *AXIS)):
        notes.append("orientation incomplete (needs qw, qx, qy, qz or ax, ay, az): ignored")
    return Scan(
        t=t,
        ec=np.stack([data["re"][order], data["im"][order]], axis=1),
        p_WT=np.stack([data[name][order] for name in "xyz"], axis=1),
        axis_W=None if axis is None else axis[order],
        notes=tuple(notes),
    )
