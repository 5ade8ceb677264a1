"""Calibration of camera against station: clocks, frame, prism and noise from a common flight
segment.

Gauss-Newton estimates the rotation, scale and offset of the frame, the offset and skew of the
clocks, and (if the camera provides orientations) the position of the prism on the robot, all at
once. The residual is whitened with the camera's drift model (`drift_noise`), so that drift does not
degrade a long calibration and the covariance is consistent.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.localisation.drift_noise import (
    GATE,
    DriftNoise,
    compute_walk,
    compute_weight,
    estimate_noise,
    find_outliers,
    whiten,
)
from skywright.models.localisation.frame_alignment import (
    UNKNOWN_ROTATION,
    FrameAlignment,
    Geometry,
    diagnose_geometry,
    estimate_affine,
    estimate_frame,
)
from skywright.models.localisation.trajectory import (
    Trajectory,
    find_gap_limit,
    interpolate_position,
    interpolate_rotation,
)

LEAST_PAIRS = 12
LARGE_RMS = 0.2
"""Residual over the extent of the motion above which a note is given; chosen, not measured."""
LEVER_STD = 0.3
"""m, one sigma of the prior of the distance between prism and camera."""
SKEW_TIME = 60.0
"""s, least duration of a calibration that estimates the skew of the clocks."""
SKEW_STD = 1e-4
"""One sigma of the prior of the skew: crystals differ by less."""
OFFSET_STD = 0.5
"""s, one sigma of the prior of the offset, after the comparison of speeds."""
SMOOTH = 0.15
"""s, on each side, of the window that averages the camera's velocity. In a shorter window the
camera's random walk counts as motion, and the clock offset seems better known than it is."""
MIN_TURN = 0.2
"""rad, least spread of the camera's rotations for an estimate of the prism's position."""


class Calibration(NamedTuple):
    """Result of the calibration; standard deviations are those of the drift-aware fit."""

    frame: FrameAlignment
    time_offset: float  # s; camera's clock = station's clock + offset + skew (station's - epoch)
    skew: float
    epoch: float  # s, on the station's clock
    p_BP: Array  # (3,) m, prism in the camera's body frame
    noise: DriftNoise
    geometry: Geometry
    rotation_std: float  # rad, largest over the axes
    fitted_std: float  # rad, the same without the axes that the geometry does not determine
    scale_std: float
    offset_std: float  # s, of the clocks
    rms: float  # m, residual of the frame alignment alone, without outliers
    pairs: int
    outliers: int
    left_out: Array  # (m,) s, station's clock: its samples that contradict those around them
    span: tuple[float, float]  # s, station's clock
    paper: FrameAlignment  # the twelve numbers on the same pairs
    notes: tuple[str, ...]

    def to_camera_time(self, t: Array) -> Array:
        """Convert times of the station's clock to the camera's."""
        return np.asarray(t + self.time_offset + self.skew * (t - self.epoch))

    def to_station_time(self, t: Array) -> Array:
        """Convert times of the camera's clock to the station's."""
        return np.asarray(self.epoch + (t - self.time_offset - self.epoch) / (1.0 + self.skew))


class _Unknowns(NamedTuple):
    R: Array  # R_WC
    log_scale: float
    offset: Array  # of the middle of the camera's points
    delay: float
    skew: float
    lever: Array


