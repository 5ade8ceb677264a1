"""Fusion of station and camera over a whole recording, by either filter."""

import math
from typing import NamedTuple

import numpy as np

from skywright.analysis.locate.blind import scale_drift
from skywright.analysis.locate.paper_filter import run_paper_filter
from skywright.core.arrays import Array, Ints
from skywright.models.localisation.calibration import Calibration
from skywright.models.localisation.drift_filter import (
    CAMERA,
    STATION,
    DriftModel,
    Fused,
    run_drift_filter,
)
from skywright.models.localisation.trajectory import (
    Trajectory,
    compute_velocity,
    find_gap_limit,
    interpolate_rotation,
)

OUTAGE = 1.0
"""Minimum duration (s) without the station that counts as an outage."""


class Events(NamedTuple):
    """Measurements of both sensors in order of time (station's clock): positions of the prism in W.

    The filters estimate the prism, because the station measures it even if its position on the
    robot is unknown. `lever` converts to the camera.
    """

    t: Array  # (n,) s
    kind: Ints
    z: Array  # (n, 3) m, the camera's by the drift-aware alignment
    z_paper: Array  # (n, 3) m, the same, the camera's by the paper's twelve numbers
    velocity: Array  # (n, 3) m/s by the paper's twelve numbers, NaN for the station
    lever: Array  # (n, 3) m, from the camera to the prism


def collect_events(station: Trajectory, camera: Trajectory, c: Calibration) -> Events:
    """Convert both sensors to the station's clock and to W, in order of time."""
    t_cam = c.to_station_time(camera.t)
    t = np.concatenate([t_cam, station.t])
    kind = np.concatenate([np.full(len(t_cam), CAMERA), np.full(len(station.t), STATION)])
    lever = np.zeros((len(t), 3))
    turn = interpolate_rotation(camera, c.to_camera_time(t))
    if turn is not None and np.any(c.p_BP != 0.0):
        lever = (turn @ c.p_BP) @ c.frame.rotation.T
    p_cam = c.frame.apply(camera.p) + lever[: len(t_cam)]
    p_paper = c.paper.apply(camera.p)
    gap = find_gap_limit(camera.t, 0.05)
    at, v = compute_velocity(camera, max(0.02, 1.0 / camera.rate), gap)
    v = np.stack([np.interp(camera.t, at, v[:, i]) for i in range(3)], axis=1) @ c.paper.matrix.T
    order = np.argsort(t, kind="stable")
    return Events(
        t[order], kind[order], np.concatenate([p_cam, station.p])[order],
        np.concatenate([p_paper, station.p])[order],
        np.concatenate([v, np.full((len(station.t), 3), np.nan)])[order], lever[order],
    )  # fmt: skip


def build_model(camera: Trajectory, c: Calibration) -> DriftModel:
    """Return the noise of the filter from the data: the calibration, and the camera's roughness."""
    rough = float("inf")
    if len(camera.t) > 8:
        third = np.diff(camera.p, n=3, axis=0)  # for white noise: 20 times its variance
        rough = float(np.median(np.abs(third))) / 0.6745 / math.sqrt(20.0) * c.frame.scale
    gap = find_gap_limit(camera.t, 0.05)
    at, v = compute_velocity(camera, max(0.1, 2.0 / camera.rate), gap)
    change = 1.0
    if len(at) > 10:
        lag = np.searchsorted(at, at + 0.5)
        first = np.flatnonzero(lag < len(at))
        dv = (v[lag[first]] - v[first]) * c.frame.scale
        change = math.sqrt(float(np.mean(np.minimum(dv**2, 25.0))) / 0.5)
    return DriftModel(
        station=c.noise.station, camera=min(max(rough, 1e-4), 0.02),
        walk_per_sqrt_s=max(c.noise.per_sqrt_s, 1e-4), walk_per_sqrt_m=c.noise.per_sqrt_m,
        acceleration=min(max(change, 0.1), 5.0),
        rotation_0=min(max(2.0 * c.rotation_std, math.radians(1.0)), 0.5),
        scale_0=min(max(2.0 * c.scale_std, 0.01), 0.5),
    )  # fmt: skip


def fuse(
    station: Trajectory, camera: Trajectory, c: Calibration
) -> tuple[Events, Fused, DriftModel]:
    """Run the drift-aware filter over both recordings, with the drift scaled by the outages."""
    events, model = collect_events(station, camera, c), build_model(camera, c)
    outages = find_outages(station, float(station.t[0]), float(events.t[-1]))
    model = scale_drift(events.t, events.kind, events.z, outages, model)
    return events, run_drift_filter(events.t, events.kind, events.z, model), model


def fuse_as_printed(events: Events) -> Array:
    """Return positions (n, 3) of the paper's filter from the same measurements."""
    return run_paper_filter(events.t, events.kind, events.z_paper, events.velocity)[0]


def find_outages(station: Trajectory, start: float, stop: float) -> list[tuple[float, float]]:
    """Return the times (s) within start to stop without station measurements for OUTAGE or
    longer."""
    t = np.concatenate([[start], station.t[(station.t > start) & (station.t < stop)], [stop]])
    long = np.flatnonzero(np.diff(t) >= max(OUTAGE, find_gap_limit(station.t)))
    return [(float(t[i]), float(t[i + 1])) for i in long]
