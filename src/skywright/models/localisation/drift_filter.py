"""Kalman filter with the camera's drift in its state.

States: position p and velocity v of the robot in W, the camera's drift b, and small errors of the
alignment's rotation (R <- R exp(turn)) and of its scale (log). The camera, aligned to W, measures a
= p + b; with a rotation error R and a scale error s, db/dt = (R' / s - 1) v + drift. The station
measures p. All noise is a density times the time step (and the path), so that the filter is the
same at every rate, unlike the paper's (`paper_filter`). Without measurements of the station, b
drifts and p with it: `drift_floor` is a lower bound of this drift.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from skywright.core.arrays import Array, Ints, Mask
from skywright.core.compiled import helper
from skywright.core.rotations import exp_so3, mat_mat, orthonormalise
from skywright.core.user_code import njit

CAMERA, STATION = 0, 1
P, V, B, TURN, SCALE, SIZE = 0, 3, 6, 9, 12, 13
GATE_STATION = 21.1
"""Squared normalised innovation of three axes, exceeded once in 10,000 by a valid measurement."""
GATE_CAMERA = 25.0
RUN = 5
"""After this many rejections in a row, the filter trusts the station and inflates its covariance.
"""


class DriftModel(NamedTuple):
    """Noise of the filter; densities are per square root of a second, per axis."""

    station: float  # m
    camera: float  # m, per sample
    walk_per_sqrt_s: float  # m
    walk_per_sqrt_m: float  # m per sqrt(m) of path
    acceleration: float = 1.0  # m/s^2 per sqrt(Hz): motion of the robot
    yaw: float = math.radians(0.1)  # rad, drift of the camera's heading
    tilt: float = math.radians(0.01)  # rad, of its vertical, which gravity stabilises
    scale: float = 1e-3
    rotation_0: float = math.radians(1.0)  # rad, of the alignment at the start
    scale_0: float = 0.01
    drift_0: float = 1.0  # m


class Fused(NamedTuple):
    """The filter's estimate after every measurement (n,), and whether it was accepted."""

    t: Array
    kind: Ints  # CAMERA or STATION
    p: Array  # (n, 3) m
    v: Array  # (n, 3) m/s
    drift: Array  # (n, 3) m, of the aligned camera
    turn: Array  # (n, 3) rad, rotation vector of the camera's frame since the alignment
    scale: Array  # (n,) of the camera since the alignment
    p_std: Array  # (n, 3) m
    innovation: Array  # (n,) squared, normalised
    accepted: Mask  # False: rejected as an outlier (station), taken as a jump (camera)


@helper
def _predict(x: Array, R: Array, cov: Array, dt: float, n: Array) -> None:
    """Move state and covariance by dt; `n`: see `_noise_row`."""
    v = x[V : V + 3]
    grow = math.exp(-x[SCALE])
    u = np.empty(3)  # velocity in the camera's frame
    for i in range(3):
        u[i] = grow * (R[0, i] * v[0] + R[1, i] * v[1] + R[2, i] * v[2])
    speed = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    F = np.eye(SIZE)
    for i in range(3):
        F[P + i, V + i] = dt
        for j in range(3):
            F[B + i, V + j] = dt * grow * R[j, i]
        F[B + i, V + i] -= dt
        F[B + i, SCALE] = -dt * u[i]
        x[P + i] += dt * v[i]
        x[B + i] += dt * (u[i] - v[i])
    # exp(-turn) u = u + u x turn
    F[B, TURN + 1], F[B, TURN + 2] = -dt * u[2], dt * u[1]
    F[B + 1, TURN], F[B + 1, TURN + 2] = dt * u[2], -dt * u[0]
    F[B + 2, TURN], F[B + 2, TURN + 1] = -dt * u[1], dt * u[0]
    half = np.zeros((SIZE, SIZE))
    for i in range(SIZE):
        for k in range(SIZE):
            if F[i, k] != 0.0:
                for j in range(SIZE):
                    half[i, j] += F[i, k] * cov[k, j]
    for i in range(SIZE):
        for j in range(i + 1):
            total = 0.0
            for k in range(SIZE):
                total += half[i, k] * F[j, k]
            cov[i, j] = total
            cov[j, i] = total
    acc = n[4] ** 2
    walk = n[2] ** 2 * dt + n[3] ** 2 * speed * dt
    for i in range(3):
        cov[P + i, P + i] += acc * dt**3 / 3.0
        cov[P + i, V + i] += acc * dt**2 / 2.0
        cov[V + i, P + i] += acc * dt**2 / 2.0
        cov[V + i, V + i] += acc * dt
        cov[B + i, B + i] += walk
        turn = n[5] if i == 2 else n[6]
        cov[TURN + i, TURN + i] += turn**2 * dt
    cov[SCALE, SCALE] += n[7] ** 2 * dt


@helper
def _innovate(x: Array, cov: Array, z: Array, camera: bool, white: float, out: Array) -> float:
    """Write the innovation (3,) to `out`; return its squared normalised norm."""
    S = np.empty((3, 3))
    for i in range(3):
        out[i] = z[i] - x[P + i] - (x[B + i] if camera else 0.0)
        for j in range(3):
            S[i, j] = cov[P + i, P + j]
            if camera:
                S[i, j] += cov[P + i, B + j] + cov[B + i, P + j] + cov[B + i, B + j]
        S[i, i] += white * white
    size = np.dot(out, np.linalg.solve(S, out))
    return float(size)


