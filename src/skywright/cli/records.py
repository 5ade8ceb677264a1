"""The command `records`: measurements of many flights, their history and their exports."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skywright.cli.options import as_json_option, check_writable, print_json
from skywright.cli.records_lists import (
    find_readings,
    show_contacts,
    show_history,
    show_indications,
    show_readings,
)
from skywright.cli.records_options import TABLE, check_options
from skywright.errors import InputError

if TYPE_CHECKING:
    from skywright.inspection.files.import_table import Imported
    from skywright.inspection.history.entries import StoredComponent, StoredFlight
    from skywright.run.records import RecordStore


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
@click.option("--readings", is_flag=True, help="Readings of all quantities, with place and reason.")
@click.option("--thickness", is_flag=True, help="Thickness, corrosion rates and remaining life.")
@click.option("--indications", is_flag=True, help="Indications with their dispositions.")
@click.option(
    "--decide",
    metavar="ID=WORD[:NOTE]",
    help="Disposition of an indication: open, accept, monitor, repair, false call.",
)
@click.option("--who", metavar="NAME", help="Who decides (with --decide).")
@click.option(
    "--import",
    "source",
    metavar="DATA",
    type=click.Path(path_type=Path),
    help="Add a RUN, or readings (thickness, coating, force) of a table (.csv, .parquet) with "
    "--structure and --component.",
)
@click.option(
    "--columns",
    metavar="SPEC",
    help="Column names of the table: value=Wall[mm],t=Time[ms],x=X[m],...",
)
@click.option(
    "--lag",
    type=float,
    default=0.0,
    metavar="S",
    help="Delay (s) of the values relative to the positions.",
)
@click.option(
    "--measured", metavar="UTC", help="Date of the measurement; times of the table count from it."
)
@click.option("--required", type=float, metavar="MM", help="Required thickness of the component.")
@click.option(
    "--registration", type=float, metavar="M", help="Standard deviation of the table's frame."
)
@click.option(
    "--datums",
    metavar="TABLE",
    type=click.Path(path_type=Path),
    help="Datum points (.csv: name, x_m, y_m, z_m, u95_m) of --structure, or measured by --flight. "
    "They register flights in the frame of the asset.",
)
@click.option("--csv", "table", type=click.Path(path_type=Path), help="Export as CSV.")
@click.option("--geojson", type=click.Path(path_type=Path), help="Export as GeoJSON.")
@click.option("--parquet", type=click.Path(path_type=Path), help="Export --readings as Parquet.")
@click.option(
    "--local",
    type=click.Path(path_type=Path),
    help="Export readings and indications as JSON points in the asset's frame.",
)
@click.option(
    "--dicom",
    type=click.Path(path_type=Path),
    help="DICONDE-style result of one --flight and --component (extra 'dicom').",
)
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    help="Report of one --flight for hand-over (.html; .pdf with Chromium installed).",
)
@click.option(
    "--deviation",
    "deviations",
    multiple=True,
    metavar="TEXT",
    help="Deviation from the procedure, stated in --report.",
)
@click.option(
    "--origin", metavar="LON,LAT[,HEIGHT]", help="Geographic position of the world's origin."
)
@as_json_option
def records_(
    file: Path, structure: str | None, spot: str | None, at: str | None, radius: float,
    component: str | None, flight: str | None, readings: bool, thickness: bool, indications: bool,
    decide: str | None, who: str | None, source: Path | None, columns: str | None, lag: float,
    measured: str | None, required: float | None, registration: float | None, table: Path | None,
    datums: Path | None, geojson: Path | None, parquet: Path | None, local: Path | None,
    dicom: Path | None, report: Path | None, deviations: tuple[str, ...], origin: str | None,
    as_json: bool,
) -> None:  # fmt: skip
    """List measurements of many flights, and export them.

    FILE is what `skywright run --records FILE` wrote. Without an option it lists the contact
    measurements.
    """
    from skywright.run.records import RecordStore

    listing, given = check_options(click.get_current_context())
    if not math.isfinite(radius):
        raise InputError(f"--radius {radius:g}; valid: a finite number of metres above 0")
    for target, endings in (
        (table, (".csv",)), (geojson, (".geojson", ".json")), (parquet, (".parquet",)),
        (local, (".json",)), (dicom, (".dcm",)), (report, (".html", ".pdf")),
    ):  # fmt: skip
        if target is not None:
            check_writable(target, endings)
    if source is not None and not source.exists():
        raise InputError(f"--import {source}: no such file or run directory")
    run = source if source is not None and source.is_dir() else None
    owner = {"structure"} if dicom is not None else {"structure", "component"}
    if run is not None and given.intersection((*TABLE, *owner)):
        raise InputError(f"--import {run}: the options of a table are not valid for a run")
    store = RecordStore(file, create=source is not None)
    flights = [] if flight is None else [flight]
    notes: tuple[str, ...] = ()
    try:
        if run is not None:
            from skywright.run.records_import import import_run

            flights = [import_run(file, run)]
        elif source is not None:
            flights, notes = _import(
                store, source, structure, component, columns, lag, measured, required,
                registration, dicom is not None or report is not None,
            )  # fmt: skip
        flight = flights[0] if len(flights) == 1 else None
        with _undoing(store, flights if source is not None else ()):
            _check_names(store, structure=structure, spot=spot, component=component, flight=flight)
            if datums is not None:
                _register(store, datums, structure, flight, as_json)
                return
            if decide is not None:
                _decide(store, decide, who)
            if local is not None or dicom is not None or parquet is not None:
                _export(store, structure, component, flights, spot, parquet, local, dicom)
            if report is not None:
                _report(store, flight, deviations, report)
        if listing in ("readings", "import"):
            show_readings(store, structure, component, flights, spot, table, as_json)
        if listing == "indications" or (run is not None and not as_json):
            show_indications(store, structure, component, flight, as_json)
        elif listing == "thickness":
            show_history(store, structure, component, spot, radius, as_json)
        elif listing == "report":
            if as_json:
                print_json({"report": str(report)})
            else:
                click.echo(str(report))
        elif listing == "contacts":
            show_contacts(
                store, structure, spot, at, radius, table, geojson, origin, as_json
            )  # fmt: skip
        for note in notes:
            click.echo(f"{source}: {note}", err=True)
    finally:
        store.close()


@contextmanager
def _undoing(store: RecordStore, imported: Sequence[str]) -> Iterator[None]:
    """Remove the flights that were `imported` if the block fails, so that it can be repeated."""
    try:
        yield
    except BaseException as error:
        try:
            if imported:
                store.remove_flights(imported)
        except InputError as second:
            remain = f"the imported flights {', '.join(imported)} remain"
            raise InputError(f"{error}; {remain}, because {second}") from error
        raise


def _check_names(store: RecordStore, **given: str | None) -> None:
    """Raise an error for a name that the database does not contain, with the valid names."""
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
        raise InputError("--decide requires --who NAME, the person who decides")
    store.decide(int(number), word.strip(), who, note.strip())


def _import(
    store: RecordStore, source: Path, asset: str | None, component: str | None,
    columns: str | None, lag: float, measured: str | None, required: float | None,
    registration: float | None, one_flight: bool,
) -> Imported:  # fmt: skip
    """Import a table."""
    from skywright.inspection.files.import_table import import_table
    from skywright.inspection.history.database import parse_stamp

    if asset is None or component is None:
        raise InputError("--import requires --structure ASSET and --component NAME")
    if measured is None:
        raise InputError("--import requires --measured UTC, such as 2026-03-01T12:00:00Z")
    return import_table(
        store, source, asset, component, parse_stamp(measured, "--measured"), columns=columns,
        lag_s=lag, required_mm=required, registration_std_m=registration, one_flight=one_flight,
    )  # fmt: skip


def _register(
    store: RecordStore, table: Path, asset: str | None, flight: str | None, as_json: bool
) -> None:
    """Store datum points, and show the flights' positions relative to them."""
    from skywright.inspection.history.datums import load_datums

    if (asset is None) == (flight is None):
        raise InputError("--datums requires --structure ASSET or --flight ID, one of them")
    flights = store.list_flights()
    owner = asset or next(f.asset for f in flights if f.id == flight)
    store.add_datums(owner, flight, load_datums(table))
    found = {f.id: store.find_registration(f.id) for f in flights if f.asset == owner}
    if as_json:
        told = {key: None if r is None else r.to_json() for key, r in found.items()}
        print_json({"asset": owner, "registrations": told})
    else:
        from skywright.reports.terminal_records import print_registrations

        print_registrations(found, owner, len(store.list_datums(owner)))


