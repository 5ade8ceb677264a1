"""The tip: forward kinematics at the encoders plus a slow correction c_B from its markers.

The correction absorbs calibration error, flexibility and the probe's spring. The filter tracks it
as a random walk, one variance for the three axes, and gates artefacts of the markers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import cross, mat_mat, mat_t_vec, mat_vec

Record = Any
Array = Any

GATE = 36.0  # squared, in standard deviations: a touch moves the tip faster than the walk expects
AGREE = 0.005  # m, between rejected samples in a row: then the tip did move
RESTART_AFTER = 3


@njit(cache=True, error_model="numpy")
def compute_tip_error(
    meas: Record, c_B: Array, p: Array, R: Array, p_BI: Array, p_BT: Array, out: Array
) -> None:
    """Write measured less predicted tip (3,) m in B; `p`, `R`, `p_BT` hold at the exposure.

    `p` is the position of the point p_BI of B.
    """
    d = np.empty(3)
    for i in range(3):
        d[i] = meas.p_WT[i] - p[i]
    mat_t_vec(R, d, out)
    for i in range(3):
        out[i] += p_BI[i] - p_BT[i] - c_B[i]


@njit(cache=True, error_model="numpy")
def correct_tip(b: Record, c_B: Array, p: Array, R: Array, p_BI: Array, p_BT: Array) -> None:
    """Update the correction with a fresh sample; an artefact gives way to the last good sample."""
    flt, meas = b.flt, b.meas
    err = np.empty(3)
    compute_tip_error(meas, c_B, p, R, p_BI, p_BT, err)
    flt.P_c += flt.q_c * meas.mocap_period
    size = apart = 0.0
    for i in range(3):
        size += err[i] * err[i]
        apart += (err[i] - flt.tip_last[i]) ** 2
    if size > GATE * (flt.P_c + flt.r_c):
        flt.tip_row = flt.tip_row + 1 if apart < AGREE * AGREE else 1
        for i in range(3):
            flt.tip_last[i] = err[i]
        if flt.tip_row < RESTART_AFTER:
            flt.tip_rejected += 1
            for i in range(3):
                meas.p_WT[i], meas.axis_W[i] = flt.good_p_WT[i], flt.good_axis_W[i]
            return
        flt.P_c = size
    flt.tip_row = 0
    gain = flt.P_c / (flt.P_c + flt.r_c)
    flt.P_c *= 1.0 - gain
    for i in range(3):
        c_B[i] += gain * err[i]
        flt.good_p_WT[i], flt.good_axis_W[i] = meas.p_WT[i], meas.axis_W[i]


@njit(cache=True, error_model="numpy")
def fill_tip(b: Record, c_B: Array) -> None:
    """Tip pose and velocity from platform estimate, kinematics and tip correction."""
    est, body = b.est, b.body
    tip, w = np.empty(3), np.empty(3)
    for i in range(3):
        tip[i] = body.p_BT[i] + c_B[i]
    mat_vec(est.R_WB, tip, est.p_WT)
    cross(est.w_WB_B, tip, w)
    for i in range(3):
        est.p_WT[i] += est.p_WB[i]
        for j in range(body.n_joints):
            w[i] += body.J_BT[i, j] * est.qd[j]
    mat_vec(est.R_WB, w, est.v_WT)
    for i in range(3):
        est.v_WT[i] += est.v_WB[i]
    mat_mat(est.R_WB, body.R_BT, est.R_WT)
