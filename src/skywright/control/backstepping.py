"""Sanchez-Cuevas 2020, section 4: backstepping with integral action, contact fed forward.

Of each axis, with z_1 = x_d - x, chi its integral, alpha = x_d' + lambda chi + k_1 z_1 and
z_2 = alpha - x', equations (42) to (44) give

    x'' = x_d'' + (1 - k_1^2 + lambda) z_1 + (k_1 + k_2) z_2 - k_1 lambda chi

which is stable for all positive gains and equals the PID x_d'' + (1 + lambda + k_1 k_2) z_1 +
(k_1 + k_2) z_1' + k_2 lambda chi (put z_2 in). Printed errors mended: e_p = p_d - p in (28), the
sign of k^2 in K (E004-1, E004-2), the lever in (24) (E004-6), only the force is turned in (23)
(E004-7). The attitude's error is a rotation vector instead of Euler angles (E004-4).

Platform, (25) and (26): mass and inertia of the arm's present pose, and less the contact wrench:
that of the tip from the measured force (24), that of the docking feet as planned. Arm, (27), (30)
and (31): along the probe the force F_d + k_f (F_d - F), across it the joints. Servos take speeds,
and a speed of the tip against the probe's spring is a rate of force, so (31) becomes
v = F_d' / K + k_f (F_d - F) / K: the servo map of section 4.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.pid import SLOW, arm_velocity, rest
from skywright.control.signature import LAW
from skywright.core.rotations import cross, mat_t_mat, mat_t_vec, mat_vec
from skywright.core.types import MAX_JOINTS

Record = Any

TIP_SPEED = 0.03
"""m/s, at which the arm moves the tip at most while it controls the force, or finds the surface."""
TOUCHING = 0.2  # N
REACH = 0.03
"""m, that the force loop moves the tip ahead of where the reference has it, and no farther."""
FOLLOW = 0.5
"""rad/s, at which the platform follows the arm: a sixth of the force loop's and of its own."""
SHIFT_MAX = 0.05  # m
DAMPING = 1e-6
"""m^2/rad^2, of the inverse of the arm's Jacobian: 1 mm of lever."""


@njit(cache=True, error_model="numpy")
def backstep(z1: float, z1_dot: float, chi: float, k1: float, k2: float, lam: float) -> float:
    """Return x'' - x_d'' by (42) to (44)."""
    z2 = z1_dot + lam * chi + k1 * z1
    return (1.0 - k1 * k1 + lam) * z1 + (k1 + k2) * z2 - k1 * lam * chi


@njit(cache=True, error_model="numpy")
def _add_friction(b: Record, f: Any) -> None:
    """Add the believed Coulomb friction of a desired sliding to f (3,) N in B, `par.friction` F.

    Without it the platform would have to be off by mu F over its stiffness before the tip moves,
    which is centimetres. It fades below SLOW.
    """
    ref, v_B = b.ref, np.empty(3)
    mat_t_vec(b.est.R_WB, ref.v_WB, v_B)
    along = 0.0
    for i in range(3):
        along += v_B[i] * b.body.R_BT[i, 2]
    speed = SLOW * SLOW
    for i in range(3):
        v_B[i] -= along * b.body.R_BT[i, 2]
        speed += v_B[i] * v_B[i]
    for i in range(3):
        f[i] -= b.par.friction * max(b.est.f_tip, 0.0) * v_B[i] / math.sqrt(speed)


@njit(cache=True, error_model="numpy")
def find_contact_wrench(b: Record, f: Any, t: Any) -> None:
    """Fill force (3,) N and torque (3,) N m about B's origin of the structure on the robot, in B.

    Tip: (24) for any arm, -F along the probe, at the tip. Feet: as planned.
    """
    ref, body = b.ref, b.body
    for i in range(3):
        f[i] = 0.0
        t[i] = 0.0
    if ref.press > 0.5:
        for i in range(3):
            f[i] = -b.est.f_tip * body.R_BT[i, 2]
        _add_friction(b, f)
        cross(body.p_BT, f, t)
    if ref.docked > 0.5:
        for i in range(3):
            f[i] += ref.f_feet_B[i]
            t[i] += ref.t_feet_B[i]


