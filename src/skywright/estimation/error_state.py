"""Error-state Kalman filter of inertial unit and external localisation, at a delayed horizon.

External localisation is motion capture (`fuse`), or fixes of a point (estimation/position_fix.py).

State: position p and velocity v of the inertial unit in W, attitude R_WB, gyroscope bias b_g and
accelerometer bias b_a in B. The error is (dp, dv, dtheta, db_g, db_a), 15 numbers, with the
attitude error in W: R_true = exp(dtheta) R (Sola, Quaternion kinematics for the error-state Kalman
filter, 2017, arXiv 1711.02508, section 7, "global angular errors").

Delay: a motion-capture sample is fused into the state of its exposure, then the inertial samples
since are integrated again. The covariance lives at the horizon only, so each inertial sample
enters it once and nothing is stored or rewound; for samples in order this equals the filter that
would have had them without delay, followed by a prediction. The state is integrated at the rate
of the inertial unit (1 kHz), the covariance in steps of at most COVARIANCE_STEP samples.

Integration and covariance step are in estimation/strapdown.py.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.core.rotations import (
    cross,
    exp_so3,
    log_so3,
    mat_mat,
    mat_t_mat,
    mat_vec,
    orthonormalise,
)
from skywright.core.signature import ON_BELIEF
from skywright.core.types import IMU_HISTORY
from skywright.estimation.kalman import correct, inject, place_point
from skywright.estimation.position_fix import fuse_fix, move_to_fix, start_from_fix
from skywright.estimation.strapdown import (
    BA_,
    BG_,
    MASK,
    N_STATE,
    P_,
    R_,
    V_,
    integrate,
    propagate_covariance,
)
from skywright.estimation.tip import correct_tip, fill_tip

Record = Any
Array = Any

COVARIANCE_STEP = 10  # IMU samples: R turns by 0.01 rad in it at 1 rad/s
GATE = 22.46  # chi-square of 6 at 99.9 %
RESTART_AFTER = 10  # rejected samples in a row that agree with each other
AGREE_P, AGREE_R = 0.1, 0.2  # m, rad: how far two good samples may be apart
AGREE_SIGMAS = 4.0  # of two fixes, on top
SPEED_START = 0.3  # m/s, 1 sigma when the filter starts
HOLD_ACCEL, HOLD_RATE = 1.0, 0.2  # m/s^2, rad/s: 1 sigma of what a lost inertial sample hid


@njit(cache=True, error_model="numpy")
def advance(flt: Record, last: int, gravity: float) -> None:
    """Move the horizon (state and covariance) up to inertial sample `last`."""
    dv, turn = np.empty(3), np.empty((3, 3))
    while flt.n_f < last:
        first = flt.n_f
        end = min(first + COVARIANCE_STEP, last)
        integrate(flt, first, end, gravity, flt.p_f, flt.v_f, flt.R_f, dv, turn)
        propagate_covariance(flt, flt.P, dv, turn, flt.h * (end - first))
        flt.n_f = end
    orthonormalise(flt.R_f)


@njit(cache=True, error_model="numpy")
def fuse(flt: Record, meas: Record) -> bool:
    """Fuse a motion-capture sample taken at the horizon; False when the gate rejects it."""
    H, nu, r, lever = np.zeros((6, N_STATE)), np.empty(6), np.empty(6), np.empty(3)
    rot, turn, dx = np.empty((3, 3)), np.empty(3), np.empty(N_STATE)
    place_point(flt, np.zeros(3), H, lever)
    for i in range(3):
        for j in range(3):  # R_meas R_f'
            rot[i, j] = (
                meas.R_WB[i, 0] * flt.R_f[j, 0]
                + meas.R_WB[i, 1] * flt.R_f[j, 1]
                + meas.R_WB[i, 2] * flt.R_f[j, 2]
            )
    log_so3(rot, turn)
    for i in range(3):
        nu[i] = meas.p_WB[i] - (flt.p_f[i] + lever[i])
        r[i] = flt.r_p
        nu[3 + i] = turn[i]
        H[3 + i, R_ + i] = 1.0
        r[3 + i] = flt.r_R
    flt.nis = correct(flt.P, H, nu, r, GATE, dx)
    if not flt.nis < GATE:
        return False
    flt.nu[:] = nu
    inject(flt, dx)
    return True


@njit(cache=True, error_model="numpy")
def receive_inertial(flt: Record, meas: Record) -> None:
    """Append this tick's inertial samples; a gap (packets lost) is bridged by holding the first."""
    missing = int((meas.t - flt.t) / flt.h + 0.5) - meas.imu_n
    flt.t = meas.t
    if missing > 0 and flt.ready == 2.0:
        if missing > IMU_HISTORY // 2:
            flt.ready = 0.0
        else:
            for i in range(3):
                flt.P[V_ + i, V_ + i] += (HOLD_ACCEL * missing * flt.h) ** 2
                flt.P[R_ + i, R_ + i] += (HOLD_RATE * missing * flt.h) ** 2
    else:
        missing = 0
    for n in range(-missing, meas.imu_n):
        k = flt.n & MASK
        m = max(n, 0)
        for i in range(3):
            flt.gyro[k, i] = meas.imu_gyro[m, i]
            flt.accel[k, i] = meas.imu_accel[m, i]
        flt.n += 1


