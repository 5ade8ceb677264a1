"""Checks of a user's arrays for an estimator: shapes, times, units, axes and stated noise.

The limits are wide: data within them may still be wrong, data outside are not those of a
multirotor in SI units.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skywright.core.rotations import rot_from_quat
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


def check_samples(
    t: ArrayLike, gyro: ArrayLike, accel: ArrayLike, t_fix: ArrayLike, p_fix: ArrayLike,
    R_fix: ArrayLike | None, heading: ArrayLike | None,
) -> tuple[Array, Array, Array, Array, Array, Array | None, Array | None]:  # fmt: skip
    """Return the arguments of `skywright.run_estimator` as arrays, attitudes as matrices.

    Raises InputError, which names the argument, for a wrong shape, a number that is not finite,
    times that are not ascending or not evenly spaced, and an attitude that is not a rotation.
    """
    times, fixed = _check("t", t, ()), _check("t_fix", t_fix, ())
    n, m = len(times), len(fixed)
    if n < 2 or not np.allclose(np.diff(times), np.median(np.diff(times)), rtol=0.2, atol=0.0):
        raise InputError(
            f"t: {_tell_times(times)}; valid: at least two times (s), evenly spaced within 20 %"
        )
    if not np.median(np.diff(times)) > 0.0:
        raise InputError(f"t: {_tell_times(times)}; valid: ascending times (s)")
    if not np.all(np.diff(fixed) > 0.0):
        raise InputError(f"t_fix: {_tell_times(fixed)}; valid: ascending times (s)")
    return (
        times, _check("gyro", gyro, (3,), n), _check("accel", accel, (3,), n),
        fixed, _check("p_fix", p_fix, (3,), m),
        None if R_fix is None else _check_rotations("R_fix", R_fix, m),
        None if heading is None else _check("heading", heading, (), m),
    )  # fmt: skip


def _read(value: ArrayLike) -> Array:
    """Return an array of numbers; one of the shape () if the value is none."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        return np.zeros(())


def _check(name: str, value: ArrayLike, shape: tuple[int, ...], n: int | None = None) -> Array:
    """Return an array (n, *shape) of finite numbers; raise InputError with the argument's name."""
    out = _read(value)
    rows = "n" if n is None else n
    wanted = f"({', '.join(map(str, (rows, *shape)))}{'' if shape else ','})"
    if out.ndim != 1 + len(shape) or out.shape[1:] != shape or n not in (None, len(out)):
        raise InputError(f"{name}: has the shape {out.shape}; valid: {wanted}")
    if not np.all(np.isfinite(out)):
        raise InputError(f"{name}: row {int(np.argwhere(~np.isfinite(out))[0, 0])} is not finite")
    return out


def _tell_times(t: Array) -> str:
    """Describe the spacing of times for a message."""
    if len(t) < 2:
        return f"{len(t)} times"
    return f"steps from {np.min(np.diff(t)):g} to {np.max(np.diff(t)):g} s"


def _check_rotations(name: str, value: ArrayLike, n: int) -> Array:
    """Return rotation matrices (n, 3, 3) of matrices, or of quaternions (n, 4) with w first.

    Raises InputError, which names the row that is not a rotation.
    """
    shape = _read(value).shape
    if shape[1:] == (4,):
        q = _check(name, value, (4,), n)
        wrong = np.abs(np.linalg.norm(q, axis=1) - 1.0) > 1e-3
        if np.any(wrong):
            raise InputError(
                f"{name}: row {int(np.argmax(wrong))} is not a rotation; valid: quaternions of "
                "the length 1, within 0.001"
            )
        return np.array([rot_from_quat(one) for one in q])
    if shape[1:] != (3, 3):
        raise InputError(f"{name}: has the shape {shape}; valid: ({n}, 3, 3) or ({n}, 4)")
    R = _check(name, value, (3, 3), n)
    wrong = ~_are_rotations(R)
    if np.any(wrong):
        raise InputError(
            f"{name}: row {int(np.argmax(wrong))} is not a rotation; valid: orthonormal matrices "
            "with the determinant 1, within 0.001"
        )
    return R


def _are_rotations(R: Array) -> NDArray[np.bool_]:
    """Return which matrices (n, 3, 3) are rotations, within 0.001."""
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    return np.asarray((off <= 1e-3) & (np.abs(np.linalg.det(R) - 1.0) <= 2e-3))


def check_record(name: str, record: Any) -> None:
    """Raise InputError, which names the field, if a record has a number that is not finite, or a
    matrix that is not a rotation."""
    for field in record.dtype.names:
        value = np.asarray(record[field])
        if not np.all(np.isfinite(value)):
            raise InputError(f"{name}.{field}: {value.tolist()}; valid: finite numbers")
        if field.startswith("R_") and not _are_rotations(value[None]).all():
            raise InputError(
                f"{name}.{field}: {value.tolist()} is not a rotation; valid: an orthonormal matrix "
                "with the determinant 1, within 0.001"
            )


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
