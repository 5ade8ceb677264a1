"""Simulated flights under a bridge, seen by a total station and a tracking camera.

A flight is a smooth path through way-points; the sensors are those of `sim/`. Truth, station and
camera are kept apart: the station in W on its own clock, the camera in its own frame.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from skywright.core.streams import build_stream
from skywright.core.user_code import njit
from skywright.models.localisation.trajectory import Trajectory
from skywright.models.total_station import (
    STATION_BLOCK,
    StationPrecision,
    build_total_station,
    draw_total_station,
    step_total_station,
)
from skywright.models.tracking_camera import (
    CAMERA_BLOCK,
    CameraErrors,
    build_tracking_camera,
    draw_tracking_camera,
    step_tracking_camera,
)

Array = NDArray[np.float64]

STEP = 0.005
"""s, of the simulation: the camera's period."""
CHUNK = 2000
"""Steps between refills of the noise (10 s)."""
STATION_AT = np.array([-18.0, -9.0, 1.6])
"""m, where the station stands, beside the river."""
PRISM = np.array([0.05, 0.0, 0.12])
"""m, prism on the robot."""


class Path(NamedTuple):
    """Truth: a rigid body at a fixed rate."""

    t: Array  # (n,) s
    p_WB: Array  # (n, 3) m
    R_WB: Array  # (n, 3, 3)


class Flight(NamedTuple):
    """A simulated flight as its files hold it, and the truth."""

    truth: Path
    station: Trajectory  # W, stamped on the station's clock
    camera: Trajectory  # C, on its own clock
    station_delay: float  # s: station's stamp - true time, in the mean
    R_CW: Array
    errors: CameraErrors
    prism: Array  # (3,) m, on the robot

    @property
    def p_WP(self) -> Array:
        """True positions (n, 3) m of the prism."""
        return np.asarray(self.truth.p_WB + self.truth.R_WB @ self.prism)


def build_path(points: Array, times: Array, yaw: Array) -> Path:
    """A path through way-points (k, 3) m at times (k,) s with headings (k,) rad, at rest at both
    ends. The body leans with the acceleration, as a multirotor does.
    """
    t = np.arange(0.0, times[-1] + 0.5 * STEP, STEP)
    line = CubicSpline(times, points, bc_type="clamped")
    heading = CubicSpline(times, yaw, bc_type="clamped")(t)
    acc = line(t, 2) + [0.0, 0.0, 9.81]
    z = acc / np.linalg.norm(acc, axis=1, keepdims=True)
    ahead = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(t)], axis=1)
    y = np.cross(z, ahead)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return Path(t, line(t), np.stack([np.cross(y, z), y, z], axis=2))


CALIBRATION_SPEED = 0.7  # m/s, mean, of the flight that tells the sensors' errors


def build_inspection_path(
    seed: int, duration: float = 100.0, speed: float = 0.5, flat_until: float = 0.0
) -> Path:
    """A flight as under a bridge: a random walk through a box of 6 x 5 x 3 m from (-1.5, -1, 1).

    `speed` (m/s) is the mean; `flat_until` (s) keeps to one height, within 5 cm, until then.
    """
    rng = build_stream(seed, "planner")
    every = 3.0  # s between way-points
    count = math.ceil(duration / every) + 1
    low, high = np.array([-3.0, -2.5, 0.5]), np.array([3.0, 2.5, 3.5])
    points = [np.array([-1.5, -1.0, 1.0])]
    while len(points) < count:
        step = rng.standard_normal(3) * [1.0, 1.0, 0.6]
        step *= speed * every / np.linalg.norm(step) * 0.9  # the spline is longer than its chords
        after = points[-1] + step
        if np.all((after >= low) & (after <= high)):
            points.append(after)
    line = np.array(points)
    times: Array = every * np.arange(count, dtype=np.float64)
    flat = times < flat_until
    line[flat, 2] = 1.0 + 0.03 * rng.standard_normal(int(flat.sum()))
    yaw: Array = np.cumsum(0.3 * rng.standard_normal(count))
    return build_path(line, times, yaw)