@njit(cache=True, error_model="numpy")
def _agrees(flt: Record, meas: Record) -> bool:
    """Whether a sample lies near the last unused one; keeps it as the last unused one."""
    rot, turn = np.empty((3, 3)), np.empty(3)
    mat_t_mat(flt.last_R, meas.R_WB, rot)
    log_so3(rot, turn)
    far = angle = 0.0
    for i in range(3):
        far += (meas.p_WB[i] - flt.last_p[i]) ** 2
        angle += turn[i] ** 2
        flt.last_p[i] = meas.p_WB[i]
        for j in range(3):
            flt.last_R[i, j] = meas.R_WB[i, j]
    return far < AGREE_P**2 and angle < AGREE_R**2


@njit(cache=True, error_model="numpy")
def start(flt: Record, meas: Record, n: int) -> None:
    """Begin at rest at a motion-capture sample taken at inertial sample `n`."""
    lever = np.empty(3)
    mat_vec(meas.R_WB, flt.p_BI, lever)
    for i in range(N_STATE):
        for j in range(N_STATE):
            flt.P[i, j] = 0.0
    for i in range(3):
        flt.p_f[i] = meas.p_WB[i] + lever[i]
        flt.v_f[i] = 0.0
        flt.bg[i] = flt.ba[i] = 0.0
        for j in range(3):
            flt.R_f[i, j] = meas.R_WB[i, j]
        flt.P[P_ + i, P_ + i] = flt.r_p
        flt.P[V_ + i, V_ + i] = SPEED_START**2
        flt.P[R_ + i, R_ + i] = flt.r_R
        flt.P[BG_ + i, BG_ + i] = flt.p_bg
        flt.P[BA_ + i, BA_ + i] = flt.p_ba
    flt.n_f = n
    flt.ready = 2.0
    flt.rejected_row = 0


@njit(cache=True, error_model="numpy")
def _use_mocap(b: Record) -> bool:
    """Bring the horizon to the exposure and fuse; False when nothing changed."""
    flt, meas = b.flt, b.meas
    n = flt.n - int((meas.t - meas.mocap_t) / flt.h + 0.5)
    if n > flt.n or n < 0 or n <= flt.n - IMU_HISTORY:
        return False  # not of this stretch of data
    if flt.ready < 2.0:  # two samples that agree begin the filter: one may be an artefact
        agrees = _agrees(flt, meas)
        if flt.ready == 1.0 and agrees:
            start(flt, meas, n)
        flt.ready = max(flt.ready, 1.0)
        return flt.ready == 2.0
    if n < flt.n_f:
        return False
    advance(flt, n, b.body.gravity)
    if fuse(flt, meas):
        flt.fused += 1
        flt.rejected_row = 0
    else:
        flt.rejected += 1
        flt.rejected_row = flt.rejected_row + 1 if _agrees(flt, meas) else 1
        if flt.rejected_row >= RESTART_AFTER:  # they agree with each other: the filter is wrong
            start(flt, meas, n)
    correct_tip(b, flt.c_B, flt.p_f, flt.R_f, flt.p_BI, flt.p_BT[(n - 1) & MASK])
    return True


@njit(cache=True, error_model="numpy")
def _use_fix(b: Record) -> bool:
    """Bring the horizon to the time of a fix and fuse it; False when nothing changed."""
    flt, meas = b.flt, b.meas
    n = flt.n - int((meas.t - meas.fix_t) / flt.h + 0.5)
    if n > flt.n or n < flt.n_f or n <= flt.n - IMU_HISTORY:
        return False
    far = spread = 0.0
    for i in range(3):
        far += (meas.fix_p[i] - flt.last_p[i]) ** 2
        spread += flt.r_fix[i]
        flt.last_p[i] = meas.fix_p[i]
    agrees = far < AGREE_P**2 + AGREE_SIGMAS**2 * spread
    if flt.ready < 2.0:
        if flt.ready == 1.0 and agrees:
            start_from_fix(flt, meas, n, b.body.gravity, SPEED_START)
        flt.ready = max(flt.ready, 1.0)
        return flt.ready == 2.0
    advance(flt, n, b.body.gravity)
    if fuse_fix(flt, meas):
        flt.fused += 1
        flt.rejected_row = 0
    else:
        flt.rejected += 1
        flt.rejected_row = flt.rejected_row + 1 if agrees else 1
        if flt.rejected_row >= RESTART_AFTER:
            move_to_fix(flt, meas, SPEED_START, HOLD_RATE)
    return True


