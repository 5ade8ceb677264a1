"""Inspection records: contact measurements of many flights in one SQLite file.

Each measurement is a transaction of its own, committed as soon as it is finished and synced to the
disk, so a crash loses none. The file is in write-ahead mode: two flights may write while others
read. A measurement lies in the frame of its structure (the world's name), so a point found in one
flight is found again in the next.
"""

from __future__ import annotations

import math
import sqlite3
import uuid
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from skywright.description.loader import Description
from skywright.errors import InputError

T = TypeVar("T")

APPLICATION_ID = 0x534B5957  # "SKYW"
SCHEMA_VERSION = 1
BUSY_S = 10.0  # s, that a writer waits for another

SCHEMA = (
    """CREATE TABLE flights (
        id TEXT PRIMARY KEY, started_utc TEXT NOT NULL, structure TEXT NOT NULL,
        mission TEXT NOT NULL, robot TEXT NOT NULL, seed INTEGER NOT NULL, run TEXT NOT NULL
    ) STRICT""",
    """CREATE TABLE measurements (
        id INTEGER PRIMARY KEY, flight TEXT NOT NULL REFERENCES flights(id),
        time_utc TEXT NOT NULL, spot TEXT NOT NULL, how TEXT NOT NULL,
        x_m REAL NOT NULL, y_m REAL NOT NULL, off_m REAL NOT NULL,
        east_m REAL NOT NULL, north_m REAL NOT NULL, up_m REAL NOT NULL,
        duration_s REAL NOT NULL, force_des_n REAL NOT NULL, force_n REAL NOT NULL,
        force_std_n REAL NOT NULL, pose_std_m REAL, wander_m REAL NOT NULL
    ) STRICT""",
    "CREATE INDEX measurements_place ON measurements (x_m, y_m)",
)


class Measurement(NamedTuple):
    """One contact measurement: where, when, how hard, and how well the place was known."""

    spot: str
    how: str  # "docked" or "flying"
    x_m: float  # place of the tip in the structure's frame S
    y_m: float
    off_m: float  # off the surface, as estimated: what the place errs by across it
    p_W: tuple[float, float, float]  # m, the same place in W
    start_s: float  # mission time
    end_s: float
    force_des_n: float
    force_n: float  # mean of the force sensor
    force_std_n: float
    pose_std_m: float  # standard deviation of the platform's place, as the estimator says
    wander_m: float  # farthest that the estimated tip was from its mean


class Record(NamedTuple):
    """One stored measurement with its flight. Places x, y in the structure's frame S."""

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
    off_m: float  # estimated place off the surface
    east_m: float  # the same place in the world's frame W
    north_m: float
    up_m: float
    duration_s: float
    force_des_n: float
    force_n: float
    force_std_n: float
    pose_std_m: float | None  # None: the estimator does not say
    wander_m: float


