"""Inverse-kinematics feedback: the arm's joints correct the tip's measured position.

The standard control of a redundant manipulator (Siciliano, Robotics, 2009, section 3.7.1): joint
velocities qd = qd^n + J^+ K e_E with the tip's error e_E. Tognon et al. 2018, section V, tried it
and dropped it because the arm's flexibility puts the feedback across an elastic mode: the tip
vibrates. The platform tracks its own nominal pose. In contact only the error along the surface is
fed back: joint velocity integrates, and the intended penetration would push without end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.pid import arm_velocity, attitude_torque, force_from_errors, rest, to_body
from skywright.control.signature import LAW
from skywright.core.rotations import mat_t_vec
from skywright.core.types import MAX_JOINTS

Record = Any

DAMPING = 0.05
"""m/rad, of the pseudo-inverse: small against the arm's reach, bounded near a stretched arm."""


@njit(cache=True, error_model="numpy")
def tip_feedback(par: Record, ref: Record, est: Record, body: Record, qd: Any) -> None:
    """qd += J^T (J J^T + d^2 1)^-1 K e_E, all in B, solved through the small joint-side matrix.

    e_E loses its part along z_S while the reference is in contact (`ref.dead_zone` > 0).
    J^T (J J^T + d^2)^-1 = (J^T J + d^2)^-1 J^T; Gauss elimination without pivoting is safe
    because the matrix is positive definite.
    """
    n = body.n_joints
    e_W, e_B = np.empty(3), np.empty(3)
    normal = 0.0
    for i in range(3):
        e_W[i] = par.k_arm * (ref.p_WT[i] - est.p_WT[i])
        normal += ref.R_WS[i, 2] * e_W[i]
    if ref.dead_zone > 0.0:
        for i in range(3):
            e_W[i] -= normal * ref.R_WS[i, 2]
    mat_t_vec(est.R_WB, e_W, e_B)
    a, x = np.zeros((MAX_JOINTS, MAX_JOINTS)), np.zeros(MAX_JOINTS)
    for r in range(n):
        for i in range(3):
            x[r] += body.J_BT[i, r] * e_B[i]
            for c in range(n):
                a[r, c] += body.J_BT[i, r] * body.J_BT[i, c]
        a[r, r] += DAMPING * DAMPING
    for p in range(n):
        for r in range(p + 1, n):
            factor = a[r, p] / a[p, p]
            for c in range(p, n):
                a[r, c] -= factor * a[p, c]
            x[r] -= factor * x[p]
    for r in range(n - 1, -1, -1):
        for c in range(r + 1, n):
            x[r] -= a[r, c] * x[c]
        x[r] /= a[r, r]
        qd[r] += x[r]


@njit(cache=True, error_model="numpy")
def step(par: Record, mem: Record, ref: Record, est: Record, body: Record, cmd: Record) -> None:
    """Tip feedback through the arm while the tip is tracked, law (2) elsewhere; law (3); platform
    on its nominal position.
    """
    if ref.track_tip > 0.5:
        for j in range(MAX_JOINTS):
            cmd.qd[j] = ref.qd[j] if j < body.n_joints else 0.0
        tip_feedback(par, ref, est, body, cmd.qd)
        limit_motors(par, body, cmd.qd)
    else:
        arm_velocity(par, ref, est, body, cmd.qd)
    if ref.active < 0.5:
        rest(mem, cmd)
        return
    e, v, f_W = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        e[i] = ref.p_WB[i] - est.p_WB[i]
        v[i] = ref.v_WB[i] - est.v_WB[i]
    force_from_errors(par, mem, ref, body, e, v, cmd.saturated, f_W)
    to_body(est, f_W, cmd.f_B)
    attitude_torque(
        par, mem, ref.R_WB, ref.w_WB_B, ref.wd_WB_B, est, body, cmd.f_B, cmd.saturated, cmd.t_B
    )


@njit(cache=True, error_model="numpy")
def limit_motors(par: Record, body: Record, qd: Any) -> None:
    """Slow all joints by one factor, so that no motor behind the belt exceeds its speed."""
    n = body.n_joints
    scale = 1.0
    for j in range(n):
        v = 0.0
        for i in range(n):
            v += par.belt_inv[j, i] * qd[i]
        if abs(v) > par.motor_speed_max[j]:
            scale = min(scale, par.motor_speed_max[j] / abs(v))
    for i in range(n):
        qd[i] *= scale


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF: one argument, so that a call from Python stays cheap."""
    b = belief[0]
    step(b.par, b.mem, b.ref, b.est, b.body, b.cmd)


@cfunc(LAW, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all laws."""
    b = carray(belief, 1)[0]
    step(b.par, b.mem, b.ref, b.est, b.body, b.cmd)
