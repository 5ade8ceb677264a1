"""Response of rotors and servos to their commands: gain, first-order lag and offset.

    y = K u - tau y' + b

Fitted by least squares on signals after a zero-phase filter, which adds no delay. Rotors share
their errors: the noise of a commanded torque is in the command of each of them. The fit therefore
weights their combinations by the residuals of a first fit (generalized least squares, Aitken 1936).
Otherwise the noisiest axis would determine the lag.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.ndimage import minimum_filter1d
from scipy.signal import butter, sosfiltfilt

from skywright.analysis.identify.fit import BLOCK, CONFIDENCE, choose_held_out
from skywright.analysis.identify.flight_log import FlightLog
from skywright.core.arrays import Array, Ints, Mask
from skywright.recordings.period import compute_period

CUTOFF = 2.0
"""Hz, above the motion of a flight. At higher frequencies, commands are mostly noise. Noise that
changes between two samples makes the fitted lag too long."""
EDGE = 1.0  # s, margin to every excluded sample and the ends: two cycles of the cut-off
RESOLUTION = 0.1
"""Share of a log's sample interval that is added to the half width of a lag. Chosen to cover the
largest error (1.0 ms at 100 Hz) of the simulated flights in docs/howto/identify.md; not derived."""
LEAST = 4  # minimum number of blocks with motion
GAINS, LAGS = (0.2, 5.0), (0.0, 1.0)  # valid range; lags in s
LEAST_R2 = 0.5  # minimum on held-out parts
GAIN_WIDEST, LAG_WIDEST = 0.1, 0.4  # maximum half widths of gain and lag, relative to their values
CLEAR_R2 = 0.7  # minimum for a combination of rotors to state a lag of its own
DISAGREEMENT = 0.5  # maximum distance between the intervals of such lags, relative to the lag
LEAST_NOISE = 0.01  # of the noisiest combination of rotors: minimum noise of any, in the weights


class Lag(NamedTuple):
    """A response to commands; `half_*` are half widths of confidence intervals."""

    name: str
    unit: str
    identified: bool
    reason: str  # why it is not identified
    gain: float
    half_gain: float
    lag: float  # s
    half_lag: float
    offset: float  # in `unit`
    r_squared: float  # on held-out parts


def fit_lag(name: str, unit: str, t: Array, command: Array, response: Array, use: Mask) -> Lag:
    """Fit the responses (k, n) of n equal drives to their commands (k, n), or of one drive (k,).

    A sample is used only if, within EDGE of it, `use` (k,) holds and all values are numbers. `t`
    (k,) s is evenly spaced.
    """

    def give_up(reason: str) -> Lag:
        nan = float("nan")
        return Lag(name, unit, False, reason, nan, nan, nan, nan, nan, nan)

    period = compute_period(t)
    u, y = (x.reshape(len(t), -1) for x in (command, response))
    known = np.all(np.isfinite(u) & np.isfinite(y), axis=1)
    if not known.any():
        return give_up("too little of it in the log")
    use = use & known
    u, y = (_filter(t, x, known, period) for x in (u, y))
    # central difference of fourth order: a gradient would lengthen the lag
    rate = 8.0 * (np.roll(y, -1, 0) - np.roll(y, 1, 0)) - np.roll(y, -2, 0) + np.roll(y, 2, 0)
    rate /= 12.0 * period
    edge = max(round(EDGE / period), 2)
    # a sample counts if all samples within `edge` do: the filter spreads the excluded ones
    keep = minimum_filter1d(use.astype(np.uint8), 2 * edge + 1, mode="constant") > 0
    if keep.sum() * period < LEAST * BLOCK:
        return give_up("too little of it in the log")
    t, u, y, rate = t[keep], u[keep], y[keep], rate[keep]
    if np.max(np.std(u, axis=0)) < 1e-9:
        return give_up("it was never commanded to move")
    X = np.stack([u, -rate, np.ones_like(u)], axis=2)
    held_out = choose_held_out(t)
    A, b = X[~held_out], y[~held_out]
    blocks = np.floor(t[~held_out] / BLOCK).astype(int)
    if len(np.unique(blocks)) < LEAST:
        return give_up("too little of it in the log")
    plain, _ = _fit(A, b, blocks)
    variance, V = _separate(b - A @ plain)
    W = V / np.sqrt(variance)  # combinations with uncorrelated errors of equal size
    found, half = _fit(_combine(A, W), b @ W, blocks)
    half[1] = np.hypot(half[1], RESOLUTION * period)
    gain, lag, offset = found
    test = y[held_out]
    spread = float(np.sum((test - test.mean()) ** 2))
    r2 = 1.0 - float(np.sum((test - X[held_out] @ found) ** 2)) / max(spread, 1e-12)
    if half[0] > GAIN_WIDEST * max(abs(gain), 0.5) or half[1] > LAG_WIDEST * max(abs(lag), 0.01):
        return give_up(
            f"it moved too little: gain {gain:.2f} +- {half[0]:.2f}, lag {1e3 * lag:.1f} +- "
            f"{1e3 * half[1]:.1f} ms"
        )
    if not (GAINS[0] <= gain <= GAINS[1] and LAGS[0] - half[1] <= lag <= LAGS[1]):
        return give_up(
            f"gain {gain:.3g} and lag {lag:.3g} s; possible: {GAINS[0]:g} to {GAINS[1]:g} and "
            f"{LAGS[0]:g} to {LAGS[1]:g} s"
        )
    shortest, longest = _find_extremes(A, b, blocks, V)
    if longest - shortest > DISAGREEMENT * max(lag, 0.01):
        return give_up(
            f"at most {1e3 * shortest:.0f} ms in one combination of the drives and at least "
            f"{1e3 * longest:.0f} ms in another; the commands of the log are not those that the "
            "drives received"
        )
    if not r2 >= LEAST_R2:
        return give_up(f"R² on held-out parts is {r2:.3g}; at least {LEAST_R2:g} is needed")
    return Lag(
        name, unit, True, "", float(gain), float(half[0]), float(lag), float(half[1]),
        float(offset), r2,
    )  # fmt: skip


def _filter(t: Array, x: Array, known: Mask, period: float) -> Array:
    """Return the filtered columns of x (k, n); values that are not `known` are interpolated.

    The filter needs numbers everywhere. Samples near interpolated ones are not used.
    """
    sos = butter(4, min(CUTOFF, 0.35 / period) * 2.0 * period, output="sos")
    filled = [np.interp(t, t[known], column[known]) for column in x.T]
    return np.asarray(sosfiltfilt(sos, np.column_stack(filled), axis=0))


def _fit(A: Array, b: Array, blocks: Ints) -> tuple[Array, Array]:
    """Return the least squares solution (3,) of A (k, n, 3) and b (k, n), and its half widths.

    Errors may be correlated within a block of time, also between drives.
    """
    scale = np.maximum(A.std(axis=(0, 1)), 1e-12)
    scale[2] = 1.0
    A = A / scale
    flat = A.reshape(-1, 3)
    found, *_ = np.linalg.lstsq(flat, b.ravel(), rcond=None)
    error = b - A @ found
    bread = np.linalg.pinv(flat.T @ flat)
    groups = np.unique(blocks)
    scores = np.array([np.einsum("knp,kn->p", A[blocks == k], error[blocks == k]) for k in groups])
    g = len(groups)
    variance = np.maximum(
        np.diag(bread @ (scores.T @ scores) @ bread) * g / (g - 1),
        np.diag(bread) * float(np.mean(error**2)),
    )
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, g - 1)) * np.sqrt(variance)
    return found / scale, half / scale


def _combine(A: Array, W: Array) -> Array:
    """Return the regressors (k, m, 3) of the combinations W (n, m) of drives, from A (k, n, 3)."""
    return np.einsum("knp,nm->kmp", A, W)


def _separate(error: Array) -> tuple[Array, Array]:
    """Return the combinations V (n, n) of drives with uncorrelated errors (k, n), as columns, and
    the variances (n,) of these errors over the largest, at least LEAST_NOISE."""
    variance, V = np.linalg.eigh(error.T @ error / len(error))
    return np.maximum(variance / max(float(variance[-1]), 1e-30), LEAST_NOISE), V


def _find_extremes(A: Array, b: Array, blocks: Ints, V: Array) -> tuple[float, float]:
    """Return the least upper and the greatest lower limit (s) of the lags of the combinations V.

    Combinations that follow their commands (CLEAR_R2) count. If the log contains the commands that
    the drives received, all combinations have the same lag.
    """
    shortest, longest = np.inf, -np.inf
    for v in V.T[:, :, None]:
        X, y = _combine(A, v), b @ v
        found, half = _fit(X, y, blocks)
        if np.mean((y - X @ found) ** 2) <= (1.0 - CLEAR_R2) * np.var(y):
            shortest = min(shortest, found[1] + half[1])
            longest = max(longest, found[1] - half[1])
    return shortest, longest


def fit_servos(log: FlightLog) -> list[Lag]:
    """Fit every joint with a servo."""
    moving = np.all(np.isfinite(log.servo_command), axis=1) & log.free
    return [
        fit_lag(
            name, log.servo_unit, log.t, log.servo_command[:, j], log.servo_response[:, j], moving
        )
        for j, name in enumerate(log.joints)
        if np.any(log.servo_command[:, j]) or np.any(log.servo_response[:, j])
    ]


def fit_rotor_lag(log: FlightLog) -> Lag | None:
    """Fit one lag to all rotors; None if the log lacks speeds or commands."""
    if log.rotor_speed is None or log.rotor_command is None or log.command_is_thrust:
        return None
    middle = log.rotor_speed[log.free].mean(axis=0)
    return fit_lag(
        "rotors", "rad/s", log.t, log.rotor_command - middle, log.rotor_speed - middle, log.free
    )
