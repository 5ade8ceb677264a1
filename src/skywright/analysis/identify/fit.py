"""Least squares on the predicted accelerations, and the parameters that a flight does not excite.

The residual is the error of the predicted specific force and angular acceleration. Measurement
noise is therefore in the dependent variable, not in the regressors, and does not bias the inertia.
Parameters with a wide confidence interval are reset to the robot file's value one after the other,
and the rest is fitted again.
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy import stats

from skywright.analysis.identify.parameters import Parameter, list_parameters
from skywright.analysis.identify.signals import INERTIA_AXES, Columns
from skywright.core.arrays import Array, Ints, Mask
from skywright.description.robot.spec import Robot
from skywright.models.rotors import RotorSet, build_rotors
from skywright.models.vectors import compute_cross

CONFIDENCE = 0.95
BLOCK = 2.0  # s, duration within which residuals may be correlated
HELD_OUT = 4  # one of this many blocks of HELD_OUT_S is held out for the test
HELD_OUT_S = 5.0  # s
LEAST_HELD_OUT, MOST_HELD_OUT = 0.15, 0.5  # of the samples
ROUNDS = 4  # of weighting
STEPS = 15  # of Gauss-Newton
FIRST_NOISE = np.array([0.1, 0.1, 0.1, 0.5, 0.5, 0.5])  # m/s^2, rad/s^2: initial weighting
LEAST_R2 = 0.5
"""Minimum R^2 of the angular acceleration on held-out parts; half of the variance is then
explained. A simulated flight gives 0.9 and more, a constant mean 0. A parameter that depends mostly
on an axis below the minimum keeps the robot file's value, or it would compensate model errors."""
LEAP = 1.0  # maximum step of a parameter, in units of its scale


class Estimate(NamedTuple):
    """Estimate of a parameter; `half_width` is NaN if the flight does not identify it."""

    parameter: Parameter
    value: float
    half_width: float  # of the confidence interval
    identified: bool
    would_be: float  # half width at which it was given up; NaN for identified ones


class Prediction(NamedTuple):
    """Measured and predicted values of k samples; `held_out` marks those not used by the fit."""

    t: Array
    held_out: Mask
    measured: Array  # (k, 6): specific force m/s^2, angular acceleration rad/s^2
    predicted: Array  # (k, 6)
    nominal: Array  # (k, 6), from the robot file

    def r_squared(self, predicted: Array) -> Array:
        """Return R^2 (6,): one minus the mean squared error on held-out samples over the variance.

        The variance is that of the whole flight, because held-out parts may have little motion.
        """
        error = np.mean((self.measured - predicted)[self.held_out] ** 2, axis=0)
        return np.asarray(1.0 - error / np.maximum(self.measured.var(axis=0), 1e-12))


class Fit(NamedTuple):
    """The result of `fit_parameters`."""

    estimates: list[Estimate]
    prediction: Prediction
    noise: Array  # (6,) rms of the residuals on the fitted samples
    samples: int
    mass: float  # kg, assumed known
    unused: Mask  # (3,) axes of the angular acceleration that the model does not predict
    given_up_r2: Array  # (3,) R^2 with which an axis became unused; NaN for the others


def predict(columns: Columns, rotors: RotorSet, mass: float, x: Array) -> Array:
    """Return specific force (m/s^2) and angular acceleration (rad/s^2), (k, 6), at parameters x."""
    n = len(rotors.axis)
    gain, kappa, drag = x[:n], x[n], x[n + 1]
    area, wind = x[n + 2 : n + 5], x[n + 5 : n + 7]
    delay, inertia, height = x[n + 7 : n + 10]
    T = (columns.thrust - delay * columns.thrust_rate) * gain
    lift = T @ rotors.axis
    hub = drag * columns.rotor_drag[:, :3]
    f = lift + hub + columns.body_drag * area
    f = f + columns.R_T @ wind - columns.arm[:, :3]
    lever = compute_cross(rotors.position, rotors.axis) - kappa * rotors.spin[:, None] * rotors.axis
    torque = T @ lever + drag * columns.rotor_drag[:, 3:] - columns.arm[:, 3:]
    torque = torque + inertia * (columns.spin - delay * columns.spin_rate)
    moment = (height - float(np.mean(rotors.position[:, 2]))) * hub
    out = np.empty((len(f), 6))
    for pose, blind in itertools.product(range(len(columns.poses)), (False, True)):
        rows = (columns.pose == pose) & (columns.no_air == blind)
        if not rows.any():
            continue
        at = slice(None) if rows.all() else rows  # a slice copies nothing
        y = x[n + 10 + 9 * pose : n + 19 + 9 * pose]
        h = mass * y[:3]
        I_B = unpack_inertia(y[3:])
        # wd is measured in the force equation, and predicted by the torque equation
        out[at, :3] = (f[at] - columns.wh[at] @ h) / mass
        bend = moment[at]
        if blind:  # drag follows from measured force and thrust: m s + w' x h + ...
            bend = bend + height * (mass * columns.s[at] + columns.ww[at] @ h - lift[at])
            bend = bend + height * columns.arm[at, :3]
            I_B[:2, :2] -= height * h[2] * np.eye(2)  # e_z x (w' x h) = h_z w' - h w_z'
            I_B[:2, 2] += height * h[:2]
        left = torque[at] - columns.s_cross[at] @ h - columns.gyroscopic[at] @ y[3:]
        left[:, :2] += np.column_stack([-bend[:, 1], bend[:, 0]])
        out[at, 3:] = np.linalg.solve(I_B, left.T).T
    return out


