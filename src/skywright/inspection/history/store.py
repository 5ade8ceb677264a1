"""Database of inspections: add entries and query them over flights and years."""

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
        """Store or update an asset; return its name. `frame` describes the frame of positions."""
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
        """Store or update a component of an asset; return its row id.

        Raises InputError if a thickness is not finite or not above 0.
        """
        for key, value in (("nominal_mm", nominal_mm), ("required_mm", required_mm)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"component {name!r}: {key} {value:g}; valid: above 0")
        self.add_asset(asset)
        more = {"material": material, "nominal_mm": nominal_mm, "required_mm": required_mm}
        return self.keep("components", {"asset": asset, "name": name}, more)

    def add_procedure(self, name: str, revision: str, text: str) -> int:
        """Store a procedure; return its row id.

        Raises InputError if the revision is stored with another text. A changed text requires a new
        revision, so that the procedure of every flight stays readable.
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
        """Store a flight that starts now, or at `started`; return its id and start time.

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
        """Set the standard deviation (m) of a stored flight's frame in the frame of the asset."""
        self.write(("UPDATE flights SET registration_std_m = ? WHERE id = ?", (std_m, flight)))

    def add_calibration(self, flight: str | None, t: datetime, c: Calibrated) -> int:
        """Store a calibration of an instrument; return its row id.

        Raises InputError if its stage is unknown.
        """
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
        """Store one reading and sync it to the disk; return its row id.

        Raises InputError like `add_readings`.
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
        """Store readings, all or none; return the row id of the last (0 if there are none).

        Raises InputError if a number is not finite, a u95 is below 0, an accepted reading has no
        value, or a refused one has no reason.
        """
        for _, r in readings:
            _check_numbers("reading", r._asdict())
            if r.accepted and r.value is None:
                raise InputError(
                    "reading: accepted without a value; give the value, or accepted=False with a "
                    "reason"
                )
            if not r.accepted and not r.reason:
                raise InputError("reading: refused without a reason; give the reason as a text")
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
        """Store one indication, which is open; return its row id.

        Raises InputError if a number is not finite, or if a u95 is below 0.
        """
        _check_numbers("indication", i._asdict())
        return self.write((
            "INSERT INTO indications (flight, component, calibration, time_utc, kind, x_m, y_m,"
            " z_m, place_u95_m, length_mm, depth_mm, depth_u95_mm, amplitude, amplitude_unit, data)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (flight, component, calibration, stamp(t), *i),
        ))  # fmt: skip

    def add_coverage(self, flight: str, c: Coverage, *, component: int | None = None) -> int:
        """Store the coverage of a flight; return its row id.

        Raises InputError if a number is not finite, or `inspected` is below 0 or above `asked`.
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
        """Add a disposition of an indication; earlier ones are kept.

        Raises InputError if the disposition or the indication is unknown.
        """
        if disposition not in DISPOSITIONS:
            raise InputError(f"disposition {disposition!r}; valid: {', '.join(DISPOSITIONS)}")
        if not self.read("SELECT 1 FROM indications WHERE id = ?", (indication,)):
            raise InputError(f"{self.path}: no indication {indication}")
        self.write((
            "INSERT INTO dispositions (indication, time_utc, who, disposition, note)"
            " VALUES (?, ?, ?, ?, ?)",
            (indication, stamp(datetime.now(UTC)), who, disposition, note),
        ))  # fmt: skip

    def remove_flights(self, flights: Sequence[str]) -> None:
        """Remove flights and the entries that refer to them, in one transaction.

        Assets, components, procedures and instruments remain.
        """
        statements = [
            f"DELETE FROM {child} WHERE {key} IN (SELECT id FROM {parent} WHERE flight = ?)"
            for child, key, parent in (
                ("contacts", "reading", "readings"), ("dispositions", "indication", "indications"),
            )
        ]  # fmt: skip
        for table in ("readings", "indications", "coverages", "datums", "calibrations"):
            statements.append(f"DELETE FROM {table} WHERE flight = ?")
        statements.append("DELETE FROM flights WHERE id = ?")
        self.write(*((sql, (flight,)) for flight in flights for sql in statements))

    def list_flights(self, asset: str | None = None) -> list[StoredFlight]:
        """Return the flights, of one asset or of all, in the order of their start."""
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
        """Return a procedure by its row id. Raises InputError if there is none."""
        rows = self.read(
            "SELECT id, name, revision, text, sha256 FROM procedures WHERE id = ?", (procedure,)
        )
        if not rows:
            raise InputError(f"{self.path}: no procedure {procedure}")
        return StoredProcedure(*rows[0])

    def list_calibrations(self, flight: str | None = None) -> list[StoredCalibration]:
        """Return the calibrations, of one flight or of all, in chronological order."""
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
        carried: bool = True,
    ) -> list[StoredReading]:
        """Return accepted and refused readings in chronological order.

        Positions are in the frame of the asset if datum points register the flight; with `carried`
        False they are as the flight measured them.
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
        found = [
            StoredReading._make((*row[:6], bool(row[6]), row[7], _read_reading(row[8:])))
            for row in rows
        ]
        return self.carry_readings(found) if carried else found

    def find_indications(
        self,
        *,
        asset: str | None = None,
        component: str | None = None,
        flight: str | None = None,
    ) -> list[StoredIndication]:
        """Return indications in chronological order, with their last disposition.

        Positions are in the frame of the asset if datum points register the flight.
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
