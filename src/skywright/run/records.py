"""Contact measurements of flights, in the database of all measurements (inspection/history/).

The force of a contact is a reading; its other values are stored with it. A measurement is expressed
in the frame of its structure (the world's name), so that later flights find the same point again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from skywright.inspection.history.database import stamp
from skywright.inspection.history.entries import Entries
from skywright.inspection.history.store import InspectionStore
from skywright.run.flight import Flown
from skywright.run.kind import load_kind
from skywright.run.setup import Setup


class Measurement(NamedTuple):
    """One contact measurement: position, time, force, and the accuracy of the position."""

    spot: str
    how: str  # "docked" or "flying"
    x_m: float  # position of the tip in the structure's frame S
    y_m: float
    off_m: float  # estimated distance off the surface: the position error normal to it
    p_W: tuple[float, float, float]  # m, the same position in W
    start_s: float  # mission time
    end_s: float
    force_des_n: float
    force_n: float  # mean of the force sensor
    force_std_n: float
    pose_std_m: float  # standard deviation of the platform's position, from the estimator
    wander_m: float  # largest distance of the estimated tip from its mean


class Record(NamedTuple):
    """One stored measurement with its flight. Positions x, y are in the structure's frame S."""

    id: int
    flight: str
    structure: str
    mission: str
    robot: str
    run: str  # directory of the run, "" where none was written
    time_utc: str  # ISO 8601, the end of the measurement
    spot: str
    how: str  # "docked" or "flying"
    x_m: float
    y_m: float
    off_m: float  # estimated position off the surface
    east_m: float  # the same position in the world's frame W
    north_m: float
    up_m: float
    duration_s: float
    force_des_n: float
    force_n: float
    force_std_n: float
    pose_std_m: float | None  # None: the estimator states none
    wander_m: float


class RecordStore(InspectionStore):
    """The database with the contact measurements of flights."""

    def add(self, flight: str, started: datetime, m: Measurement) -> None:
        """Store one measurement of a flight and sync it to the disk."""
        known = m.pose_std_m if math.isfinite(m.pose_std_m) else None
        at = stamp(started + timedelta(seconds=m.end_s))
        self.write(
            (
                "INSERT INTO readings (flight, time_utc, spot, quantity, value, unit, u95, x_m,"
                " y_m, z_m, place_u95_m, accepted, reason, data)"
                " VALUES (?, ?, ?, 'force', ?, 'N', NULL, ?, ?, ?, ?, 1, '', '')",
                (flight, at, m.spot, m.force_n, m.x_m, m.y_m, m.off_m,
                 None if known is None else 2.0 * known),
            ),
            (
                "INSERT INTO contacts VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (":last", m.how, *m.p_W, m.end_s - m.start_s, m.force_des_n, m.force_std_n, known,
                 m.wander_m),
            ),
        )  # fmt: skip

    def find(
        self,
        *,
        structure: str | None = None,
        spot: str | None = None,
        at: tuple[float, float] | None = None,
        radius: float = 0.05,
    ) -> list[Record]:
        """Return contacts in the order of time, of a structure, a spot, or around a position.

        `at` (m in S) and `radius` (m) select the history of a point over flights.
        """
        wheres, values = [], []
        for name, value in (("structure", structure), ("spot", spot)):
            if value is not None:
                wheres.append(f"{name} = ?")
                values.append(value)
        where = f"WHERE {' AND '.join(wheres)}" if wheres else ""
        other = {"id": "r.id", "flight": "r.flight", "off_m": "z_m", "force_n": "value"}
        columns = ", ".join(other.get(n, n) for n in Record._fields)
        rows = self.read(
            f"SELECT {columns} FROM readings r JOIN contacts c ON c.reading = r.id"
            f" JOIN flights f ON f.id = r.flight {where} ORDER BY time_utc, r.id",
            values,
        )
        found = [Record(*row) for row in rows]
        if at is None:
            return found
        return [r for r in found if math.hypot(r.x_m - at[0], r.y_m - at[1]) <= radius]

    def list_names(self, column: str) -> list[str]:
        """Return the structures ("structure") or spots ("spot") that have records."""
        table = {"structure": "flights", "spot": "readings"}[column]
        return [row[0] for row in self.read(f"SELECT DISTINCT {column} FROM {table} ORDER BY 1")]


