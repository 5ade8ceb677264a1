"""Tables of the database by version, and the migration from each version to the next.

Statements of earlier versions must not change, because files of these versions exist.
"""

APPLICATION_ID = 0x534B5957  # "SKYW"

VERSION_1 = (
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
"""Contact measurements only."""

TO_VERSION_2 = (
    """CREATE TABLE assets (
        name TEXT PRIMARY KEY, description TEXT NOT NULL DEFAULT '', frame TEXT NOT NULL DEFAULT ''
    ) STRICT""",
    """CREATE TABLE components (
        id INTEGER PRIMARY KEY, asset TEXT NOT NULL REFERENCES assets(name), name TEXT NOT NULL,
        material TEXT NOT NULL DEFAULT '', nominal_mm REAL, required_mm REAL, UNIQUE (asset, name)
    ) STRICT""",
    """CREATE TABLE procedures (
        id INTEGER PRIMARY KEY, name TEXT NOT NULL, revision TEXT NOT NULL, text TEXT NOT NULL,
        sha256 TEXT NOT NULL, UNIQUE (name, revision)
    ) STRICT""",
    """CREATE TABLE instruments (
        id INTEGER PRIMARY KEY, method TEXT NOT NULL, model TEXT NOT NULL, serial TEXT NOT NULL,
        UNIQUE (method, model, serial)
    ) STRICT""",
    """CREATE TABLE calibrations (
        id INTEGER PRIMARY KEY, instrument INTEGER NOT NULL REFERENCES instruments(id),
        flight TEXT REFERENCES flights(id), time_utc TEXT NOT NULL,
        stage TEXT NOT NULL CHECK (stage IN ('before', 'after')),
        block TEXT NOT NULL, settings TEXT NOT NULL, passed INTEGER NOT NULL, note TEXT NOT NULL
    ) STRICT""",
    "ALTER TABLE flights ADD COLUMN simulated INTEGER NOT NULL DEFAULT 1",
    "ALTER TABLE flights ADD COLUMN procedure INTEGER REFERENCES procedures(id)",
    "ALTER TABLE flights ADD COLUMN registration_std_m REAL",
    """CREATE TABLE readings (
        id INTEGER PRIMARY KEY, flight TEXT NOT NULL REFERENCES flights(id),
        component INTEGER REFERENCES components(id),
        calibration INTEGER REFERENCES calibrations(id), time_utc TEXT NOT NULL,
        spot TEXT NOT NULL, quantity TEXT NOT NULL, value REAL, unit TEXT NOT NULL, u95 REAL,
        x_m REAL NOT NULL, y_m REAL NOT NULL, z_m REAL NOT NULL, place_u95_m REAL,
        accepted INTEGER NOT NULL, reason TEXT NOT NULL, data TEXT NOT NULL
    ) STRICT""",
    "CREATE INDEX readings_place ON readings (x_m, y_m)",
    "CREATE INDEX readings_flight ON readings (flight)",
    """CREATE TABLE contacts (
        reading INTEGER PRIMARY KEY REFERENCES readings(id), how TEXT NOT NULL,
        east_m REAL NOT NULL, north_m REAL NOT NULL, up_m REAL NOT NULL, duration_s REAL NOT NULL,
        force_des_n REAL NOT NULL, force_std_n REAL NOT NULL, pose_std_m REAL,
        wander_m REAL NOT NULL
    ) STRICT""",
    """CREATE TABLE indications (
        id INTEGER PRIMARY KEY, flight TEXT NOT NULL REFERENCES flights(id),
        component INTEGER REFERENCES components(id),
        calibration INTEGER REFERENCES calibrations(id), time_utc TEXT NOT NULL,
        kind TEXT NOT NULL, x_m REAL NOT NULL, y_m REAL NOT NULL, z_m REAL NOT NULL,
        place_u95_m REAL, length_mm REAL, depth_mm REAL, depth_u95_mm REAL, amplitude REAL,
        amplitude_unit TEXT NOT NULL, data TEXT NOT NULL
    ) STRICT""",
    """CREATE TABLE dispositions (
        id INTEGER PRIMARY KEY, indication INTEGER NOT NULL REFERENCES indications(id),
        time_utc TEXT NOT NULL, who TEXT NOT NULL, disposition TEXT NOT NULL, note TEXT NOT NULL
    ) STRICT""",
    # data of version 1: the force becomes a reading, the other columns a row of contacts
    "INSERT INTO assets (name) SELECT DISTINCT structure FROM flights",
    """INSERT INTO readings (id, flight, time_utc, spot, quantity, value, unit, u95, x_m, y_m, z_m,
        place_u95_m, accepted, reason, data)
        SELECT id, flight, time_utc, spot, 'force', force_n, 'N', NULL, x_m, y_m, off_m,
        2.0 * pose_std_m, 1, '', '' FROM measurements""",
    """INSERT INTO contacts SELECT id, how, east_m, north_m, up_m, duration_s, force_des_n,
        force_std_n, pose_std_m, wander_m FROM measurements""",
    "DROP TABLE measurements",
)
"""Assets, components, procedures, instruments, calibrations, readings and indications."""

TO_VERSION_3 = (
    """CREATE TABLE coverages (
        id INTEGER PRIMARY KEY, flight TEXT NOT NULL REFERENCES flights(id),
        component INTEGER REFERENCES components(id), unit TEXT NOT NULL, asked REAL NOT NULL,
        inspected REAL NOT NULL, missed TEXT NOT NULL
    ) STRICT""",
    "CREATE INDEX coverages_flight ON coverages (flight)",
)
"""Requested and inspected amount, and the parts that were missed."""

TO_VERSION_4 = (
    """CREATE TABLE datums (
        id INTEGER PRIMARY KEY, asset TEXT NOT NULL REFERENCES assets(name),
        flight TEXT REFERENCES flights(id), name TEXT NOT NULL,
        x_m REAL NOT NULL, y_m REAL NOT NULL, z_m REAL NOT NULL, u95_m REAL NOT NULL
    ) STRICT""",
    # a name occurs once for the asset, and once for each flight
    "CREATE UNIQUE INDEX datums_name ON datums (asset, coalesce(flight, ''), name)",
)
"""Datum points, which register flights in the frame of the asset."""

STEPS = (VERSION_1, TO_VERSION_2, TO_VERSION_3, TO_VERSION_4)
"""Migration steps: from an empty file to version 1, from version 1 to version 2, ..."""
VERSION = len(STEPS)
