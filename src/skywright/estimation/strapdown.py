"""Strapdown integration of inertial samples, and the covariance that goes with it.

The error is (dp, dv, dtheta, db_g, db_a) with the attitude's in W (estimation/error_state.py). Its
F has four blocks off the diagonal, so F P F' is shears of block rows (`shear`), one a block,
instead of two dense 15 x 15 products.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from skywright.core.types import IMU_HISTORY

Record = Any
Array = Any

P_, V_, R_, BG_, BA_ = 0, 3, 6, 9, 12  # where the error's parts start
N_STATE = 15
MASK = IMU_HISTORY - 1  # of an index into the ring of samples


@njit(cache=True, error_model="numpy")
def integrate(
    flt: Record, first: int, last: int, gravity: float, p: Array, v: Array, R: Array,
    dv: Array, turn: Array,
) -> None:  # fmt: skip
    """Strapdown integration of the samples first..last-1, in place.

    `dv` (3,) returns the integral of R f (m/s), `turn` (3, 3) that of R (s). A sample holds the
    mean over its period, so the force is rotated with the attitude in the middle of it.
    """
    h = flt.h
    for i in range(3):
        dv[i] = 0.0
        for j in range(3):
            turn[i, j] = 0.0
    g0, g1, g2 = flt.bg[0], flt.bg[1], flt.bg[2]
    a0, a1, a2 = flt.ba[0], flt.ba[1], flt.ba[2]
    for n in range(first, last):
        k = n & MASK
        x, y, z = h * (flt.gyro[k, 0] - g0), h * (flt.gyro[k, 1] - g1), h * (flt.gyro[k, 2] - g2)
        fx, fy, fz = flt.accel[k, 0] - a0, flt.accel[k, 1] - a1, flt.accel[k, 2] - a2
        mx = fx + 0.5 * (y * fz - z * fy)
        my = fy + 0.5 * (z * fx - x * fz)
        mz = fz + 0.5 * (x * fy - y * fx)
        # exp of a turn of millirad: the series to fifth order is exact to rounding
        s = x * x + y * y + z * z
        a = 1.0 - s * (1.0 / 6.0) * (1.0 - s * 0.05)
        b = 0.5 - s * (1.0 / 24.0)
        for i in range(3):
            r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
            f = h * (r0 * mx + r1 * my + r2 * mz)
            dv[i] += f
            old = v[i]
            v[i] = old + f
            turn[i, 0] += h * r0
            turn[i, 1] += h * r1
            turn[i, 2] += h * r2
            if i == 2:
                v[i] -= h * gravity
            p[i] += 0.5 * h * (old + v[i])
            # row of R (I + a [t] + b [t]^2) = r + a (r x t) + b ((r x t) x t)
            c0, c1, c2 = r1 * z - r2 * y, r2 * x - r0 * z, r0 * y - r1 * x
            R[i, 0] = r0 + a * c0 + b * (c1 * z - c2 * y)
            R[i, 1] = r1 + a * c1 + b * (c2 * x - c0 * z)
            R[i, 2] = r2 + a * c2 + b * (c0 * y - c1 * x)


@njit(cache=True, error_model="numpy")
def shear(P: Array, i: int, j: int, M: Array) -> None:
    """P <- S P S' with S = I + M in block (i, j): x_i += M x_j."""
    for r in range(3):
        m0, m1, m2 = M[r, 0], M[r, 1], M[r, 2]
        for c in range(P.shape[1]):
            P[i + r, c] += m0 * P[j, c] + m1 * P[j + 1, c] + m2 * P[j + 2, c]
    for r in range(3):
        x, y, z = P[i + r, j], P[i + r, j + 1], P[i + r, j + 2]
        for c in range(3):
            P[i + r, i + c] += x * M[c, 0] + y * M[c, 1] + z * M[c, 2]
    _mirror(P, i)


@njit(cache=True, error_model="numpy")
def _drift(P: Array, dt: float) -> None:
    """P <- S P S' with x_p += dt x_v."""
    for r in range(3):
        for c in range(P.shape[1]):
            P[r, c] += dt * P[3 + r, c]
    for r in range(3):
        for c in range(3):
            P[r, c] += dt * P[r, 3 + c]
    _mirror(P, 0)


@njit(cache=True, error_model="numpy")
def _mirror(P: Array, i: int) -> None:
    """Copy block row `i` to block column `i`."""
    for c in range(P.shape[1]):
        for r in range(3):
            P[c, i + r] = P[i + r, c]


@njit(cache=True, error_model="numpy")
def propagate_covariance(flt: Record, P: Array, dv: Array, turn: Array, dt: float) -> None:
    """Advance `P` by `dt`: dp' = dv, dv' = -[R f] dtheta - R db_a, dtheta' = -R db_g, plus noise.

    Half of the drift before and half after makes the step exact to second order. Rows of `P`
    beyond the 15 belong to states that stay as they are.
    """
    M = np.zeros((3, 3))
    M[0, 1], M[0, 2], M[1, 2] = dv[2], -dv[1], dv[0]
    M[1, 0], M[2, 0], M[2, 1] = -dv[2], dv[1], -dv[0]
    _drift(P, 0.5 * dt)
    shear(P, V_, R_, M)
    for i in range(3):
        for j in range(3):
            M[i, j] = -turn[i, j]
    shear(P, V_, BA_, M)
    shear(P, R_, BG_, M)
    _drift(P, 0.5 * dt)
    for i in range(3):
        P[V_ + i, V_ + i] += dt * flt.q_v
        P[R_ + i, R_ + i] += dt * flt.q_R
        P[BG_ + i, BG_ + i] += dt * flt.q_bg
        P[BA_ + i, BA_ + i] += dt * flt.q_ba
