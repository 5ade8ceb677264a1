"""Noise of station and camera, estimated from the residuals of the alignment.

The residual of an aligned calibration is white noise of the station plus a random walk of the
camera: r_k = b_k + n_k, b_(k+1) = b_k + w_k. That is a local-level model; its Kalman filter
converts the residual to innovations, which are white (Harvey, Forecasting, Structural Time Series
Models and the Kalman Filter, 1989, section 3.4). Least squares on innovations is therefore
generalised least squares under drift, and their likelihood determines the noise.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from skywright.core.arrays import Array
from skywright.core.user_code import njit

GATE = 21.1
"""Squared normalised innovation of three axes, exceeded once in 10,000 by a valid one."""

LEAST_STATION = 0.5e-3
"""m; lower bound of the noise of any station or camera."""
SHEET_SPREAD = 0.3
"""Standard deviation of ln(noise of an instrument / noise in its data sheet)."""


class DriftNoise(NamedTuple):
    """Standard deviations, per axis."""

    station: float  # m, white
    per_sqrt_s: float  # m per sqrt(s), random walk of the camera in time
    per_sqrt_m: float  # m per sqrt(m), random walk along the path


@njit(cache=True, error_model="numpy")
def find_outliers(r: Array, white: float, walk: Array, gate: float) -> Array:
    """Return (n,) 1.0 where the residual (n, 3) exceeds noise and drift, else 0.0.

    `walk` (n,) m^2: variance of the drift since the previous sample. Five outliers in a row are
    accepted: the level has changed.
    """
    n = r.shape[0]
    out = np.zeros(n)
    level = r[0].copy()
    p, run = white * white, 0
    for k in range(1, n):
        p += walk[k]
        s = p + white * white
        d2 = 0.0
        for i in range(3):
            d2 += (r[k, i] - level[i]) ** 2
        if d2 > gate * s and run < 5:
            out[k] = 1.0
            run += 1
            continue
        if run >= 5:
            for j in range(k - run, k):
                out[j] = 0.0
            p += d2
            s += d2
        run = 0
        gain = p / s
        for i in range(3):
            level[i] += gain * (r[k, i] - level[i])
        p *= 1.0 - gain
    return out


@njit(cache=True, error_model="numpy")
def whiten(m: Array, white: float, walk: Array, outlier: Array) -> Array:
    """Return normalised innovations of the columns of m (n, k); the initial level is exactly zero.

    Rows at outliers become zero: they contain no information.
    """
    n, k = m.shape
    out = np.zeros((n, k))
    level = np.zeros(k)
    p = 0.0
    for row in range(n):
        p += walk[row]
        if outlier[row] > 0.0:
            continue
        s = p + white * white
        gain, root = p / s, math.sqrt(s)
        for j in range(k):
            e = m[row, j] - level[j]
            out[row, j] = e / root
            level[j] += gain * e
        p *= 1.0 - gain
    return out


@njit(cache=True, error_model="numpy")
def compute_weight(white: float, walk: Array, outlier: Array) -> float:
    """Return trace(S^-1) (1/m^2) of the covariance S of white noise and walk, without outliers.

    The disturbance smoother of the local-level model yields the diagonal of S^-1 in one backward
    pass (Durbin and Koopman, Time Series Analysis by State Space Methods, 2012, section 2.5.3).
    `white` (m), `walk` (n,) m^2 and `outlier` (n,) as in `whiten`.
    """
    n = len(walk)
    size, gain = np.zeros(n), np.zeros(n)
    p = 0.0
    for k in range(n):
        p += walk[k]
        if outlier[k] > 0.0:
            continue
        size[k] = p + white * white
        gain[k] = p / size[k]
        p *= 1.0 - gain[k]
    total = later = 0.0
    for k in range(n - 1, -1, -1):
        if outlier[k] > 0.0:
            continue
        total += 1.0 / size[k] + gain[k] ** 2 * later
        later = 1.0 / size[k] + (1.0 - gain[k]) ** 2 * later
    return total


@njit(cache=True, error_model="numpy")
def _cost(r: Array, white: float, walk: Array, outlier: Array) -> float:
    """Twice the negative log likelihood of residuals (n, 3), innovations clipped at four sigma."""
    level, p, cost = r[0].copy(), white * white, 0.0
    for k in range(1, r.shape[0]):
        p += walk[k]
        if outlier[k] > 0.0:
            continue
        s = p + white * white
        gain = p / s
        for i in range(3):
            e = r[k, i] - level[i]
            cost += min(e * e / s, 16.0) + math.log(s)
            level[i] += gain * e
        p *= 1.0 - gain
    return cost


def compute_walk(noise: DriftNoise, dt: Array, path: Array) -> Array:
    """Variance (n,) m^2 of the camera's drift over steps of `dt` (n,) s and `path` (n,) m."""
    return np.asarray(noise.per_sqrt_s**2 * dt + noise.per_sqrt_m**2 * path)


def estimate_noise(r: Array, dt: Array, path: Array, station: float | None = None) -> DriftNoise:
    """Estimate the noise of the residuals r (n, 3) m by maximum likelihood, without outliers.

    dt (n,) s and path (n,) m since the previous sample (0 for the first). `station` (m): the
    station's white noise by its data sheet, a prior with the spread SHEET_SPREAD. If the camera
    drifts several times as far between two samples, the residuals contain hardly any information on
    it.
    """
    step = np.diff(r, axis=0)
    size = float(np.median(np.abs(step))) / 0.6745 + 1e-6  # of white noise and walk together
    start = DriftNoise(
        max(size / math.sqrt(2.0), LEAST_STATION),
        size / math.sqrt(max(float(np.median(dt[1:])), 1e-3)),
        0.0,
    )
    outlier = find_outliers(r, start.station, compute_walk(start, dt, path), 2.0 * GATE)
    floor, best = math.log(1e-6), None
    speed = max(float(np.sum(path)) / max(float(np.sum(dt)), 1e-9), 1e-3)
    middle = math.log(start.per_sqrt_s / 3.0)

    def unpack(u: Array) -> DriftNoise:
        v = np.exp(np.clip(u, floor, math.log(10.0)))
        return DriftNoise(max(float(v[0]), LEAST_STATION), float(v[1]), float(v[2]))

    def cost(u: Array) -> float:
        noise = unpack(u)
        off = 0.0 if station is None else math.log(noise.station / station) / SHEET_SPREAD
        return float(_cost(r, noise.station, compute_walk(noise, dt, path), outlier)) + off**2

    for time_share, path_share in (
        (middle, floor / 2),
        (floor / 2, middle - 0.5 * math.log(speed)),
    ):
        found = minimize(
            cost, np.array([math.log(start.station), time_share, path_share]),
            method="Nelder-Mead", options={"maxiter": 300, "xatol": 0.02, "fatol": 0.1},
        )  # fmt: skip
        if best is None or found.fun < best.fun:
            best = found
    assert best is not None
    return unpack(best.x)
