"""Files to try `skywright locate` on: a simulated flight as its sensors would have recorded it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skywright.core.streams import build_stream
from skywright.errors import InputError
from skywright.studies.locate.flights import (
    CameraErrors,
    Flight,
    build_inspection_path,
    simulate_flight,
)

OUTAGE = (60.0, 72.0)
"""s; the station needs another second to find the prism again (the paper's outage is 13 s)."""
STATION_CLOCK = 41.3
"""s, on the station's clock when the flight starts."""
STATION_FILE, CAMERA_FILE, TRUTH_FILE = "station.csv", "camera.txt", "truth.csv"


def build_demo_flight(seed: int = 1) -> Flight:
    """80 s under a bridge, without the station for 13 s, the camera at 50 Hz."""
    path = build_inspection_path(seed, duration=80.0, speed=0.85)
    return simulate_flight(
        path, seed, errors=CameraErrors(rate_hz=50.0), blocked=(OUTAGE,),
        station_clock=STATION_CLOCK,
    )  # fmt: skip


def write_demo(folder: Path, seed: int = 1) -> tuple[Path, Path, Path]:
    """Write station.csv (mm, own clock, with gross errors), camera.txt (TUM) and truth.csv.

    Returns the three paths. Raises InputError where the folder cannot be written.
    """
    flight = build_demo_flight(seed)
    rng = build_stream(seed, "outlier")
    s, c, truth = flight.station, flight.camera, flight.truth
    p = s.p.copy()
    wrong = rng.choice(len(p), 6, replace=False)  # reflections on the steel
    p[wrong] += rng.uniform(0.3, 1.5, (6, 1)) * rng.standard_normal((6, 3))
    station = ["t_s,x_mm,y_mm,z_mm"]
    station += ["%.3f,%.2f,%.2f,%.2f" % (t, *(1e3 * x)) for t, x in zip(s.t, p, strict=True)]
    assert c.q is not None
    camera = ["# timestamp tx ty tz qx qy qz qw"]
    rows = np.column_stack([c.t, c.p, np.roll(c.q, -1, axis=1)])
    camera += ["%.4f %.5f %.5f %.5f %.6f %.6f %.6f %.6f" % tuple(r) for r in rows]
    prism = flight.p_WP
    true = ["t_s,x_m,y_m,z_m"]
    true += ["%.3f,%.5f,%.5f,%.5f" % (t, *x) for t, x in zip(truth.t[::4], prism[::4], strict=True)]
    paths = folder / STATION_FILE, folder / CAMERA_FILE, folder / TRUTH_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, lines in zip(paths, (station, camera, true), strict=True):
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return paths