def calibrate(
    station: Trajectory,
    camera: Trajectory,
    time_offset: float,
    *,
    method: str = "similarity",
    fixed_time: bool = False,
    p_BP: Array | None = None,
    span: tuple[float, float] | None = None,
    station_noise: float | None = None,
) -> Calibration:
    """Align `camera` to `station`, starting from a `time_offset` (s) with an error of at most about
    0.2 s.

    `span` (s, station's clock) limits the used data. `p_BP` (3,) m fixes the prism's position; by
    default it is estimated if the camera provides orientations with sufficient rotation.
    `fixed_time` keeps the offset; `station_noise` (m) is the value of the station's data sheet
    (`estimate_noise`). Raises InputError if the common data are insufficient.
    """
    used = station if span is None else station.cut(*span)
    epoch = float(station.t[0])
    gap = find_gap_limit(camera.t, 0.05)
    # only within the camera's recording, with a margin for changes of the offset
    at = used.t + time_offset
    keep = np.isfinite(interpolate_position(camera, at, gap)[:, 0])
    used = used._replace(t=used.t[keep], p=used.p[keep])
    if len(used.t) < LEAST_PAIRS:
        where = "" if span is None else f" from {span[0]:g} to {span[1]:g} s"
        raise InputError(
            f"{station.name} and {camera.name}: {len(used.t)} samples of the station{where} "
            f"have a matching camera sample; a calibration requires at least {LEAST_PAIRS}"
        )
    notes: list[str] = []
    x = interpolate_position(camera, used.t + time_offset, gap)
    first = _align_robustly("similarity" if method == "affine" else method, x, used.p)
    lever_free = p_BP is None and camera.q is not None and _turns(camera)
    dt = np.concatenate([[0.0], np.diff(used.t)])
    free = {"rotation": 2 if method == "level" else 3, "scale": method != "rigid"}
    free |= {"time": not fixed_time, "skew": not fixed_time and used.duration >= SKEW_TIME}
    free |= {"lever": lever_free}
    state = _Unknowns(
        first.rotation, math.log(first.scale) if free["scale"] else 0.0,
        first.apply(x.mean(axis=0)[None])[0], time_offset, 0.0,
        np.zeros(3) if p_BP is None else np.asarray(p_BP, dtype=np.float64),
    )  # fmt: skip
    middle = x.mean(axis=0)
    noise = DriftNoise(0.005, 0.02, 0.0)
    outlier, change = np.zeros(len(used.t)), np.zeros(len(used.t))
    covariance = np.eye(1)
    names: list[str] = []
    for turn in range(12):
        r, J, names, path = _linearise(state, used, camera, middle, epoch, gap, free)
        known = np.isfinite(r[:, 0])
        if turn in (0, 2, 4, 8):
            noise = estimate_noise(r[known], dt[known], path[known], station_noise)
            walk = compute_walk(noise, dt, path)
            outlier, change = np.ones(len(r)), np.zeros(len(r))
            outlier[known], change[known] = find_outliers(
                r[known], noise.station, walk[known], GATE
            )
        outlier[~known] = 1.0
        walk = compute_walk(noise, dt, path) + change
        step, covariance = _solve(r, J, noise, walk, outlier, names, state)
        state = _apply(state, step, names)
        if np.max(np.abs(step)) < 1e-7 and turn > 8:
            break
    std = dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=True))
    scale = math.exp(state.log_scale)
    matrix = scale * state.R
    frame = FrameAlignment(
        "similarity" if method == "affine" else method,  # type: ignore[arg-type]
        matrix, state.offset - matrix @ middle,
    )  # fmt: skip
    r, _, _, _ = _linearise(state, used, camera, middle, epoch, gap, free)
    x, y = _pair_points(state, used, camera, epoch, gap)
    good = (outlier == 0.0) & np.isfinite(x[:, 0])  # the last step may move a sample past the end
    paper = estimate_affine(x[good], used.p[good])  # this method has no prism offset
    if method == "affine":
        frame = estimate_affine(x[good], y[good])
        r = frame.apply(x) - y
    centred = r[good] if method == "affine" else r[good] - r[good].mean(axis=0)
    geometry = diagnose_geometry(y[good], noise.station, method)
    rms = float(np.sqrt(np.mean(np.sum(centred**2, axis=1))))
    notes += _check_agreement(camera.name, x[good], y[good], geometry, rms)
    notes += [geometry.note] if geometry.note else []
    fitted_std = max((v for k, v in std.items() if k.startswith("turn")), default=0.0)
    # noise across a line makes the fit look certain
    rotation_std = UNKNOWN_ROTATION if len(geometry.open_axes) else fitted_std
    notes += _doubt(std, used, geometry, rotation_std, free)
    return Calibration(
        frame, state.delay, state.skew, epoch, state.lever, noise, geometry, float(rotation_std),
        float(fitted_std), float(std.get("scale", 0.0)), float(std.get("delay", 0.0)),
        rms, int(good.sum()), int(np.count_nonzero(~good)), used.t[known & (outlier > 0.0)],
        (float(used.t[0]), float(used.t[-1])), paper, tuple(notes),
    )  # fmt: skip


