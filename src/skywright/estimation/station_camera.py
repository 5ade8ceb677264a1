"""Error-state Kalman filter of inertial unit, total station, tracking camera and range finder.

As estimation/error_state.py, which it shares the integration with, but nothing tells the pose: the
station tells now and then, late, where the prism was; the camera tells at 200 Hz how the robot
moved, in a frame of its own. Beyond the 15 errors of that filter it estimates how the camera errs
against its calibration (vehicle/localisation.py): drift b, rotation T and scale g = exp(growth) of
the aligned frame, further the range finder's bias and the station's clock:

    camera aligned to W:  a = p_B + b,  b' = (g T - 1) v + drift;   attitude: T R_WB
    station:              z = p_B + R p_BP - v delay                (stamps ahead by `delay`)
    range finder:         d = p_z / R_zz + bias                     (above the ground z = 0)

The errors of rotations are in W: T_true = exp(turn) T. A sample waits until the horizon, which
moves every FUSE_EVERY to a fixed lag behind now, passes its stamp, so that the station's late
samples are in order with the camera's; from there to now only the inertial samples are integrated.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.core.rotations import (
    exp_so3,
    log_so3,
    mat_mat,
    mat_vec,
    orthonormalise,
)
from skywright.core.signature import ON_BELIEF
from skywright.core.types import IMU_HISTORY, N_FUSION, PENDING
from skywright.estimation.error_state import (
    COVARIANCE_STEP,
    HOLD_ACCEL,
    HOLD_RATE,
    SPEED_START,
    predict_now,
    receive_inertial,
)
from skywright.estimation.kalman import correct, inject, place_point
from skywright.estimation.strapdown import (
    BA_,
    BG_,
    N_STATE,
    P_,
    R_,
    V_,
    integrate,
    propagate_covariance,
    shear,
)

Record = Any
Array = Any

B_, T_, G_, RANGE_, DELAY_ = 15, 18, 21, 22, 23  # where the further errors start

GATE_FIX = 21.1  # chi-square of 3, exceeded once in 10,000
GATE_ODO = 30.0  # the camera has jumped, not the robot
GATE_RANGE = 16.0
NO_GATE = math.inf
RUN = 5  # rejected fixes in a row: not they are wrong but the filter
DRIFT_START = 1.0  # m
FUSE_EVERY = 0.02  # s: the state is integrated again from the horizon each time that this moves


@njit(cache=True, error_model="numpy")
def _grown(fus: Record, out: Array) -> None:
    """Write g T."""
    g = math.exp(fus.growth)
    for i in range(3):
        for j in range(3):
            out[i, j] = g * fus.T[i, j]


@njit(cache=True, error_model="numpy")
def advance(flt: Record, fus: Record, last: int, gravity: float) -> None:
    """Move the horizon up to inertial sample `last`."""
    P = fus.P
    dv, turn, M, before = np.empty(3), np.empty((3, 3)), np.zeros((3, 3)), np.empty(3)
    grown, moved, u = np.empty((3, 3)), np.empty(3), np.empty(3)
    _grown(fus, grown)
    while flt.n_f < last:
        first = flt.n_f
        end = min(first + COVARIANCE_STEP, last)
        dt = flt.h * (end - first)
        for i in range(3):
            before[i] = flt.p_f[i]
        integrate(flt, first, end, gravity, flt.p_f, flt.v_f, flt.R_f, dv, turn)
        path = 0.0
        for i in range(3):
            moved[i] = flt.p_f[i] - before[i]
            path += moved[i] * moved[i]
        path = math.sqrt(path)
        mat_vec(grown, moved, u)
        for i in range(3):
            fus.drift[i] += u[i] - moved[i]
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
        propagate_covariance(flt, P, dv, turn, dt)
        for i in range(3):
            P[B_ + i, B_ + i] += fus.q_walk_s * dt + fus.q_walk_m * path
            P[T_ + i, T_ + i] += dt * (fus.q_yaw if i == 2 else fus.q_tilt)
        P[G_, G_] += dt * fus.q_scale
        flt.n_f = end
    orthonormalise(flt.R_f)


@njit(cache=True, error_model="numpy")
def _inject(flt: Record, fus: Record, dx: Array) -> None:
    """Move the estimated error into the state."""
    turn, rot, old = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    inject(flt, dx)
    for i in range(3):
        fus.drift[i] += dx[B_ + i]
        turn[i] = dx[T_ + i]
    exp_so3(turn, rot)
    old[:, :] = fus.T
    mat_mat(rot, old, fus.T)
    orthonormalise(fus.T)
    fus.growth += dx[G_]
    fus.range_bias += dx[RANGE_]
    fus.delay += dx[DELAY_]


@njit(cache=True, error_model="numpy")
def fuse_fix(flt: Record, fus: Record, z: Array) -> None:
    """Fuse where the station saw the prism when the horizon's clock stood at the stamp."""
    H, nu, r, lever = np.zeros((3, N_FUSION)), np.empty(3), np.empty(3), np.empty(3)
    dx = np.empty(N_FUSION)
    place_point(flt, fus.p_BP, H, lever)
    far = 0.0
    for i in range(3):
        H[i, DELAY_] = -flt.v_f[i]
        nu[i] = z[i] - (flt.p_f[i] + lever[i] - flt.v_f[i] * fus.delay)
        far += nu[i] * nu[i] / 3.0
        r[i] = fus.r_fix
    if correct(fus.P, H, nu.copy(), r, GATE_FIX, dx) < GATE_FIX:
        fus.rejected_row = 0
    else:
        fus.rejected += 1
        fus.rejected_row += 1
        if fus.rejected_row < RUN:
            return
        fus.rejected_row = 0
        for i in range(3):  # lost: the position is anywhere, what the camera tells of it is not
            fus.P[P_ + i, P_ + i] += far
            fus.P[B_ + i, B_ + i] += far
            fus.P[P_ + i, B_ + i] -= far
            fus.P[B_ + i, P_ + i] -= far
        correct(fus.P, H, nu, r, NO_GATE, dx)
    _inject(flt, fus, dx)
    fus.fixes += 1


