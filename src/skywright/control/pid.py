"""The pieces that the built-in laws share: position, attitude and arm loops.

Every gain follows from a bandwidth: stiffness m wn^2, damping 2 zeta m wn, integral wi times the
stiffness; the same with the composite inertia for the attitude.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import cross, mat_t_mat, mat_t_vec, mat_vec

Record = Any

SLOW = 1e-3
"""m/s, desired sliding speed below which the friction feed-forward fades."""


@njit(cache=True, error_model="numpy")
def position_force(
    par: Record, mem: Record, ref: Record, est: Record, body: Record, saturated: float, f_W: Any
) -> None:
    """Tognon 2018, law (4): f_W = -g_1 + M_11 a^n + K^D (v^n - v) + K^P e + sigma.

    e is the tip's position error where `ref.track_tip` is set, else the platform's; the velocity is
    always the platform's. sigma integrates e with a dead zone in the interaction frame: along the
    surface normal only while |e_n| exceeds `ref.dead_zone` (a dead zone of 0 integrates always),
    so in contact the intended penetration does not wind up. The integral rests while the rotors
    are saturated.

    Beyond the paper: in contact the believed Coulomb friction of the desired sliding, mu K^P |e_n|
    along v_T^d, is fed forward (`par.friction`, 0 gives the paper's law). Without it each reversal
    of the friction leaves the tip 2 mu F / K^P behind until the integral has caught up.
    """
    e, v = np.empty(3), np.empty(3)
    for i in range(3):
        if ref.track_tip > 0.5:
            e[i] = ref.p_WT[i] - est.p_WT[i]
        else:
            e[i] = ref.p_WB[i] - est.p_WB[i]
        v[i] = ref.v_WB[i] - est.v_WB[i]
    force_from_errors(par, mem, ref, body, e, v, saturated, f_W)


@njit(cache=True, error_model="numpy")
def force_from_errors(
    par: Record, mem: Record, ref: Record, body: Record, e: Any, v: Any, saturated: float, f_W: Any
) -> None:
    """`position_force` of a position error e (3,) m and a velocity error v (3,) m/s, in W.

    The laws differ in whose errors these are, the platform's or the tip's.
    """
    kp = body.mass * par.wn_p * par.wn_p
    kd = 2.0 * par.zeta_p * body.mass * par.wn_p
    for i in range(3):
        f_W[i] = body.mass * ref.a_WB[i] + kd * v[i] + kp * e[i] + mem.sigma[i]
    f_W[2] += body.mass * body.gravity
    normal = 0.0
    for i in range(3):
        normal += ref.R_WS[i, 2] * e[i]
    if ref.dead_zone > 0.0 and normal < 0.0:
        speed = math.sqrt(ref.v_WT[0] ** 2 + ref.v_WT[1] ** 2 + ref.v_WT[2] ** 2 + SLOW**2)
        for i in range(3):
            f_W[i] -= par.friction * kp * normal * ref.v_WT[i] / speed
    if saturated > 0.0:
        return
    keep = 1.0 if ref.dead_zone > 0.0 and abs(normal) < ref.dead_zone else 0.0
    total = 0.0
    for i in range(3):
        mem.sigma[i] += par.dt * par.wi_p * kp * (e[i] - keep * normal * ref.R_WS[i, 2])
        total += mem.sigma[i] * mem.sigma[i]
    if total > par.f_integral_max * par.f_integral_max:
        scale = par.f_integral_max / math.sqrt(total)
        for i in range(3):
            mem.sigma[i] *= scale


@njit(cache=True, error_model="numpy")
def attitude_torque(
    par: Record,
    mem: Record,
    R_des: Any,
    w_des_B: Any,
    wd_des_B: Any,
    est: Record,
    body: Record,
    f_B: Any,
    saturated: float,
    t_B: Any,
) -> None:
    """Tognon 2018, law (3), about the whole robot's centre of mass.

    t_B = p_BC x f_B + I_C (wd^n + wn^2 e_R + 2 zeta wn e_w) + theta + w x I_C w. The paper's g_2 is
    the first term at hover; the rest of it compensates the commanded lateral force's lever about
    the centre of mass. e_R = 1/2 [R^T R^n - R^nT R]_vee; the rate error is taken to the same frame,
    e_w = R^T R^n w^n - w (E001-4).
    """
    rel, e_R, e_w, acc, lever = (
        np.empty((3, 3)),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
    )
    mat_t_mat(est.R_WB, R_des, rel)
    e_R[0] = 0.5 * (rel[2, 1] - rel[1, 2])
    e_R[1] = 0.5 * (rel[0, 2] - rel[2, 0])
    e_R[2] = 0.5 * (rel[1, 0] - rel[0, 1])
    mat_vec(rel, w_des_B, e_w)
    kp, kd = par.wn_R * par.wn_R, 2.0 * par.zeta_R * par.wn_R
    for i in range(3):
        e_w[i] -= est.w_WB_B[i]
        acc[i] = wd_des_B[i] + kp * e_R[i] + kd * e_w[i]
    # I_C = I_B - m (c.c 1 - c c^T)
    c, m = body.p_BC, body.mass
    cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    spin, gyro, push = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        spin[i] = 0.0
        t_B[i] = 0.0
        push[i] = 0.0
        for j in range(3):
            inertia = body.I_B[i, j] + m * c[i] * c[j] - (m * cc if i == j else 0.0)
            t_B[i] += inertia * acc[j]
            spin[i] += inertia * est.w_WB_B[j]
            push[i] += inertia * e_R[j]
    cross(est.w_WB_B, spin, gyro)
    cross(c, f_B, lever)
    for i in range(3):
        t_B[i] += lever[i] + gyro[i] + mem.theta[i]
        if saturated == 0.0:
            mem.theta[i] += par.dt * par.wi_R * kp * push[i]
            mem.theta[i] = min(max(mem.theta[i], -par.t_integral_max), par.t_integral_max)


@njit(cache=True, error_model="numpy")
def arm_velocity(par: Record, ref: Record, est: Record, body: Record, qd: Any) -> None:
    """Tognon 2018, law (2): v_M* = v_M^n + K_M (q_M^n - q_M), returned at the joints."""
    n = body.n_joints
    for i in range(n):
        qd[i] = 0.0
    for j in range(n):  # motor j
        v = 0.0
        for i in range(n):
            v += par.belt_inv[j, i] * (ref.qd[i] + par.k_arm * (ref.q[i] - est.q[i]))
        v = min(max(v, -par.motor_speed_max[j]), par.motor_speed_max[j])
        for i in range(n):
            qd[i] += par.belt[i, j] * v


@njit(cache=True, error_model="numpy")
def to_body(est: Record, f_W: Any, f_B: Any) -> None:
    """f_B = R_WB^T f_W."""
    mat_t_vec(est.R_WB, f_W, f_B)


@njit(cache=True, error_model="numpy")
def rest(mem: Record, cmd: Record) -> None:
    """Motors off: no wrench, integrals cleared."""
    for i in range(3):
        mem.sigma[i] = 0.0
        mem.theta[i] = 0.0
        cmd.f_B[i] = 0.0
        cmd.t_B[i] = 0.0
