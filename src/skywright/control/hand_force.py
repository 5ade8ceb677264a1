"""Force of a hand through its position, and both together.

Suarez 2020, figure 17: the error of the force moves the reference that the inverse kinematics take,
so that the springs stretch until the force is right. The arm's own compliance C = J K^-1 J^T turns
newtons into metres (the inverse of K_C of (27), which exists at a singularity where K_C does not).
With the hand held by what it touches, f' = K_C p_ref' in series with the servos' lag: the
displacement dr = w T C (f_ref - f) makes the force answer at w (models/compliant_arms.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import dot, mat_t_vec, mat_vec, norm
from skywright.models.compliant_arms import spring_stiffness

Record = Any


@njit(cache=True, error_model="numpy")
def compliance_along(b: Record, h: int, n_W: Any, out: Any) -> None:
    """Fill out (3,) m with C n_W: how the hand yields, in W, to a force n_W (3,) N.

    Of the joints whose deflection is measured: what is not felt is not controlled. A hand that
    yields sideways to the noise of a force that only pitch joints feel would wander off.
    """
    arms = b.arms
    n_B, c_B = np.empty(3), np.zeros(3)
    mat_t_vec(b.est.R_WB, n_W, n_B)
    for j in range(arms.first[h], arms.first[h] + arms.n):
        if arms.k[j] == 0.0 or arms.sensed[j] == 0.0:
            continue
        k = spring_stiffness(arms.k[j], arms.linear[j], arms.hardening[j], arms.deflection[j])
        turn = 0.0
        for a in range(3):
            turn += arms.J_BP[h, a, j] * n_B[a] / k
        for a in range(3):
            c_B[a] += arms.J_BP[h, a, j] * turn
    mat_vec(b.est.R_WB, c_B, out)


@njit(cache=True, error_model="numpy")
def _yield_to(b: Record, h: int, error: Any, dr: Any) -> None:
    """Fill dr (3,) m with w T C error, within speed_hand."""
    arms = b.arms
    compliance_along(b, h, error, dr)
    gain = arms.ki_force * arms.dt
    length = gain * norm(dr)
    most = arms.speed_hand * arms.dt
    if length > most:
        gain *= most / length
    for a in range(3):
        dr[a] *= gain


@njit(cache=True, error_model="numpy")
def step_force_along(b: Record, h: int, f_ref: Any, dr: Any) -> None:
    """Fill dr (3,) m: w T C n (|f_ref| - n.f), n the direction of f_ref; f across n stays."""
    error = np.empty(3)
    size = norm(f_ref)
    miss = size - dot(f_ref, b.arms.f_WH[h]) / size if size > 0.0 else 0.0
    for a in range(3):
        error[a] = miss * f_ref[a] / size if size > 0.0 else 0.0
    _yield_to(b, h, error, dr)


@njit(cache=True, error_model="numpy")
def step_force(b: Record, h: int, f_ref: Any, dr: Any) -> None:
    """Fill dr (3,) m: w T C (f_ref - f), within speed_hand.

    The force across f_ref is led to zero as well. Left alone, it would be an integral without an
    end: the step for a force along n moves the hand's reference across n too, and an arm at the end
    of a swinging link then walks away until the hand slips. The printed estimator reads the arm's
    weight across f_ref: with it only the force along f_ref can be led.
    """
    if b.arms.estimator < 0.5:
        step_force_along(b, h, f_ref, dr)
        return
    error = np.empty(3)
    for a in range(3):
        error[a] = f_ref[a] - b.arms.f_WH[h, a]
    _yield_to(b, h, error, dr)


@njit(cache=True, error_model="numpy")
def step_hold_position(b: Record, h: int, dr: Any) -> None:
    """Fill dr (3,) m of the position's part in (31): towards p_WH from the measured hand.

    The step is w T |e| within speed_hand: it answers as fast as the force does.
    """
    arms = b.arms
    for a in range(3):
        dr[a] = arms.ki_force * arms.dt * (b.ref.p_WH[h, a] - arms.p_WH[h, a])
    length, most = norm(dr), arms.speed_hand * arms.dt
    if length > most:
        for a in range(3):
            dr[a] *= most / length


@njit(cache=True, error_model="numpy")
def step_force_position(b: Record, h: int, f_ref: Any, dr: Any) -> None:
    """Fill dr (3,) m with (31): gamma dr_F + (1 - gamma) dr_P."""
    dr_P = np.empty(3)
    gamma = min(max(b.ref.gamma[h], 0.0), 1.0)
    step_force_along(b, h, f_ref, dr)
    step_hold_position(b, h, dr_P)
    for a in range(3):
        dr[a] = gamma * dr[a] + (1.0 - gamma) * dr_P[a]


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
