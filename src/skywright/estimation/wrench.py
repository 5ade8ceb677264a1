"""External wrench on a robot whose arms hang on a joint without a servo, or on no such joint.

Momentum observer (De Luca and Mattone 2005, ICRA, eq. 6-9, here for the linear momentum, whose
balance in W has no Coriolis terms): with P = R_WB (m v_B + m w x c + L_s q')

    dP/dt = R_WB f_rotors + m g + f_hands + f_rest,    f_rest = k (P - P_predicted).

The swinging link's momentum is in P, so a swing alone is no external force; the estimators' plain
`f_ext_W` (mass times the platform's acceleration, less the rotors' force) shows it as one.
f_hands, the reaction of what the hands press, is known from the joints; subtracting it here means
that the sum f_hands + f_rest counts no force twice, whatever f_hands says.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import cross, mat_t_vec, mat_vec, norm
from skywright.core.types import TASK_FORCE, TASK_FORCE_POSITION

Record = Any

SWING_BANDWIDTH = 2.0
"""rad/s, of the torque about the swinging joint: below its own frequency, so that at that of the
arms on their springs `balance_rate` stays a fraction (k^2 M_ss / (m l g), 0.4) of the rate."""
TRUSTED = 2.0
"""Largest force at a hand that is believed, over the one asked for."""
HANGING = 0.1
"""m, lever below which the weight of a hanging link says nothing about a force."""


@njit(cache=True, error_model="numpy")
def estimate_wrench(b: Record) -> None:
    """Fill the estimate of `b.wrench` from est, body and the rotors' believed force."""
    w, est, body, dt = b.wrench, b.est, b.body, b.par.dt
    _take_hands(b)
    P, p_B, f_W = np.empty(3), np.empty(3), np.empty(3)
    mat_t_vec(est.R_WB, est.v_WB, p_B)
    cross(est.w_WB_B, body.p_BC, f_W)
    rate = est.qd[w.swing] if w.swing >= 0 else 0.0
    for a in range(3):
        p_B[a] = body.mass * (p_B[a] + f_W[a]) + w.L_s[a] * rate
    mat_vec(est.R_WB, p_B, P)
    if b.ref.active < 0.5:
        _start(b, P)
        return
    mat_vec(est.R_WB, b.obs.f_B, f_W)
    f_W[2] -= body.mass * body.gravity
    x, y = est.R_WB[0, 0], est.R_WB[1, 0]
    size = max(math.sqrt(x * x + y * y), 1e-3)
    x, y = x / size, y / size
    e_x, e_y = P[0] - w.momentum_W[0], P[1] - w.momentum_W[1]
    forward = _gain(w.bandwidth[0], dt) * (x * e_x + y * e_y)
    left = _gain(w.bandwidth[1], dt) * (x * e_y - y * e_x)
    w.f_rest_W[0] = forward * x - left * y
    w.f_rest_W[1] = forward * y + left * x
    w.f_rest_W[2] = _gain(w.bandwidth[2], dt) * (P[2] - w.momentum_W[2])
    for a in range(3):
        w.momentum_W[a] += dt * (f_W[a] + w.f_hands_W[a] + w.f_rest_W[a])
    if w.swing >= 0:
        _observe_swing(b, rate)


@njit(cache=True, error_model="numpy")
def _observe_swing(b: Record, rate: float) -> None:
    """The same for the link's joint: dp/dt = dT/dq + L_s . g + s_hands + s_rest.

    p = L_s . v_B + M_ws . w + M_ss q'. Of dT/dq only what makes the balance independent of a steady
    velocity is kept: w . (L_s x v_B) + q' (axis x L_s) . v_B; the rest is quadratic in slow rates.
    A changing torque moves the angle at which the link is in balance, at `balance_rate`.
    """
    w, est, dt = b.wrench, b.est, b.par.dt
    v_B, lever, turned = np.empty(3), np.empty(3), np.empty(3)
    mat_t_vec(est.R_WB, est.v_WB, v_B)
    cross(w.L_s, v_B, lever)
    cross(w.axis, w.L_s, turned)
    p, force, size = w.M_ss * rate, 0.0, 0.0
    for a in range(3):
        p += w.L_s[a] * v_B[a] + w.M_ws[a] * est.w_WB_B[a]
        force += est.w_WB_B[a] * lever[a] + rate * turned[a] * v_B[a]
        force -= w.L_s[a] * est.R_WB[2, a] * b.body.gravity
        size += w.L_s[a] * w.L_s[a]
    w.s_rest = _gain(SWING_BANDWIDTH, dt) * (p - w.momentum_s)
    w.momentum_s += dt * (force + w.s_hands + w.s_rest)
    change = SWING_BANDWIDTH * (w.s_hands + w.s_rest - w.s_slow)
    w.s_slow += dt * change
    w.balance_rate = change / (math.sqrt(size) * b.body.gravity)


