"""The tip: forward kinematics of the encoder angles plus a slow correction c_B from its markers.

The correction includes calibration error, flexibility and the probe's spring. The filter models it
as a random walk with one variance for the three axes, and rejects artefacts of the markers.
"""

from __future__ import annotations

from typing import Any

from skywright.core.record import Record, Vec3
from skywright.core.rotations import cross, mat_mat, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.vehicle.component import helper

GATE = 36.0  # squared standard deviations; wide, as a touch moves the tip faster than the walk
AGREE = 0.005  # m, largest difference of rejected samples in a row that show a true motion
RESTART_AFTER = 3


TIP_WALK = 5e-4
"""m/sqrt(s): walk of the tip's correction; the gain is then a bandwidth of about 12 rad/s."""


class TipCorrection(Record):
    """State of the tip correction."""

    q_c: float  # m^2/s, walk of the correction
    r_c: float  # m^2, of a tip sample
    c_B: Vec3  # m, correction
    P_c: float  # m^2, its variance per axis
    good_p_WT: Vec3  # last accepted tip sample
    good_axis_W: Vec3
    tip_last: Vec3
    tip_row: int
    tip_rejected: int


@helper
def compute_tip_error(mocap: Any, c_B: Any, p: Any, R: Any, p_BI: Any, p_BT: Any, out: Any) -> None:
    """Write measured minus predicted tip (3,) m in B; `p`, `R`, `p_BT` are those at the exposure.

    `p` is the position of the point p_BI of B.
    """
    d = local(3)
    for i in range(3):
        d[i] = mocap.p_WT[i] - p[i]
    mat_t_vec(R, d, out)
    for i in range(3):
        out[i] += p_BI[i] - p_BT[i] - c_B[i]


@helper
def correct_tip(me: Any, mocap: Any, c_B: Any, p: Any, R: Any, p_BI: Any, p_BT: Any) -> None:
    """Update the correction with a new sample; the last good sample replaces an artefact."""
    err = local(3)
    compute_tip_error(mocap, c_B, p, R, p_BI, p_BT, err)
    me.P_c += me.q_c * mocap.period
    size = apart = 0.0
    for i in range(3):
        size += err[i] * err[i]
        apart += (err[i] - me.tip_last[i]) ** 2
    if size > GATE * (me.P_c + me.r_c):
        me.tip_row = me.tip_row + 1 if apart < AGREE * AGREE else 1
        for i in range(3):
            me.tip_last[i] = err[i]
        if me.tip_row < RESTART_AFTER:
            me.tip_rejected += 1
            for i in range(3):
                mocap.p_WT[i], mocap.axis_W[i] = me.good_p_WT[i], me.good_axis_W[i]
            return
        me.P_c = size
    me.tip_row = 0
    gain = me.P_c / (me.P_c + me.r_c)
    me.P_c *= 1.0 - gain
    for i in range(3):
        c_B[i] += gain * err[i]
        me.good_p_WT[i], me.good_axis_W[i] = mocap.p_WT[i], mocap.axis_W[i]


@helper
def fill_tip(est: Any, body: Any, c_B: Any) -> None:
    """Fill tip pose and velocity from platform estimate, kinematics and tip correction."""
    tip, w = local(3), local(3)
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