@njit(cache=True, error_model="numpy")
def _find_extension(b: Record) -> float:
    """How far (m) the arm has the tip ahead of where the reference has it, along the probe."""
    ref, body, total = b.ref, b.body, 0.0
    p_W, p_B = np.empty(3), np.empty(3)
    for i in range(3):
        p_W[i] = ref.p_WT[i] - ref.p_WB[i]
    mat_t_vec(ref.R_WB, p_W, p_B)
    for i in range(3):
        total += body.R_BT[i, 2] * (body.p_BT[i] - p_B[i])
    return total


@njit(cache=True, error_model="numpy")
def _follow_arm(b: Record, shift_W: Any) -> None:
    """Fill the shift (3,) m of the platform's reference that brings the arm back to its pose.

    While it presses in flight the platform follows along the probe what the arm has reached out,
    slower than the force loop, so that static errors of place do not use up the arm's way. It goes
    back in the same way. `mem.lead[0]` holds the shift (m).
    """
    par, mem, ref, body = b.par, b.mem, b.ref, b.body
    axis = np.empty(3)
    mat_vec(b.est.R_WB, body.R_BT[:, 2], axis)
    if ref.press > 0.5 and ref.docked < 0.5:
        rate = FOLLOW * _find_extension(b)
    else:
        rate = -FOLLOW * mem.lead[0]
    mem.lead[0] = min(max(mem.lead[0] + par.dt * rate, -SHIFT_MAX), SHIFT_MAX)
    for i in range(3):
        shift_W[i] = mem.lead[0] * axis[i]


@njit(cache=True, error_model="numpy")
def command_platform(b: Record) -> None:
    """(25) and (26): fill `cmd.f_B` and `cmd.t_B`."""
    par, mem, ref, est, body, cmd = b.par, b.mem, b.ref, b.est, b.body, b.cmd
    k, lam = par.k_p, par.k_p[2]
    m = body.mass
    integrate = cmd.saturated == 0.0 and ref.docked < 0.5
    standard = ref.mode > 0.5
    f_W, f_free, f_C, t_C = np.zeros(3), np.empty(3), np.empty(3), np.empty(3)
    shift, total = np.empty(3), 0.0
    _follow_arm(b, shift)
    for i in range(3):
        if standard and i < 2:
            mem.sigma[i] = 0.0
            continue
        z1 = ref.p_WB[i] + shift[i] - est.p_WB[i]
        z1_dot = ref.v_WB[i] - est.v_WB[i]
        f_W[i] = m * (ref.a_WB[i] + backstep(z1, z1_dot, mem.sigma[i], k[0], k[1], lam))
        if integrate:
            mem.sigma[i] += par.dt * z1
        total += mem.sigma[i] * mem.sigma[i]
    f_W[2] += m * body.gravity
    largest = par.f_integral_max / max(m * k[1] * lam, 1e-9)
    if total > largest * largest:
        for i in range(3):
            mem.sigma[i] *= largest / math.sqrt(total)
    if standard:  # coplanar logic: thrust along z_B alone, height held
        f_free[0] = 0.0
        f_free[1] = 0.0
        f_free[2] = min(max(f_W[2] / max(est.R_WB[2, 2], 0.5), 0.0), par.thrust_max)
    else:
        mat_t_vec(est.R_WB, f_W, f_free)
    find_contact_wrench(b, f_C, t_C)
    for i in range(3):
        cmd.f_B[i] = f_free[i] - f_C[i]
    _command_torque(b, f_free, t_C, integrate)


@njit(cache=True, error_model="numpy")
def _command_torque(b: Record, f_free: Any, t_C: Any, integrate: bool) -> None:
    """(26), about the centre of mass: t_B = I_C w_d' + w x I_C w + c x f - t_C.

    f is the whole force on the robot but its weight, so rotors and contact together.
    """
    par, mem, ref, est, body, cmd = b.par, b.mem, b.ref, b.est, b.body, b.cmd
    k, lam = par.k_R, par.k_R[2]
    rel, e, w_des = np.empty((3, 3)), np.empty(3), np.empty(3)
    acc, spin, gyro, lever = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    mat_t_mat(est.R_WB, ref.R_WB, rel)
    e[0] = 0.5 * (rel[2, 1] - rel[1, 2])
    e[1] = 0.5 * (rel[0, 2] - rel[2, 0])
    e[2] = 0.5 * (rel[1, 0] - rel[0, 1])
    mat_vec(rel, ref.w_WB_B, w_des)
    for i in range(3):
        acc[i] = ref.wd_WB_B[i] + backstep(
            e[i], w_des[i] - est.w_WB_B[i], mem.theta[i], k[0], k[1], lam
        )
    c, m = body.p_BC, body.mass
    cc = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    for i in range(3):
        spin[i] = 0.0
        cmd.t_B[i] = 0.0
        own = 0.0
        for j in range(3):
            inertia = body.I_B[i, j] + m * c[i] * c[j] - (m * cc if i == j else 0.0)
            cmd.t_B[i] += inertia * acc[j]
            spin[i] += inertia * est.w_WB_B[j]
            if i == j:
                own = inertia
        if integrate:
            most = par.t_integral_max / max(own * k[1] * lam, 1e-9)
            mem.theta[i] = min(max(mem.theta[i] + par.dt * e[i], -most), most)
    cross(est.w_WB_B, spin, gyro)
    cross(c, f_free, lever)
    for i in range(3):
        cmd.t_B[i] += gyro[i] + lever[i] - t_C[i]


