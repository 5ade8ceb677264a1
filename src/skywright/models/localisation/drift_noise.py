"""The noise of station and camera, from what the alignment leaves unexplained.

The residual of an aligned calibration is white noise of the station plus a camera that walks away:
r_k = b_k + n_k, b_(k+1) = b_k + w_k. That is a local-level model; its Kalman filter turns the
residual into innovations, which are white (Harvey, Forecasting, Structural Time Series Models and
the Kalman Filter, 1989, section 3.4). So least squares on innovations is generalised least squares
under drift, and their likelihood tells the noise.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from skywright.core.arrays import Array
from skywright.core.user_code import njit

GATE = 21.1
"""Squared normalised innovation of three axes that a good one exceeds once in 10,000."""

LEAST_STATION = 0.5e-3
"""m; no station and no camera is better."""
SHEET_SPREAD = 0.3
"""Natural logarithm: an instrument's noise is its data sheet's times exp(0.3), one sigma."""


class DriftNoise(NamedTuple):
    """Standard deviations, each axis."""

    station: float  # m, white
    per_sqrt_s: float  # m per sqrt(s), the camera's walk in time
    per_sqrt_m: float  # m per sqrt(m), its walk along the path


@njit(cache=True, error_model="numpy")
def find_outliers(r: Array, white: float, walk: Array, gate: float) -> Array:
    """(n,) 1.0 where the residual (n, 3) steps out of what noise and drift explain, else 0.0.

    `walk` (n,) m^2: variance of the drift since the sample before. Five outliers in a row are
    none: the level has moved.
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
    """Innovations of the columns of m (n, k), normalised; the level starts at zero, known.

    Rows at outliers become zero: they tell nothing.
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
    """Noise of the residuals r (n, 3) m by maximum likelihood, outliers left out.

    dt (n,) s and path (n,) m since the sample before (0 for the first). `station` (m): the
    station's white noise by its data sheet, taken for known to SHEET_SPREAD before the residuals:
    where the camera walks several times as far between two samples, they hardly tell it.
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
