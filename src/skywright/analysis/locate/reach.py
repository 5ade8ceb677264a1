"""Accuracy of localisation on simulated flights: nominal, after outage and climb, repeated flights.

Every measure covers many seeds: another flight, camera and noise each. Errors are three-dimensional
errors of the prism against the truth, without alignment.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from skywright.analysis.locate.drift_floor import compute_drift_floor
from skywright.analysis.locate.fusion import Events, fuse, fuse_as_printed
from skywright.analysis.locate.station_frame import StationPose, estimate_station_pose
from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.models.localisation.calibration import Calibration, calibrate
from skywright.models.localisation.drift_filter import CAMERA, Fused
from skywright.models.localisation.time_alignment import estimate_offset
from skywright.models.tracking_camera import CameraErrors
from skywright.vehicle.sensor_flight import (
    Flight,
    build_inspection_path,
    build_path,
    simulate_flight,
)

CALIBRATION = 40.0
"""Time (s) at the start of a flight for the alignment of camera and station."""
OUTAGE = (60.0, 72.0)
"""s, blocked view; 13 s with the second to lock on again and the wait for a sample."""
OUTAGE_SPEED = 0.85
"""m/s: 11 m in 13 s, as in the paper's figure 12."""
INSPECTION_SPEED = 0.5
"""m/s, speed of the nominal flight."""
CLIMB = 3.0
"""m"""
STATION_CLOCK = 0.1
"""s by which the station's clock is ahead; unknown to the estimators."""


class Estimates(NamedTuple):
    """Estimates of a flight, processed like a user's recording, and the truth."""

    flight: Flight
    calibration: Calibration
    events: Events
    fused: Fused
    paper: Array  # (n, 3) m, the paper's filter
    t: Array  # (n,) s, true time of the events
    truth: Array  # (n, 3) m, of the prism

    def error(self, p: Array) -> Array:
        """Return the distances (n,) m from the truth."""
        return np.asarray(np.linalg.norm(p - self.truth, axis=1))


def process(flight: Flight, method: str = "similarity", calibrated: float = CALIBRATION
            ) -> Estimates:  # fmt: skip
    """Align on the first seconds of a flight, then filter the whole flight."""
    station, camera = flight.station, flight.camera
    first = float(station.t[0])
    found = estimate_offset(station.cut(first, first + calibrated), camera)
    c = calibrate(station, camera, found.offset, method=method, span=(first, first + calibrated))
    events, fused, _ = fuse(station, camera, c)
    t = events.t - flight.station_delay
    p = flight.p_WP
    truth = np.stack([np.interp(t, flight.truth.t, p[:, i]) for i in range(3)], axis=1)
    return Estimates(flight, c, events, fused, fuse_as_printed(events), t, truth)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


class Nominal(NamedTuple):
    """Rms errors (m) over all seeds with both sensors."""

    fused: float
    predicted: float  # standard deviation stated by the filter
    paper: float
    aligned: float  # the camera alone, aligned


@lru_cache(maxsize=8)
def measure_nominal(
    seeds: int = 20, speed: float = INSPECTION_SPEED, arrival_stamps: bool = False
) -> Nominal:
    """Return the errors after the calibration; `arrival_stamps`: stamped on arrival, with
    jitter."""
    rows = []
    for seed in range(1, seeds + 1):
        path = build_inspection_path(seed, duration=90.0, speed=speed)
        e = process(
            simulate_flight(
                path, seed, arrival_stamps=arrival_stamps,
                station_clock=0.0 if arrival_stamps else STATION_CLOCK,
            )
        )  # fmt: skip
        use = (e.t > CALIBRATION + 2.0) & (e.events.kind == CAMERA)
        rows.append([
            _rms(e.error(e.fused.p)[use]), _rms(np.linalg.norm(e.fused.p_std[use], axis=1)),
            _rms(e.error(e.paper)[use]), _rms(e.error(e.events.z)[use]),
        ])  # fmt: skip
    return Nominal(*[_rms(column) for column in np.array(rows).T][:4])


class Outage(NamedTuple):
    """Errors (m) of each seed (k,) at the end of 13 s without the station, and the recovery."""

    fused: Array
    predicted: Array
    paper: Array
    aligned: Array  # the camera, aligned by the paper's twelve numbers
    floor: Array  # lower bound from the drift model
    lasted: Array  # s
    path: Array  # m, flown during the outage
    since: Array  # (m,) s since the end of the outage
    recovery: Array  # (m,) m, rms over the seeds of the fused estimate
    recovery_paper: Array

    @property
    def ratio(self) -> float:
        """Rms error over that of the lower bound."""
        return _rms(self.fused) / _rms(self.floor)

    def recovery_time(self, limit: float) -> float:
        """Return the time (s) from which the rms error stays below `limit` (m); inf if it does
        not."""
        above = np.flatnonzero(self.recovery > limit)
        if not len(above):
            return 0.0
        return float(self.since[above[-1] + 1]) if above[-1] + 1 < len(self.since) else math.inf