def _report(
    store: RecordStore, flight: str | None, deviations: tuple[str, ...], page: Path
) -> None:
    from skywright.reports.inspection_report import (
        build_inspection_report,
        write_inspection_report,
    )

    assert flight is not None  # checked with the options
    built = build_inspection_report(store, flight, deviations)
    if page.suffix.lower() == ".html":
        write_inspection_report(built, page, store.path.parent)
        return
    from skywright.reports.pdf import write_pdf

    with tempfile.TemporaryDirectory() as folder:
        html = Path(folder) / "page.html"
        write_inspection_report(built, html, store.path.parent)
        write_pdf(html, page)


def _export(
    store: RecordStore, asset: str | None, component: str | None, flights: Sequence[str],
    spot: str | None, parquet: Path | None, local: Path | None, dicom: Path | None,
) -> None:  # fmt: skip
    """Write the requested files for other programs."""
    from skywright.inspection.files import readings as tables

    flight = flights[0] if len(flights) == 1 else None
    result = None if dicom is None else _find_component(store, flight, component)
    found = find_readings(store, asset, component, flights, spot)
    chosen: list[str | None] = [*flights] or [None]
    indications = [
        one for each in chosen
        for one in store.find_indications(asset=asset, component=component, flight=each)
    ]  # fmt: skip
    if parquet is not None:
        tables.write_readings_parquet(found, parquet)
    if local is not None:
        frames = store.read("SELECT frame FROM assets WHERE name = ?", (asset or "",))
        data = tables.build_local_json(found, indications, frames[0][0] if frames else "")
        tables.write_local_json(data, local)
    if dicom is not None and result is not None:
        from skywright.inspection.files.diconde import Result, write_diconde

        one, part = result
        calibrations = store.list_calibrations(one.id)
        write_diconde(Result(one.asset, part, one, calibrations, found, indications), dicom)


def _find_component(
    store: RecordStore, flight: str | None, component: str | None
) -> tuple[StoredFlight, StoredComponent]:
    """Return a flight and the component of its asset; raise InputError if it has none."""
    one = next(f for f in store.list_flights() if f.id == flight)
    for part in store.list_components(one.asset):
        if part.name == component:
            return one, part
    raise InputError(f"{store.path}: flight {flight} has no component {component!r}")
