"""Write and read readings: CSV, Parquet (an extra), and JSON in the local frame of the asset.

A written table has one row per reading and states whether it is SIMULATED. Tables of a gauge or of
another program can be read: `columns` maps their names and units, and `lag_s` shifts the values
relative to the probe's positions.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.bounded import LARGEST_TABLE, read_bytes
from skywright.errors import InputError
from skywright.inspection.history.database import parse_stamp
from skywright.inspection.history.entries import Reading, StoredIndication, StoredReading
from skywright.recordings.text_table import decode, read_number, split_row

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
TIMES = {"s": 1.0, "ms": 1e-3, "min": 60.0}
QUANTITIES = {
    "t": TIMES, "value": LENGTHS, "u95": LENGTHS, "x": LENGTHS, "y": LENGTHS, "z": LENGTHS,
    "place_u95": LENGTHS, "spot": {}, "accepted": {}, "reason": {},
}  # fmt: skip
"""Quantities of columns and their units. A name without a unit is in the first unit; value and
u95 are in mm with --columns or if the table has a column "unit"."""
YES, NO = ("1", "true", "yes", "accepted"), ("0", "false", "no", "refused")


class Row(NamedTuple):
    """A reading with its time."""

    time: datetime
    reading: Reading


def flatten_reading(r: StoredReading) -> dict[str, Any]:
    """Return a reading as one row of plain values."""
    return {
        "id": r.id, "asset": r.asset, "component": r.component, "flight": r.flight,
        "time_utc": r.time_utc, "origin": "SIMULATED" if r.simulated else "measured",
        **r.reading._asdict(), "registration_std_m": r.registration_std_m,
    }  # fmt: skip


def write_readings_csv(readings: Sequence[StoredReading], path: Path) -> None:
    """Write a header and one line per reading; a cell without a value is empty."""
    rows = [flatten_reading(r) for r in readings]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0] if rows else ())
        writer.writerows(row.values() for row in rows)


def write_readings_parquet(readings: Sequence[StoredReading], path: Path) -> None:
    """Write the same table as Parquet. Raises InputError if pyarrow is missing."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "--parquet needs pyarrow: pip install 'skywright[parquet]'; --csv holds the same table"
        ) from None
    rows = [flatten_reading(r) for r in readings]
    kinds = {"id": pyarrow.int64(), "accepted": pyarrow.bool_()}
    numbers = ("value", "u95", "x_m", "y_m", "z_m", "place_u95_m", "registration_std_m")
    names = list(rows[0]) if rows else []
    columns = {
        name: pyarrow.array(
            [row[name] for row in rows],
            kinds.get(name, pyarrow.float64() if name in numbers else pyarrow.string()),
        )
        for name in names
    }
    pyarrow.parquet.write_table(pyarrow.table(columns), path)


def build_local_json(
    readings: Sequence[StoredReading], indications: Sequence[StoredIndication], frame: str
) -> dict[str, Any]:
    """Return readings and indications as points in the frame of the asset.

    This is not GeoJSON, which supports longitude and latitude only (RFC 7946).
    """
    points = [
        {"kind": "reading", "point_m": [r.reading.x_m, r.reading.y_m, r.reading.z_m],
         **flatten_reading(r)}
        for r in readings
    ] + [
        {"kind": "indication", "point_m": [i.indication.x_m, i.indication.y_m, i.indication.z_m],
         "id": i.id, "asset": i.asset, "component": i.component, "flight": i.flight,
         "time_utc": i.time_utc, "origin": "SIMULATED" if i.simulated else "measured",
         "disposition": i.disposition, "indication": i.indication._asdict()}
        for i in indications
    ]  # fmt: skip
    simulated = any(p["origin"] == "SIMULATED" for p in points)
    return {
        "format": "skywright-local-points", "version": 1, "units": "m",
        "frame": frame or "frame of the asset", "note": "SIMULATED" if simulated else "",
        "points": points,
    }  # fmt: skip