@njit(cache=True, error_model="numpy")
def _align(flt: Record, fus: Record, k: int, a: Array, R: Array) -> None:
    """Camera sample `k` in W: position (3,) m and attitude (3, 3)."""
    mat_vec(fus.R_WC, fus.odo_p[k], a)
    for i in range(3):
        a[i] *= fus.scale
    mat_mat(fus.R_WC, fus.odo_R[k], R)


@njit(cache=True, error_model="numpy")
def fuse_odometry(flt: Record, fus: Record, k: int) -> None:
    """Fuse camera sample `k`; a jump of the camera goes into its drift."""
    H, nu, r, lever = np.zeros((6, N_FUSION)), np.empty(6), np.empty(6), np.empty(3)
    a, R, seen, rest = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    dx, turn = np.empty(N_FUSION), np.empty(3)
    _align(flt, fus, k, a, R)
    place_point(flt, np.zeros(3), H, lever)
    mat_mat(fus.T, flt.R_f, seen)
    for i in range(3):
        for j in range(3):  # R seen'
            rest[i, j] = R[i, 0] * seen[j, 0] + R[i, 1] * seen[j, 1] + R[i, 2] * seen[j, 2]
    log_so3(rest, turn)
    far = 0.0
    for i in range(3):
        H[i, B_ + i] = 1.0
        nu[i] = a[i] - (flt.p_f[i] + lever[i] + fus.drift[i])
        far += nu[i] * nu[i] / 3.0
        r[i] = fus.r_odo
        # log(T_true R_true (T R)') = turn + T theta
        nu[3 + i] = turn[i]
        H[3 + i, T_ + i] = 1.0
        for j in range(3):
            H[3 + i, R_ + j] = fus.T[i, j]
        r[3 + i] = fus.r_odo_R
    if not correct(fus.P, H, nu.copy(), r, GATE_ODO, dx) < GATE_ODO:
        fus.jumps += 1
        for i in range(3):
            fus.P[B_ + i, B_ + i] += far
        correct(fus.P, H, nu, r, NO_GATE, dx)
    _inject(flt, fus, dx)