@helper
def _correct(x: Array, cov: Array, z: Array, camera: bool, white: float) -> None:
    """Apply a position measurement, axis by axis (the noise of the axes is independent)."""
    h = np.empty(SIZE)
    for i in range(3):
        e = z[i] - x[P + i] - (x[B + i] if camera else 0.0)
        for k in range(SIZE):
            h[k] = cov[k, P + i] + (cov[k, B + i] if camera else 0.0)
        s = h[P + i] + (h[B + i] if camera else 0.0) + white * white
        for k in range(SIZE):
            x[k] += h[k] / s * e
        for k in range(SIZE):
            for j in range(k + 1):
                cov[k, j] -= h[k] * h[j] / s
                cov[j, k] = cov[k, j]


@helper
def _reset_turn(x: Array, R: Array) -> None:
    """Move the estimated small rotation into the rotation matrix."""
    step, new = np.empty((3, 3)), np.empty((3, 3))
    exp_so3(x[TURN : TURN + 3], step)
    mat_mat(R, step, new)
    for i in range(3):
        x[TURN + i] = 0.0
        for j in range(3):
            R[i, j] = new[i, j]
    orthonormalise(R)


@njit(cache=True, error_model="numpy")
def _run(
    t: Array, kind: Array, z: Array, used: Array, n: Array, start: Array, out: Array, R_out: Array
) -> None:
    """Filter events in order; `out` (n, 15): p, v, b, scale, std of p, innovation, accepted."""
    x, cov, R, e = np.zeros(SIZE), np.zeros((SIZE, SIZE)), np.eye(3), np.empty(3)
    first = np.argmax(used)
    for i in range(3):
        x[P + i] = z[first, i]
        cov[P + i, P + i] = start[2] ** 2
        cov[V + i, V + i] = 1.0
        cov[B + i, B + i] = start[2] ** 2
        cov[TURN + i, TURN + i] = start[0] ** 2
    cov[SCALE, SCALE] = start[1] ** 2
    rejected, now = 0, t[0]
    for k in range(len(t)):
        dt = t[k] - now
        now = t[k]
        while dt > 0.0:  # split a long gap: the speed's uncertainty grows during it
            part = min(dt, 0.1)
            _predict(x, R, cov, part, n)
            dt -= part
        camera = kind[k] == CAMERA
        white = n[1] if camera else n[0]
        size = _innovate(x, cov, z[k], camera, white, e)
        good = bool(used[k])
        if not good:
            pass
        elif camera and size > GATE_CAMERA:  # the camera has jumped, not the robot
            good = False
            jump = (e[0] ** 2 + e[1] ** 2 + e[2] ** 2) / 3.0
            for i in range(3):
                cov[B + i, B + i] += jump
            _correct(x, cov, z[k], True, white)
        elif not camera and size > GATE_STATION:
            good = False
            rejected += 1
            if rejected >= RUN:  # the filter is wrong, not the station
                lost = (e[0] ** 2 + e[1] ** 2 + e[2] ** 2) / 3.0
                for i in range(3):
                    cov[P + i, P + i] += lost
                    cov[B + i, B + i] += lost
                    cov[P + i, B + i] -= lost  # the camera measures the sum
                    cov[B + i, P + i] -= lost
                _correct(x, cov, z[k], False, white)
                good, rejected = True, 0
        else:
            _correct(x, cov, z[k], camera, white)
            if not camera:
                rejected = 0
        _reset_turn(x, R)
        for i in range(9):
            out[k, i] = x[i]
        out[k, 9] = x[SCALE]
        for i in range(3):
            out[k, 10 + i] = math.sqrt(max(cov[P + i, P + i], 0.0))
        out[k, 13] = size
        out[k, 14] = 1.0 if good else 0.0
        R_out[k] = R


def run_drift_filter(
    t: Array, kind: Ints, z: Array, model: DriftModel, used: Mask | None = None
) -> Fused:
    """Filter measurements in order of time.

    t (n,) s; kind (n,) CAMERA or STATION; z (n, 3) m: the aligned camera's position, or the
    station's of the same point (the prism's offset removed). Where `used` (n,) is False, the
    estimate is a prediction; by default all measurements are used.
    """
    used = np.ones(len(t), dtype=np.bool_) if used is None else used
    out, R = np.empty((len(t), 15)), np.empty((len(t), 3, 3))
    noise = np.array([
        model.station, model.camera, model.walk_per_sqrt_s, model.walk_per_sqrt_m,
        model.acceleration, model.yaw, model.tilt, model.scale,
    ])  # fmt: skip
    start = np.array([model.rotation_0, model.scale_0, model.drift_0])
    _run(t, kind, np.ascontiguousarray(z), used, noise, start, out, R)
    turn = Rotation.from_matrix(R).as_rotvec()
    return Fused(
        t, kind, out[:, 0:3], out[:, 3:6], out[:, 6:9], turn, np.exp(out[:, 9]), out[:, 10:13],
        out[:, 13], out[:, 14] > 0.0,
    )  # fmt: skip