def write_local_json(data: dict[str, Any], path: Path) -> None:
    """Write the result of `build_local_json` to a file."""
    path.write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def parse_columns(text: str) -> dict[str, tuple[str, str]]:
    """Parse "value=Dicke[mm],t=Zeit[ms]" and return {quantity: (name in the file, unit)}."""
    found: dict[str, tuple[str, str]] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\w+)\s*=\s*([^\[\]]+?)\s*(?:\[\s*(\w*)\s*\])?\s*", part)
        what, name, unit = match.groups() if match else (part.strip()[:40], "", None)
        if not match or what not in QUANTITIES:
            raise InputError(
                f"--columns: {what!r}; valid: QUANTITY=NAME[UNIT],... with a quantity of "
                + ", ".join(QUANTITIES)
            )
        units = QUANTITIES[what]
        if unit and unit not in units:
            raise InputError(
                f"--columns: {what} in {unit!r}; valid units: {', '.join(units) or 'none'}"
            )
        found[what] = (name.lower(), unit or "")
    return found


def load_readings(
    path: Path, start: datetime, columns: str | None = None, lag_s: float = 0.0
) -> list[Row]:
    """Read thickness readings of a gauge: CSV or Parquet with a header.

    Numbers in the column t are times since `start`; ISO 8601 times are absolute. A value belongs to
    the position of the probe `lag_s` before the value was recorded; positions are interpolated over
    time. Raises InputError in one line, with the row, if the table has no values or no places (or
    spots), if a cell is not a number, or if the lag exceeds the time span of the file.
    """
    header, rows = _load_cells(path)
    places = _find_columns(path, header, parse_columns(columns) if columns else {})

    def numbers(what: str) -> list[float] | None:
        if what not in places:
            return None
        at, factor = places[what]
        out = []
        for number, cells in rows:
            value = read_number(cells[at]) if cells[at] else math.nan
            if not math.isfinite(value) and (cells[at] or what in ("x", "y", "z")):
                raise InputError(
                    f"{path}: row {number}: {header[at]} is {cells[at][:30]!r}; valid: a number"
                )
            out.append(value * factor)
        return out

    def texts(what: str) -> list[str]:
        return [cells[places[what][0]] if what in places else "" for _, cells in rows]

    values, u95, errors = numbers("value"), numbers("u95"), numbers("place_u95")
    assert values is not None
    times = _read_times(path, header, rows, places, start)
    points = [numbers(axis) or [0.0] * len(rows) for axis in "xyz"]
    if lag_s:
        points = _shift(path, times, points, lag_s, start)
    spots, reasons = texts("spot"), texts("reason")
    out = []
    for k, (number, cells) in enumerate(rows):
        value = None if math.isnan(values[k]) else 1e3 * values[k]
        accepted = value is not None
        if "accepted" in places:
            at = places["accepted"][0]
            plain = cells[at].strip().lower()
            if plain not in (*YES, *NO):
                raise InputError(
                    f"{path}: row {number}: {header[at]} is {cells[at][:30]!r}; valid: 1 or 0"
                )
            accepted = plain in YES
        if accepted and value is None:
            raise InputError(f"{path}: row {number}: accepted without a value")
        reason = reasons[k] or ("" if accepted else "refused by the gauge, no reason given")
        out.append(Row(times[k], Reading(
            "thickness", value, "mm", _get(u95, k, 1e3), points[0][k], points[1][k], points[2][k],
            _get(errors, k, 1.0), accepted, reason, spots[k], f"{path.name}#{number}",
        )))  # fmt: skip
    return out


def _get(values: list[float] | None, k: int, factor: float) -> float | None:
    return None if values is None or math.isnan(values[k]) else factor * values[k]


