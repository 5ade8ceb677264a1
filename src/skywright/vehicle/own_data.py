"""Checks of a user's arrays for an estimator: units, axes and stated noise.

The limits are wide: data within them may still be wrong, data outside are not those of a
multirotor in SI units.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from skywright.errors import InputError
from skywright.recordings.period import compute_period

Array = np.ndarray[Any, np.dtype[np.float64]]

RATES = (20.0, 10_000.0)
"""Hz: slower samples do not follow a multirotor's attitude; no inertial unit is faster."""
LONGEST = 5.0
"""s, largest median period of fixes: satellite receivers give at least one fix a second."""
FASTEST_TURN = 35.0
"""rad/s: 2000 deg/s, the range of common gyroscopes; less in a mean over a record."""
SPECIFIC_FORCE = (0.3, 4.0)
"""g, of the median magnitude of means over BLOCK, in which vibration averages out: aggressive
flight has more than 1 g; 0.3 g is less than on the Moon only if the robot falls."""
BLOCK = 0.5  # s
MOST_TILT = 60.0
"""deg between the mean specific force and up. Only a change of speed of 1.7 g T during a record of
length T tilts it further."""
FARTHEST = 20_000.0
"""m from the median position; of 95 % of the fixes, as some are artefacts."""
FASTEST = 100.0
"""m/s, faster than multirotors fly; over SPAN, in which the noise of fixes hardly counts."""
SPAN = 0.5  # s
IN_A_ROW = 5
"""Rejected fixes in a row of which a caller is warned: single ones are artefacts."""
FEW = 10  # fixes that start every estimator


def check_units(
    t: Array, gyro: Array, accel: Array, t_fix: Array, p_fix: Array, R_fix: Array | None,
    gravity: float,
) -> None:  # fmt: skip
    """Raise InputError, which names the argument, for data that no multirotor gives in SI units."""
    rate = 1.0 / compute_period(t)
    if not RATES[0] <= rate <= RATES[1]:
        raise InputError(
            f"t: {rate:.4g} samples per second; valid: {RATES[0]:g} to {RATES[1]:g}, with times "
            "in s"
        )
    period = float(np.median(np.diff(t_fix))) if len(t_fix) > 1 else 0.0
    if period > 1.001 * LONGEST:
        raise InputError(
            f"t_fix: {period:.4g} s from fix to fix; valid: at most {LONGEST:g}, with times in s"
        )
    turn = float(np.sqrt(np.mean(np.sum(gyro**2, axis=1))))
    if turn > FASTEST_TURN:
        raise InputError(f"gyro: {turn:.4g} rad/s rms; valid: at most {FASTEST_TURN:g} rad/s")
    n = max(round(BLOCK * rate), 1)
    blocks = [accel[i : i + n].mean(axis=0) for i in range(0, len(t), n)]
    force = float(np.median(np.linalg.norm(blocks, axis=1)))
    low, high = SPECIFIC_FORCE[0] * gravity, SPECIFIC_FORCE[1] * gravity
    if not low <= force <= high:
        raise InputError(
            f"accel: magnitude {force:.4g} m/s^2; valid: {low:.3g} to {high:.3g} m/s^2, as "
            f"the specific force at rest is {gravity:.3g} m/s^2"
        )
    _check_up(t, accel, t_fix, R_fix, gravity)
    away = np.linalg.norm(p_fix - np.median(p_fix, axis=0), axis=1)
    far = float(np.percentile(away, 95.0))
    if far > FARTHEST:
        raise InputError(f"p_fix: {far:.4g} m from its median; valid: at most {FARTHEST:g} m, in m")
    later = np.searchsorted(t_fix, t_fix + SPAN)
    k = np.flatnonzero(later < len(t_fix))
    if len(k):
        moved = np.linalg.norm(p_fix[later[k]] - p_fix[k], axis=1)
        speed = float(np.percentile(moved / (t_fix[later[k]] - t_fix[k]), 95.0))
        if speed > FASTEST:
            raise InputError(
                f"p_fix: moves at {speed:.4g} m/s; valid: at most {FASTEST:g} m/s, with p_fix in m "
                "and t_fix in s"
            )


def _check_up(t: Array, accel: Array, t_fix: Array, R_fix: Array | None, gravity: float) -> None:
    """Raise InputError unless the mean specific force points up."""
    if R_fix is None:
        frame, names, axes = "B", "accel", "B's z axis points up"
        mean = accel.mean(axis=0)
    else:
        frame, names, axes = "W", "accel, R_fix", "R_fix turns B (z up) to W (z up)"
        near = np.clip(np.searchsorted(t_fix, t), 0, len(t_fix) - 1)
        mean = np.einsum("nij,nj->i", R_fix[near], accel) / len(t)
    if mean[2] < np.cos(np.deg2rad(MOST_TILT)) * np.linalg.norm(mean):
        x, y, z = mean
        raise InputError(
            f"{names}: the mean specific force in {frame} is ({x:.2f}, {y:.2f}, {z:.2f}) m/s^2; "
            f"valid: within {MOST_TILT:g} deg of up, as it is (0, 0, {gravity:.2f}) at rest, where "
            f"{axes}"
        )


class Innovations:
    """Differences between the fixes and the estimate before each of them."""

    def __init__(self) -> None:
        self.p: list[Array] = []
        self.turn: list[Array] = []
        self.longest, self.restarts = 0.0, 0.0

    def add(self, p: Array, turn: Array, state: Any) -> None:
        """Add that of a position (m) and an angle or rotation vector (rad), after a step."""
        self.p.append(p)
        self.turn.append(turn)
        if state is not None:
            self.longest = max(self.longest, float(state.rejected))
            self.restarts = float(state.restarts)

    def judge(self, stated: dict[str, float], ready: bool) -> None:
        """Warn of fixes that the estimator rejected in a row; raise InputError if none started it.

        `stated` are the noises (1 sigma) that the estimator assumed, by key: of the position, then
        of the angle.
        """
        n = len(self.p)
        if not ready and n >= FEW:
            step = np.median(np.linalg.norm(np.diff(np.array(self.p), axis=0), axis=1))
            raise InputError(
                f"p_fix: {n} fixes did not start the estimator; they differ by {step:.3g} m from "
                "one to the next; valid: positions in m, on the clock of t"
            )
        if self.longest < IN_A_ROW and self.restarts == 0.0:
            return
        found = [_scatter(np.array(self.p)), _scatter(np.array(self.turn))]
        text = "; ".join(
            f"{key} = {value:.2g} (found: {sigma:.2g})"
            for (key, value), sigma in zip(stated.items(), found, strict=True)
        )
        warnings.warn(
            f"run_estimator: the estimator rejected {self.longest:.0f} fixes in a row and "
            f"restarted {self.restarts:.0f} times, so its estimate is poor there. It assumed "
            f"{text}. If the noise found is larger, set these keys: "
            "skywright.load(mission, sets={...}); otherwise compare axes, clocks and units",
            stacklevel=4,
        )


def _scatter(values: Array) -> float:
    """Return the deviation (1 sigma per axis) of noise in innovations, artefacts apart."""
    if len(values) < 2:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values, axis=0))) / np.sqrt(2.0))
