"""Lists that the command `records` prints and exports."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from skywright.cli.options import print_json
from skywright.errors import InputError

if TYPE_CHECKING:
    from skywright.inspection.history.entries import StoredReading
    from skywright.run.records import Record, RecordStore


def find_readings(
    store: RecordStore, asset: str | None, component: str | None, flights: Sequence[str],
    spot: str | None = None,
) -> list[StoredReading]:  # fmt: skip
    """Return readings in chronological order: of these flights, or of all if `flights` is empty."""
    chosen: Sequence[str | None] = flights or (None,)
    found = [
        r for flight in chosen
        for r in store.find_readings(asset=asset, component=component, flight=flight)
        if spot is None or r.reading.spot == spot
    ]  # fmt: skip
    return sorted(found, key=lambda r: (r.time_utc, r.id))


def show_readings(
    store: RecordStore, asset: str | None, component: str | None, flights: Sequence[str],
    spot: str | None, table: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Print readings, and write them to `table`."""
    from skywright.inspection.files.readings import flatten_reading, write_readings_csv

    found = find_readings(store, asset, component, flights, spot)
    if table is not None:
        write_readings_csv(found, table)
    if as_json:
        print_json({"readings": [flatten_reading(r) for r in found]})
    else:
        from skywright.reports.terminal_records import print_readings

        print_readings(found, store.path)


def show_history(
    store: RecordStore, asset: str | None, component: str | None, spot: str | None, radius: float,
    as_json: bool,
) -> None:  # fmt: skip
    """Print the history of each location of a wall."""
    from skywright.inspection.history.corrosion import build_history

    readings = store.find_readings(asset=asset, component=component, quantity="thickness")
    readings = [r for r in readings if spot is None or r.reading.spot == spot]
    required = {(c.asset, c.name): c.required_mm for c in store.list_components(asset)}
    places = build_history(readings, required, radius, store.list_calibrations())
    if as_json:
        print_json({"locations": [p.to_json() for p in places]})
    else:
        from skywright.reports.terminal_records import print_history

        print_history(places, store.path)


def show_indications(
    store: RecordStore, asset: str | None, component: str | None, flight: str | None, as_json: bool
) -> None:
    """Print the indications."""
    found = store.find_indications(asset=asset, component=component, flight=flight)
    if as_json:
        told = [i._asdict() | {"indication": i.indication._asdict()} for i in found]
        print_json({"indications": told})
    else:
        from skywright.reports.terminal_records import print_indications

        print_indications(found, store.path)


def show_contacts(
    store: RecordStore, structure: str | None, spot: str | None, at: str | None, radius: float,
    table: Path | None, geojson: Path | None, origin: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Print contact measurements, and write them to `table` and `geojson`."""
    from skywright.models.docked_map import parse_condition
    from skywright.run.records_export import parse_origin, write_csv, write_geojson

    point = parse_condition(contact=at, named="at").contact
    if geojson is not None and origin is None:
        raise InputError(
            "--geojson requires --origin LON,LAT, the geographic position of the world's origin"
        )
    place = None if origin is None else parse_origin(origin)
    found: list[Record] = store.find(structure=structure, spot=spot, at=point, radius=radius)
    if table is not None:
        write_csv(found, table)
    if geojson is not None and place is not None:
        write_geojson(found, place, geojson)
    if as_json:
        print_json({"records": [r._asdict() for r in found]})
    else:
        from skywright.reports.terminal_records import print_records

        print_records(found, store.path)
