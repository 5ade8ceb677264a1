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

EXCLUSION = 1.5
"""Cost of a left-out sample over the gate. Leaving a valid sample out of a chain removes two steps
and adds one, which saves at most 1.5 times a chi-squared variable of three axes: in white noise it
deviates from the mean of its neighbours with 1.5 times its own variance. The probability of leaving
a valid sample out is therefore at most that of the gate."""
CHANGE = 20
"""Least number of samples at a new level from which it counts as a change, not as an error: 2 s of
a station with 10 Hz. It is not critical, because recordings are longer: a change in their last
samples is left out, and a reflection of more than twice as many samples counts as two changes, of
which only the two steps are lost."""

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
def find_outliers(r: Array, white: float, walk: Array, gate: float) -> tuple[Array, Array]:
    """Return (n,) 1.0 where a residual of r (n, 3) is no measurement, else 0.0, and the variance
    (n,) m^2 of changes of the level.

    `walk` (n,) m^2: variance of the drift since the previous sample. Samples are judged by those
    before and after them: of all chains of samples, the one of least cost is kept. A step of a
    chain costs its squared normalised length, a left-out sample EXCLUSION times `gate`, and a
    change of the level as much as CHANGE left-out samples. A reflection of the station's beam is
    therefore left out, because the level after it is that before it, also across an outage. A
    lasting change is a jump of the camera, or the station was set up anew; with its square as
    variance, it does not enter the estimates. Smaller steps beyond `gate` do: where a filter
    corrects what it predicted, the corrections balance the errors of the predictions.
    """
    n = r.shape[0]
    skip = EXCLUSION * gate
    longest = 10 * CHANGE  # samples left out in a row; limits the time for long recordings
    cost, before, jump = np.empty(n), np.full(n, -1), np.zeros(n)
    out, change = np.ones(n), np.zeros(n)
    for k in range(n):
        cost[k] = k * skip
        s = 2.0 * white * white
        for i in range(k - 1, max(k - longest - 2, -1), -1):
            s += walk[i + 1]
            d2 = 0.0
            for axis in range(3):
                d2 += (r[k, axis] - r[i, axis]) ** 2
            total = cost[i] + (k - i - 1) * skip + min(d2 / s, CHANGE * skip)
            if total < cost[k]:
                cost[k], before[k] = total, i
                jump[k] = d2 if d2 > CHANGE * skip * s else 0.0
    k = int(np.argmin(cost - skip * np.arange(n)))  # samples after the last of the chain are out
    while k >= 0:
        out[k], change[k] = 0.0, jump[k]
        k = before[k]
    return out, change


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
    first = int(np.argmin(outlier))
    level, p, cost = r[first].copy(), white * white, 0.0
    for k in range(first + 1, r.shape[0]):
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
    outlier, change = find_outliers(r, start.station, compute_walk(start, dt, path), 2.0 * GATE)
    floor, best = math.log(1e-6), None
    speed = max(float(np.sum(path)) / max(float(np.sum(dt)), 1e-9), 1e-3)
    middle = math.log(start.per_sqrt_s / 3.0)

    def unpack(u: Array) -> DriftNoise:
        v = np.exp(np.clip(u, floor, math.log(10.0)))
        return DriftNoise(max(float(v[0]), LEAST_STATION), float(v[1]), float(v[2]))

    def cost(u: Array) -> float:
        noise = unpack(u)
        off = 0.0 if station is None else math.log(noise.station / station) / SHEET_SPREAD
        walk = compute_walk(noise, dt, path) + change
        return float(_cost(r, noise.station, walk, outlier)) + off**2

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