@lru_cache(maxsize=8)
def measure_outage(seeds: int = 50, errors: CameraErrors | None = None) -> Outage:
    """Fly 11 m in 13 s without the station, after 60 s with it."""
    errors = errors or CameraErrors()
    rows, after, after_paper = [], [], []
    since = np.arange(0.0, 6.0, 0.05)
    for seed in range(1, seeds + 1):
        e = process(fly_outage(seed, errors))
        start, back = find_outage(e)
        k = int(np.searchsorted(e.t, back - 0.5 / errors.rate_hz)) - 1
        path = e.flight.truth
        inside = (path.t >= start) & (path.t <= e.t[k])
        p = e.flight.p_WP[inside]
        least = compute_drift_floor(
            path.t[inside], p, walk_per_sqrt_s=errors.walk_m_per_sqrt_s,
            walk_per_sqrt_m=errors.walk_m_per_sqrt_m,
            yaw_walk=math.radians(errors.yaw_walk_deg_per_sqrt_s),
            scale_walk=errors.scale_walk_per_sqrt_s,
        )  # fmt: skip
        off, off_paper = e.error(e.fused.p), e.error(e.paper)
        flown = float(np.sum(np.linalg.norm(np.diff(p, axis=0), axis=1)))
        rows.append([
            off[k], float(np.linalg.norm(e.fused.p_std[k])), off_paper[k],
            e.error(e.events.z_paper)[k], least, e.t[k] - start, flown,
        ])  # fmt: skip
        after.append(np.interp(back + since, e.t, off))
        after_paper.append(np.interp(back + since, e.t, off_paper))
    fused, said, paper, aligned, floor, lasted, length = np.array(rows).T
    recovery, recovery_paper = (
        np.sqrt(np.mean(np.square(sizes), axis=0)) for sizes in (after, after_paper)
    )
    return Outage(
        fused, said, paper, aligned, floor, lasted, length, since, recovery, recovery_paper
    )


def fly_outage(seed: int, errors: CameraErrors | None = None) -> Flight:
    """Simulate a flight of 80 s; the view of the station is blocked during OUTAGE."""
    path = build_inspection_path(seed, duration=80.0, speed=OUTAGE_SPEED)
    return simulate_flight(
        path, seed, errors=errors, blocked=(OUTAGE,), station_clock=STATION_CLOCK
    )


def find_outage(e: Estimates) -> tuple[float, float]:
    """Return true times (s) of the station's last measurement before and first after the outage."""
    t = e.flight.station.t - e.flight.station_delay
    return float(t[t < OUTAGE[0] + 0.5].max()), float(t[t > OUTAGE[0] + 0.5].min())


class Climb(NamedTuple):
    """Errors (m) of each seed (k,) at the top of a climb without the station."""

    fused: Array
    paper: Array
    affine: Array  # the camera, aligned by twelve numbers
    similarity: Array  # the camera, aligned by seven
    flatness: Array  # (k,) smallest over largest extent of the calibration


@lru_cache(maxsize=4)
def measure_climb(seeds: int = 30) -> Climb:
    """Calibrate in a plane (within 3 cm, 1 sigma), then climb 3 m without the station."""
    rows = []
    for seed in range(1, seeds + 1):
        e = process(fly_climb(seed), calibrated=CALIBRATION + 2.0)
        extent = e.calibration.geometry.extent
        rows.append([
            e.error(e.fused.p)[-1], e.error(e.paper)[-1], e.error(e.events.z_paper)[-1],
            e.error(e.events.z)[-1], extent[2] / extent[0],
        ])  # fmt: skip
    return Climb(*list(np.array(rows).T)[:5])


def fly_climb(seed: int) -> Flight:
    """Simulate 42 s in a plane, then a climb by CLIMB in 7.5 s without the station."""
    rng = build_stream(seed, "wind_start")
    flat = build_inspection_path(seed, duration=42.0, speed=INSPECTION_SPEED, flat_until=1e9)
    every = 600  # way-points 3 s apart
    points, times = list(flat.p_WB[::every]), list(flat.t[::every])
    for _ in range(3):
        points.append(points[-1] + [*(0.02 * rng.standard_normal(2)), CLIMB / 3.0])
        times.append(times[-1] + 2.5)
    yaw: Array = np.cumsum(0.3 * rng.standard_normal(len(times)))
    path = build_path(np.array(points), np.array(times), yaw)
    return simulate_flight(path, seed, blocked=((42.0, 1e9),), station_clock=STATION_CLOCK)


