"""Example files for `skywright locate`: a simulated flight as its sensors record it."""

from pathlib import Path

from skywright.analysis.locate.trajectory_file import format_table, format_tum
from skywright.core.streams import build_stream
from skywright.errors import InputError
from skywright.models.tracking_camera import CameraErrors
from skywright.vehicle.sensor_flight import (
    Flight,
    build_inspection_path,
    simulate_flight,
)

OUTAGE = (60.0, 72.0)
"""s; the station takes another second to find the prism again (the paper's outage is 13 s)."""
STATION_CLOCK = 41.3
"""s, station's clock at the start of the flight."""
STATION_FILE, CAMERA_FILE, TRUTH_FILE = "station.csv", "camera.txt", "truth.csv"


def build_demo_flight(seed: int = 1) -> Flight:
    """80 s under a bridge, with an outage of the station of 13 s and the camera at 50 Hz."""
    path = build_inspection_path(seed, duration=80.0, speed=0.85)
    return simulate_flight(
        path, seed, errors=CameraErrors(rate_hz=50.0), blocked=(OUTAGE,),
        station_clock=STATION_CLOCK,
    )  # fmt: skip


def write_demo(folder: Path, seed: int = 1) -> tuple[Path, Path, Path]:
    """Write station.csv (mm, own clock, with gross errors), camera.txt (TUM) and truth.csv.

    Return the three paths. Raises InputError if the folder cannot be written.
    """
    flight = build_demo_flight(seed)
    rng = build_stream(seed, "outlier")
    s, truth = flight.station, flight.truth
    p = s.p.copy()
    wrong = rng.choice(len(p), 6, replace=False)  # reflections on the steel
    p[wrong] += rng.uniform(0.3, 1.5, (6, 1)) * rng.standard_normal((6, 3))
    texts = (
        format_table(["t_s", "x_mm", "y_mm", "z_mm"], [s.t, *(1e3 * p.T)], [3, 2, 2, 2]),
        format_tum(flight.camera),
        format_table(
            ["t_s", "x_m", "y_m", "z_m"], [truth.t[::4], *flight.p_WP[::4].T], [3, 5, 5, 5]
        ),
    )
    paths = folder / STATION_FILE, folder / CAMERA_FILE, folder / TRUTH_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, text in zip(paths, texts, strict=True):
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return paths
