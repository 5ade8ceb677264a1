"""Cascade as autopilots fly it: position P, velocity P, attitude P, rate PI with a lead.

Loops (PX4's structure): velocity asked = v_des + k e; acceleration = k (velocity error), less the
damping of a swinging link; the force for it, with every known external force cancelled, points the
thrust; rate asked = k (attitude error); angular acceleration = k (rate error). The torque for it
comes from models/floating.py, so that a link on a joint without a servo, arms that moved and forces
at the hands turn the platform no more than the model is wrong. The velocity loop needs no integral
of its own: f_rest_W of vehicle/arms/external_wrench.py is one. All gains follow from bandwidths
(`compute_gains`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.pid import arm_velocity, rest
from skywright.control.signature import LAW
from skywright.control.thrust_vectoring import aim_thrust
from skywright.core.rotations import (
    cross,
    log_so3,
    mat_t_mat,
    mat_t_vec,
    mat_vec,
    norm,
)

Record = Any

JERK_MAX = 3.0
"""m/s^3, of a reference; a larger step is one between two tables."""
SHIFT = 2  # place of the tip's shift (3,) m in mem.user
SHIFT_BANDWIDTH = 3.0
"""rad/s, of that shift; the estimates that it is made of are of 2 to 3 rad/s themselves."""


@njit(cache=True, error_model="numpy")
def step(b: Record) -> None:
    """Fill `cmd.f_B` = (0, 0, T), `cmd.t_B` and `cmd.qd`."""
    if begin(b):
        f_W = np.empty(3)
        force_for_motion(b, f_W)
        apply_force(b, f_W)


@njit(cache=True, error_model="numpy")
def begin(b: Record) -> bool:
    """Fill `cmd.qd`; returns whether the motors are on. Off, everything is at rest."""
    mem = b.mem
    arm_velocity(b.par, b.ref, b.est, b.body, b.cmd.qd)
    if b.ref.active >= 0.5:
        return True
    rest(mem, b.cmd)
    for i in range(3):
        mem.lead[i] = mem.user[SHIFT + i] = 0.0
    return False


@njit(cache=True, error_model="numpy")
def apply_force(b: Record, f_W: Any) -> None:
    """Make a force f_W (3,) N by thrust and attitude."""
    cmd, R_des, acc = b.cmd, np.empty((3, 3)), np.empty(3)
    thrust = aim_thrust(b.par, b.ref, b.est, b.body, f_W, R_des)
    cmd.f_B[0], cmd.f_B[1], cmd.f_B[2] = 0.0, 0.0, thrust
    angular_acceleration(b, R_des, acc)
    torque_for_turn(b, acc)


@njit(cache=True, error_model="numpy")
def force_for_motion(b: Record, f_W: Any) -> None:
    """Position and velocity loop, swing damping and feed-forward: the rotors' force f_W (3,) N."""
    body, w = b.body, b.wrench
    acceleration_for_motion(b, f_W)
    f_W[2] += body.gravity
    rest_W = np.empty(3)
    size = 0.0
    for i in range(3):
        rest_W[i] = w.f_hands_W[i] + w.f_rest_W[i]
        size += rest_W[i] * rest_W[i]
    size = min(1.0, b.par.f_integral_max / max(math.sqrt(size), 1e-9))
    for i in range(3):
        f_W[i] = body.mass * f_W[i] - size * rest_W[i]


