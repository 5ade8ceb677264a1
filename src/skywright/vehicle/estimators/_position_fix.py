"""Fusion of a fix of a point of the robot, with or without a heading, into the error-state filter.

From positions alone, heading is observable only during horizontal acceleration, which is small in a
transport flight. A fix therefore includes a heading (two antennas, or a magnetometer). Roll and
pitch follow from gravity.
"""

from __future__ import annotations

import math
from typing import Any

from skywright.core.record import Record, Vec3
from skywright.core.rotations import cross, mat_vec
from skywright.core.scratch import local
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._kalman import correct, inject, place_point
from skywright.vehicle.estimators._noise import (
    KNOWN_AFTER,
    LEAST,
    MOST,
    ROW,
    compute_product,
    compute_scatter,
    keep_innovation,
    widen,
)
from skywright.vehicle.estimators._strapdown import (
    BA_,
    BG_,
    HOLD_ACCEL,
    HOLD_RATE,
    MASK,
    N_STATE,
    P_,
    R_,
    V_,
)

GATES = (16.27, 18.47)  # chi-square of 3 and of 4 degrees of freedom at 99.9 %
LONGEST_S = 1.0  # s without a fix whose errors of the inertial unit are accounted for
LEVEL_SAMPLES = 256  # inertial samples at rest that give roll and pitch at the start


class FixNoise(Record):
    """Noise of fixes."""

    p_BF: Vec3  # m, the measured point
    r_fix: Vec3  # m^2
    r_heading: float  # rad^2; 0: no heading
    more_fix: float  # r_fix over that of the data sheet; 1: nothing was learned
    more_heading: float


@helper
def fuse_fix(me: Any, fix: Any) -> bool:
    """Fuse a fix taken at the horizon; returns False if the gate rejects it."""
    n = 4 if me.r_heading > 0.0 else 3
    H, nu, r, lever = local(4, N_STATE), local(4), local(4), local(3)
    dx, before = local(N_STATE), local(4)
    for i in range(4):
        for j in range(N_STATE):
            H[i, j] = 0.0
    place_point(me, me.p_BF, H, lever)
    for i in range(3):
        nu[i] = fix.p[i] - (me.p_f[i] + lever[i])
        r[i] = me.r_fix[i]
    if n == 4:  # the heading measures the rotation about W's z
        off = fix.heading - math.atan2(me.R_f[1, 0], me.R_f[0, 0])
        nu[3] = math.atan2(math.sin(off), math.cos(off))
        H[3, R_ + 2], r[3] = 1.0, me.r_heading
    for i in range(n):
        before[i] = nu[i]
    me.nis = correct(me.P, H[:n], nu[:n], r[:n], GATES[n - 3], dx)
    if not me.nis < GATES[n - 3]:
        keep_innovation(me, before, fix.t)
        return False
    if me.more_fix > 1.0 or me.more_heading > 1.0:
        _adapt(me, H[:n], before, dx)
    inject(me, dx)
    return True


@helper
def _adapt(me: Any, H: Any, before: Any, dx: Any) -> None:
    """Average a noise that was learned from few fixes over more of them.

    `before` (n,) are the residuals, `dx` is the correction.
    """
    p = heading = 1.0
    for i in range(len(H)):
        found = compute_product(before, H, dx, i)
        if i < 3:
            p += (found / me.r_fix[i] - 1.0) / (3.0 * KNOWN_AFTER)
        else:
            heading += (found / me.r_heading - 1.0) / KNOWN_AFTER
    scale_fix_noise(me, max(p, 1.0 / me.more_fix), max(heading, 1.0 / me.more_heading))


@helper
def scale_fix_noise(me: Any, p: float, heading: float) -> None:
    """Multiply the variances of the noise of positions and heading."""
    for i in range(3):
        me.r_fix[i] *= p
    me.r_heading *= heading
    me.more_fix *= p
    me.more_heading *= heading


@helper
def judge_again(me: Any, fix: Any) -> bool:
    """Fuse a rejected fix with the noise of the fixes in its row, if they scatter by more.

    Returns False, and changes nothing, if they do not, or if the fix is rejected again.
    """
    p, heading = 0.0, 1.0  # the three axes' noise has a known proportion
    for i in range(3):
        p += compute_scatter(me, i, 1, ROW) / me.r_fix[i] / 3.0
    if me.r_heading > 0.0:
        heading = compute_scatter(me, 3, 1, ROW) / me.r_heading
    if not (p * me.more_fix <= MOST and heading * me.more_heading <= MOST):
        return False  # also if one is not a number
    if p < LEAST and heading < LEAST:
        return False
    p, heading, P = max(p, 1.0), max(heading, 1.0), local(N_STATE, N_STATE)
    for i in range(N_STATE):
        for j in range(N_STATE):
            P[i, j] = me.P[i, j]
    widen(me, p, heading)
    scale_fix_noise(me, p, heading)
    me.rejected -= 1
    if fuse_fix(me, fix):
        return True
    scale_fix_noise(me, 1.0 / p, 1.0 / heading)
    for i in range(N_STATE):
        for j in range(N_STATE):
            me.P[i, j] = P[i, j]
    return False


