"""Least squares on the predicted accelerations, and what a flight could not tell.

The residual is the error of the predicted specific force and angular acceleration: measurement
noise is then in what is predicted, not in what predicts, so that it does not bias the inertia.
Parameters whose confidence interval is wide are kept at the robot file's value, one after the
other, and the rest is fitted anew.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from skywright.analysis.identify.signals import INERTIA_AXES, Columns
from skywright.core.arrays import Array, Ints, Mask
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.rotors import RotorSet, build_rotors

CONFIDENCE = 0.95
BLOCK = 2.0  # s, within which residuals may hang together
HELD_OUT = 4  # every so many blocks of HELD_OUT_S is kept for the test
HELD_OUT_S = 5.0  # s
ROUNDS = 4  # of weighting
STEPS = 15  # of Gauss-Newton
FIRST_NOISE = np.array([0.1, 0.1, 0.1, 0.5, 0.5, 0.5])  # m/s^2, rad/s^2: where weighting starts
GAIN, COEFFICIENT, INERTIA = 2.0, 5.0, 3.0
"""Factors of the robot file's value, both ways, within which an identified one lies: of a rotor's
thrust (another propeller is another file), of a propeller's drag torque, of an inertia."""
COM = 0.1  # m, from the file's
DELAY = (-0.05, 0.2)  # s
LEAP = 1.0  # largest step of a parameter, in its scale


class Parameter(NamedTuple):
    """One parameter of the model."""

    name: str
    unit: str
    nominal: float  # by the robot file
    scale: float  # of the numerics
    widest: float  # half of the confidence interval beyond which it counts as not identified
    meaning: str
    low: float = -math.inf  # what physics leaves possible, from the robot file
    high: float = math.inf


class Estimate(NamedTuple):
    """What the flight says about a parameter; `half_width` NaN where it says nothing."""

    parameter: Parameter
    value: float
    half_width: float  # of the confidence interval
    identified: bool
    would_be: float  # half width with which it was given up; NaN for identified ones


class Prediction(NamedTuple):
    """Measured against predicted, k samples; `held_out` marks those that the fit did not see."""

    t: Array
    held_out: Mask
    measured: Array  # (k, 6): specific force m/s^2, angular acceleration rad/s^2
    predicted: Array  # (k, 6)
    nominal: Array  # (k, 6), by the robot file

    def r_squared(self, predicted: Array) -> Array:
        """Coefficient of determination (6,): the error on held-out samples over the variance.

        The variance is that of the whole flight, as held-out parts may happen to be quiet.
        """
        error = np.mean((self.measured - predicted)[self.held_out] ** 2, axis=0)
        return np.asarray(1.0 - error / np.maximum(self.measured.var(axis=0), 1e-12))


class Fit(NamedTuple):
    """The result of `fit_parameters`."""

    estimates: list[Estimate]
    prediction: Prediction
    noise: Array  # (6,) rms of the residuals on the fitted samples
    samples: int
    mass: float  # kg, taken as known


