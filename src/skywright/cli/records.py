"""The command that lists what flights measured, what became of it over years, and exports it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skywright.cli.options import as_json_option, check_writable, print_json
from skywright.errors import InputError

if TYPE_CHECKING:
    from skywright.run.records import Record, RecordStore


@click.command("records")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--structure", metavar="NAME", help="Only this structure (world).")
@click.option("--spot", metavar="NAME", help="Only this spot.")
@click.option("--at", metavar="X,Y", help="History of a point (m in the structure's frame).")
@click.option(
    "--radius",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.05,
    show_default=True,
    metavar="M",
    help="Radius around that point.",
)
@click.option("--component", metavar="NAME", help="Only this component.")
@click.option("--flight", metavar="ID", help="Only this flight.")
@click.option("--thickness", is_flag=True, help="Thickness, corrosion rates and remaining life.")
@click.option("--indications", is_flag=True, help="Indications with their dispositions.")
@click.option(
    "--decide",
    metavar="ID=WORD[:NOTE]",
    help="Disposition of an indication: open, accept, monitor, repair, false call.",
)
@click.option("--who", metavar="NAME", help="Who decides (with --decide).")
@click.option("--csv", "table", type=click.Path(path_type=Path), help="Export as CSV.")
@click.option("--geojson", type=click.Path(path_type=Path), help="Export as GeoJSON.")
@click.option(
    "--origin", metavar="LON,LAT[,HEIGHT]", help="Geographic position of the world's origin."
)
@as_json_option
def records_(
    file: Path, structure: str | None, spot: str | None, at: str | None, radius: float,
    component: str | None, flight: str | None, thickness: bool, indications: bool,
    decide: str | None, who: str | None, table: Path | None, geojson: Path | None,
    origin: str | None, as_json: bool,
) -> None:  # fmt: skip
    """List measurements of many flights, and export them.

    FILE is what `skywright run --records FILE` wrote. Without an option it lists the contact
    measurements.
    """
    from skywright.run.records import RecordStore

    if who is not None and decide is None:
        raise InputError("--who: valid with --decide")
    if sum((thickness, indications, decide is not None)) > 1:
        raise InputError("--thickness, --indications and --decide: choose one")
    store = RecordStore(file)
    try:
        _check_names(store, structure=structure, spot=spot, component=component, flight=flight)
        if decide is not None:
            _decide(store, decide, who)
        if thickness:
            _show_history(store, structure, component, radius, as_json)
        elif indications or decide is not None:
            _show_indications(store, structure, component, flight, as_json)
        else:
            _show_contacts(
                store, structure, spot, at, radius, table, geojson, origin, as_json
            )  # fmt: skip
    finally:
        store.close()


def _check_names(store: RecordStore, **given: str | None) -> None:
    """Refuse a name that the database does not hold, with those that it holds."""
    for name, value in given.items():
        if value is None:
            continue
        if name == "component":
            known = sorted({c.name for c in store.list_components()})
        elif name == "flight":
            known = [f.id for f in store.list_flights()]
        else:
            known = store.list_names(name)
        if value not in known:
            raise InputError(
                f"{store.path}: no {name} {value!r}; there are: {', '.join(known) or '-'}"
            )


def _decide(store: RecordStore, text: str, who: str | None) -> None:
    from skywright.inspection.history.entries import DISPOSITIONS

    number, _, rest = text.partition("=")
    word, _, note = rest.partition(":")
    if not number.strip().isdecimal() or not rest:
        raise InputError(
            f"--decide {text!r}; valid: ID=WORD[:NOTE] with one of {', '.join(DISPOSITIONS)}"
        )
    if not who:
        raise InputError("--decide requires --who NAME: a disposition is somebody's")
    store.decide(int(number), word.strip(), who, note.strip())


def _show_history(
    store: RecordStore, asset: str | None, component: str | None, radius: float, as_json: bool
) -> None:
    from skywright.inspection.history.corrosion import build_history

    readings = store.find_readings(asset=asset, component=component, quantity="thickness")
    required = {c.name: c.required_mm for c in store.list_components(asset)}
    places = build_history(readings, required, radius)
    if as_json:
        print_json({"locations": [p.to_json() for p in places]})
    else:
        from skywright.reports.terminal_records import print_history

        print_history(places, store.path)


def _show_indications(
    store: RecordStore, asset: str | None, component: str | None, flight: str | None, as_json: bool
) -> None:
    found = store.find_indications(asset=asset, component=component, flight=flight)
    if as_json:
        told = [i._asdict() | {"indication": i.indication._asdict()} for i in found]
        print_json({"indications": told})
    else:
        from skywright.reports.terminal_records import print_indications

        print_indications(found, store.path)


def _show_contacts(
    store: RecordStore, structure: str | None, spot: str | None, at: str | None, radius: float,
    table: Path | None, geojson: Path | None, origin: str | None, as_json: bool,
) -> None:  # fmt: skip
    from skywright.models.docked_map import parse_condition
    from skywright.run.records_export import parse_origin, write_csv, write_geojson

    point = parse_condition(contact=at, named="at").contact
    if not math.isfinite(radius):
        raise InputError(f"--radius {radius:g}; valid: a finite number of metres above 0")
    if geojson is not None and origin is None:
        raise InputError(
            "--geojson requires --origin LON,LAT, the geographic position of the world's origin"
        )
    place = None if origin is None else parse_origin(origin)
    found: list[Record] = store.find(structure=structure, spot=spot, at=point, radius=radius)
    if table is not None:
        write_csv(found, check_writable(table, (".csv",)))
    if geojson is not None and place is not None:
        write_geojson(found, place, check_writable(geojson, (".geojson", ".json")))
    if as_json:
        print_json({"records": [r._asdict() for r in found]})
    else:
        from skywright.reports.terminal_records import print_records

        print_records(found, store.path)