def unpack_inertia(y: Array) -> Array:
    """Return the (3, 3) matrix of (xx, yy, zz, xy, xz, yz)."""
    I_B = np.empty((3, 3))
    for value, (i, j) in zip(y, INERTIA_AXES, strict=True):
        I_B[i, j] = I_B[j, i] = value
    return I_B


def fit_parameters(columns: Columns, robot: Robot, mass: float, gravity: float) -> Fit:
    """Fit the model to the columns.

    `mass` (kg) sets the scale: accelerations determine the other parameters only relative to it.
    """
    rotors = build_rotors(robot.rotors)
    parameters = list_parameters(robot, columns.poses, gravity)
    x0 = np.array([p.nominal for p in parameters])
    scale = np.array([p.scale for p in parameters])
    widest = np.array([p.widest for p in parameters])
    held_out = choose_held_out(columns.t)
    train = keep_rows(columns, ~held_out)
    measured = np.hstack([train.s, train.wd])
    whole = np.hstack([columns.s, columns.wd])
    nominal = predict(columns, rotors, mass, x0)
    free = np.ones(len(x0), dtype=bool)
    unused = np.zeros(3, dtype=bool)
    given_up = np.full(3, np.nan)
    while True:
        x, half, gave_up, noise = _eliminate(
            train, rotors, mass, measured, x0, scale, widest, free.copy()
        )
        found = predict(columns, rotors, mass, x)
        prediction = Prediction(columns.t, held_out, whole, found, nominal)
        r2 = prediction.r_squared(found)[3:]
        fails = r2 < LEAST_R2
        if np.all(fails) or not np.any(fails & ~unused):
            break
        given_up = np.where(fails & ~unused, r2, given_up)
        unused |= fails
        base = predict(train, rotors, mass, x)
        slope = _jacobian(train, rotors, mass, x, base, scale, np.arange(len(x))) / noise[:, None]
        told = np.sum(slope**2, axis=0)
        free &= told[3:][unused].sum(axis=0) <= 0.5 * told.sum(axis=0)
    estimates = [
        Estimate(p, float(x[i]), float(half[i]), bool(np.isfinite(half[i])), float(gave_up[i]))
        for i, p in enumerate(parameters)
    ]
    return Fit(estimates, prediction, noise, len(train.t), mass, unused, given_up)


