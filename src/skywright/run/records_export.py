"""Inspection records as CSV and as GeoJSON (RFC 7946), for spreadsheets and maps."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from skywright.errors import InputError
from skywright.run.records import Record

SEMI_MAJOR = 6378137.0  # m, WGS 84
FLATTENING = 1.0 / 298.257223563


class Origin(NamedTuple):
    """Origin of the world's frame W (east, north, up)."""

    longitude_deg: float
    latitude_deg: float
    height_m: float = 0.0


def parse_origin(text: str) -> Origin:
    """Return the origin of "LON,LAT" or "LON,LAT,HEIGHT"; raises InputError for anything else."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise InputError(f"--origin {text!r}: give LON,LAT or LON,LAT,HEIGHT in degrees and metres")
    origin = Origin(*numbers)
    if abs(origin.longitude_deg) > 180.0 or abs(origin.latitude_deg) > 85.0:
        raise InputError(
            f"--origin {text!r}: longitude first (-180 to 180 deg), then latitude (-85 to 85 deg)"
        )
    return origin


def locate_on_earth(origin: Origin, east: float, north: float, up: float) -> list[float]:
    """Return [longitude, latitude (deg), height (m)] of a position near the origin.

    Uses the ellipsoid's radii of curvature at the origin: accurate to a millimetre within 100 m.
    """
    lat = math.radians(origin.latitude_deg)
    e2 = FLATTENING * (2.0 - FLATTENING)
    w = math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    across, along = SEMI_MAJOR / w, SEMI_MAJOR * (1.0 - e2) / w**3
    return [
        origin.longitude_deg + math.degrees(east / (across * math.cos(lat))),
        origin.latitude_deg + math.degrees(north / along),
        origin.height_m + up,
    ]


def build_geojson(records: Sequence[Record], origin: Origin) -> dict[str, Any]:
    """Return a FeatureCollection with one point per measurement."""
    features = []
    for r in records:
        place = locate_on_earth(origin, r.east_m, r.north_m, r.up_m)
        geometry = {"type": "Point", "coordinates": [*(round(x, 10) for x in place[:2]), place[2]]}
        features.append(
            {"type": "Feature", "id": r.id, "geometry": geometry, "properties": r._asdict()}
        )
    return {"type": "FeatureCollection", "features": features}


def write_geojson(records: Sequence[Record], origin: Origin, path: Path) -> None:
    """Write `build_geojson` to a file."""
    path.write_text(json.dumps(build_geojson(records, origin), indent=1) + "\n", encoding="utf-8")


def write_csv(records: Sequence[Record], path: Path) -> None:
    """Write a header and one line per record; names include the units."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Record._fields)
        writer.writerows(records)
