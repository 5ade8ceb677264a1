"""Fusion of station and camera over a whole recording, by either filter."""

import math
from typing import NamedTuple

import numpy as np

from skywright.analysis.locate.blind import scale_drift
from skywright.analysis.locate.paper_filter import run_paper_filter
from skywright.core.arrays import Array, Ints
from skywright.errors import InputError
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
    drop_repeats,
    find_gap_limit,
    interpolate_rotation,
)

MOST_JUMPS = 0.05
"""Share of the camera's samples that count as jumps above which the filter's noise is doubtful."""
SLOWEST = 1.0
"""Longest usual interval (s) of a tracking camera."""
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


def prepare_camera(camera: Trajectory, notes: list[str]) -> Trajectory:
    """Return the camera's measurements: its samples without repeated ones, with a note.

    Raises InputError if it measured fewer than two poses, or less often than once in SLOWEST.
    """
    usual = float(np.median(np.diff(camera.t)))
    if usual > SLOWEST:
        raise InputError(
            f"{camera.name}: the usual interval of the camera is {usual:.3g} s; at most "
            f"{SLOWEST:g} s is valid; if the times are not in s, name their column t_ms, t_us or "
            "t_ns"
        )
    new = drop_repeats(camera)
    lost = len(camera.t) - len(new.t)
    if len(new.t) < 2:
        raise InputError(
            f"{camera.name}: all {len(camera.t)} samples have the same position; the camera's file "
            "must hold at least two different ones"
        )
    if lost:
        notes.append(
            f"{camera.name}: {lost} of {len(camera.t)} samples repeat the previous one: dropped"
        )
    return new


def describe_jumps(fused: Fused) -> list[str]:
    """Return a note if the filter takes an implausible share of the camera's samples as jumps."""
    share = float(np.mean(~fused.accepted[fused.kind == CAMERA]))
    if share <= MOST_JUMPS:
        return []
    return [
        f"the filter takes {100.0 * share:.0f} % of the camera's samples as jumps: the camera does "
        "not follow its noise model, and the stated standard deviations are too small"
    ]


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
        rotation_0=min(max(2.0 * c.fitted_std, math.radians(1.0)), 0.5),
        scale_0=min(max(2.0 * c.scale_std, 0.01), 0.5),
    )  # fmt: skip


def fuse(
    station: Trajectory, camera: Trajectory, c: Calibration
) -> tuple[Events, Fused, DriftModel]:
    """Run the drift-aware filter over both recordings, with the drift scaled by the outages.

    The filter itself rejects a reflection only for a few samples, because it does not use later
    ones. The calibration does: the filter omits the samples that it left out.
    """
    events, model = collect_events(station, camera, c), build_model(camera, c)
    outages = find_outages(station, float(station.t[0]), float(events.t[-1]))
    used = (events.kind == CAMERA) | ~np.isin(events.t, c.left_out)
    model = scale_drift(events.t[used], events.kind[used], events.z[used], outages, model)
    fused = run_drift_filter(events.t, events.kind, events.z, model, used)
    unknown = compute_unknown_turn(events, fused, c.geometry.open_axes)
    return events, fused._replace(p_std=np.sqrt(fused.p_std**2 + unknown)), model


def compute_unknown_turn(events: Events, fused: Fused, axes: Array) -> Array:
    """Return the variance (n, 3) m^2 of the position by a rotation that the calibration leaves
    open.

    `axes` (k, 3): unit vectors in W about which the angle is unknown, none if k = 0. The camera
    measures the displacement d since the last accepted measurement of the station in an unknown
    direction. For an angle uniform over a full turn about one axis a, the error (R - 1) d has the
    mean square 3/2 along the part of d across a, and 1/2 across both. If the whole rotation is
    unknown, R d is uniform on a sphere. The filter cannot compute this: it is linear in the
    rotation.
    """
    if not len(axes):
        return np.zeros_like(events.z)
    camera = events.kind == CAMERA
    seen = np.stack(
        [np.interp(events.t, events.t[camera], events.z[camera, i]) for i in range(3)], axis=1
    )
    known = (events.kind == STATION) & fused.accepted
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), 0))
    d = seen - seen[last]
    if len(axes) > 1:
        return np.asarray(d**2 + np.sum(d**2, axis=1, keepdims=True) / 3.0)
    a = axes[0]
    d -= (d @ a)[:, None] * a
    return np.asarray(1.5 * d**2 + 0.5 * np.cross(a, d) ** 2)


def fuse_as_printed(events: Events) -> Array:
    """Return positions (n, 3) of the paper's filter from the same measurements."""
    return run_paper_filter(events.t, events.kind, events.z_paper, events.velocity)[0]


def find_outages(station: Trajectory, start: float, stop: float) -> list[tuple[float, float]]:
    """Return the times (s) within start to stop without station measurements for OUTAGE or
    longer."""
    t = np.concatenate([[start], station.t[(station.t > start) & (station.t < stop)], [stop]])
    long = np.flatnonzero(np.diff(t) >= max(OUTAGE, find_gap_limit(station.t)))
    return [(float(t[i]), float(t[i + 1])) for i in long]