@njit(cache=True, error_model="numpy")
def fuse_range(flt: Record, fus: Record, distance: float) -> None:
    """Fuse the distance to the ground below; what is not the ground is gated."""
    H, nu, r, lever = np.zeros((3, N_FUSION)), np.empty(1), np.empty(1), np.empty(3)
    dx = np.empty(N_FUSION)
    place_point(flt, np.zeros(3), H, lever)
    z, up = flt.p_f[2] + lever[2], flt.R_f[2, 2]
    if up < 0.5:
        return
    one = np.zeros((1, N_FUSION))
    for i in range(N_FUSION):
        one[0, i] = H[2, i] / up
    # d(R_zz) = turn_x R_yz - turn_y R_xz
    one[0, R_] -= z / (up * up) * flt.R_f[1, 2]
    one[0, R_ + 1] += z / (up * up) * flt.R_f[0, 2]
    one[0, RANGE_] = 1.0
    nu[0], r[0] = distance - (z / up + fus.range_bias), fus.r_range
    if correct(fus.P, one, nu, r, GATE_RANGE, dx) < GATE_RANGE:
        _inject(flt, fus, dx)


@njit(cache=True, error_model="numpy")
def _keep(fus: Record, meas: Record) -> None:
    """Put this tick's samples where they wait for the horizon; stamps on the robot's clock."""
    if meas.fix_fresh > 0.0:
        k = fus.fix_n % PENDING
        fus.fix_t[k] = meas.fix_t - fus.clock
        for i in range(3):
            fus.fix_p[k, i] = meas.fix_p[i]
        fus.fix_n += 1
        fus.fix_used = max(fus.fix_used, fus.fix_n - PENDING)
    if meas.odo_fresh > 0.0:
        k = fus.odo_n % PENDING
        fus.odo_t[k] = meas.odo_t
        for i in range(3):
            fus.odo_p[k, i] = meas.odo_p[i]
            for j in range(3):
                fus.odo_R[k, i, j] = meas.odo_R[i, j]
        fus.odo_n += 1
        fus.odo_used = max(fus.odo_used, fus.odo_n - PENDING)
    if meas.range_fresh > 0.0:
        k = fus.range_n % PENDING
        fus.range_t[k], fus.range[k] = meas.range_t, meas.range
        fus.range_n += 1
        fus.range_used = max(fus.range_used, fus.range_n - PENDING)


@njit(cache=True, error_model="numpy")
def _place(flt: Record, t: float) -> int:
    """Inertial samples taken up to time `t`."""
    return flt.n - math.floor((flt.t - t) / flt.h + 0.5)


@njit(cache=True, error_model="numpy")
def start(flt: Record, fus: Record) -> None:
    """Begin at rest from the oldest fix that waits and the camera sample nearest to it.

    The attitude is the camera's: it and the camera's rotation T err together.
    """
    t = fus.fix_t[fus.fix_used % PENDING]
    n = _place(flt, t)
    best, k = math.inf, -1
    for s in range(fus.odo_used, fus.odo_n):
        if abs(fus.odo_t[s % PENDING] - t) < best:
            best, k = abs(fus.odo_t[s % PENDING] - t), s
    if k < 0 or n <= flt.n - IMU_HISTORY or n > flt.n or n < 0:
        if fus.fix_n - fus.fix_used > 1:
            fus.fix_used += 1
        return
    a, R, lever, P = np.empty(3), np.empty((3, 3)), np.empty(3), fus.P
    _align(flt, fus, k % PENDING, a, R)
    flt.R_f[:, :] = R
    P[:, :] = 0.0
    d = np.empty(3)
    for i in range(3):
        d[i] = fus.p_BP[i] - flt.p_BI[i]
    mat_vec(R, d, lever)
    p = np.empty(3)
    mat_vec(R, flt.p_BI, p)  # from B to the inertial unit
    for i in range(3):
        flt.p_f[i] = fus.fix_p[fus.fix_used % PENDING, i] - lever[i]
        flt.v_f[i] = flt.bg[i] = flt.ba[i] = 0.0
        fus.drift[i] = a[i] - (flt.p_f[i] - p[i])
        for j in range(3):
            fus.T[i, j] = 1.0 if i == j else 0.0
        frame = fus.std_0[1 if i == 2 else 0] ** 2
        P[P_ + i, P_ + i] = fus.r_fix
        P[V_ + i, V_ + i] = SPEED_START**2
        P[R_ + i, R_ + i] = frame + fus.r_odo_R
        P[BG_ + i, BG_ + i], P[BA_ + i, BA_ + i] = flt.p_bg, flt.p_ba
        P[B_ + i, B_ + i] = DRIFT_START**2
        P[T_ + i, T_ + i] = frame
        P[T_ + i, R_ + i] = P[R_ + i, T_ + i] = -frame
    P[G_, G_], P[RANGE_, RANGE_] = fus.std_0[2] ** 2, fus.bias_0**2
    P[DELAY_, DELAY_] = fus.std_0[3] ** 2
    fus.growth = fus.range_bias = fus.delay = 0.0
    fus.fix_used += 1
    fus.odo_used, fus.range_used = k + 1, fus.range_n
    fus.last_fix, fus.rejected_row = t, 0
    flt.n_f, flt.ready = n, 2.0


