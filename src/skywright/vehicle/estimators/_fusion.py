"""Fusing fixes, odometry and ranges into the filter of station_camera.py, at its horizon."""

from __future__ import annotations

import math
from typing import Any

from skywright.core.rotations import exp_so3, log_so3, mat_mat, mat_vec, orthonormalise
from skywright.core.scratch import local
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._kalman import correct, inject, place_point
from skywright.vehicle.estimators._strapdown import (
    BA_,
    BG_,
    COVARIANCE_STEP,
    HOLD_ACCEL,
    HOLD_RATE,
    P_,
    R_,
    V_,
    integrate,
    propagate_covariance,
    shear,
)

N_FUSION = 25
B_, T_, G_, RANGE_, DELAY_, RATE_ = 15, 18, 21, 22, 23, 24  # where the further errors start

GATE_FIX = 21.1  # chi-square of 3, exceeded once in 10,000
GATE_ODO = 30.0  # the camera has jumped, not the robot
GATE_RANGE = 16.0
NO_GATE = math.inf
RUN = 5  # rejected fixes in a row: not they are wrong but the filter
OFTEN, OFTEN_S = 8.0, 0.5  # jumps of the camera within s: not it jumps but the inertial unit is off
NOISIEST = 1.9
"""Times the stated noise that a camera may have: plant.sensor_noise_error of 0.2, cut at three
deviations, is 1.82. It exceeds GATE_ODO in every sixth sample then; what counts as a jump for OFTEN
exceeds this as well."""


@helper
def clear(H: Any) -> None:
    """Set all of a matrix to zero."""
    for i in range(H.shape[0]):
        for j in range(H.shape[1]):
            H[i, j] = 0.0


@helper
def _turn_frame(me: Any, x: float, y: float, z: float) -> None:
    """Turn the camera's frame by a rotation vector (rad) in W."""
    turn, rot, old = local(3), local(3, 3), local(3, 3)
    turn[0], turn[1], turn[2] = x, y, z
    exp_so3(turn, rot)
    for i in range(3):
        for j in range(3):
            old[i, j] = me.T[i, j]
    mat_mat(rot, old, me.T)


@helper
def _grown(me: Any, out: Any) -> None:
    """Write g T."""
    g = math.exp(me.growth)
    for i in range(3):
        for j in range(3):
            out[i, j] = g * me.T[i, j]


@helper
def advance(me: Any, last: int, gravity: float) -> None:
    """Move the horizon up to inertial sample `last`."""
    P = me.P_full
    dv, turn, M, before = local(3), local(3, 3), local(3, 3), local(3)
    grown, moved, u = local(3, 3), local(3), local(3)
    _grown(me, grown)
    while me.n_f < last:
        first = me.n_f
        end = min(first + COVARIANCE_STEP, last)
        dt = me.h * (end - first)
        for i in range(3):
            before[i] = me.p_f[i]
        integrate(me, first, end, gravity, me.p_f, me.v_f, me.R_f, dv, turn)
        path = 0.0
        for i in range(3):
            moved[i] = me.p_f[i] - before[i]
            path += moved[i] * moved[i]
        path = math.sqrt(path)
        mat_vec(grown, moved, u)
        for i in range(3):
            me.drift[i] += u[i] - moved[i]
            for j in range(3):
                M[i, j] = dt * grown[i, j]
            M[i, i] -= dt
        shear(P, B_, V_, M)
        M[0, 0] = M[1, 1] = M[2, 2] = 0.0
        M[0, 1], M[0, 2], M[1, 2] = u[2], -u[1], u[0]  # d(exp(turn) u) = turn x u
        M[1, 0], M[2, 0], M[2, 1] = -u[2], u[1], -u[0]
        shear(P, B_, T_, M)
        for i in range(3):
            M[i, 0], M[i, 1], M[i, 2] = u[i], 0.0, 0.0
        shear(P, B_, G_, M)
        for c in range(N_FUSION):  # the camera's heading drifts at a rate
            P[T_ + 2, c] += dt * P[RATE_, c]
        for c in range(N_FUSION):
            P[c, T_ + 2] += dt * P[c, RATE_]
        _turn_frame(me, 0.0, 0.0, dt * me.rate)
        propagate_covariance(me, P, dv, turn, dt)
        for i in range(3):
            P[B_ + i, B_ + i] += me.q_walk_s * dt + me.q_walk_m * path
            P[T_ + i, T_ + i] += dt * (me.q_yaw if i == 2 else me.q_tilt)
        P[G_, G_] += dt * me.q_scale
        P[RATE_, RATE_] += dt * me.q_rate
        me.n_f = end
    orthonormalise(me.R_f)


@helper
def _inject(me: Any, dx: Any) -> None:
    """Move the estimated error into the state."""
    inject(me, dx)
    for i in range(3):
        me.drift[i] += dx[B_ + i]
    _turn_frame(me, dx[T_], dx[T_ + 1], dx[T_ + 2])
    orthonormalise(me.T)
    me.growth += dx[G_]
    me.range_bias += dx[RANGE_]
    me.delay += dx[DELAY_]
    me.rate += dx[RATE_]


