"""The report of an inspection flight: one page, from the database.

It contains the entries of the database and of the run's directory and marks missing ones. Name,
level and signature are empty: the page is a draft that a person must evaluate and sign.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.bounded import LARGEST_TOML, parse_json, read_text
from skywright.errors import InputError
from skywright.inspection.files.nde import UltrasonicScan, read_nde
from skywright.inspection.history.entries import (
    Coverage,
    Missed,
    StoredCalibration,
    StoredComponent,
    StoredFlight,
    StoredIndication,
    StoredProcedure,
    StoredReading,
)
from skywright.inspection.history.registration import Registration
from skywright.inspection.history.store import InspectionStore
from skywright.reports.figures.style import house_style
from skywright.reports.inspection_figures import choose_axes, draw_ascans, draw_places
from skywright.reports.page import build_picture, render_page, write_page

MOST_ASCANS = 6
HASHED = ("mission.toml", "metrics.json", "recording.mcap")
"""Files of a run's directory whose hashes the page states."""


class InspectionReport(NamedTuple):
    """Contents of the page."""

    asset: str
    description: str
    frame: str
    flight: StoredFlight
    components: list[StoredComponent]
    procedure: StoredProcedure | None
    calibrations: list[StoredCalibration]
    readings: list[StoredReading]
    indications: list[StoredIndication]
    coverages: list[Coverage]
    """From the database, else from the run; empty if neither has any."""
    outcome: str
    deviations: list[str]
    hashes: list[tuple[str, str]]  # (file or entry, SHA-256)
    registration: str = "not stated"  # of the flight in the frame of the asset


def build_inspection_report(
    store: InspectionStore, flight: str, stated: Sequence[str] = ()
) -> InspectionReport:
    """Collect the contents of the page for a flight; `stated` are deviations added by a person.

    Raises InputError for an unknown flight, or one without any record.
    """
    known = {f.id: f for f in store.list_flights()}
    if flight not in known:
        raise InputError(
            f"{store.path}: no flight {flight!r}; there are: {', '.join(known) or '-'}"
        )
    one = known[flight]
    readings, found = store.find_readings(flight=flight), store.find_indications(flight=flight)
    calibrations, covered = store.list_calibrations(flight), store.list_coverages(flight)
    if not (readings or found or calibrations or covered):
        raise InputError(
            f"{store.path}: flight {flight} has no readings, indications, calibrations or coverage"
        )
    names = {entry.component for some in (readings, found, covered) for entry in some}
    parts = [c for c in store.list_components(one.asset) if c.name in names]
    procedure = None if one.procedure is None else store.get_procedure(one.procedure)
    run = _read_run(Path(one.run)) if one.run else {}
    rows = store.read("SELECT description, frame FROM assets WHERE name = ?", (one.asset,))
    about, frame = rows[0]
    known_at = store.find_registration(flight)
    tells = _tell_registration(one, known_at)
    deviations = [*stated, *_list_deviations(one, procedure, calibrations, readings, found, run)]
    if known_at is not None:
        deviations += [f"registration: {note}" for note in known_at.notes]
    elif one.registration_std_m is None:
        deviations.append("the registration of the flight in the frame of the asset is not stated")
    text = json.dumps(
        [one._asdict(), [r._asdict() for r in readings], [i._asdict() for i in found],
         [c._asdict() for c in calibrations]], sort_keys=True, default=str,
    )  # fmt: skip
    hashes = [("entries of this flight in the database", hashlib.sha256(text.encode()).hexdigest())]
    if procedure is not None:
        hashes.append((f"procedure {procedure.name} {procedure.revision}", procedure.sha256))
    hashes += [(str(p), _hash(p)) for p in _list_files(one, readings, found, store.path.parent)]
    coverages = [c.coverage for c in covered] or _read_coverage(run.get("result") or {})
    return InspectionReport(
        one.asset, about, frame, one, parts, procedure, calibrations, readings, found, coverages,
        str(run.get("outcome", "")), deviations, hashes, tells,
    )  # fmt: skip


def write_inspection_report(report: InspectionReport, path: Path, folder: Path) -> None:
    """Write the page; `folder` is that of the database, which may contain files of A-scans."""
    places = [(r.reading.x_m, r.reading.y_m, r.reading.z_m) for r in report.readings]
    places += [(i.indication.x_m, i.indication.y_m, i.indication.z_m) for i in report.indications]
    points = np.array(places)
    scans = _load_ascans(report.readings, report.flight, folder)
    with house_style():
        figure = draw_places(report.readings, report.indications, choose_axes(points))
        pictures = [
            build_picture(
                "Coverage", figure,
                "Places in the frame of the asset. Crosses were asked for and hold no accepted "
                "reading; parts of a surface that were missed are in the table of coverage.",
            ),
            build_picture(
                "A-scans", draw_ascans(scans),
                f"The first {len(scans)} readings with a stored A-scan; red: the gated echo. Depth "
                "counts from the transmitter's pulse, probe and coating included: the wall is the "
                "distance between echoes.",
            ),
        ]  # fmt: skip
    accepted = [r for r in report.readings if r.reading.accepted]
    page = render_page(
        "inspection.html.j2", report=report, pictures=[p for p in pictures if p],
        accepted=len(accepted), simulated=report.flight.simulated,
    )  # fmt: skip
    write_page(path, page)