def simulate_flight(
    path: Path,
    seed: int,
    *,
    errors: CameraErrors | None = None,
    precision: StationPrecision | None = None,
    blocked: tuple[tuple[float, float], ...] = (),
    prism: Array = PRISM,
    station_at: Array = STATION_AT,
    arrival_stamps: bool = False,
    station_clock: float = 0.0,
    camera_clock: float = 0.0,
) -> Flight:
    """What the sensors record of a path; `blocked` (s) are times without line of sight.

    The clocks stand at `station_clock` and `camera_clock` (s) when the flight starts.
    `arrival_stamps`: the station's samples are not stamped by the instrument when it measures but
    by the receiver when they arrive, so each is late by another time.
    """
    errors = errors or CameraErrors()
    station_rng, camera_rng = build_stream(seed, "station"), build_stream(seed, "camera")
    tilt = math.radians(1.0) * camera_rng.standard_normal(2)
    R_CW = Rotation.from_euler(
        "zyx", [camera_rng.uniform(-math.pi, math.pi), *tilt]
    ).as_matrix()  # fmt: skip
    ts = build_total_station(station_at, prism, precision)
    cam = build_tracking_camera(R_CW, errors)
    seen = record_flight(
        path, ts, cam, station_rng, camera_rng, blocked=blocked, arrival_stamps=arrival_stamps,
        station_clock=station_clock, camera_clock=camera_clock,
    )  # fmt: skip
    return Flight(path, seen.station, seen.camera, seen.delay, R_CW, errors, np.asarray(prism))


class Seen(NamedTuple):
    """The recordings of station and camera."""

    station: Trajectory
    camera: Trajectory
    delay: float  # s: station's stamp - true time, in the mean


def record_flight(
    path: Path,
    station: NDArray[Any],
    camera: NDArray[Any],
    station_rng: np.random.Generator,
    camera_rng: np.random.Generator,
    *,
    blocked: tuple[tuple[float, float], ...] = (),
    arrival_stamps: bool = False,
    station_clock: float = 0.0,
    camera_clock: float = 0.0,
) -> Seen:
    """Fly a path past (1,) arrays of Station and Tracker; see `simulate_flight`."""
    ts, cam = station, camera
    n = len(path.t)
    visible = np.ones(n, dtype=np.bool_)
    for start, stop in blocked:
        visible &= (path.t < start) | (path.t >= stop)
    station_rows, camera_rows = np.full((n, 5), np.nan), np.full((n, 13), np.nan)
    for first in range(0, n, CHUNK):
        last = min(first + CHUNK, n)
        draw_total_station(ts[0], station_rng)
        draw_tracking_camera(cam[0], camera_rng)
        _record(ts, cam, path.t, path.p_WB, path.R_WB, visible, first, last, station_rows,
                camera_rows)  # fmt: skip
    assert ts[0]["index"] <= STATION_BLOCK and cam[0]["index"] <= CAMERA_BLOCK
    s = station_rows[np.isfinite(station_rows[:, 0])]
    c = camera_rows[np.isfinite(camera_rows[:, 0])]
    stamps = (s[:, 1] if arrival_stamps else s[:, 0]) + station_clock
    keep = np.concatenate([[True], np.diff(stamps) > 0])
    q = Rotation.from_matrix(c[:, 4:].reshape(-1, 3, 3)).as_quat()
    return Seen(
        Trajectory("station", stamps[keep], s[keep, 2:]),
        Trajectory("camera", c[:, 0] + camera_clock, c[:, 1:4], np.roll(q, 1, axis=1)),
        float(np.mean(stamps - s[:, 0])) if len(s) else 0.0,
    )


@njit(cache=True, error_model="numpy")
def _record(
    ts: Any, cam: Any, t: Array, p: Array, R: Array, visible: Array, first: int, last: int,
    station_rows: Array, camera_rows: Array,
) -> None:  # fmt: skip
    """Step both sensors along the path and record their new samples."""
    for k in range(first, last):
        step_total_station(ts[0], t[k], p[k], R[k], visible[k])
        step_tracking_camera(cam[0], t[k], p[k], R[k])
        if ts[0].fresh > 0.0:
            station_rows[k, 0], station_rows[k, 1] = ts[0].stamp, t[k]
            for i in range(3):
                station_rows[k, 2 + i] = ts[0].p_WP[i]
        if cam[0].fresh > 0.0:
            camera_rows[k, 0] = cam[0].stamp
            for i in range(3):
                camera_rows[k, 1 + i] = cam[0].p_CB[i]
                for j in range(3):
                    camera_rows[k, 4 + 3 * i + j] = cam[0].R_CB[i, j]