def _load_cells(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header and the (number, cells) of each row."""
    if path.suffix.lower() == ".parquet":
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
        header = list(table)
    else:
        text = decode(read_bytes(path, LARGEST_TABLE))
        lines = [(k, x) for k, x in enumerate(text.splitlines(), 1) if x.strip()]
        lines = [(k, x) for k, x in lines if not x.lstrip().startswith("#")]
        if "\0" in text or not lines:
            raise InputError(f"{path}: is empty or no text; valid: a header and rows")
        delimiter = max(",;\t", key=lambda d: len(split_row(lines[0][1], d)))
        header = split_row(lines[0][1], delimiter)
        rows = [(k, split_row(x, delimiter)) for k, x in lines[1:]]
    for number, cells in rows:
        if len(cells) != len(header):
            raise InputError(
                f"{path}: row {number} has {len(cells)} cells; the header has {len(header)}"
            )
    if not rows:
        raise InputError(f"{path}: the table has a header and no rows")
    return header, rows


def _find_columns(
    path: Path, header: list[str], given: dict[str, tuple[str, str]]
) -> dict[str, tuple[int, float]]:
    """Return {quantity: (column, factor to SI)}."""
    plain = [name.strip().lower() for name in header]
    shown = ", ".join(name[:30] or "(empty)" for name in header[:14])
    found: dict[str, tuple[int, float]] = {}
    for what, (name, unit) in given.items():
        if name not in plain:
            raise InputError(f"{path}: --columns: no column {name!r}; found: {shown}")
        units = QUANTITIES[what]
        factor = units[unit] if unit else units.get("mm" if what in ("value", "u95") else "", 1.0)
        found[what] = (plain.index(name), factor)
    stated = plain.index("unit") if "unit" in plain else None
    for what, units in QUANTITIES.items():
        if what in found:
            continue
        for k, name in enumerate(plain):
            stem, _, unit = name.rpartition("_")
            if name == what:
                default = "mm" if what in ("value", "u95") and stated is not None else ""
                found[what] = (k, units.get(default, 1.0))
            elif (stem == what and unit in units) or (what == "value" and stem == "thickness"):
                found[what] = (k, units.get(unit, 1.0))
    if "value" not in found:
        raise InputError(
            f"{path}: no column gives the value; found: {shown}; valid: thickness_mm, value_mm, or "
            "--columns value=NAME[mm]"
        )
    if not {"x", "y", "z"} <= set(found) and "spot" not in found:
        raise InputError(
            f"{path}: no column gives the place; found: {shown}; valid: x_m, y_m and z_m, or spot"
        )
    return found


def _read_times(
    path: Path, header: list[str], rows: list[tuple[int, list[str]]],
    places: dict[str, tuple[int, float]], start: datetime,
) -> list[datetime]:  # fmt: skip
    names = [name.strip().lower() for name in header]
    at, factor = places.get("t", (names.index("time_utc") if "time_utc" in names else -1, 1.0))
    if at < 0:
        return [start] * len(rows)
    out = []
    for number, cells in rows:
        seconds = read_number(cells[at])
        if math.isfinite(seconds):
            out.append(start + timedelta(seconds=seconds * factor))
        else:
            out.append(parse_stamp(cells[at], f"{path}: row {number}"))
    return out


def _shift(
    path: Path, times: list[datetime], points: list[list[float]], lag_s: float, start: datetime
) -> list[list[float]]:
    """Return the positions (3 lists) of the probe `lag_s` before each row."""
    t = np.array([(x - start).total_seconds() for x in times])
    if not math.isfinite(lag_s) or abs(lag_s) > max(float(np.ptp(t)), 0.0):
        raise InputError(
            f"--lag {lag_s:g}: the times of {path} span {float(np.ptp(t)):g} s; valid: less"
        )
    if np.any(np.diff(t) <= 0):
        raise InputError(f"{path}: --lag requires a column t with increasing times")
    interpolate: Callable[[list[float]], list[float]] = lambda p: np.interp(  # noqa: E731
        t - lag_s, t, p
    ).tolist()
    return [interpolate(axis) for axis in points]
