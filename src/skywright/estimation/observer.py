"""The plain estimator: motion capture and gyroscope, delay compensated.

Translation: a third-order observer (position, velocity, external force) per axis that predicts
with the believed rotor force and corrects with each motion-capture sample at the time of its
exposure. The gains are those of a critically damped g-h-k filter: all three poles at
theta = exp(-w T) for a sample that comes T after the one before (Brookner, Tracking and Kalman
Filtering Made Easy, 1998, eq. 1.3-10), so they follow from one bandwidth at any rate and through
drop-outs. Attitude: the gyroscope is integrated, motion capture corrects angle and bias
(complementary filter on SO(3), Mahony et al. 2008). Tip: forward kinematics plus a slow
correction in B that absorbs calibration error, flexibility and spring.
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
    mat_t_mat,
    mat_t_vec,
    mat_vec,
    orthonormalise,
)
from skywright.core.signature import ON_BELIEF
from skywright.core.types import HISTORY
from skywright.estimation.tip import fill_tip

Record = Any


@njit(cache=True, error_model="numpy")
def predict(b: Record) -> None:
    """Propagate the estimate over one control period with gyroscope and believed force."""
    obs, est, dt = b.obs, b.est, b.par.dt
    decay = math.exp(-dt / obs.rotor_tau)
    acc = np.empty(3)
    for i in range(3):
        obs.f_B[i] = b.cmd.f_B_alloc[i] + (obs.f_B[i] - b.cmd.f_B_alloc[i]) * decay
    mat_vec(est.R_WB, obs.f_B, acc)
    mass = b.body.mass
    for i in range(3):
        acc[i] = (acc[i] + est.f_ext_W[i]) / mass
    acc[2] -= b.body.gravity
    turn, step, rot = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        est.p_WB[i] += dt * (est.v_WB[i] + 0.5 * dt * acc[i])
        est.v_WB[i] += dt * acc[i]
        est.w_WB_B[i] = b.meas.gyro[i] - obs.bias[i]
        turn[i] = dt * est.w_WB_B[i]
    exp_so3(turn, step)
    mat_mat(est.R_WB, step, rot)
    for i in range(3):
        for j in range(3):
            est.R_WB[i, j] = rot[i, j]


@njit(cache=True, error_model="numpy")
def correct(b: Record) -> None:
    """Use a fresh motion-capture sample, compared with the estimate at its exposure."""
    obs, est, meas, dt = b.obs, b.est, b.meas, b.par.dt
    back = int(meas.mocap_age / dt + 0.5)
    back = min(max(back, 0), HISTORY - 1)
    h = (obs.head - 1 - back) % HISTORY
    period = min(max(meas.mocap_period, dt), 0.2)
    theta = math.exp(-obs.bandwidth * period)
    g = 1.0 - theta**3
    hv = 1.5 * (1.0 - theta) ** 2 * (1.0 + theta) / period
    k = (1.0 - theta) ** 3 / (period * period) * b.body.mass
    shift = np.empty(3)
    for i in range(3):
        e = meas.p_WB[i] - obs.p[h, i]
        shift[i] = g * e
        est.p_WB[i] += shift[i]
        est.v_WB[i] += hv * e
        est.f_ext_W[i] += k * e
    # attitude: error in B at the exposure; a second-order filter with both poles at theta
    rot, turn, step = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    mat_t_mat(obs.R[h], meas.R_WB, rot)
    log_so3(rot, turn)
    ga = 1.0 - theta * theta
    gb = (1.0 - theta) ** 2 / period
    for i in range(3):
        obs.bias[i] -= gb * turn[i] * 0.1  # the bias is slow: a tenth of the filter's speed
        turn[i] *= ga
    exp_so3(turn, step)
    mat_mat(est.R_WB, step, rot)
    for i in range(3):
        for j in range(3):
            est.R_WB[i, j] = rot[i, j]
    orthonormalise(est.R_WB)
    # tip correction, in B
    pred, err = np.empty(3), np.empty(3)
    for i in range(3):
        err[i] = obs.p_BT[h, i] + obs.c_B[i]
    mat_vec(obs.R[h], err, pred)
    for i in range(3):
        pred[i] = meas.p_WT[i] - obs.p[h, i] - pred[i]
    mat_t_vec(obs.R[h], pred, err)
    gc = 1.0 - theta
    for i in range(3):
        obs.c_B[i] += gc * err[i]
    # the corrections also hold for the past that later samples will be compared with
    for n in range(back + 1):
        j = (obs.head - 1 - n) % HISTORY
        mat_mat(obs.R[j], step, rot)
        for a in range(3):
            obs.p[j, a] += shift[a]
            for c in range(3):
                obs.R[j, a, c] = rot[a, c]


@njit(cache=True, error_model="numpy")
def step(b: Record) -> None:
    """One control tick of the observer."""
    obs, est, meas, p_BT = b.obs, b.est, b.meas, b.body.p_BT
    est.t = b.t
    if obs.ready == 0.0:
        if meas.mocap_fresh == 0.0:
            return
        _start(b, p_BT)
    predict(b)
    i = obs.head
    for a in range(3):
        obs.p[i, a] = est.p_WB[a]
        obs.p_BT[i, a] = p_BT[a]
        for c in range(3):
            obs.R[i, a, c] = est.R_WB[a, c]
    obs.head = (obs.head + 1) % HISTORY
    if meas.mocap_fresh > 0.0:
        correct(b)
    fill_tip(b, obs.c_B)


@njit(cache=True, error_model="numpy")
def _start(b: Record, p_BT: Any) -> None:
    """Begin at the first motion-capture sample, at rest."""
    obs, est, meas = b.obs, b.est, b.meas
    for a in range(3):
        est.p_WB[a] = meas.p_WB[a]
        est.v_WB[a] = 0.0
        est.f_ext_W[a] = 0.0
        obs.c_B[a] = 0.0
        for c in range(3):
            est.R_WB[a, c] = meas.R_WB[a, c]
    for n in range(HISTORY):
        for a in range(3):
            obs.p[n, a] = est.p_WB[a]
            obs.p_BT[n, a] = p_BT[a]
            for c in range(3):
                obs.R[n, a, c] = est.R_WB[a, c]
    obs.head = 0
    obs.ready = 1.0


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF."""
    step(belief[0])


@cfunc(ON_BELIEF, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all estimators."""
    step(carray(belief, 1)[0])