@helper
def fuse_fix(me: Any, z: Any) -> None:
    """Fuse the fix of the station when the horizon's clock reaches its time stamp."""
    H, nu, kept, r, lever = local(3, N_FUSION), local(3), local(3), local(3), local(3)
    dx = local(N_FUSION)
    clear(H)
    place_point(me, me.p_BP, H, lever)
    far = 0.0
    for i in range(3):
        H[i, DELAY_] = -me.v_f[i]
        nu[i] = z[i] - (me.p_f[i] + lever[i] - me.v_f[i] * me.delay)
        far += nu[i] * nu[i] / 3.0
        r[i], kept[i] = me.r_fix, nu[i]
    if correct(me.P_full, H, kept, r, GATE_FIX, dx) < GATE_FIX:
        me.rejected_row = 0
    else:
        me.rejected += 1
        me.rejected_row += 1
        if me.rejected_row < RUN:
            return
        me.rejected_row = 0
        me.restarts += 1
        for i in range(3):  # lost: the position is anywhere, what the camera tells of it is not
            me.P_full[P_ + i, P_ + i] += far
            me.P_full[B_ + i, B_ + i] += far
            me.P_full[P_ + i, B_ + i] -= far
            me.P_full[B_ + i, P_ + i] -= far
        correct(me.P_full, H, nu, r, NO_GATE, dx)
    _inject(me, dx)
    me.fixes += 1


@helper
def align(me: Any, k: int, a: Any, R: Any) -> None:
    """Camera sample `k` in W: position (3,) m and attitude (3, 3)."""
    mat_vec(me.R_WC, me.odo_p[k], a)
    for i in range(3):
        a[i] *= me.scale
    mat_mat(me.R_WC, me.odo_R[k], R)


@helper
def fuse_odometry(me: Any, k: int) -> None:
    """Fuse camera sample `k`; a jump of the camera goes into its drift."""
    H, nu, kept, r, lever = local(6, N_FUSION), local(6), local(6), local(6), local(3)
    a, R, seen, rest = local(3), local(3, 3), local(3, 3), local(3, 3)
    dx, turn = local(N_FUSION), local(3)
    align(me, k, a, R)
    clear(H)
    for i in range(3):
        turn[i] = 0.0
    place_point(me, turn, H, lever)
    mat_mat(me.T, me.R_f, seen)
    for i in range(3):
        for j in range(3):  # R seen'
            rest[i, j] = R[i, 0] * seen[j, 0] + R[i, 1] * seen[j, 1] + R[i, 2] * seen[j, 2]
    log_so3(rest, turn)
    far = 0.0
    for i in range(3):
        H[i, B_ + i] = 1.0
        nu[i] = a[i] - (me.p_f[i] + lever[i] + me.drift[i])
        far += nu[i] * nu[i] / 3.0
        r[i] = me.r_odo
        # log(T_true R_true (T R)') = turn + T theta
        nu[3 + i] = turn[i]
        H[3 + i, T_ + i] = 1.0
        for j in range(3):
            H[3 + i, R_ + j] = me.T[i, j]
        r[3 + i] = me.r_odo_R
    for i in range(6):
        kept[i] = nu[i]
    me.often *= math.exp(-max(me.odo_t[k] - me.last_odo, 0.0) / OFTEN_S)
    me.last_odo = me.odo_t[k]
    off = correct(me.P_full, H, kept, r, GATE_ODO, dx)
    if not off < GATE_ODO:
        me.jumps += 1
        if not off < NOISIEST**2 * GATE_ODO:
            me.often += 1.0
        for i in range(3):
            me.P_full[B_ + i, B_ + i] += far
        if me.often > OFTEN:
            me.often = 0.0
            me.restarts += 1
            doubt_inertial(me)
        correct(me.P_full, H, nu, r, NO_GATE, dx)
    _inject(me, dx)


@helper
def doubt_inertial(me: Any) -> None:
    """Inflate the covariance of the inertial biases and of the states integrated with them."""
    for i in range(3):
        me.P_full[BG_ + i, BG_ + i] += HOLD_RATE**2
        me.P_full[BA_ + i, BA_ + i] += HOLD_ACCEL**2
        me.P_full[R_ + i, R_ + i] += (OFTEN_S * HOLD_RATE) ** 2
        me.P_full[V_ + i, V_ + i] += (OFTEN_S * HOLD_ACCEL) ** 2
        me.P_full[P_ + i, P_ + i] += (0.5 * OFTEN_S**2 * HOLD_ACCEL) ** 2


@helper
def fuse_range(me: Any, distance: float) -> None:
    """Fuse the distance to the ground below; what is not the ground is gated."""
    H, nu, r, lever = local(3, N_FUSION), local(1), local(1), local(3)
    dx, one = local(N_FUSION), local(1, N_FUSION)
    clear(H)
    for i in range(3):
        dx[i] = 0.0
    place_point(me, dx, H, lever)
    z, up = me.p_f[2] + lever[2], me.R_f[2, 2]
    if up < 0.5:
        return
    for i in range(N_FUSION):
        one[0, i] = H[2, i] / up
    # d(R_zz) = turn_x R_yz - turn_y R_xz
    one[0, R_] -= z / (up * up) * me.R_f[1, 2]
    one[0, R_ + 1] += z / (up * up) * me.R_f[0, 2]
    one[0, RANGE_] = 1.0
    nu[0], r[0] = distance - (z / up + me.range_bias), me.r_range
    if correct(me.P_full, one, nu, r, GATE_RANGE, dx) < GATE_RANGE:
        _inject(me, dx)