@njit(cache=True, error_model="numpy")
def acceleration_for_motion(b: Record, a_W: Any) -> None:
    """Acceleration a_W (3,) m/s^2 that the loops ask of the platform, the reference's included."""
    par, ref, est, w = b.par, b.ref, b.est, b.wrench
    # axes of the platform, level: forward, left, up
    forward, left = np.empty(2), np.empty(2)
    x, y = est.R_WB[0, 0], est.R_WB[1, 0]
    size = max(math.sqrt(x * x + y * y), 1e-3)
    forward[0], forward[1] = x / size, y / size
    left[0], left[1] = -forward[1], forward[0]
    e, v, a = np.empty(3), np.empty(3), np.empty(3)
    shift, rate = np.empty(3), np.empty(3)
    shift_for_tip(b, shift, rate)
    for i in range(3):
        shift[i] += ref.p_WB[i]
        rate[i] += ref.v_WB[i]
    into_axes(forward, left, shift, est.p_WB, e)
    into_axes(forward, left, rate, est.v_WB, v)
    speed = 0.0
    for i in range(3):
        e[i] *= par.k_position[i]
        speed += e[i] * e[i]
    scale = min(1.0, par.speed_max / max(math.sqrt(speed), 1e-9))
    for i in range(3):
        a[i] = par.k_velocity[i] * (scale * e[i] + v[i])
    if w.swing >= 0:
        damp_swing(b, forward, left, a)
    a_W[0] = forward[0] * a[0] + left[0] * a[1] + ref.a_WB[0]
    a_W[1] = forward[1] * a[0] + left[1] * a[1] + ref.a_WB[1]
    a_W[2] = a[2] + ref.a_WB[2]


@njit(cache=True, error_model="numpy")
def shift_for_tip(b: Record, shift: Any, rate: Any) -> None:
    """Fill shift (3,) m and rate (3,) m/s: the platform gives way so that the tip stays.

    Only where the reference tracks the tip. The estimated torque s about a link's joint turns it by
    s / (m l g) from where it hangs; the estimated force f leans the platform by f / (m g). Both
    come from external forces alone, so no loop closes over what the platform's own motion does to
    the link; low-passed twice they do not see what the model leaves out of it (with the torque
    low-passed once the platform rings at 22 rad/s).
    """
    mem, ref, est, body, w = b.mem, b.ref, b.est, b.body, b.wrench
    goal, axis, vec = np.zeros(3), np.zeros(3), np.empty(3)
    if ref.track_tip > 0.5:
        along, joint = 0.0, body.p_BT[2]
        if w.swing >= 0:
            mat_vec(est.R_WB, w.axis, axis)
            turn = w.s_slow / (max(norm(w.L_s), 1e-6) * body.gravity)
            mat_vec(est.R_WB, body.J_BT[:, w.swing], vec)
            for i in range(2):
                goal[i] = -turn * vec[i]
                along += axis[i] * (w.f_hands_W[i] + w.f_rest_W[i])
            joint = b.arms.p_BA[2]
        for i in range(2):  # what hangs on the joint leans with the platform only along its axis
            across = w.f_hands_W[i] + w.f_rest_W[i] - along * axis[i]
            goal[i] += (along * axis[i] * body.p_BT[2] + across * joint) / (
                body.mass * body.gravity
            )
    k = -math.expm1(-SHIFT_BANDWIDTH * b.par.dt)
    for i in range(3):
        rate[i] = k * (goal[i] - mem.user[SHIFT + i])
        mem.user[SHIFT + i] += rate[i]
        rate[i] /= b.par.dt
        shift[i] = mem.user[SHIFT + i]


@njit(cache=True, error_model="numpy")
def into_axes(forward: Any, left: Any, a: Any, b: Any, out: Any) -> None:
    """Write a - b in the level axes (forward, left, up)."""
    x, y = a[0] - b[0], a[1] - b[1]
    out[0] = forward[0] * x + forward[1] * y
    out[1] = left[0] * x + left[1] * y
    out[2] = a[2] - b[2]


