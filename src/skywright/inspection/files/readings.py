"""Write readings: CSV, Parquet (an extra), and JSON in the local frame of the asset.

A written table has one row per reading and states whether it is SIMULATED.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skywright.errors import InputError
from skywright.inspection.history.entries import StoredIndication, StoredReading


def flatten_reading(r: StoredReading) -> dict[str, Any]:
    """Return a reading as one row of plain values."""
    return {
        "id": r.id, "asset": r.asset, "component": r.component, "flight": r.flight,
        "time_utc": r.time_utc, "origin": "SIMULATED" if r.simulated else "measured",
        **r.reading._asdict(), "registration_std_m": r.registration_std_m,
    }  # fmt: skip


def write_readings_csv(readings: Sequence[StoredReading], path: Path) -> None:
    """Write a header and one line per reading; a cell without a value is empty."""
    rows = [flatten_reading(r) for r in readings]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0] if rows else ())
        writer.writerows(row.values() for row in rows)


def write_readings_parquet(readings: Sequence[StoredReading], path: Path) -> None:
    """Write the same table as Parquet. Raises InputError if pyarrow is missing."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "--parquet needs pyarrow: pip install 'skywright[parquet]'; --csv holds the same table"
        ) from None
    rows = [flatten_reading(r) for r in readings]
    kinds = {"id": pyarrow.int64(), "accepted": pyarrow.bool_()}
    numbers = ("value", "u95", "x_m", "y_m", "z_m", "place_u95_m", "registration_std_m")
    names = list(rows[0]) if rows else []
    columns = {
        name: pyarrow.array(
            [row[name] for row in rows],
            kinds.get(name, pyarrow.float64() if name in numbers else pyarrow.string()),
        )
        for name in names
    }
    pyarrow.parquet.write_table(pyarrow.table(columns), path)


def build_local_json(
    readings: Sequence[StoredReading], indications: Sequence[StoredIndication], frame: str
) -> dict[str, Any]:
    """Return readings and indications as points in the frame of the asset.

    This is not GeoJSON, which supports longitude and latitude only (RFC 7946).
    """
    points = [
        {"kind": "reading", "point_m": [r.reading.x_m, r.reading.y_m, r.reading.z_m],
         **flatten_reading(r)}
        for r in readings
    ] + [
        {"kind": "indication", "point_m": [i.indication.x_m, i.indication.y_m, i.indication.z_m],
         "id": i.id, "asset": i.asset, "component": i.component, "flight": i.flight,
         "time_utc": i.time_utc, "origin": "SIMULATED" if i.simulated else "measured",
         "disposition": i.disposition, "indication": i.indication._asdict()}
        for i in indications
    ]  # fmt: skip
    simulated = any(p["origin"] == "SIMULATED" for p in points)
    return {
        "format": "skywright-local-points", "version": 1, "units": "m",
        "frame": frame or "frame of the asset", "note": "SIMULATED" if simulated else "",
        "points": points,
    }  # fmt: skip


def write_local_json(data: dict[str, Any], path: Path) -> None:
    """Write the result of `build_local_json` to a file."""
    path.write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
