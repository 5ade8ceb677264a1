"""Rotations and 3 x 3 linear algebra, compiled. Quaternions are wxyz, unit.

The loops are written out: a BLAS call on a 3 x 3 matrix costs more than the product.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper

Array = NDArray[np.float64]


@helper
def mat_vec(m: Array, v: Array, out: Array) -> None:
    """out = m @ v for 3 x 3 `m`; `out` must not alias `v`."""
    for i in range(3):
        out[i] = m[i, 0] * v[0] + m[i, 1] * v[1] + m[i, 2] * v[2]


@helper
def mat_t_vec(m: Array, v: Array, out: Array) -> None:
    """out = m.T @ v for 3 x 3 `m`; `out` must not alias `v`."""
    for i in range(3):
        out[i] = m[0, i] * v[0] + m[1, i] * v[1] + m[2, i] * v[2]


@helper
def mat_mat(a: Array, b: Array, out: Array) -> None:
    """out = a @ b for 3 x 3 matrices; `out` must not alias."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@helper
def mat_t_mat(a: Array, b: Array, out: Array) -> None:
    """out = a.T @ b for 3 x 3 matrices; `out` must not alias."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]


@helper
def cross(a: Array, b: Array, out: Array) -> None:
    """out = a x b; `out` must not alias."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@helper
def dot(a: Array, b: Array) -> float:
    """Inner product of two 3-vectors."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@helper
def norm(a: Array) -> float:
    """Length of a 3-vector."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@helper
def solve3(M: Array, y: Array, x: Array) -> None:
    """Solve the symmetric positive definite M x = y, (3, 3) and (3,), by Cholesky."""
    a = math.sqrt(M[0, 0])
    b, c = M[1, 0] / a, M[2, 0] / a
    d = math.sqrt(M[1, 1] - b * b)
    e = (M[2, 1] - c * b) / d
    f = math.sqrt(M[2, 2] - c * c - e * e)
    u = y[0] / a
    v = (y[1] - b * u) / d
    w = (y[2] - c * u - e * v) / f
    x[2] = w / f
    x[1] = (v - e * x[2]) / d
    x[0] = (u - b * x[1] - c * x[2]) / a


@helper
def exp_so3(w: Array, out: Array) -> None:
    """out = rotation matrix of the rotation vector `w` (Rodrigues)."""
    angle = norm(w)
    if angle < 1e-8:  # series: the closed form divides zero by zero
        a, b = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    x, y, z = w[0], w[1], w[2]
    out[0, 0] = 1.0 - b * (y * y + z * z)
    out[0, 1] = b * x * y - a * z
    out[0, 2] = b * x * z + a * y
    out[1, 0] = b * x * y + a * z
    out[1, 1] = 1.0 - b * (x * x + z * z)
    out[1, 2] = b * y * z - a * x
    out[2, 0] = b * x * z - a * y
    out[2, 1] = b * y * z + a * x
    out[2, 2] = 1.0 - b * (x * x + y * y)


@helper
def log_so3(r: Array, out: Array) -> None:
    """out = rotation vector of the rotation matrix `r`, angle in [0, pi]."""
    w, x, y, z = _quaternion(r)
    sign = 1.0 if w >= 0.0 else -1.0
    s = math.sqrt(x * x + y * y + z * z)
    k = 2.0 if s < 1e-12 else 2.0 * math.atan2(s, sign * w) / s
    out[0], out[1], out[2] = sign * k * x, sign * k * y, sign * k * z


@helper
def orthonormalise(r: Array) -> None:
    """One Gram-Schmidt pass in place, keeping the z column's direction (first-order exact)."""
    n = math.sqrt(r[0, 2] ** 2 + r[1, 2] ** 2 + r[2, 2] ** 2)
    for i in range(3):
        r[i, 2] /= n
    d = r[0, 0] * r[0, 2] + r[1, 0] * r[1, 2] + r[2, 0] * r[2, 2]
    for i in range(3):
        r[i, 0] -= d * r[i, 2]
    n = math.sqrt(r[0, 0] ** 2 + r[1, 0] ** 2 + r[2, 0] ** 2)
    for i in range(3):
        r[i, 0] /= n
    r[0, 1] = r[1, 2] * r[2, 0] - r[2, 2] * r[1, 0]
    r[1, 1] = r[2, 2] * r[0, 0] - r[0, 2] * r[2, 0]
    r[2, 1] = r[0, 2] * r[1, 0] - r[1, 2] * r[0, 0]


@helper
def quat_to_rot(q: Array, out: Array) -> None:
    """out = rotation matrix of the unit quaternion `q` (wxyz)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[0, 1] = 2.0 * (x * y - w * z)
    out[0, 2] = 2.0 * (x * z + w * y)
    out[1, 0] = 2.0 * (x * y + w * z)
    out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[1, 2] = 2.0 * (y * z - w * x)
    out[2, 0] = 2.0 * (x * z - w * y)
    out[2, 1] = 2.0 * (y * z + w * x)
    out[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@helper
def _quaternion(r: Array) -> tuple[float, float, float, float]:
    """Return the unit quaternion (wxyz) of the rotation matrix `r` (Shepperd's branches)."""
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        x, y, z = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        return 0.25 * s, x / s, y / s, z / s
    if r[0, 0] > r[1, 1] and r[0, 0] > r[2, 2]:
        s = 2.0 * math.sqrt(1.0 + r[0, 0] - r[1, 1] - r[2, 2])
        w, y, z = r[2, 1] - r[1, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]
        return w / s, 0.25 * s, y / s, z / s
    if r[1, 1] > r[2, 2]:
        s = 2.0 * math.sqrt(1.0 + r[1, 1] - r[0, 0] - r[2, 2])
        w, x, z = r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 2] + r[2, 1]
        return w / s, x / s, 0.25 * s, z / s
    s = 2.0 * math.sqrt(1.0 + r[2, 2] - r[0, 0] - r[1, 1])
    w, x, y = r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    return w / s, x / s, y / s, 0.25 * s


@helper
def rot_to_quat(r: Array, out: Array) -> None:
    """out = unit quaternion (wxyz) of the rotation matrix `r`."""
    out[0], out[1], out[2], out[3] = _quaternion(r)


@helper
def rot_about(axis: int, angle: float, out: Array) -> None:
    """out = rotation by `angle` about the coordinate axis 0, 1 or 2."""
    c, s = math.cos(angle), math.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    for i in range(3):
        for n in range(3):
            out[i, n] = 0.0
    out[axis, axis] = 1.0
    out[j, j] = c
    out[k, k] = c
    out[j, k] = -s
    out[k, j] = s


def rot_x(angle: float) -> Array:
    """Return the (3, 3) rotation about x."""
    out = np.empty((3, 3))
    rot_about(0, angle, out)
    return out


def rot_y(angle: float) -> Array:
    """Return the (3, 3) rotation about y."""
    out = np.empty((3, 3))
    rot_about(1, angle, out)
    return out


def rot_z(angle: float) -> Array:
    """Return the (3, 3) rotation about z."""
    out = np.empty((3, 3))
    rot_about(2, angle, out)
    return out


def quat_from_rot(r: Array) -> Array:
    """Return the (4,) wxyz quaternion of a rotation matrix."""
    out = np.empty(4)
    rot_to_quat(np.ascontiguousarray(r, dtype=float), out)
    return out


def rot_from_quat(q: Array) -> Array:
    """Return the (3, 3) matrix of a wxyz quaternion, which is normalised first."""
    out = np.empty((3, 3))
    q = np.asarray(q, dtype=float)
    quat_to_rot(q / np.linalg.norm(q), out)
    return out
