"""Fusing a fix of a point of the robot, with or without a heading, into the error-state filter.

A position alone does not tell a robot that flies straight which way it faces: heading is observable
through horizontal acceleration only, and a transport hardly accelerates. So a fix brings a heading
(two antennas, or a magnetometer); roll and pitch follow from gravity.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import cross, mat_vec
from skywright.estimation.kalman import correct, inject, place_point
from skywright.estimation.strapdown import BA_, BG_, MASK, N_STATE, P_, R_, V_

Record = Any
Array = Any

GATES = (16.27, 18.47)  # chi-square of 3 and of 4 at 99.9 %
LEVEL_SAMPLES = 256  # inertial samples at rest from which roll and pitch are taken at the start


@njit(cache=True, error_model="numpy")
def fuse_fix(flt: Record, meas: Record) -> bool:
    """Fuse a fix taken at the horizon; False when the gate rejects it."""
    n = 4 if flt.r_heading > 0.0 else 3
    H, nu, r, lever = np.zeros((n, N_STATE)), np.empty(n), np.empty(n), np.empty(3)
    dx = np.empty(N_STATE)
    place_point(flt, flt.p_BF, H, lever)
    for i in range(3):
        nu[i] = meas.fix_p[i] - (flt.p_f[i] + lever[i])
        r[i] = flt.r_fix[i]
    if n == 4:  # a turn about W's z is the heading's
        off = meas.fix_heading - math.atan2(flt.R_f[1, 0], flt.R_f[0, 0])
        nu[3] = math.atan2(math.sin(off), math.cos(off))
        H[3, R_ + 2], r[3] = 1.0, flt.r_heading
    flt.nis = correct(flt.P, H, nu, r, GATES[n - 3], dx)
    if not flt.nis < GATES[n - 3]:
        return False
    inject(flt, dx)
    return True


@njit(cache=True, error_model="numpy")
def start_from_fix(flt: Record, meas: Record, n: int, gravity: float, speed: float) -> None:
    """Begin at rest at a fix taken at inertial sample `n`: level by gravity, facing as it says.

    `speed` (m/s) is one sigma of how much at rest. The tilt is wrong by the accelerometer's bias
    over g, and the filter is told that the two belong together.
    """
    f, x, y, z = np.zeros(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(max(flt.n - LEVEL_SAMPLES, 0), flt.n):
        for i in range(3):
            f[i] += flt.accel[k & MASK, i]
    # rows of R_WB: up is where the specific force points, x faces along the heading
    size = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    for i in range(3):
        z[i] = f[i] / size
    # in B, the level axis ahead: B's x less its part along z
    for i in range(3):
        x[i] = (1.0 if i == 0 else 0.0) - z[0] * z[i]
    size = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for i in range(3):
        x[i] /= size
    cross(z, x, y)
    c, s = math.cos(meas.fix_heading), math.sin(meas.fix_heading)
    flt.P[:, :] = 0.0
    for i in range(3):
        flt.R_f[0, i] = c * x[i] - s * y[i]
        flt.R_f[1, i] = s * x[i] + c * y[i]
        flt.R_f[2, i] = z[i]
        flt.v_f[i] = flt.bg[i] = flt.ba[i] = 0.0
        flt.P[P_ + i, P_ + i] = flt.r_fix[i]
        flt.P[V_ + i, V_ + i] = speed * speed
        flt.P[BG_ + i, BG_ + i] = flt.p_bg
        flt.P[BA_ + i, BA_ + i] = flt.p_ba
    d = np.empty(3)
    for i in range(3):
        d[i] = flt.p_BI[i] - flt.p_BF[i]
    mat_vec(flt.R_f, d, x)
    for i in range(3):
        flt.p_f[i] = meas.fix_p[i] + x[i]
    # at rest R f = g z + b_W, taken for z, is level when turned by (-b_y, b_x) / g
    for i in range(2):
        flt.P[R_ + i, R_ + i] = flt.p_ba / (gravity * gravity) + 1e-6
    flt.P[R_ + 2, R_ + 2] = max(flt.r_heading, 1e-6)
    for j in range(3):
        about_x = -flt.R_f[1, j] * flt.p_ba / gravity
        about_y = flt.R_f[0, j] * flt.p_ba / gravity
        flt.P[R_, BA_ + j] = flt.P[BA_ + j, R_] = about_x
        flt.P[R_ + 1, BA_ + j] = flt.P[BA_ + j, R_ + 1] = about_y
    flt.n_f = n
    flt.ready = 2.0
    flt.rejected_row = 0


@njit(cache=True, error_model="numpy")
def move_to_fix(flt: Record, meas: Record, speed: float, turn: float) -> None:
    """Go to a fix where the filter lost its place; velocity and attitude stay, less certain.

    `speed` (m/s) and `turn` (rad) are one sigma more.
    """
    d, lever = np.empty(3), np.empty(3)
    for i in range(3):
        d[i] = flt.p_BI[i] - flt.p_BF[i]
    mat_vec(flt.R_f, d, lever)
    for i in range(3):
        flt.p_f[i] = meas.fix_p[i] + lever[i]
        for j in range(N_STATE):
            flt.P[P_ + i, j] = flt.P[j, P_ + i] = 0.0
        flt.P[P_ + i, P_ + i] = flt.r_fix[i]
        flt.P[V_ + i, V_ + i] += speed * speed
        flt.P[R_ + i, R_ + i] += turn * turn
    flt.rejected_row = 0