@njit(cache=True, error_model="numpy")
def _use_pending(b: Record) -> bool:
    """Move the horizon to what waits and is old enough, in order of time, and fuse it."""
    flt, fus, gravity = b.flt, b.fus, b.body.gravity
    until, changed = flt.t - fus.lag, False
    while True:
        t, kind = math.inf, -1
        if fus.fix_used < fus.fix_n and fus.fix_t[fus.fix_used % PENDING] < t:
            t, kind = fus.fix_t[fus.fix_used % PENDING], 0
        if fus.odo_used < fus.odo_n and fus.odo_t[fus.odo_used % PENDING] < t:
            t, kind = fus.odo_t[fus.odo_used % PENDING], 1
        if fus.range_used < fus.range_n and fus.range_t[fus.range_used % PENDING] < t:
            t, kind = fus.range_t[fus.range_used % PENDING], 2
        if kind < 0 or t > until:
            return changed
        n = _place(flt, t)
        if n < flt.n_f - 1:  # by a sample: rounding
            fus.late += 1
        else:
            advance(flt, fus, min(n, flt.n), gravity)
            if kind == 0:
                fuse_fix(flt, fus, fus.fix_p[fus.fix_used % PENDING])
                fus.last_fix = t
            elif kind == 1:
                fuse_odometry(flt, fus, fus.odo_used % PENDING)
            else:
                fuse_range(flt, fus, fus.range[fus.range_used % PENDING])
            changed = True
        if kind == 0:
            fus.fix_used += 1
        elif kind == 1:
            fus.odo_used += 1
        else:
            fus.range_used += 1


@njit(cache=True, error_model="numpy")
def step(b: Record) -> None:
    """One control tick of the filter."""
    flt, fus, est, meas = b.flt, b.fus, b.est, b.meas
    gravity = b.body.gravity
    est.t = b.t
    before = flt.n
    if meas.imu_n > 0:
        receive_inertial(flt, meas)
        lost = flt.h * (flt.n - before - meas.imu_n)  # s of samples that were held
        for i in range(3):
            fus.P[V_ + i, V_ + i] += (HOLD_ACCEL * lost) ** 2
            fus.P[R_ + i, R_ + i] += (HOLD_RATE * lost) ** 2
    _keep(fus, meas)
    changed = False
    if flt.ready < 2.0:
        if fus.fix_used == fus.fix_n or flt.n == 0:
            return
        start(flt, fus)
        if flt.ready < 2.0:
            return
        changed = True
    if flt.h * (flt.n - flt.n_f) > fus.lag + FUSE_EVERY:
        changed = _use_pending(b) or changed
    if flt.n - flt.n_f > IMU_HISTORY - 2 * COVARIANCE_STEP:  # nothing to fuse for long
        advance(flt, fus, flt.n - IMU_HISTORY // 2, gravity)
        changed = True
    if changed:
        flt.P[:, :] = fus.P[:N_STATE, :N_STATE]
    predict_now(b, before, changed)


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF."""
    step(belief[0])


@cfunc(ON_BELIEF, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all estimators."""
    step(carray(belief, 1)[0])
