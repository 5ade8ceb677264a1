"""The air around the robot: steady wind, the jet of a fan, Dryden turbulence; compiled.

`WIND` sits inside the plant's record. `step_wind` advances it by one control tick and writes the
air's velocity at the body and at every rotor; the drag is `sim.plant.blow`. Gusts are linear
filters of unit white noise, stepped by their exact discretisation, so their variance does not
depend on the control rate.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import mat_vec
from skywright.core.types import MAX_ROTORS
from skywright.description.world.spec import Wind
from skywright.description.world.wind import (
    compute_direction,
    compute_dryden_scales,
    compute_mean_wind,
    compute_speed,
    jet_velocity,
)

Array = NDArray[np.float64]
Record = Any

STILL, STEADY, FAN, DRYDEN = 0, 1, 2, 3
KINDS = {"none": STILL, "steady": STEADY, "fan": FAN, "dryden": DRYDEN}
POINTS = MAX_ROTORS + 1  # the body and every rotor
NOISE = 3 * POINTS  # normal numbers a control tick at most
SLOWEST = 0.1  # of the fan's speed, for the time in which eddies pass

f8, i8 = np.float64, np.int64

WIND = np.dtype(
    [
        ("kind", i8),
        ("body_W", f8, 3),  # m/s, air at the origin of B
        ("rotor_W", f8, (MAX_ROTORS, 3)),  # m/s, air at every hub; used in a fan's jet only
        ("mean_W", f8, 3),  # m/s
        ("R_WG", f8, (3, 3)),  # gust axes: along the mean wind, across it, and the third
        # fan
        ("place", f8, 3),
        ("diameter", f8),
        ("speed", f8),  # m/s at the outlet
        ("turbulence", f8),
        ("eddy_length", f8),  # m
        ("sweep", f8),  # rad
        ("sweep_rate", f8),  # rad/s of the phase
        ("sweep_phase", f8),  # rad at t = 0
        ("mix", f8, (POINTS, POINTS)),  # lower Cholesky factor of the points' correlation
        ("eddy", f8, (POINTS, 3)),  # unit variance
        # Dryden, one filter an axis: x+ = phi x + noise w, gust = out x
        ("phi", f8, (3, 2, 2)),
        ("noise", f8, (3, 2, 2)),  # lower triangle
        ("out", f8, (3, 2)),
        ("gust", f8, (3, 2)),
    ]
)


def fill_wind(w: Any, wind: Wind, rotor_p: Array, dt: float, rng: np.random.Generator) -> None:
    """Fill a WIND record; `rotor_p` (n, 3) m in B, `dt` the control period.

    `rng` draws the turbulence at the start (stationary) and where in its sweep the fan begins.
    """
    w["kind"] = KINDS[wind.kind]
    along = compute_direction(wind)
    level = np.array([-along[1], along[0], 0.0])
    size = float(np.linalg.norm(level))
    across = level / size if size > 1e-9 else np.array([0.0, 1.0, 0.0])
    w["R_WG"] = np.column_stack([along, across, np.cross(along, across)])
    speed = compute_speed(wind)
    if wind.kind == "fan":
        fan = wind.fan
        w["place"] = [fan.x_m, fan.y_m, fan.z_m]
        w["diameter"], w["speed"] = fan.diameter_m, speed
        w["turbulence"], w["eddy_length"] = fan.turbulence, fan.turbulence_length_m
        w["sweep"] = math.radians(fan.sweep_deg)
        w["sweep_rate"] = 2.0 * math.pi / fan.sweep_period_s
        w["sweep_phase"] = rng.uniform(0.0, 2.0 * math.pi)
        points = np.vstack([np.zeros(3), rotor_p])
        n = len(points)
        apart = np.linalg.norm(points[:, None] - points[None], axis=2)
        mix = np.linalg.cholesky(np.exp(-apart / fan.turbulence_length_m) + 1e-12 * np.eye(n))
        w["mix"][:n, :n] = mix
        w["eddy"][:n] = mix @ rng.standard_normal((n, 3))
        return
    w["mean_W"] = compute_mean_wind(wind, np.zeros((1, 3)))[0]
    w["body_W"] = w["mean_W"]
    if wind.kind == "dryden":
        scales = compute_dryden_scales(wind)
        lags = scales.length / max(speed, 1e-9)  # turbulence hardly passes in next to no wind
        for axis in range(3):
            filtered = build_dryden_filter(
                float(scales.sigma[axis]), float(lags[axis]), dt, axis == 0
            )
            w["phi"][axis], w["noise"][axis], w["out"][axis] = filtered
        start = np.where([[True, False], [True, True], [True, True]], [[1.0], [0.5], [0.5]], 0.0)
        w["gust"] = start * rng.standard_normal((3, 2))  # their stationary deviations


def count_noise(wind: Wind, n_rotors: int) -> int:
    """How many normal numbers a control tick of this wind uses."""
    return {"fan": 3 * (n_rotors + 1), "dryden": 6}.get(wind.kind, 0)


def build_dryden_filter(
    sigma: float, lag: float, dt: float, longitudinal: bool
) -> tuple[Array, Array, Array]:
    """Return (phi (2, 2), noise (2, 2), out (2,)) of one exactly discretised Dryden filter.

    `lag` T = L / V (s). Driven by unit white noise, MIL-F-8785C's spectra are
    H_u = sigma sqrt(2 T) / (1 + T s) and H_v = H_w = sigma sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2.
    The second in states z with z1' = z2 / T, z2' = -(z1 + 2 z2) / T + w / sqrt(T) and output
    sigma (z1 + sqrt(3) z2) has the stationary covariance 1/4 for each state, hence rms sigma.
    """
    h = dt / lag
    if longitudinal:
        a = math.exp(-h)
        return (
            np.diag([a, 0.0]),
            np.diag([math.sqrt(-math.expm1(-2.0 * h)), 0.0]),
            np.array([sigma, 0.0]),
        )
    phi = math.exp(-h) * np.array([[1.0 + h, h], [-h, 1.0 - h]])
    # covariance of the noise over one tick; by quadrature, for the closed form cancels
    x, weight = np.polynomial.legendre.leggauss(16)
    s, weight = 0.5 * h * (x + 1.0), 0.5 * h * weight
    g = np.exp(-s) * np.stack([s, 1.0 - s])
    covariance = (g * weight) @ g.T
    return phi, np.linalg.cholesky(covariance), sigma * np.array([1.0, math.sqrt(3.0)])


@njit(cache=True, error_model="numpy")
def step_wind(
    w: Record, noise: Array, t: float, dt: float, p_WB: Array, R_WB: Array, rotor_p: Array, n: int
) -> None:
    """Advance the air by one control tick: `noise` (NOISE,) normal numbers, `n` rotors."""
    if w.kind == FAN:
        _step_jet(w, noise, t, dt, p_WB, R_WB, rotor_p, n)
    elif w.kind == DRYDEN:
        _step_dryden(w, noise)


@njit(cache=True, error_model="numpy")
def _step_dryden(w: Record, noise: Array) -> None:
    """Frozen turbulence carried past by the mean wind; the same over the robot (L is metres)."""
    gust, gust_W = np.empty(3), np.empty(3)
    for a in range(3):
        x0, x1 = w.gust[a, 0], w.gust[a, 1]
        n0, n1 = noise[2 * a], noise[2 * a + 1]
        w.gust[a, 0] = w.phi[a, 0, 0] * x0 + w.phi[a, 0, 1] * x1 + w.noise[a, 0, 0] * n0
        w.gust[a, 1] = (
            w.phi[a, 1, 0] * x0 + w.phi[a, 1, 1] * x1 + w.noise[a, 1, 0] * n0
            + w.noise[a, 1, 1] * n1
        )  # fmt: skip
        gust[a] = w.out[a, 0] * w.gust[a, 0] + w.out[a, 1] * w.gust[a, 1]
    mat_vec(w.R_WG, gust, gust_W)
    for i in range(3):
        w.body_W[i] = w.mean_W[i] + gust_W[i]


@njit(cache=True, error_model="numpy")
def _step_jet(
    w: Record, noise: Array, t: float, dt: float, p_WB: Array, R_WB: Array, rotor_p: Array, n: int
) -> None:
    """Mean jet and eddies at the body and at every rotor.

    The eddies are an Ornstein-Uhlenbeck process with the time L / U in which they pass, correlated
    over the robot as exp(-distance / L), and scaled with the local mean speed.
    """
    angle = w.sweep * math.sin(w.sweep_rate * t + w.sweep_phase)
    c, s = math.cos(angle), math.sin(angle)
    axis, p, v = np.empty(3), np.empty(3), np.empty(3)
    axis[0] = c * w.R_WG[0, 0] - s * w.R_WG[1, 0]
    axis[1] = s * w.R_WG[0, 0] + c * w.R_WG[1, 0]
    axis[2] = w.R_WG[2, 0]
    decay = grow = 0.0
    for k in range(n + 1):
        for i in range(3):
            p[i] = p_WB[i]
            if k > 0:
                for j in range(3):
                    p[i] += R_WB[i, j] * rotor_p[k - 1, j]
        jet_velocity(w.place, axis, w.diameter, w.speed, p, v)
        speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if k == 0:
            passing = max(speed, SLOWEST * w.speed) / w.eddy_length
            decay = math.exp(-passing * dt)
            grow = math.sqrt(1.0 - decay * decay)
        for i in range(3):
            mixed = 0.0
            for m in range(k + 1):
                mixed += w.mix[k, m] * noise[3 * m + i]
            w.eddy[k, i] = decay * w.eddy[k, i] + grow * mixed
            gusty = v[i] + w.turbulence * speed * w.eddy[k, i]
            if k == 0:
                w.body_W[i] = gusty
            else:
                w.rotor_W[k - 1, i] = gusty