@helper
def start_from_fix(me: Any, fix: Any, n: int, gravity: float, speed: float) -> None:
    """Start at rest at a fix taken at inertial sample `n`: tilt by gravity, heading by the fix.

    `speed` (m/s) is one sigma of the velocity at the start. The tilt error is the accelerometer
    bias over g; the covariance includes this correlation.
    """
    f, x, y, z = local(3), local(3), local(3), local(3)
    for i in range(3):
        f[i] = 0.0
    for k in range(max(me.n - LEVEL_SAMPLES, 0), me.n):
        for i in range(3):
            f[i] += me.accel[k & MASK, i]
    # rows of R_WB: the specific force points up, and x points along the heading
    size = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    for i in range(3):
        z[i] = f[i] / size
    # the horizontal forward axis in B: x of B minus its component along z
    for i in range(3):
        x[i] = (1.0 if i == 0 else 0.0) - z[0] * z[i]
    size = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for i in range(3):
        x[i] /= size
    cross(z, x, y)
    c, s = math.cos(fix.heading), math.sin(fix.heading)
    for i in range(N_STATE):
        for j in range(N_STATE):
            me.P[i, j] = 0.0
    for i in range(3):
        me.R_f[0, i] = c * x[i] - s * y[i]
        me.R_f[1, i] = s * x[i] + c * y[i]
        me.R_f[2, i] = z[i]
        me.v_f[i] = me.bg[i] = me.ba[i] = 0.0
        me.P[P_ + i, P_ + i] = me.r_fix[i]
        me.P[V_ + i, V_ + i] = speed * speed
        me.P[BG_ + i, BG_ + i] = me.p_bg
        me.P[BA_ + i, BA_ + i] = me.p_ba
    d = local(3)
    for i in range(3):
        d[i] = me.p_BI[i] - me.p_BF[i]
    mat_vec(me.R_f, d, x)
    for i in range(3):
        me.p_f[i] = fix.p[i] + x[i]
    # at rest R f = g z + b_W, taken for z, is level when turned by (-b_y, b_x) / g
    for i in range(2):
        me.P[R_ + i, R_ + i] = me.p_ba / (gravity * gravity) + 1e-6
    me.P[R_ + 2, R_ + 2] = max(me.r_heading, 1e-6)
    for j in range(3):
        about_x = -me.R_f[1, j] * me.p_ba / gravity
        about_y = me.R_f[0, j] * me.p_ba / gravity
        me.P[R_, BA_ + j] = me.P[BA_ + j, R_] = about_x
        me.P[R_ + 1, BA_ + j] = me.P[BA_ + j, R_ + 1] = about_y
    me.n_f, me.last_fix = n, fix.t
    me.ready = 2.0
    me.rejected_row = 0


@helper
def move_to_fix(me: Any, fix: Any, gravity: float) -> None:
    """Set the position to a fix, and inflate the covariance of what may have made it wrong.

    Fixes that agree contradicted the inertial unit since the last one that was fused. Its biases
    may have changed by HOLD_RATE and HOLD_ACCEL, and attitude and velocity by their integrals.
    """
    d, lever, t = local(3), local(3), min(max(fix.t - me.last_fix, 0.0), LONGEST_S)
    for i in range(3):
        d[i] = me.p_BI[i] - me.p_BF[i]
    mat_vec(me.R_f, d, lever)
    turn = t * HOLD_RATE
    speed = t * (HOLD_ACCEL + 0.5 * gravity * turn)
    for i in range(3):
        me.p_f[i] = fix.p[i] + lever[i]
        for j in range(N_STATE):
            me.P[P_ + i, j] = me.P[j, P_ + i] = 0.0
        me.P[P_ + i, P_ + i] = me.r_fix[i]
        me.P[V_ + i, V_ + i] += speed * speed
        me.P[R_ + i, R_ + i] += turn * turn
        me.P[BG_ + i, BG_ + i] = max(me.P[BG_ + i, BG_ + i], HOLD_RATE**2)
        me.P[BA_ + i, BA_ + i] = max(me.P[BA_ + i, BA_ + i], HOLD_ACCEL**2)
    me.rejected_row = 0