def _eliminate(
    train: Columns, rotors: RotorSet, mass: float, measured: Array, x0: Array, scale: Array,
    widest: Array, free: Mask,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Fit, and eliminate the parameters that the flight does not excite until the rest is
    identified.

    Return the parameters, half widths of their intervals (NaN for eliminated ones), half widths at
    elimination, and the noise. `free` (n,) marks the parameters to fit.
    """
    gave_up, half = np.full(len(x0), np.nan), np.full(len(x0), np.nan)
    x, noise = x0.copy(), FIRST_NOISE
    while True:
        x, noise = _solve(train, rotors, mass, measured, x, scale, free, noise)
        if not free.any():  # the flight identifies nothing
            return x, half, gave_up, noise
        half = _half_widths(train, rotors, mass, measured, x, scale, free, noise)
        ratio = np.where(free, half / widest, 0.0)
        worst = int(np.argmax(ratio))
        if ratio[worst] <= 1.0:
            return x, half, gave_up, noise
        # eliminate unobservable ones together, the rest one by one
        hopeless = ratio >= max(10.0, 0.5 * ratio[worst])
        for i in np.flatnonzero(hopeless) if hopeless.any() else [worst]:
            free[i], gave_up[i], x[i], half[i] = False, half[i], x0[i], np.nan


def choose_held_out(t: Array) -> Mask:
    """Return the mask of the samples at t (k,) s that the fit does not use.

    These are a quarter of the time in parts of HELD_OUT_S, or the last quarter if a short log
    would hold out less than LEAST_HELD_OUT or more than MOST_HELD_OUT.
    """
    out = (np.floor(t / HELD_OUT_S).astype(int) % HELD_OUT) == HELD_OUT - 1
    if LEAST_HELD_OUT <= np.mean(out) <= MOST_HELD_OUT:
        return np.asarray(out)
    return np.arange(len(t)) >= 0.75 * len(t)


def keep_rows(columns: Columns, use: Mask) -> Columns:
    """Return the samples in `use`."""
    return Columns(*(v if n == "poses" else v[use] for n, v in columns._asdict().items()))


def compute_misfit(
    columns: Columns, robot: Robot, mass: float, gravity: float, free: Mask
) -> float:
    """Return the misfit of the `free` parameters: the sum of the logs of the fitted residuals.

    Other parameters stay constant, because unexcited ones would compensate a wrong lag.
    """
    parameters = list_parameters(robot, columns.poses, gravity)
    x0 = np.array([p.nominal for p in parameters])
    scale = np.array([p.scale for p in parameters])
    train = keep_rows(columns, ~choose_held_out(columns.t))
    measured = np.hstack([train.s, train.wd])
    _, noise = _solve(
        train, build_rotors(robot.rotors), mass, measured, x0, scale, free, FIRST_NOISE
    )
    return float(np.sum(np.log(noise)))


def _solve(
    columns: Columns, rotors: RotorSet, mass: float, measured: Array, x: Array, scale: Array,
    free: Mask, noise: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Solve weighted least squares over the free parameters, with weights from the residuals.

    Gauss-Newton converges in a few steps, because the model is linear except for products (thrust
    gain and lever, inverse inertia). Unobservable directions stay unchanged (least norm).
    """
    index = np.flatnonzero(free)
    for _ in range(ROUNDS):
        for _ in range(STEPS if index.size else 0):  # the flight may identify nothing
            base = predict(columns, rotors, mass, x)
            error = ((measured - base) / noise).ravel()
            slope = _jacobian(columns, rotors, mass, x, base, scale, index) / noise[None, :, None]
            step = np.linalg.lstsq(slope.reshape(-1, len(index)), error, rcond=1e-10)[0]
            x = x.copy()
            x[index] += scale[index] * np.clip(step, -LEAP, LEAP)
            if np.max(np.abs(step), initial=0.0) < 1e-4:  # converges quadratically
                break
        error = predict(columns, rotors, mass, x) - measured
        fresh = np.maximum(np.sqrt(np.mean(error**2, axis=0)), 1e-6)
        if np.all(np.abs(fresh / noise - 1.0) < 0.01):
            return x, fresh
        noise = fresh
    return x, noise


def _jacobian(
    columns: Columns, rotors: RotorSet, mass: float, x: Array, base: Array, scale: Array,
    index: Ints,
) -> Array:  # fmt: skip
    """Return the derivatives (k, 6, p) of the predictions with respect to the scaled parameters."""
    out = np.empty((*base.shape, len(index)))
    for k, i in enumerate(index):
        y = x.copy()
        y[i] += 1e-5 * scale[i]
        out[:, :, k] = (predict(columns, rotors, mass, y) - base) / 1e-5
    return out


def _half_widths(
    columns: Columns, rotors: RotorSet, mass: float, measured: Array, x: Array, scale: Array,
    free: Mask, noise: Array,
) -> Array:  # fmt: skip
    """Return half of each free parameter's confidence interval (NaN for the others).

    Residuals may be correlated within a block (filter, unmodelled effects), but not between blocks:
    the covariance is the sandwich over blocks (Liang and Zeger 1986, Biometrika 73).
    """
    index = np.flatnonzero(free)
    base = predict(columns, rotors, mass, x)
    jacobian = _jacobian(columns, rotors, mass, x, base, scale, index) / noise[None, :, None]
    error = (measured - base) / noise
    flat = jacobian.reshape(-1, len(index))
    bread = np.linalg.pinv(flat.T @ flat, rcond=1e-12, hermitian=True)
    blocks = np.floor(columns.t / BLOCK).astype(int)
    groups = np.unique(blocks)
    scores = np.array(
        [np.einsum("kcp,kc->p", jacobian[blocks == b], error[blocks == b]) for b in groups]
    )
    g, p = len(groups), len(index)
    correction = g / max(g - 1, 1) * (flat.shape[0] - 1) / max(flat.shape[0] - p, 1)
    robust = correction * bread @ (scores.T @ scores) @ bread
    # with few blocks the sandwich is too small: use at least the ordinary estimate
    variance = np.maximum(np.diag(robust), np.diag(bread))
    t = float(stats.t.ppf(0.5 + CONFIDENCE / 2, max(g - 1, 1)))
    half = np.full(len(x), np.nan)
    half[index] = t * np.sqrt(variance) * scale[index]
    # directions that the data do not determine, independent of the scale of the columns
    size = np.linalg.norm(flat, axis=0)
    level = flat / np.where(size > 1e-12, size, 1.0)
    sigma, vectors = np.linalg.eigh(level.T @ level)
    blind = vectors[:, sigma < 1e-10]
    lost = np.any(np.abs(blind) > 0.1, axis=1) | (size <= 1e-12)
    half[index[lost]] = np.inf
    return half