@njit(cache=True, error_model="numpy")
def _gain(bandwidth: float, dt: float) -> float:
    """Gain (1/s) of a first-order observer of a bandwidth (rad/s) at the period dt."""
    return -math.expm1(-bandwidth * dt) / dt


@njit(cache=True, error_model="numpy")
def _start(b: Record, P: Any) -> None:
    """Motors off: when they start, the ground still carries the end of a link that lies on it."""
    w = b.wrench
    level = math.sqrt(w.L_s[0] ** 2 + w.L_s[1] ** 2)
    for a in range(3):
        w.f_rest_W[a] = 0.0
    if w.swing >= 0 and abs(w.L_s[2]) > level:  # it lies rather than hangs
        w.f_rest_W[2] = w.L_s[2] * w.L_s[2] / w.M_ss * b.body.gravity
    for a in range(3):
        w.momentum_W[a] = P[a]
    torque = 0.0  # what holds the link on the ground
    for a in range(3):
        torque += w.L_s[a] * b.est.R_WB[2, a] * b.body.gravity
    w.s_rest, w.s_slow, w.balance_rate = torque, torque, 0.0
    w.momentum_s = -torque / _gain(SWING_BANDWIDTH, b.par.dt)
    w.momentum_W[2] -= w.f_rest_W[2] / _gain(w.bandwidth[2], b.par.dt)


@njit(cache=True, error_model="numpy")
def _take_hands(b: Record) -> None:
    """Reaction of the forces that the hands exert; and the level force from the swing angle.

    A hand's force counts while the reference asks it to press, and up to twice what is asked: in
    free air the springs carry the arm's inertia, and near a stretched arm their reading means
    little. f_rest takes what this leaves out. A load that is said to hang on a hand counts in full.

    Slowed down to `bandwidth[0]`: while friction holds a hand, the link bounces on the springs of
    the arm (2.2 Hz under a wide pipe). The rotors answer a level force by leaning, at that
    frequency more than a quarter turn late: what cancels a steady reaction would drive the bounce.
    """
    w, arms, est = b.wrench, b.arms, b.est
    w.f_swing = 0.0
    if arms.on == 0:
        return
    f_W, f_B, t_B, moment = np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    force, about_swing = np.zeros(3), 0.0
    lever = 0.0
    for h in range(arms.n_hands):
        share = 0.0
        if b.ref.task[h] == TASK_FORCE or b.ref.task[h] == TASK_FORCE_POSITION:
            asked, felt = norm(b.ref.f_WH[h]), norm(arms.f_WH[h])
            share = min(1.0, TRUSTED * asked / max(felt, 1e-9))
        for a in range(3):
            f_W[a] = share * arms.f_WH[h, a]
        f_W[2] += b.ref.load[h]
        mat_t_vec(est.R_WB, f_W, f_B)
        cross(arms.p_BH[h], f_B, t_B)
        for a in range(3):
            force[a] -= f_W[a]
            moment[a] -= t_B[a]
            if w.swing >= 0:
                about_swing -= arms.J_BH[h, a, w.swing] * f_B[a]
        if w.swing >= 0:
            mat_vec(est.R_WB, arms.J_BH[h, :, w.swing], t_B)
            lever += t_B[0] * est.R_WB[0, 0] + t_B[1] * est.R_WB[1, 0]
    blend = -math.expm1(-w.bandwidth[0] * b.par.dt)
    for a in range(3):
        w.f_hands_W[a] += blend * (force[a] - w.f_hands_W[a])
        w.t_hands_B[a] += blend * (moment[a] - w.t_hands_B[a])
    w.s_hands += blend * (about_swing - w.s_hands)
    lever /= max(arms.n_hands, 1)
    if w.swing >= 0 and abs(lever) > HANGING:
        up = 0.0  # moment of the weight: -L_s . g
        for a in range(3):
            up += w.L_s[a] * est.R_WB[2, a]
        w.f_swing = -up * b.body.gravity / lever