@njit(cache=True, error_model="numpy")
def damp_swing(b: Record, forward: Any, left: Any, a: Any) -> None:
    """Suarez 2020's passive link: move the platform with the link's swing, a = -k psi'.

    psi' is the link's rate in W less the rates that belong to what is wanted: the reference's own
    (take-off and landing along the link's arc), the lag a / g behind a reference that accelerates,
    and that of the balance under a changing force. Only the rate is fed back: a link that wind or
    contact holds at an angle pulls the platform nowhere.
    """
    par, mem, ref, est, w = b.par, b.mem, b.ref, b.est, b.wrench
    axis = np.empty(3)
    mat_vec(est.R_WB, w.axis, axis)
    rate = est.qd[w.swing] - ref.qd[w.swing] - w.balance_rate
    jerk = np.empty(2)
    for i in range(2):
        jerk[i] = min(max((ref.a_WB[i] - mem.user[i]) / par.dt, -JERK_MAX), JERK_MAX)
        mem.user[i] = ref.a_WB[i]
    rate -= (jerk[0] * axis[1] - jerk[1] * axis[0]) / b.body.gravity
    for i in range(3):
        rate += w.axis[i] * est.w_WB_B[i]
    # a link that turns about the axis moves its end backward: along z x axis
    a[0] -= par.k_swing * rate * (forward[0] * axis[1] - forward[1] * axis[0])
    a[1] -= par.k_swing * rate * (left[0] * axis[1] - left[1] * axis[0])
    a[0] += (forward[0] * jerk[0] + forward[1] * jerk[1]) / par.k_attitude[1]
    a[1] += (left[0] * jerk[0] + left[1] * jerk[1]) / par.k_attitude[0]


@njit(cache=True, error_model="numpy")
def angular_acceleration(b: Record, R_des: Any, acc: Any) -> None:
    """Attitude and rate loop: the angular acceleration acc (3,) rad/s^2 in B."""
    par, ref, est = b.par, b.ref, b.est
    rel, turn, w_des, spin = np.empty((3, 3)), np.empty(3), np.zeros(3), np.empty(3)
    mat_t_mat(est.R_WB, R_des, rel)
    log_so3(rel, turn)
    spin[0], spin[1], spin[2] = 0.0, 0.0, ref.w_WB_B[2]
    mat_vec(rel, spin, w_des)
    for i in range(3):
        acc[i] = par.k_rate[i] * (par.k_attitude[i] * turn[i] + w_des[i] - est.w_WB_B[i])


@njit(cache=True, error_model="numpy")
def torque_for_turn(b: Record, acc: Any) -> None:
    """Torque cmd.t_B that turns the platform with `acc`, ahead of the rotors' lag.

    The lead (1 + tau s) / (1 + lead s) acts on the loops' part only; what is fed forward is slow.
    """
    par, mem, est, body, cmd, w = b.par, b.mem, b.est, b.body, b.cmd, b.wrench
    t_fb, spin, gyro, g_B, u_v, u_w = (
        np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    )  # fmt: skip
    for i in range(3):
        t_fb[i], spin[i] = 0.0, 0.0
        for j in range(3):
            t_fb[i] += w.I_eff[i, j] * acc[j]
            spin[i] += w.I_eff[i, j] * est.w_WB_B[j]
        g_B[i] = -body.gravity * est.R_WB[2, i]
    cross(est.w_WB_B, spin, gyro)
    cross(body.p_BC, g_B, u_w)  # gravity moment about B
    for i in range(3):
        u_w[i] = body.mass * u_w[i] + w.t_hands_B[i]
        spin[i] = w.f_hands_W[i] + w.f_rest_W[i]
    mat_t_vec(est.R_WB, spin, u_v)
    u_s = w.s_hands
    for i in range(3):
        u_v[i] += cmd.f_B[i] + body.mass * g_B[i]
        u_s += w.L_s[i] * g_B[i]
    ahead = par.rotor_tau / par.lead
    blend = -math.expm1(-par.dt / par.lead)
    for i in range(3):
        lead = t_fb[i]
        if i < 2:  # yaw is slow enough without, and its little torque costs much thrust
            lead = ahead * t_fb[i] + (1.0 - ahead) * mem.lead[i]
            mem.lead[i] += blend * (t_fb[i] - mem.lead[i])
        t = lead + gyro[i] - u_w[i] + w.A[i, 3] * u_s + mem.theta[i]
        for j in range(3):
            t += w.A[i, j] * u_v[j]
        cmd.t_B[i] = t
        if cmd.saturated == 0.0:
            mem.theta[i] += par.dt * par.k_integral[i] * t_fb[i]
            mem.theta[i] = min(max(mem.theta[i], -par.t_integral_max), par.t_integral_max)


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF."""
    step(belief[0])


@cfunc(LAW, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all laws."""
    step(carray(belief, 1)[0])