def _check_agreement(name: str, x: Array, y: Array, geometry: Geometry, rms: float) -> list[str]:
    """Return a note if points x of the camera and y of the station (n, 3) m hardly agree.

    `rms` (m) is the residual of their alignment. Raises InputError if x is a mirror image of y.
    """
    extent = float(np.linalg.norm(geometry.extent))
    if geometry.kind == "point" or rms < LARGE_RMS * extent:
        return []
    affine = estimate_affine(x, y)
    off = float(np.sqrt(np.mean(np.sum((y - affine.apply(x)) ** 2, axis=1))))
    if geometry.kind == "full" and np.linalg.det(affine.matrix) < 0.0 and off < 0.5 * rms:
        raise InputError(
            f"{name}: the camera's frame is left-handed: its positions are a mirror image of the "
            "station's; valid: a right-handed frame; change the sign of one axis"
        )
    return [
        f"the aligned recordings differ by {rms:.2f} m rms, and the motion extends over "
        f"{extent:.2f} m: check units, axes and the order of the quaternion in {name}"
    ]


def _align_robustly(method: str, x: Array, y: Array) -> FrameAlignment:
    """Align, exclude outliers and align again until the result does not change."""
    keep = np.ones(len(x), dtype=bool)
    frame = estimate_frame(method, x, y)
    for _ in range(10):
        off = np.linalg.norm(y - frame.apply(x), axis=1)
        limit = max(4.0 * float(np.median(off[keep])), 0.01)
        now = off <= limit
        if now.sum() < LEAST_PAIRS or bool(np.all(now == keep)):
            break
        keep = now
        frame = estimate_frame(method, x[keep], y[keep])
    return frame