class RecordStore:
    """An open file of records. Every method raises InputError on what goes wrong with the file."""

    def __init__(self, path: Path, *, create: bool = False) -> None:
        """Open `path`, or with `create` make it.

        Raises InputError for a file that is none of ours, damaged, of another version, locked by
        another program, or that cannot be written.
        """
        self.path = path
        if not create and not path.is_file():
            what = "is a folder" if path.is_dir() else "no such file"
            raise InputError(f"{path}: {what}; records are written by skywright run --records")
        if create and path.is_dir():
            raise InputError(f"{path}: is a folder; give a file for the records")
        if create and not path.parent.is_dir():
            raise InputError(f"{path}: the folder does not exist")
        self._db = self._try(
            lambda: sqlite3.connect(path, timeout=BUSY_S, isolation_level=None), "opened"
        )
        try:
            self._try(lambda: self._open(create), "opened")
        except BaseException:
            self._db.close()
            raise

    def _open(self, create: bool) -> None:
        db = self._db
        if create:
            db.execute(
                "PRAGMA journal_mode = WAL"
            )  # where the file system has none: a rollback log
            db.execute("PRAGMA synchronous = FULL")
        db.execute("PRAGMA foreign_keys = ON")
        if create:
            db.execute("BEGIN IMMEDIATE")
        owner = int(db.execute("PRAGMA application_id").fetchone()[0])
        version = int(db.execute("PRAGMA user_version").fetchone()[0])
        tables = int(db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0])
        if create and owner == 0 and version == 0 and tables == 0:
            for statement in SCHEMA:
                db.execute(statement)
            db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        elif owner != APPLICATION_ID:
            raise InputError(f"{self.path}: is a database without inspection records")
        elif version != SCHEMA_VERSION:
            raise InputError(
                f"{self.path}: records of version {version}; this version of Skywright "
                f"reads version {SCHEMA_VERSION}"
            )
        if create:
            db.execute("COMMIT")

    def close(self) -> None:
        """Close the file."""
        self._db.close()

    def add_flight(
        self, *, structure: str, mission: str, robot: str, seed: int, run: str
    ) -> tuple[str, datetime]:
        """Store a flight that begins now; returns its id and time."""
        key, now = uuid.uuid4().hex[:12], datetime.now(UTC)
        row = (key, _stamp(now), structure, mission, robot, seed, run)
        self._write("INSERT INTO flights VALUES (?, ?, ?, ?, ?, ?, ?)", row)
        return key, now

    def add(self, flight: str, started: datetime, m: Measurement) -> None:
        """Store one measurement of a flight and sync it to the disk."""
        self._write(
            "INSERT INTO measurements (flight, time_utc, spot, how, x_m, y_m, off_m, east_m,"
            " north_m, up_m, duration_s, force_des_n, force_n, force_std_n, pose_std_m, wander_m)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                flight, _stamp(started + timedelta(seconds=m.end_s)), m.spot, m.how, m.x_m, m.y_m,
                m.off_m, *m.p_W, m.end_s - m.start_s, m.force_des_n, m.force_n, m.force_std_n,
                m.pose_std_m if math.isfinite(m.pose_std_m) else None, m.wander_m,
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
        """Return records in the order of their time, of a structure, a spot, or around a place.

        `at` (m in S) and `radius` (m) give the history of a point over flights.
        """
        wheres, values = [], []
        for name, value in (("structure", structure), ("spot", spot)):
            if value is not None:
                wheres.append(f"{name} = ?")
                values.append(value)
        where = f"WHERE {' AND '.join(wheres)}" if wheres else ""
        columns = ", ".join(f"m.{n}" if n in ("id", "flight") else n for n in Record._fields)
        sql = (
            f"SELECT {columns} FROM measurements m JOIN flights f ON f.id = m.flight {where}"
            " ORDER BY time_utc, m.id"
        )
        rows = self._try(lambda: self._db.execute(sql, values).fetchall(), "read")
        found = [Record(*row) for row in rows]
        if at is None:
            return found
        return [r for r in found if math.hypot(r.x_m - at[0], r.y_m - at[1]) <= radius]

    def list_names(self, column: str) -> list[str]:
        """Return the structures ("structure") or spots ("spot") that there are records of."""
        table = {"structure": "flights", "spot": "measurements"}[column]
        sql = f"SELECT DISTINCT {column} FROM {table} ORDER BY 1"
        return [row[0] for row in self._try(lambda: self._db.execute(sql).fetchall(), "read")]

    def _write(self, sql: str, values: tuple[object, ...]) -> None:
        self._try(lambda: self._db.execute(sql, values), "written")

    def _try(self, action: Callable[[], T], what: str) -> T:
        """Do it; an error of SQLite becomes an InputError that says what to do about it."""
        try:
            return action()
        except sqlite3.Error as error:
            if self._in_transaction():
                self._db.rollback()
            text = str(error)
            if "locked" in text:
                text = f"another program has locked it for {BUSY_S:g} s"
            elif "not a database" in text:
                text = "it is not a SQLite database"
            elif "malformed" in text:
                text = "it is damaged; sqlite3 FILE .recover may save what is left"
            elif "full" in text:
                text = "the disk is full"
            raise InputError(f"{self.path}: records cannot be {what}: {text}") from None

    def _in_transaction(self) -> bool:
        return hasattr(self, "_db") and self._db.in_transaction


def _stamp(t: datetime) -> str:
    return t.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def start_records(
    store: RecordStore, d: Description[Any], directory: Path
) -> Callable[[Measurement], None]:
    """Store the flight; returns what stores a measurement of it."""
    flight, started = store.add_flight(
        structure=d.world.name, mission=d.mission.name, robot=d.robot.name, seed=d.mission.seed,
        run=str(directory),
    )  # fmt: skip
    return lambda m: store.add(flight, started, m)