@njit(cache=True, error_model="numpy")
def fill_estimate(b: Record) -> None:
    """Platform pose and velocity at B from the state at the inertial unit, brought to now."""
    flt, est, meas = b.flt, b.est, b.meas
    w, lever, turn = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        if meas.imu_n > 0:
            est.w_WB_B[i] = meas.gyro[i] - flt.bg[i]
        w[i] = est.w_WB_B[i]
    late = max(b.t - flt.t, 0.0)  # of the newest data; zero without a link
    if late > 0.0:
        rot = np.empty((3, 3))
        for i in range(3):
            turn[i] = late * w[i]
        exp_so3(turn, rot)
        mat_mat(flt.R, rot, est.R_WB)
    else:
        for i in range(3):
            for j in range(3):
                est.R_WB[i, j] = flt.R[i, j]
    orthonormalise(est.R_WB)
    cross(w, flt.p_BI, turn)
    mat_vec(est.R_WB, turn, lever)
    for i in range(3):
        v = flt.v[i] + late * flt.a_W[i]
        est.p_WB[i] = flt.p[i] + late * (flt.v[i] + 0.5 * late * flt.a_W[i])
        est.v_WB[i] = v - lever[i]
    mat_vec(est.R_WB, flt.p_BI, lever)
    for i in range(3):
        est.p_WB[i] -= lever[i]


@njit(cache=True, error_model="numpy")
def estimate_force(b: Record, dv: Array, span: float) -> None:
    """External force: measured specific force times mass, less what the rotors make; low-passed.

    `dv` is the integral of the specific force in W over `span` seconds.
    """
    flt, est, obs, dt = b.flt, b.est, b.obs, b.par.dt
    decay = math.exp(-dt / obs.rotor_tau)
    f_W = np.empty(3)
    for i in range(3):
        obs.f_B[i] = b.cmd.f_B_alloc[i] + (obs.f_B[i] - b.cmd.f_B_alloc[i]) * decay
    mat_vec(flt.R, obs.f_B, f_W)
    k = 1.0 - math.exp(-obs.bandwidth * dt)
    for i in range(3):
        f = dv[i] / span
        flt.a_W[i] = f
        est.f_ext_W[i] += k * (b.body.mass * f - f_W[i] - est.f_ext_W[i])
    flt.a_W[2] -= b.body.gravity


@njit(cache=True, error_model="numpy")
def predict_now(b: Record, before: int, changed: bool) -> None:
    """Bring the state to now and fill the estimate.

    `before` is the inertial sample that it stood at, `changed` says that the horizon has changed
    since: then it is integrated anew from there.
    """
    flt, gravity = b.flt, b.body.gravity
    dv, turn = np.empty(3), np.empty((3, 3))
    if changed:
        for i in range(3):
            flt.p[i], flt.v[i] = flt.p_f[i], flt.v_f[i]
            for j in range(3):
                flt.R[i, j] = flt.R_f[i, j]
        if before > flt.n_f:
            integrate(flt, flt.n_f, before, gravity, flt.p, flt.v, flt.R, dv, turn)
        before = max(before, flt.n_f)
    if before < flt.n:
        integrate(flt, before, flt.n, gravity, flt.p, flt.v, flt.R, dv, turn)
        estimate_force(b, dv, flt.h * (flt.n - before))
    fill_estimate(b)
    fill_tip(b, flt.c_B)


@njit(cache=True, error_model="numpy")
def step(b: Record) -> None:
    """One control tick of the filter."""
    flt, est, meas = b.flt, b.est, b.meas
    gravity = b.body.gravity
    est.t = b.t
    before = flt.n
    if meas.imu_n > 0:
        receive_inertial(flt, meas)
        for n in range(before, flt.n):
            for i in range(3):
                flt.p_BT[n & MASK, i] = b.body.p_BT[i]
    changed = meas.mocap_fresh > 0.0 and _use_mocap(b)
    changed = changed or (meas.fix_fresh > 0.0 and _use_fix(b))
    if flt.ready < 2.0:
        return
    if flt.n - flt.n_f > IMU_HISTORY // 2:  # nothing to fuse for long: keep up with the ring
        advance(flt, flt.n - IMU_HISTORY // 4, gravity)
        changed = True
    predict_now(b, before, changed)


@njit(cache=True, error_model="numpy")
def head_covariance(flt: Record, gravity: float, P: Array) -> None:
    """Write the covariance of the newest state into `P` (15, 15), for tests of consistency.

    The inertial unit shakes with the rotors while the body does not: the share of that in
    velocity and attitude is bounded, not a random walk, so it is added here and not integrated.
    """
    p, v, R = flt.p_f.copy(), flt.v_f.copy(), flt.R_f.copy()
    dv, turn = np.empty(3), np.empty((3, 3))
    P[:, :] = flt.P
    n = flt.n_f
    while n < flt.n:
        end = min(n + COVARIANCE_STEP, flt.n)
        integrate(flt, n, end, gravity, p, v, R, dv, turn)
        propagate_covariance(flt, P, dv, turn, flt.h * (end - n))
        n = end
    for i in range(3):
        P[V_ + i, V_ + i] += flt.vibration_v
        P[R_ + i, R_ + i] += flt.vibration_R


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF."""
    step(belief[0])


@cfunc(ON_BELIEF, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all estimators."""
    step(carray(belief, 1)[0])