def list_parameters(robot: Robot, poses: Array, gravity: float) -> list[Parameter]:
    """Return the model's parameters with the robot file's values."""
    r = robot.rotors
    model = build_body_model(robot, gravity)
    out = [
        Parameter(
            f"rotor_gain_{i + 1}", "", 1.0, 0.1, 0.05, f"thrust of rotor {i + 1} over the file's",
            1.0 / GAIN, GAIN,
        )
        for i in range(len(r.azimuth_deg))
    ]  # fmt: skip
    k, c = r.torque_per_thrust_m, r.drag_coefficient_n_per_rads_mps
    out.append(
        Parameter(
            "torque_per_thrust_m", "m", k, k, 0.25 * k, "propellers' drag torque over thrust",
            k / COEFFICIENT, COEFFICIENT * k,
        )
    )  # fmt: skip
    out.append(
        Parameter(
            "drag_coefficient_n_per_rads_mps",
            "N/((rad/s)(m/s))",
            c,
            max(c, 1e-5),
            max(0.3 * c, 1e-5),
            "rotors' drag in their discs",
        )
    )
    p = robot.platform
    for axis in "xyz":
        area = getattr(p, f"drag_area_{axis}_m2")
        out.append(
            Parameter(
                f"drag_area_{axis}_m2",
                "m^2",
                area,
                max(area, 0.01),
                max(0.3 * area, 0.01),
                f"C_D A of the body along {axis}",
            )
        )
    for axis in "xy":
        out.append(
            Parameter(f"wind_force_{axis}_n", "N", 0.0, 1.0, 0.2, f"steady force along {axis} of W")
        )
    out.append(
        Parameter(
            "rotor_delay_s", "s", 0.0, 0.01, 0.005,
            "delay of the thrust relative to the rotor signals of the log", *DELAY,
        )
    )  # fmt: skip
    for n, q in enumerate(poses):
        _, com, I_B = compute_body(model, q)
        size = float(np.trace(I_B)) / 3.0
        where = f"pose_{n + 1}"
        for axis, value in zip("xyz", com, strict=True):
            out.append(
                Parameter(
                    f"{where}.com_{axis}_m",
                    "m",
                    float(value),
                    0.01,
                    0.01,
                    f"centre of mass, arm in pose {n + 1}",
                    float(value) - COM,
                    float(value) + COM,
                )
            )
        for i, j in INERTIA_AXES:
            name = "xyz"[i] + "xyz"[j]
            value = float(I_B[i, j])
            widest = 0.15 * value if i == j else 0.1 * size
            low, high = (value / INERTIA, INERTIA * value) if i == j else (-size, size)
            out.append(
                Parameter(
                    f"{where}.inertia_{name}_kgm2",
                    "kg m^2",
                    value,
                    size,
                    widest,
                    f"inertia about B's origin, arm in pose {n + 1}",
                    low,
                    high,
                )
            )
    return out


def predict(columns: Columns, rotors: RotorSet, mass: float, x: Array) -> Array:
    """Return specific force (m/s^2) and angular acceleration (rad/s^2), (k, 6), at parameters x."""
    n = len(rotors.axis)
    gain, kappa, drag = x[:n], x[n], x[n + 1]
    area, wind = x[n + 2 : n + 5], x[n + 5 : n + 7]
    T = (columns.thrust - x[n + 7] * columns.thrust_rate) * gain
    f = T @ rotors.axis + drag * columns.rotor_drag[:, :3] + columns.body_drag * area
    f = f + columns.R_T @ wind - columns.arm[:, :3]
    lever = np.cross(rotors.position, rotors.axis) - kappa * rotors.spin[:, None] * rotors.axis
    torque = T @ lever + drag * columns.rotor_drag[:, 3:] - columns.arm[:, 3:]
    out = np.empty((len(f), 6))
    for pose in range(len(columns.poses)):
        at = columns.pose == pose
        y = x[n + 8 + 9 * pose : n + 17 + 9 * pose]
        h = mass * y[:3]
        I_B = unpack_inertia(y[3:])
        # wd enters both equations: w' x h of the force equation uses the measured one
        out[at, :3] = (f[at] - columns.wh[at] @ h) / mass
        left = torque[at] - columns.s_cross[at] @ h - columns.gyroscopic[at] @ y[3:]
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

    `mass` (kg) sets the scale: accelerations tell every other parameter only in ratio to it.
    """
    rotors = build_rotors(robot.rotors)
    parameters = list_parameters(robot, columns.poses, gravity)
    x0 = np.array([p.nominal for p in parameters])
    scale = np.array([p.scale for p in parameters])
    widest = np.array([p.widest for p in parameters])
    held_out = (np.floor(columns.t / HELD_OUT_S).astype(int) % HELD_OUT) == HELD_OUT - 1
    if held_out.all() or not held_out.any():
        held_out = np.arange(len(columns.t)) >= 0.75 * len(columns.t)
    train = Columns(*(v if n == "poses" else v[~held_out] for n, v in columns._asdict().items()))
    measured = np.hstack([train.s, train.wd])
    free = np.ones(len(x0), dtype=bool)
    gave_up = np.full(len(x0), np.nan)
    x, noise, half = x0.copy(), FIRST_NOISE, np.full(len(x0), np.nan)
    while True:
        x, noise = _solve(train, rotors, mass, measured, x0, x, scale, free, noise)
        if not free.any():  # the flight tells nothing
            break
        half = _half_widths(train, rotors, mass, measured, x, scale, free, noise)
        ratio = np.where(free, half / widest, 0.0)
        worst = int(np.argmax(ratio))
        if ratio[worst] <= 1.0:
            break
        # what is hopeless goes at once, the rest one by one
        hopeless = ratio >= max(10.0, 0.5 * ratio[worst])
        for i in np.flatnonzero(hopeless) if hopeless.any() else [worst]:
            free[i], gave_up[i], x[i] = False, half[i], x0[i]
    estimates = [
        Estimate(
            p, float(x[i]), float(half[i]) if free[i] else np.nan, bool(free[i]), float(gave_up[i])
        )
        for i, p in enumerate(parameters)
    ]
    whole = np.hstack([columns.s, columns.wd])
    found, nominal = (predict(columns, rotors, mass, y) for y in (x, x0))
    prediction = Prediction(columns.t, held_out, whole, found, nominal)
    return Fit(estimates, prediction, noise, len(train.t), mass)


def compute_misfit(columns: Columns, robot: Robot, mass: float, gravity: float) -> float:
    """Return how badly the model with all parameters free fits: the sum of the residuals' logs."""
    parameters = list_parameters(robot, columns.poses, gravity)
    x0 = np.array([p.nominal for p in parameters])
    scale = np.array([p.scale for p in parameters])
    measured = np.hstack([columns.s, columns.wd])
    free = np.ones(len(x0), dtype=bool)
    _, noise = _solve(
        columns, build_rotors(robot.rotors), mass, measured, x0, x0, scale, free, FIRST_NOISE
    )
    return float(np.sum(np.log(noise)))