TERRAIN = np.array([
    [14.0, 9.0, 0.3], [-12.0, 14.0, 0.8], [-9.0, -16.0, 0.1], [17.0, -11.0, 1.2],
    [2.0, 21.0, 0.5], [24.0, 3.0, 0.9],
])  # fmt: skip
"""m, terrain points around the bridge, in the time-consistent frame."""
INSPECTED = np.array([1.2, -0.6, 3.2])
"""m, position of the prism during the inspection of the point."""
KNOWN_STD = 1e-3
"""m, standard deviation of the terrain points' coordinates from the first campaign."""
CENTRING_STD = 1.5e-3
"""m, standard deviation of the set-up of a prism on a point."""
MOVED = 0.05
"""m by which one terrain point moves before every third flight."""


class Revisit(NamedTuple):
    """Errors (k, 3) m of the inspected point in the time-consistent frame, one row per flight."""

    errors: Array
    untested: Array  # the same without the test of the terrain points
    predicted: Array  # (k,) m, of the station's pose at that point
    found: int  # number of moved points that the test detected
    moved: int
    false_alarms: int
    stations: Array  # (k, 3) m, positions of the station
    poses: tuple[StationPose, ...]

    @property
    def rms(self) -> float:
        """Rms error in m, three-dimensional."""
        return _rms(np.linalg.norm(self.errors, axis=1))


@lru_cache(maxsize=2)
def measure_revisit(flights: int = 10) -> Revisit:
    """Inspect one point in several flights, with the station set up elsewhere each time."""
    known = TERRAIN + KNOWN_STD * build_stream(0, "plant").standard_normal(TERRAIN.shape)
    names = [f"P{i + 1}" for i in range(len(known))]
    errors, untested, predicted, stations, poses = [], [], [], [], []
    found = moved = alarms = 0
    for seed in range(1, flights + 1):
        rng = build_stream(seed, "plant")
        angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(15.0, 30.0)
        p_WS = np.array([away * math.cos(angle), away * math.sin(angle), rng.uniform(1.4, 2.0)])
        R_WS = Rotation.from_euler("z", rng.uniform(-math.pi, math.pi)).as_matrix()
        ground = TERRAIN.copy()
        if seed % 3 == 0:
            ground[seed % len(ground)] += MOVED * np.array([0.6, -0.7, -0.4])
            moved += 1
        measured = _sight(ground, p_WS, rng) @ R_WS
        pose = estimate_station_pose(names, known, measured)
        out = [p.name for p in pose.points if not p.used]
        wrong = names[seed % len(names)] if seed % 3 == 0 else ""
        found += wrong in out
        alarms += sum(name != wrong for name in out)
        believed = estimate_station_pose(names, known, measured, significance=1e-300)
        place_S = _inspect(seed, p_WS, R_WS)
        errors.append(pose.apply(place_S[None])[0] - INSPECTED)
        untested.append(believed.apply(place_S[None])[0] - INSPECTED)
        predicted.append(pose.predict_std(INSPECTED))
        stations.append(p_WS)
        poses.append(pose)
    return Revisit(
        np.array(errors), np.array(untested), np.array(predicted), found, moved, alarms,
        np.array(stations), tuple(poses),
    )  # fmt: skip


def _sight(points: Array, p_WS: Array, rng: np.random.Generator) -> Array:
    """Return points (n, 3) as measured by a station at p_WS: relative to it, along the axes of
    W."""
    sight = points - p_WS
    distance = np.linalg.norm(sight, axis=1, keepdims=True)
    along = (1e-3 + 1.5e-6 * distance) * rng.standard_normal((len(points), 1)) * sight / distance
    across = 4.85e-6 * distance * rng.standard_normal(sight.shape)
    return np.asarray(sight + along + across + CENTRING_STD * rng.standard_normal(sight.shape))


def _inspect(seed: int, p_WS: Array, R_WS: Array) -> Array:
    """Fly to the point, stay 6 s; return the mean estimate (3,) m there, in the station's frame.

    The deviation of the prism from INSPECTED is subtracted, so that only the estimation error
    counts.
    """
    start = build_inspection_path(seed, duration=48.0, speed=INSPECTION_SPEED)
    every = 600
    points = [*start.p_WB[::every], INSPECTED, INSPECTED, INSPECTED, INSPECTED]
    times: Array = 3.0 * np.arange(len(points), dtype=np.float64)
    times[-4:] += 5.0  # the point may be far away
    path = build_path(np.array(points), times, np.linspace(0.0, 2.0, len(points)))
    flight = simulate_flight(path, seed, station_at=p_WS, station_clock=STATION_CLOCK)
    station = flight.station._replace(p=(flight.station.p - p_WS) @ R_WS)
    e = process(flight._replace(station=station))
    stay = (e.t > times[-3]) & (e.t < times[-2]) & (e.events.kind == CAMERA)
    seen = e.fused.p[stay].mean(axis=0)
    was = e.truth[stay].mean(axis=0)  # W
    return np.asarray(seen + R_WS.T @ (INSPECTED - was))
