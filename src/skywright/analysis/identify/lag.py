"""Response of rotors and servos to their commands: gain, first-order lag and offset.

    y = K u - tau y' + b

Fitted by least squares on signals after a zero-phase filter, which adds no delay.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.signal import butter, sosfiltfilt

from skywright.analysis.identify.fit import BLOCK, CONFIDENCE, choose_held_out
from skywright.analysis.identify.flight_log import FlightLog
from skywright.core.arrays import Array, Mask
from skywright.recordings.period import compute_period

CUTOFF = 5.0  # Hz
LEAST = 4  # minimum number of blocks with motion
GAINS, LAGS = (0.2, 5.0), (0.0, 1.0)  # valid range; lags in s
LEAST_R2 = 0.5  # minimum on held-out parts
GAIN_WIDEST, LAG_WIDEST = 0.1, 0.4  # maximum half widths of gain and lag, relative to their values


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
    """Fit a response (k,) to its command (k,) where `use` holds and both are numbers.

    `t` (k,) s is evenly spaced.
    """

    def give_up(reason: str) -> Lag:
        nan = float("nan")
        return Lag(name, unit, False, reason, nan, nan, nan, nan, nan, nan)

    period = compute_period(t)
    sos = butter(4, min(CUTOFF, 0.35 / period) * 2 * period, output="sos")
    known = np.isfinite(command) & np.isfinite(response)
    if not known.any():
        return give_up("too little of it in the log")
    use = use & known
    # the filter needs numbers everywhere; samples near interpolated ones are not used
    u, y = (np.asarray(sosfiltfilt(sos, np.interp(t, t[known], x[known])))
            for x in (command, response))  # fmt: skip
    rate = np.gradient(y, period)
    edge = round(0.5 / period)
    keep = use.copy()
    for shift in (-edge, edge):  # keep a margin to excluded samples
        moved = np.roll(use, shift)
        keep &= moved
    keep[:edge] = keep[-edge:] = False
    if keep.sum() * period < LEAST * BLOCK:
        return give_up("too little of it in the log")
    t, u, y, rate = t[keep], u[keep], y[keep], rate[keep]
    if np.std(u) < 1e-9:
        return give_up("it was never commanded to move")
    X = np.column_stack([u, -rate, np.ones(len(u))])
    held_out = choose_held_out(t)
    A, b = X[~held_out], y[~held_out]
    scale = np.maximum(A.std(axis=0), 1e-12)
    scale[2] = 1.0
    found, *_ = np.linalg.lstsq(A / scale, b, rcond=None)
    error = b - A / scale @ found
    bread = np.linalg.pinv((A / scale).T @ (A / scale))
    blocks = np.floor(t[~held_out] / BLOCK).astype(int)
    scores = np.array([(A / scale)[blocks == k].T @ error[blocks == k] for k in np.unique(blocks)])
    g = len(scores)
    if g < LEAST:
        return give_up("too little of it in the log")
    variance = np.maximum(
        np.diag(bread @ (scores.T @ scores) @ bread) * g / (g - 1),
        np.diag(bread) * float(np.mean(error**2)),
    )
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, g - 1)) * np.sqrt(variance) / scale
    gain, lag, offset = found / scale
    test = y[held_out]
    spread = float(np.sum((test - test.mean()) ** 2))
    r2 = 1.0 - float(np.sum((test - X[held_out] @ (found / scale)) ** 2)) / max(spread, 1e-12)
    if half[0] > GAIN_WIDEST * max(abs(gain), 0.5) or half[1] > LAG_WIDEST * max(abs(lag), 0.01):
        return give_up(f"it moved too little: gain {gain:.2f} +- {half[0]:.2f}")
    if not (GAINS[0] <= gain <= GAINS[1] and LAGS[0] - half[1] <= lag <= LAGS[1]):
        return give_up(
            f"gain {gain:.3g} and lag {lag:.3g} s; possible: {GAINS[0]:g} to {GAINS[1]:g} and "
            f"{LAGS[0]:g} to {LAGS[1]:g} s"
        )
    if not r2 >= LEAST_R2:
        return give_up(f"R² on held-out parts is {r2:.3g}; at least {LEAST_R2:g} is needed")
    return Lag(
        name, unit, True, "", float(gain), float(half[0]), float(lag), float(half[1]),
        float(offset), r2,
    )  # fmt: skip


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
    n = log.rotor_speed.shape[1]
    middle = log.rotor_speed[log.free].mean(axis=0)
    period = log.period
    gap = round(2.0 / period)  # between the records of two rotors
    length = len(log.t) + gap
    t = period * np.arange(n * length)
    command, response = np.zeros(n * length), np.zeros(n * length)
    use = np.zeros(n * length, dtype=bool)
    for i in range(n):
        at = slice(i * length, i * length + len(log.t))
        command[at] = log.rotor_command[:, i] - middle[i]
        response[at] = log.rotor_speed[:, i] - middle[i]
        use[at] = log.free
    return fit_lag("rotors", "rad/s", t, command, response, use)