def _solve(
    columns: Columns, rotors: RotorSet, mass: float, measured: Array, x0: Array, x: Array,
    scale: Array, free: Mask, noise: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Weighted least squares over the free parameters; the weights follow from the residuals.

    Gauss-Newton: the model is linear but for products (thrust gain by lever, inertia inverted), so
    a few steps end it. Directions that the data do not see stay where they are (least norm).
    """
    index = np.flatnonzero(free)
    for _ in range(ROUNDS):
        for _ in range(STEPS if index.size else 0):  # a flight may tell nothing at all
            base = predict(columns, rotors, mass, x)
            error = ((measured - base) / noise).ravel()
            slope = _jacobian(columns, rotors, mass, x, base, scale, index) / noise[None, :, None]
            step = np.linalg.lstsq(slope.reshape(-1, len(index)), error, rcond=1e-10)[0]
            x = x.copy()
            x[index] += scale[index] * np.clip(step, -LEAP, LEAP)
            if np.max(np.abs(step), initial=0.0) < 1e-4:  # the next would be its square
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
    """Return the derivatives (k, 6, p) of the predictions by the parameters, in their scales."""
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

    Residuals of one block may be correlated (filter, unmodelled effects), those of different
    blocks not: the covariance is the sandwich over blocks (Liang and Zeger 1986, Biometrika 73).
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
    # with few blocks the sandwich is too small: never below the textbook's own
    variance = np.maximum(np.diag(robust), np.diag(bread))
    t = float(stats.t.ppf(0.5 + CONFIDENCE / 2, max(g - 1, 1)))
    half = np.full(len(x), np.nan)
    half[index] = t * np.sqrt(variance) * scale[index]
    # directions that the data do not determine at all, whatever the columns' sizes
    size = np.linalg.norm(flat, axis=0)
    level = flat / np.where(size > 1e-12, size, 1.0)
    sigma, vectors = np.linalg.eigh(level.T @ level)
    blind = vectors[:, sigma < 1e-10]
    lost = np.any(np.abs(blind) > 0.1, axis=1) | (size <= 1e-12)
    half[index[lost]] = np.inf
    return half