class FlightRecords:
    """Writes one flight to the database: contacts immediately, other findings at its end."""

    def __init__(self, path: Path, setup: Setup[Any]) -> None:
        """Open or create the file, and store the procedure in it.

        Raises InputError as `DatabaseFile` does, and if the procedure's revision is already stored
        with another text.
        """
        self._path, self._setup = path, setup
        self._directory, self._flight, self._started = Path(), "", datetime.now(UTC)
        self._store = RecordStore(path, create=True)
        self._procedure: int | None = None
        try:
            procedure = load_kind(setup.description.mission.kind).procedure(setup)
            if procedure is not None:
                self._procedure = self._store.add_procedure(*procedure)
        except BaseException:
            self._store.close()
            raise

    def start(
        self, directory: Path, started: datetime | None = None
    ) -> Callable[[Measurement], None]:
        """Store the flight, which begins now or `started`; returns the storing function."""
        d = self._setup.description
        self._directory = directory
        self._store.add_asset(d.world.name, frame=describe_frame(self._setup))
        self._flight, self._started = self._store.add_flight(
            structure=d.world.name, mission=d.mission.name, robot=d.robot.name,
            seed=d.mission.seed, run=str(directory), started=started, procedure=self._procedure,
            registration_std_m=d.plant.map_error_m / math.sqrt(3.0),
        )  # fmt: skip
        return lambda measurement: self._store.add(self._flight, self._started, measurement)

    def close(self) -> None:
        """Close the file."""
        self._store.close()

    def undo(self) -> None:
        """Remove the flight. Opens and closes the file."""
        store = RecordStore(self._path)
        try:
            store.remove_flights([self._flight])
        finally:
            store.close()

    def add(self, flown: Flown[Any, Any]) -> str:
        """Store what the flight found; returns its id. Opens and closes the file."""
        found = load_kind(self._setup.description.mission.kind).entries(flown)
        nothing = not (found.readings or found.indications or found.calibrations or found.coverage)
        if nothing and found.registration_std_m is None:
            return self._flight
        found = write_scans(found, self._directory)
        store = RecordStore(self._path, create=True)
        try:
            part = None
            if found.component:
                part = store.add_component(
                    self._setup.world.name, found.component, material=found.material or None,
                    nominal_mm=found.nominal_mm,
                )  # fmt: skip

            def at(seconds: float) -> datetime:
                return self._started + timedelta(seconds=seconds)

            if found.registration_std_m is not None:
                store.set_registration(self._flight, found.registration_std_m)
            row = None
            for t, calibrated in found.calibrations:
                last = store.add_calibration(self._flight, at(t), calibrated)
                row = last if row is None else row  # the calibration before the flight
            store.add_readings(self._flight, [(at(t), r) for t, r in found.readings],
                               component=part, calibration=row)  # fmt: skip
            for t, indication in found.indications:
                store.add_indication(
                    self._flight, at(t), indication, component=part, calibration=row
                )
            if found.coverage is not None:
                store.add_coverage(self._flight, found.coverage, component=part)
        finally:
            store.close()
        return self._flight


def describe_frame(setup: Setup[Any]) -> str:
    """Return a description of the frame of a flight's positions."""
    if setup.world.structure is not None:
        return "S of the structure, as the world's file has it: x and y on the surface, z off it"
    return "W of the world's file: x east, y north, z up; the pipe as that file has it"


def write_scans(found: Entries, directory: Path) -> Entries:
    """Write the signals beside the recording; without h5py, `data` refers to the recording."""
    if find_spec("h5py") is not None:
        from skywright.inspection.files.nde import write_nde

        for name, scan in found.scans:
            (directory / name).parent.mkdir(exist_ok=True)
            write_nde(directory / name, scan)
        return found

    def rename(data: str) -> str:
        return "recording.mcap" if data else ""

    return found._replace(
        readings=tuple((t, r._replace(data=rename(r.data))) for t, r in found.readings),
        indications=tuple((t, i._replace(data=rename(i.data))) for t, i in found.indications),
    )