def _turns(camera: Trajectory) -> bool:
    """Whether the camera rotates enough to determine the position of the prism on the robot."""
    assert camera.q is not None
    q = camera.q[:: max(1, len(camera.q) // 500)]
    turned = Rotation.from_quat(np.roll(q, -1, axis=1))
    mean = turned.mean()
    return bool(np.quantile((mean.inv() * turned).magnitude(), 0.9) > MIN_TURN)


def _pair_points(
    s: _Unknowns, used: Trajectory, camera: Trajectory, epoch: float, gap: float
) -> tuple[Array, Array]:
    """Return camera positions (n, 3) in C, and in W from the station with the prism's offset
    removed."""
    at = used.t + s.delay + s.skew * (used.t - epoch)
    x = interpolate_position(camera, at, gap)
    y = used.p.copy()
    turn = interpolate_rotation(camera, at)
    if turn is not None:
        y -= (turn @ s.lever) @ s.R.T
    return x, y


def _linearise(
    s: _Unknowns,
    used: Trajectory,
    camera: Trajectory,
    middle: Array,
    epoch: float,
    gap: float,
    free: dict[str, int | bool],
) -> tuple[Array, Array, list[str], Array]:
    """Return the residual (n, 3), its Jacobian (n, 3, k), the unknowns' names, and the path between
    samples.

    r = y - s R (x(t) - middle) - offset - R A(t) l, with the camera's orientation A and the prism
    l; small rotations from the left: R -> exp(turn) R.
    """
    at = used.t + s.delay + s.skew * (used.t - epoch)
    x = interpolate_position(camera, at, gap)
    h = SMOOTH
    moved = interpolate_position(camera, at + h, gap) - interpolate_position(camera, at - h, gap)
    scale = math.exp(s.log_scale)
    v = np.nan_to_num(scale * (moved / (2.0 * h)) @ s.R.T)
    body = scale * (x - middle) @ s.R.T
    turn = interpolate_rotation(camera, at)
    arm = np.zeros_like(body) if turn is None else (turn @ s.lever) @ s.R.T
    r = used.p - body - s.offset - arm
    u = body + arm
    n = len(r)
    columns: list[Array] = []
    names: list[str] = []
    for i in (2,) if free["rotation"] == 2 else range(3):
        axis = np.zeros(3)
        axis[i] = 1.0
        columns.append(-np.cross(axis, u))
        names.append(f"turn_{'xyz'[i]}")
    if free["scale"]:
        columns.append(-body)
        names.append("scale")
    for i in range(3):
        column = np.zeros((n, 3))
        column[:, i] = -1.0
        columns.append(column)
        names.append(f"offset_{'xyz'[i]}")
    if free["time"]:
        columns.append(-v)
        names.append("delay")
    if free["skew"]:
        columns.append(-v * (used.t - epoch)[:, None])
        names.append("skew")
    if free["lever"]:
        assert turn is not None
        for i in range(3):
            columns.append(-turn[:, :, i] @ s.R.T)
            names.append(f"lever_{'xyz'[i]}")
    steps = np.linalg.norm(np.diff(x, axis=0), axis=1) * scale
    path = np.concatenate([[0.0], np.nan_to_num(steps)])
    return r, np.stack(columns, axis=2), names, path


def _solve(
    r: Array, J: Array, noise: DriftNoise, walk: Array, outlier: Array, names: list[str],
    s: _Unknowns,
) -> tuple[Array, Array]:  # fmt: skip
    """Return step and covariance of a Gauss-Newton step on whitened residuals with priors."""
    k = J.shape[2]
    H, g = np.zeros((k, k)), np.zeros(k)
    for axis in range(3):
        both = np.nan_to_num(np.column_stack([r[:, axis], J[:, axis, :]]))
        white = whiten(both, noise.station, walk, outlier)
        H += white[:, 1:].T @ white[:, 1:]
        g -= white[:, 1:].T @ white[:, 0]
    if "scale" in names:
        g[names.index("scale")] += 3.0 * _count_drift(noise, walk, outlier)
    for i, name in enumerate(names):
        if name.startswith("lever"):
            H[i, i] += 1.0 / LEVER_STD**2
            g[i] -= s.lever["xyz".index(name[-1])] / LEVER_STD**2
        elif name == "skew":
            H[i, i] += 1.0 / SKEW_STD**2
            g[i] -= s.skew / SKEW_STD**2
        elif name == "delay":
            H[i, i] += 1.0 / OFFSET_STD**2
        elif name.startswith("turn") or name == "scale":
            H[i, i] += 1.0  # a radian, a factor of e: a direction without data stays where it is
    covariance = np.asarray(np.linalg.inv(H), dtype=np.float64)
    step = covariance @ g
    # limit the rotation and delay of a step: the start may be far off
    for i, name in enumerate(names):
        limit = 0.3 if name.startswith("turn") or name == "scale" else 0.1 if name == "delay" else 0
        if limit:
            step[i] = min(max(step[i], -limit), limit)
    return step, covariance


def _count_drift(noise: DriftNoise, walk: Array, outlier: Array) -> float:
    """Return trace(S^-1 W) of the camera's drift W in the residual's covariance S = W + white
    noise.

    The camera's drift is in the residual and in the camera's positions that determine the scale
    (errors in variables). At the true scale, -J' S^-1 r has this expectation per axis and not zero,
    and least squares would overestimate the camera's scale by it over H, about half a per cent. A
    drift rotated by 90 degrees is in neither product, so rotations have no such bias.
    """
    weight = compute_weight(noise.station, walk, outlier)
    return float(np.count_nonzero(outlier == 0.0) - noise.station**2 * weight)


def _apply(s: _Unknowns, step: Array, names: list[str]) -> _Unknowns:
    value = dict(zip(names, step, strict=True))
    turn = np.array([value.get(f"turn_{a}", 0.0) for a in "xyz"])
    offset = np.array([value.get(f"offset_{a}", 0.0) for a in "xyz"])
    lever = np.array([value.get(f"lever_{a}", 0.0) for a in "xyz"])
    return _Unknowns(
        Rotation.from_rotvec(turn).as_matrix() @ s.R, s.log_scale + value.get("scale", 0.0),
        s.offset + offset, s.delay + value.get("delay", 0.0), s.skew + value.get("skew", 0.0),
        s.lever + lever,
    )  # fmt: skip


def _doubt(
    std: dict[str, float], used: Trajectory, geometry: Geometry, rotation: float,
    free: dict[str, int | bool],
) -> list[str]:  # fmt: skip
    """Return texts on the parameters that the covariance shows as poorly determined."""
    notes = []
    if rotation > math.radians(2.0) and not geometry.note:
        notes.append(
            "the rotation between the frames has a standard deviation of "
            f"{math.degrees(rotation):.1f} deg: move farther during the calibration"
        )
    if std.get("scale", 0.0) > 0.02 and not geometry.note:
        notes.append(f"the camera's scale is known to ± {100 * std['scale']:.1f} % only")
    if free["time"] and std.get("delay", 0.0) > 0.02:
        notes.append(
            "the delay between the clocks has a standard deviation of "
            f"{1000.0 * std['delay']:.0f} ms: change speed and direction during the "
            "calibration"
        )
    return notes