def _tell_registration(flight: StoredFlight, known: Registration | None) -> str:
    if known is not None:
        std = 1e3 * known.carry(known.middle)[1]
        return (
            f"by {known.points} datum points, {std:.1f} mm at their middle (standard deviation), "
            f"{1e3 * known.residual_m:.1f} mm rms left at them"
        )
    if flight.registration_std_m is None:
        return "not stated"
    return f"{1e3 * flight.registration_std_m:.1f} mm (standard deviation), stated"


def _read_run(directory: Path) -> dict[str, Any]:
    """Return metrics.json of the run; empty if its directory was moved or removed."""
    file = directory / "metrics.json"
    if not file.is_file():
        return {}
    data = parse_json(read_text(file, LARGEST_TOML), str(file))
    return data if isinstance(data, dict) else {}


def _read_coverage(result: dict[str, Any]) -> list[Coverage]:
    """Return the coverage of a run without coverage entries, from the missed parts of its path."""
    if not result.get("sector_m2"):
        return []
    missed = tuple(
        Missed("part of the path", tuple(m["from_m"]), tuple(m["to_m"]), float(m["length_m"]))
        for m in result.get("missed", [])
    )
    return [Coverage("m2", float(result["sector_m2"]), float(result["inspected_m2"]), missed)]


def _list_deviations(
    flight: StoredFlight, procedure: StoredProcedure | None,
    calibrations: Sequence[StoredCalibration], readings: Sequence[StoredReading],
    indications: Sequence[StoredIndication], run: dict[str, Any],
) -> list[str]:  # fmt: skip
    """Return deviations and missing items that follow from the entries."""
    out = []
    if procedure is None:
        out.append("no procedure is stored with the flight")
    for stage in ("before", "after"):
        some = [c for c in calibrations if c.calibrated.stage == stage]
        if not some:
            out.append(f"no calibration {stage} the flight is stored")
        out += [
            f"the calibration {stage} the flight failed ({c.calibrated.block})"
            + (f": {c.calibrated.note}" if c.calibrated.note else "")
            for c in some if not c.calibrated.passed
        ]  # fmt: skip
    refused = [r for r in readings if not r.reading.accepted]
    if refused:
        reasons = dict.fromkeys(r.reading.reason for r in refused)
        out.append(f"{len(refused)} of {len(readings)} readings refused: {'; '.join(reasons)}")
    without = sum(r.reading.u95 is None for r in readings if r.reading.accepted)
    if without:
        out.append(f"{without} accepted readings state no uncertainty")
    if any(i.indication.place_u95_m is None for i in indications):
        out.append("indications without an uncertainty of their place")
    if flight.run and not run:
        out.append(f"the run directory {flight.run} was not found: its files are not shown")
    out += [
        f"requirement {r['name']} not met: {r['value']} {r.get('unit', '')} ({r['sense']} "
        f"{r['limit']})"
        for r in run.get("requirements", []) if not r.get("passed", True)
    ]  # fmt: skip
    return out


def _split_data(text: str, flight: StoredFlight, folder: Path) -> tuple[Path, str]:
    """Split a reading's `data`, FILE#U,V, into file (beside the database or in the run) and
    position."""
    name, _, place = text.partition("#")
    beside, inside = folder / name, Path(flight.run) / name
    return (inside if flight.run and not beside.is_file() else beside), place


def _list_files(
    flight: StoredFlight, readings: Sequence[StoredReading],
    indications: Sequence[StoredIndication], folder: Path,
) -> list[Path]:  # fmt: skip
    files = [Path(flight.run) / name for name in HASHED] if flight.run else []
    named = [r.reading.data for r in readings] + [i.indication.data for i in indications]
    files += [_split_data(data, flight, folder)[0] for data in named if data]
    return [f for f in dict.fromkeys(files) if f.is_file()]


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _load_ascans(
    readings: Sequence[StoredReading], flight: StoredFlight, folder: Path
) -> list[tuple[str, UltrasonicScan, tuple[int, int]]]:
    out: list[tuple[str, UltrasonicScan, tuple[int, int]]] = []
    loaded: dict[Path, Any] = {}
    for r in readings:
        file, place = _split_data(r.reading.data, flight, folder)
        if file.suffix != ".nde" or not file.is_file() or len(out) == MOST_ASCANS:
            continue
        if file not in loaded:
            loaded[file] = read_nde(file)
        scan = loaded[file]
        u, _, v = (place or "0,0").partition(",")
        if not isinstance(scan, UltrasonicScan) or not (u + (v or "0")).isdecimal():
            continue
        i, j = int(u), int(v or 0)
        if i < scan.ascan.shape[0] and j < scan.ascan.shape[1]:
            one = r.reading
            name = one.spot or f"reading {r.id}"
            value = "no value" if one.value is None else f"{one.value:.2f} {one.unit}"
            out.append((f"{name}: {value}", scan, (i, j)))
    return out
