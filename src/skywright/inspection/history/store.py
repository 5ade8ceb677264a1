"""Entries of the database: added, and found again over flights and years."""

from __future__ import annotations

import hashlib
import json
import math
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from skywright.errors import InputError
from skywright.inspection.history.database import stamp
from skywright.inspection.history.datums import DatumFile
from skywright.inspection.history.entries import (
    DISPOSITIONS,
    STAGES,
    Calibrated,
    Coverage,
    Indication,
    Missed,
    Reading,
    StoredCalibration,
    StoredComponent,
    StoredCoverage,
    StoredFlight,
    StoredIndication,
    StoredProcedure,
    StoredReading,
)


class InspectionStore(DatumFile):
    """All measurements of assets in one file."""

    def add_asset(self, name: str, description: str | None = None, frame: str | None = None) -> str:
        """Store an asset, or what is newly said of it; `frame` says where places count from."""
        self.keep("assets", {"name": name}, {"description": description, "frame": frame})
        return name

    def add_component(
        self,
        asset: str,
        name: str,
        *,
        material: str | None = None,
        nominal_mm: float | None = None,
        required_mm: float | None = None,
    ) -> int:
        """Store a component of an asset, or what is newly said of it; returns its row."""
        for key, value in (("nominal_mm", nominal_mm), ("required_mm", required_mm)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"component {name!r}: {key} {value:g}; valid: above 0")
        self.add_asset(asset)
        more = {"material": material, "nominal_mm": nominal_mm, "required_mm": required_mm}
        return self.keep("components", {"asset": asset, "name": name}, more)

    def add_procedure(self, name: str, revision: str, text: str) -> int:
        """Store a procedure; returns its row. Raises InputError where the revision says otherwise.

        What was flown by a revision stays readable: another text needs another revision.
        """
        digest = hashlib.sha256(text.encode()).hexdigest()
        known = self.read(
            "SELECT id, sha256 FROM procedures WHERE name = ? AND revision = ?", (name, revision)
        )
        if known and known[0][1] != digest:
            raise InputError(
                f"{self.path}: procedure {name!r} revision {revision!r} is stored with another "
                "text; give it another revision"
            )
        keys = {"name": name, "revision": revision}
        return self.keep("procedures", keys, {"text": text, "sha256": digest})

    def add_flight(
        self,
        *,
        structure: str,
        mission: str,
        robot: str,
        seed: int,
        run: str,
        simulated: bool = True,
        started: datetime | None = None,
        procedure: int | None = None,
        registration_std_m: float | None = None,
    ) -> tuple[str, datetime]:
        """Store a flight that begins now, or began; returns its id and time.

        `registration_std_m` is the standard deviation of the flight's frame in that of the asset.
        """
        key, now = uuid.uuid4().hex[:12], started or datetime.now(UTC)
        self.add_asset(structure)
        self.write((
            "INSERT INTO flights (id, started_utc, structure, mission, robot, seed, run, simulated,"
            " procedure, registration_std_m) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (key, stamp(now), structure, mission, robot, seed, run, int(simulated), procedure,
             registration_std_m),
        ))  # fmt: skip
        return key, now

    def set_registration(self, flight: str, std_m: float) -> None:
        """State how well the frame of a stored flight is known in that of the asset."""
        self.write(("UPDATE flights SET registration_std_m = ? WHERE id = ?", (std_m, flight)))

    def add_calibration(self, flight: str | None, t: datetime, c: Calibrated) -> int:
        """Store a calibration of an instrument; returns its row."""
        if c.stage not in STAGES:
            raise InputError(f"calibration: stage {c.stage!r}; valid: {', '.join(STAGES)}")
        keys = {"method": c.method, "model": c.model, "serial": c.serial}
        instrument = self.keep("instruments", keys, {})
        return self.write((
            "INSERT INTO calibrations (instrument, flight, time_utc, stage, block, settings,"
            " passed, note) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (instrument, flight, stamp(t), c.stage, c.block, json.dumps(c.settings), int(c.passed),
             c.note),
        ))  # fmt: skip

    def add_reading(
        self,
        flight: str,
        t: datetime,
        r: Reading,
        *,
        component: int | None = None,
        calibration: int | None = None,
    ) -> int:
        """Store one reading and sync it to the disk; returns its row.

        Raises InputError for an accepted reading without a value, or numbers that are not finite.
        """
        return self.add_readings(flight, [(t, r)], component=component, calibration=calibration)

    def add_readings(
        self,
        flight: str,
        readings: Sequence[tuple[datetime, Reading]],
        *,
        component: int | None = None,
        calibration: int | None = None,
    ) -> int:
        """Store readings, all of them or none; returns the row of the last."""
        for _, r in readings:
            _check_numbers("reading", r._asdict())
            if r.accepted and r.value is None:
                raise InputError("reading: accepted without a value; refuse it with the reason")
            if not r.accepted and not r.reason:
                raise InputError("reading: refused without a reason")
        if not readings:
            return 0
        columns = ", ".join(Reading._fields)
        marks = ", ".join("?" * (4 + len(Reading._fields)))
        sql = (
            f"INSERT INTO readings (flight, component, calibration, time_utc, {columns})"
            f" VALUES ({marks})"
        )
        return self.write(
            *((sql, (flight, component, calibration, stamp(t), *r)) for t, r in readings)
        )

    def add_indication(
        self,
        flight: str,
        t: datetime,
        i: Indication,
        *,
        component: int | None = None,
        calibration: int | None = None,
    ) -> int:
        """Store one indication, which is open; returns its row."""
        _check_numbers("indication", i._asdict())
        return self.write((
            "INSERT INTO indications (flight, component, calibration, time_utc, kind, x_m, y_m,"
            " z_m, place_u95_m, length_mm, depth_mm, depth_u95_mm, amplitude, amplitude_unit, data)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (flight, component, calibration, stamp(t), *i),
        ))  # fmt: skip

    def add_coverage(self, flight: str, c: Coverage, *, component: int | None = None) -> int:
        """Store how much a flight inspected; returns its row.

        Raises InputError for numbers that are not finite or below 0, or more than was asked for.
        """
        _check_numbers("coverage", {"asked": c.asked, "inspected": c.inspected})
        if not 0.0 <= c.inspected <= c.asked:
            raise InputError(
                f"coverage: {c.inspected:g} of {c.asked:g} {c.unit}; valid: 0 to what was asked"
            )
        return self.write((
            "INSERT INTO coverages (flight, component, unit, asked, inspected, missed)"
            " VALUES (?, ?, ?, ?, ?, ?)",
            (flight, component, c.unit, c.asked, c.inspected, json.dumps(c.missed)),
        ))  # fmt: skip

    def decide(self, indication: int, disposition: str, who: str, note: str = "") -> None:
        """Add a disposition; earlier ones stay. Raises InputError for an unknown one."""
        if disposition not in DISPOSITIONS:
            raise InputError(f"disposition {disposition!r}; valid: {', '.join(DISPOSITIONS)}")
        if not self.read("SELECT 1 FROM indications WHERE id = ?", (indication,)):
            raise InputError(f"{self.path}: no indication {indication}")
        self.write((
            "INSERT INTO dispositions (indication, time_utc, who, disposition, note)"
            " VALUES (?, ?, ?, ?, ?)",
            (indication, stamp(datetime.now(UTC)), who, disposition, note),
        ))  # fmt: skip

    def list_flights(self, asset: str | None = None) -> list[StoredFlight]:
        """Return the flights in the order of their start."""
        where, values = ("WHERE structure = ?", (asset,)) if asset else ("", ())
        rows = self.read(
            "SELECT id, started_utc, structure, mission, robot, seed, run, simulated, procedure,"
            f" registration_std_m FROM flights {where} ORDER BY started_utc, rowid", values,
        )  # fmt: skip
        return [StoredFlight._make((*row[:7], bool(row[7]), *row[8:])) for row in rows]

    def list_components(self, asset: str | None = None) -> list[StoredComponent]:
        """Return the components, of one asset or of all."""
        where, values = ("WHERE asset = ?", (asset,)) if asset else ("", ())
        rows = self.read(
            "SELECT id, asset, name, material, nominal_mm, required_mm FROM components "
            f"{where} ORDER BY asset, name", values,
        )  # fmt: skip
        return [StoredComponent(*row) for row in rows]

    def get_procedure(self, procedure: int) -> StoredProcedure:
        """Return a procedure by its row."""
        rows = self.read(
            "SELECT id, name, revision, text, sha256 FROM procedures WHERE id = ?", (procedure,)
        )
        if not rows:
            raise InputError(f"{self.path}: no procedure {procedure}")
        return StoredProcedure(*rows[0])

    def list_calibrations(self, flight: str | None = None) -> list[StoredCalibration]:
        """Return the calibrations, of one flight or of all, in the order of their time."""
        where, values = ("WHERE flight = ?", (flight,)) if flight else ("", ())
        rows = self.read(
            "SELECT c.id, flight, time_utc, method, model, serial, stage, block, settings, passed,"
            " note FROM calibrations c JOIN instruments i ON i.id = c.instrument "
            f"{where} ORDER BY time_utc, c.id", values,
        )  # fmt: skip
        return [
            StoredCalibration(row[0], row[1], row[2], _read_calibrated(row[3:])) for row in rows
        ]

    def list_coverages(self, flight: str) -> list[StoredCoverage]:
        """Return the coverages of a flight."""
        rows = self.read(
            "SELECT v.id, flight, c.name, unit, asked, inspected, missed FROM coverages v"
            " LEFT JOIN components c ON c.id = v.component WHERE flight = ? ORDER BY v.id",
            (flight,),
        )
        return [
            StoredCoverage(
                row[0], row[1], row[2], Coverage(row[3], row[4], row[5], _read_missed(row[6]))
            )
            for row in rows
        ]

    def find_readings(
        self,
        *,
        asset: str | None = None,
        component: str | None = None,
        quantity: str | None = None,
        flight: str | None = None,
    ) -> list[StoredReading]:
        """Return readings in the order of their time, accepted and refused ones.

        Places are in the frame of the asset where datum points register their flight.
        """
        where, values = _join(
            ("f.structure", asset), ("c.name", component), ("r.quantity", quantity),
            ("r.flight", flight),
        )  # fmt: skip
        columns = ", ".join(f"r.{name}" for name in Reading._fields)
        rows = self.read(
            "SELECT r.id, r.flight, f.structure, c.name, r.calibration, r.time_utc, f.simulated,"
            f" f.registration_std_m, {columns} FROM readings r JOIN flights f ON f.id = r.flight"
            f" LEFT JOIN components c ON c.id = r.component {where} ORDER BY r.time_utc, r.id",
            values,
        )
        return self.carry_readings([
            StoredReading._make((*row[:6], bool(row[6]), row[7], _read_reading(row[8:])))
            for row in rows
        ])  # fmt: skip

    def find_indications(
        self,
        *,
        asset: str | None = None,
        component: str | None = None,
        flight: str | None = None,
    ) -> list[StoredIndication]:
        """Return indications in the order of their time, with their last disposition.

        Places are in the frame of the asset, as those of readings.
        """
        where, values = _join(("f.structure", asset), ("c.name", component), ("i.flight", flight))
        columns = ", ".join(f"i.{name}" for name in Indication._fields)
        rows = self.read(
            "SELECT i.id, i.flight, f.structure, c.name, i.time_utc, f.simulated,"
            f" f.registration_std_m, d.disposition, d.who, d.time_utc, d.note, {columns}"
            " FROM indications i JOIN flights f ON f.id = i.flight"
            " LEFT JOIN components c ON c.id = i.component"
            " LEFT JOIN dispositions d ON d.id ="
            " (SELECT max(id) FROM dispositions WHERE indication = i.id)"
            f" {where} ORDER BY i.time_utc, i.id", values,
        )  # fmt: skip
        return self.carry_indications([
            StoredIndication._make((
                *row[:5], bool(row[5]), row[6], Indication._make(row[11:]), row[7] or "open",
                ", ".join(x for x in row[8:11] if x),
            ))
            for row in rows
        ])  # fmt: skip


def _read_calibrated(row: tuple[Any, ...]) -> Calibrated:
    method, model, serial, stage, block, settings, passed, note = row
    return Calibrated(method, model, serial, stage, block, json.loads(settings), bool(passed), note)


def _read_missed(text: str) -> tuple[Missed, ...]:
    return tuple(Missed(x[0], tuple(x[1]), tuple(x[2]), x[3]) for x in json.loads(text))


def _read_reading(row: tuple[Any, ...]) -> Reading:
    r = Reading._make(row)
    return r._replace(accepted=bool(r.accepted))


def _join(*conditions: tuple[str, object | None]) -> tuple[str, list[object]]:
    given = [(name, value) for name, value in conditions if value is not None]
    where = " AND ".join(f"{name} = ?" for name, _ in given)
    return (f"WHERE {where}" if where else ""), [value for _, value in given]


def _check_numbers(what: str, values: dict[str, object]) -> None:
    for name, value in values.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{what}: {name} is {value}; valid: a finite number")
        if name.endswith(("u95", "u95_m", "u95_mm")) and isinstance(value, float) and value < 0:
            raise InputError(f"{what}: {name} is {value:g}; valid: 0 or more")
