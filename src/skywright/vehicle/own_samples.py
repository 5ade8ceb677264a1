"""Checks of your own inertial samples and position fixes before an estimator runs on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from skywright.errors import InputError

Array = NDArray[np.float64]


def check_samples(
    t: ArrayLike, gyro: ArrayLike, accel: ArrayLike, t_fix: ArrayLike, p_fix: ArrayLike,
    R_fix: ArrayLike | None, heading: ArrayLike | None,
) -> tuple[Array, Array, Array, Array, Array, Array | None, Array | None]:  # fmt: skip
    """Return the arguments of `skywright.run_estimator` as arrays, attitudes as matrices.

    Raises InputError, which names the argument, for a wrong shape, a number that is not finite,
    times that do not rise or are not evenly spaced, and an attitude that is not a rotation.
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
    """Return an array of numbers; () for what is none."""
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
    if _read(value).shape[1:] == (4,):
        q = _check(name, value, (4,), n)
        wrong = np.abs(np.linalg.norm(q, axis=1) - 1.0) > 1e-3
        if np.any(wrong):
            raise InputError(
                f"{name}: row {int(np.argmax(wrong))} is not a rotation; valid: quaternions of "
                "the length 1, within 0.001"
            )
        return Rotation.from_quat(q, scalar_first=True).as_matrix()
    if _read(value).shape[1:] != (3, 3):
        raise InputError(
            f"{name}: has the shape {_read(value).shape}; valid: ({n}, 3, 3) or ({n}, 4)"
        )
    R = _check(name, value, (3, 3), n)
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = (off > 1e-3) | (np.abs(np.linalg.det(R) - 1.0) > 2e-3)
    if np.any(wrong):
        raise InputError(
            f"{name}: row {int(np.argmax(wrong))} is not a rotation; valid: orthonormal matrices "
            "with the determinant 1, within 0.001"
        )
    return R
