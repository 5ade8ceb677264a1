"""Fusing a fix of a point of the robot, with or without a heading, into the error-state filter.

A position alone does not tell a robot that flies straight which way it faces: heading is observable
through horizontal acceleration only, and a transport hardly accelerates. So a fix brings a heading
(two antennas, or a magnetometer); roll and pitch follow from gravity.
"""

from __future__ import annotations

import math
from typing import Any

from skywright.core.record import Record, Vec3
from skywright.core.rotations import cross, mat_vec
from skywright.core.scratch import local
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._kalman import correct, inject, place_point
from skywright.vehicle.estimators._strapdown import BA_, BG_, MASK, N_STATE, P_, R_, V_

GATES = (16.27, 18.47)  # chi-square of 3 and of 4 at 99.9 %
LEVEL_SAMPLES = 256  # inertial samples at rest from which roll and pitch are taken at the start


class FixNoise(Record):
    """Noise of fixes."""

    p_BF: Vec3  # m, the point that they are of
    r_fix: Vec3  # m^2
    r_heading: float  # rad^2; 0: they have no heading


@helper
def fuse_fix(me: Any, fix: Any) -> bool:
    """Fuse a fix taken at the horizon; False when the gate rejects it."""
    n = 4 if me.r_heading > 0.0 else 3
    H, nu, r, lever = local(4, N_STATE), local(4), local(4), local(3)
    dx = local(N_STATE)
    for i in range(4):
        for j in range(N_STATE):
            H[i, j] = 0.0
    place_point(me, me.p_BF, H, lever)
    for i in range(3):
        nu[i] = fix.p[i] - (me.p_f[i] + lever[i])
        r[i] = me.r_fix[i]
    if n == 4:  # a turn about W's z is the heading's
        off = fix.heading - math.atan2(me.R_f[1, 0], me.R_f[0, 0])
        nu[3] = math.atan2(math.sin(off), math.cos(off))
        H[3, R_ + 2], r[3] = 1.0, me.r_heading
    me.nis = correct(me.P, H[:n], nu[:n], r[:n], GATES[n - 3], dx)
    if not me.nis < GATES[n - 3]:
        return False
    inject(me, dx)
    return True


@helper
def start_from_fix(me: Any, fix: Any, n: int, gravity: float, speed: float) -> None:
    """Begin at rest at a fix taken at inertial sample `n`: level by gravity, facing as it says.

    `speed` (m/s) is one sigma of how much at rest. The tilt is wrong by the accelerometer's bias
    over g, and the filter is told that the two belong together.
    """
    f, x, y, z = local(3), local(3), local(3), local(3)
    for i in range(3):
        f[i] = 0.0
    for k in range(max(me.n - LEVEL_SAMPLES, 0), me.n):
        for i in range(3):
            f[i] += me.accel[k & MASK, i]
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
    me.n_f = n
    me.ready = 2.0
    me.rejected_row = 0


@helper
def move_to_fix(me: Any, fix: Any, speed: float, turn: float) -> None:
    """Go to a fix where the filter lost its place; velocity and attitude stay, less certain.

    `speed` (m/s) and `turn` (rad) are one sigma more.
    """
    d, lever = local(3), local(3)
    for i in range(3):
        d[i] = me.p_BI[i] - me.p_BF[i]
    mat_vec(me.R_f, d, lever)
    for i in range(3):
        me.p_f[i] = fix.p[i] + lever[i]
        for j in range(N_STATE):
            me.P[P_ + i, j] = me.P[j, P_ + i] = 0.0
        me.P[P_ + i, P_ + i] = me.r_fix[i]
        me.P[V_ + i, V_ + i] += speed * speed
        me.P[R_ + i, R_ + i] += turn * turn
    me.rejected_row = 0