@njit(cache=True, error_model="numpy")
def _find_approach(ref: Record, est: Record, body: Record) -> float:
    """Speed (m/s) of the tip along the probe that the platform makes beside its reference's.

    A reference that slides along the surface moves along a probe that leans, and not towards it.
    """
    v_W, v_B, turn, total = np.empty(3), np.empty(3), np.empty(3), 0.0
    for i in range(3):
        v_W[i] = est.v_WB[i] - ref.v_WB[i]
    mat_t_vec(est.R_WB, v_W, v_B)
    cross(est.w_WB_B, body.p_BT, turn)
    for i in range(3):
        total += (v_B[i] + turn[i]) * body.R_BT[i, 2]
    return total


@njit(cache=True, error_model="numpy")
def command_arm(b: Record) -> None:
    """(27), (30), (31) through the servo map: fill `cmd.qd`."""
    par, ref, est, body, cmd = b.par, b.ref, b.est, b.body, b.cmd
    arm_velocity(par, ref, est, body, cmd.qd)
    if ref.press < 0.5 or par.spring <= 0.0:
        return
    n = body.n_joints
    along = (ref.force - est.f_tip) * par.k_force / par.spring
    along = min(max(along, -TIP_SPEED), TIP_SPEED)
    if ref.docked < 0.5:  # in flight the arm takes back what the platform moves
        along -= _find_approach(ref, est, body)
    p_W, p_B, across = np.empty(3), np.empty(3), 0.0
    for i in range(3):
        p_W[i] = ref.p_WT[i] - ref.p_WB[i]
    mat_t_vec(ref.R_WB, p_W, p_B)
    for i in range(3):
        across += body.R_BT[i, 0] * (p_B[i] - body.p_BT[i])
    if _find_extension(b) > REACH:  # nothing there, or it has gone
        along = min(along, 0.0)
    across = min(max(par.k_arm * across, -TIP_SPEED), TIP_SPEED)
    if est.f_tip > TOUCHING:  # friction holds the tip: to insist would only load arm and tip
        across = 0.0
    J = np.zeros((2, MAX_JOINTS))
    for j in range(n):
        for i in range(3):
            J[0, j] += body.R_BT[i, 2] * body.J_BT[i, j]
            J[1, j] += body.R_BT[i, 0] * body.J_BT[i, j]
    # joint speeds of least size that move the tip so: J^T (J J^T + e I)^-1 v
    aa, cc, ac = DAMPING, DAMPING, 0.0
    for j in range(n):
        aa += J[0, j] * J[0, j]
        cc += J[1, j] * J[1, j]
        ac += J[0, j] * J[1, j]
    det = aa * cc - ac * ac
    x = (cc * along - ac * across) / det
    y = (aa * across - ac * along) / det
    for j in range(n):
        v = J[0, j] * x + J[1, j] * y
        cmd.qd[j] = min(max(v, -par.motor_speed_max[j]), par.motor_speed_max[j])


@njit(cache=True, error_model="numpy")
def step(b: Record) -> None:
    """Fill `cmd` of a BELIEF record."""
    command_arm(b)
    if b.ref.active < 0.5:
        rest(b.mem, b.cmd)
        return
    command_platform(b)


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF: one argument, so that a call from Python stays cheap."""
    step(belief[0])


@cfunc(LAW, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all laws."""
    step(carray(belief, 1)[0])
