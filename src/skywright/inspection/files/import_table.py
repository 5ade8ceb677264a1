"""Import of a table of readings: one flight for each day and origin, in one transaction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date, datetime
from pathlib import Path
from typing import NamedTuple

from skywright.errors import InputError
from skywright.inspection.files.gauge_table import YEARS, Row, load_readings
from skywright.inspection.history.database import stamp
from skywright.inspection.history.entries import Reading
from skywright.inspection.history.store import InspectionStore
from skywright.recordings.text_table import list_names


class Imported(NamedTuple):
    """The flights that an import added, and notes on the table."""

    flights: list[str]
    notes: tuple[str, ...]


def import_table(
    store: InspectionStore,
    source: Path,
    asset: str,
    component: str,
    start: datetime,
    *,
    columns: str | None = None,
    lag_s: float = 0.0,
    required_mm: float | None = None,
    registration_std_m: float | None = None,
    one_flight: bool = False,
) -> Imported:
    """Store the readings of a table for one component.

    Rows of different days (in UTC) or origins are different flights; a flight starts at its first
    row. `start` is the time of rows without a time, and the origin of relative times. `lag_s` and
    `columns` are those of `load_readings`. `registration_std_m` is the standard deviation of the
    table's frame in that of the asset. Raises InputError, and stores nothing, if the table is not
    valid, if the database already contains one of its rows, or if `one_flight` is set and the rows
    are several flights.
    """
    if registration_std_m is not None and not (
        math.isfinite(registration_std_m) and registration_std_m >= 0
    ):
        raise InputError(f"--registration {registration_std_m:g}; valid: metres, 0 or more")
    if not YEARS[0] <= start.year <= YEARS[1]:
        raise InputError(f"--measured {stamp(start)}; valid: a year from {YEARS[0]} to {YEARS[1]}")
    rows, notes = load_readings(source, start, columns, lag_s)
    flights: dict[tuple[date, bool], list[Row]] = {}
    for row in sorted(rows, key=lambda row: row.time):
        flights.setdefault((row.time.date(), row.simulated), []).append(row)
    if one_flight and len(flights) > 1:
        days = (f"{day}{' SIMULATED' if simulated else ''}" for day, simulated in flights)
        raise InputError(
            f"{source}: has readings of {len(flights)} flights ({list_names(tuple(days), 5)}); "
            "valid with --dicom and --report: one; import the table without them, and then give "
            "one flight as --flight"
        )
    added = []
    with store.transaction():
        _check_new(store, source, asset, component, rows)
        part = store.add_component(asset, component, required_mm=required_mm)
        for (_, simulated), members in flights.items():
            flight, _ = store.add_flight(
                structure=asset, mission=f"import of {source.name}", robot="", seed=0, run="",
                simulated=simulated, started=members[0].time,
                registration_std_m=registration_std_m,
            )  # fmt: skip
            store.add_readings(flight, [(m.time, m.reading) for m in members], component=part)
            added.append(flight)
    return Imported(added, notes)


def _check_new(
    store: InspectionStore, source: Path, asset: str, component: str, rows: Sequence[Row]
) -> None:
    """Raise InputError if a row is stored: same time, quantity, value and spot (or place)."""
    stored = store.find_readings(asset=asset, component=component, carried=False)
    # a gauge's table has the measured places, an exported one those that datum points carried
    known = {
        _identify(r.time_utc, r.reading): r.flight for r in (*stored, *store.carry_readings(stored))
    }
    found = [row for row in rows if _identify(stamp(row.time), row.reading) in known]
    if not found:
        return
    first = found[0]
    flight = known[_identify(stamp(first.time), first.reading)]
    raise InputError(
        f"{source}: {len(found)} of {len(rows)} rows are stored already, such as row "
        f"{first.number} as flight {flight} (same time, place and value); valid: new readings; "
        "remove these rows, or correct --measured"
    )


def _identify(time_utc: str, r: Reading) -> tuple[object, ...]:
    place = () if r.spot else tuple(round(v, 6) for v in (r.x_m, r.y_m, r.z_m))
    value = None if r.value is None else round(r.value, 9)
    return time_utc, r.quantity, value, r.spot, place
