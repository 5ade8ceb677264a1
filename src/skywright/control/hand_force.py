"""Force of a hand through the springs of its joints, and force and position together.

Suarez 2020, figure 17: the error of the force moves the hand's reference, so that the springs
stretch until the force is right. The arm's own compliance C = J K^-1 J^T turns newtons into metres
(the inverse of K_C of (27), which exists at a singularity where K_C does not): dr_F = C n e. The
joints that make this way are those that yield to the force, dtheta = K^-1 J^T n e, and there it is
commanded, as `ARMS.wind`: each spring is wound and the links stay where they are. The printed way
through the inverse kinematics moves the hand as far, but at a fixed roll of the shoulder other
joints make up for what the roll's spring yields, and the arm walks off: a squeeze of 4 N turned the
yaw by 70 deg.

Held by what it touches, the force follows the shafts: integral of w e, in series with the servos'
lag. Held position is another matter: a free hand on its springs rings, and an integral loop around
that is stable below 2 zeta w_n only (models/compliant_arms.py has both bandwidths).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import dot, mat_t_vec, norm
from skywright.models.springs import spring_deflection, spring_stiffness

Record = Any

TOUCH = 0.3  # N, under which the hand counts as free
TOUCH_SPEED = 0.04  # m/s of a free hand on its way to a contact: it arrives with half a newton
LET_OUT = 0.3  # s, in which a wound spring is let out when another task begins


@njit(cache=True, error_model="numpy")
def wind_for(b: Record, h: int, f_W: Any, out: Any) -> float:
    """Fill out (MAX_JOINTS,) rad with K^-1 J^T f_W, f_W (3,) N; returns |C f_W| (m).

    Of the joints whose deflection is measured: what is not felt is not controlled. A hand that
    yields sideways to the noise of a force that only pitch joints feel would wander off.
    """
    arms = b.arms
    f_B, c_B = np.empty(3), np.zeros(3)
    mat_t_vec(b.est.R_WB, f_W, f_B)
    for j in range(arms.first[h], arms.first[h] + arms.n):
        out[j] = 0.0
        if arms.k[j] == 0.0 or arms.sensed[j] == 0.0:
            continue
        k = spring_stiffness(arms.k[j], arms.linear[j], arms.hardening[j], arms.deflection[j])
        for a in range(3):
            out[j] += arms.J_BP[h, a, j] * f_B[a] / k
        for a in range(3):
            c_B[a] += arms.J_BP[h, a, j] * out[j]
    return norm(c_B)


@njit(cache=True, error_model="numpy")
def step_force(b: Record, h: int, f_ref: Any, gamma: float, along: bool) -> None:
    """Wind the springs of hand h by gamma w T K^-1 J^T (f_ref - f).

    `along`: of the error only the part along f_ref; the force across it stays, as it must where
    what is held has a weight. Else the force across is led to zero as well: left alone, an arm at
    the end of a swinging link walks away until the hand slips. The printed estimator reads the
    arm's weight across f_ref: with it only the force along can be led.

    The hand moves within speed_hand, before it touches within TOUCH_SPEED. A spring is wound up to
    the servo's stall torque, a shaft leads its link's limits by the spring's deflection at most;
    what is more is not integrated (anti-windup).
    """
    arms, error, share = b.arms, np.zeros(3), np.empty(len(b.arms.wind))
    size = norm(f_ref)
    felt = dot(f_ref, arms.f_WH[h]) / size if size > 0.0 else 0.0
    for a in range(3):
        if along or arms.estimator < 0.5:
            error[a] = (size - felt) * f_ref[a] / size if size > 0.0 else 0.0
        else:
            error[a] = f_ref[a] - arms.f_WH[h, a]
    gain = gamma * arms.ki_force * arms.dt
    speed = arms.speed_hand if felt > TOUCH else min(TOUCH_SPEED, arms.speed_hand)
    length, most = gain * wind_for(b, h, error, share), speed * arms.dt
    if length > most:
        gain *= most / length
    for j in range(arms.first[h], arms.first[h] + arms.n):
        if arms.k[j] == 0.0:
            continue
        deflection, led = arms.deflection[j], b.cmd.theta[j] - arms.wind[j]
        most = spring_deflection(arms.k[j], arms.linear[j], arms.hardening[j], arms.stall[j])
        lowest = max(-most, arms.q_min[j] + min(deflection, 0.0) - led)
        highest = min(most, arms.q_max[j] + max(deflection, 0.0) - led)
        now, wanted = arms.wind[j], arms.wind[j] + gain * share[j]
        arms.wind[j] = min(max(wanted, min(lowest, now)), max(highest, now))
        if arms.wind[j] != wanted:
            arms.saturated[h] = 1.0


@njit(cache=True, error_model="numpy")
def let_out(b: Record, h: int) -> None:
    """Let the wound springs of hand h go, in a task that asks for no force."""
    arms = b.arms
    share = math.exp(-arms.dt / LET_OUT)
    for j in range(arms.first[h], arms.first[h] + arms.n):
        arms.wind[j] *= share


@njit(cache=True, error_model="numpy")
def step_hold_position(b: Record, h: int, gamma: float, dr: Any) -> None:
    """Fill dr (3,) m of the position's part in (31): (1 - gamma) w T (p_WH - p) and v_WH T.

    The goal's own speed v_WH is fed forward: what is held is led as fast as the goal moves, and
    only what the springs yield to its weight is left to the slow loop.
    """
    arms = b.arms
    for a in range(3):
        e = b.ref.p_WH[h, a] - arms.p_WH[h, a]
        dr[a] = ((1.0 - gamma) * arms.ki_hold * e + b.ref.v_WH[h, a]) * arms.dt
    length, most = norm(dr), arms.speed_hand * arms.dt
    if length > most:
        for a in range(3):
            dr[a] *= most / length


@njit(cache=True, error_model="numpy")
def squeeze_force(b: Record, h: int, f_ref: Any) -> None:
    """Fill f_ref (3,) N with (32): F (-1)^i (r1 - r2) / |r1 - r2|; F = |f_WH|, i = h + 1."""
    arms = b.arms
    for a in range(3):
        f_ref[a] = arms.p_WH[0, a] - arms.p_WH[1, a]
    size = norm(b.ref.f_WH[h]) / max(norm(f_ref), 1e-9)
    sign = -1.0 if h == 0 else 1.0
    for a in range(3):
        f_ref[a] *= sign * size
