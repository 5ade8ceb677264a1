"""The program of `whole_body_qp`: desired values, check of the limits, and solution.

Variables are deviations from the desired values, x = (T - T^d, q'' - q''^d, f - f^d). The residual
of the dynamics is zero at x = 0, so the cost is x'H x / 2, and the solution is the feasible point
nearest to the desired values in the metric H. H is positive definite: the solution is unique.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import table, words
from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS, MAX_ROTORS
from skywright.vehicle.component import helper
from skywright.vehicle.laws._arm_reaction import fill_reaction
from skywright.vehicle.laws._daqp import (
    OPTIMAL,
    SOFT,
    SOFT_OPTIMAL,
    UNBOUNDED,
    read_flag,
    set_senses,
    solve,
)
from skywright.vehicle.loops import SLOW

FACETS = 8
"""Sides of the pyramid in the friction cone; a vertex lies in the direction of the friction."""
APOTHEM = math.cos(math.pi / FACETS)
EDGE = np.array([[math.cos(a), math.sin(a)] for a in math.pi / FACETS * (1 + 2 * np.arange(8))])
MAX_VARIABLES = MAX_ROTORS + MAX_JOINTS + 3
CLOSE = 1e-9
"""N, rad/s, rad/s^2: tolerance of the limits."""
THRUST_WEIGHT = 1e-2
"""Relative to a rotor's share of the weight; small, resolves the redundancy of over six rotors."""


class Wanted(NamedTuple):
    """Desired values before any limit, and their geometry."""

    axes: Array  # (3, 3) columns in W: opposite to the sliding, across it, surface normal
    contact: Array  # (3,) N, force of the surface on the tip, along the axes
    qdd: Array  # (MAX_JOINTS,) rad/s^2
    thrust: Array  # (MAX_ROTORS,) N
    L: Array  # (6, MAX_JOINTS) reaction of the joints: N in B, N m about the centre of mass


@helper
def fill_wanted(
    me: Any, ref: Any, est: Any, body: Any, model: Any, kin: Any, cmd: Any, out: Any
) -> bool:
    """Fill `out` from the command `cmd` of laws (2) to (4) and the allocation of its wrench.

    Adds the moment of the contact force and the arm's reaction to `cmd`. Returns whether all values
    are finite.
    """
    n, m, c = me.n, me.m, body.p_BC
    f_B, lever, moment = local(3), local(3), local(3)
    fill_contact(me, ref, est, body, out)
    mat_vec(out.axes, out.contact, moment)
    mat_t_vec(est.R_WB, moment, f_B)
    for i in range(3):
        lever[i] = body.p_BT[i] - c[i]
    cross(lever, f_B, moment)
    for i in range(3):
        cmd.t_B[i] -= moment[i]
    force, torque = local(3), local(3)
    for j in range(m):
        fill_reaction(model, kin, j, force, torque)
        cross(c, force, moment)
        out.qdd[j] = (cmd.qd[j] - est.qd[j]) / me.T_v[j]
        for i in range(3):
            cmd.f_B[i] += force[i] * out.qdd[j]
            cmd.t_B[i] += torque[i] * out.qdd[j]
            out.L[i, j], out.L[i + 3, j] = force[i], torque[i] - moment[i]
    me.t_z += (cmd.t_B[2] - me.t_z) * me.share
    total = 0.0
    for i in range(n):
        t = me.preload[i] + me.P[i, 5] * me.t_z
        for r in range(3):
            t += me.P[i, r] * cmd.f_B[r]
        t += me.P[i, 3] * cmd.t_B[0] + me.P[i, 4] * cmd.t_B[1]
        out.thrust[i] = t
        total += t
    for j in range(m):
        total += out.qdd[j]
    return math.isfinite(total)


@helper
def fill_contact(me: Any, ref: Any, est: Any, body: Any, out: Any) -> None:
    """Fill the axes and the contact force of law (4), zero without contact."""
    e_n = along = 0.0
    v, u, n = local(3), local(3), local(3)
    for i in range(3):
        n[i] = ref.R_WS[i, 2]
        if ref.track_tip > 0.5:
            e_n += n[i] * (ref.p_WT[i] - est.p_WT[i])
        else:
            e_n += n[i] * (ref.p_WB[i] - est.p_WB[i])
        along += n[i] * ref.v_WT[i]
    push = 0.0
    if ref.dead_zone > 0.0 and e_n < 0.0:
        push = -body.mass * me.wn_p * me.wn_p * e_n
    speed = total = 0.0
    for i in range(3):
        total += ref.v_WT[i] * ref.v_WT[i]
        v[i] = along * n[i] - ref.v_WT[i]  # against the sliding
        speed += v[i] * v[i]
    speed, total = math.sqrt(speed), math.sqrt(total + SLOW * SLOW)
    for i in range(3):
        v[i] = v[i] / speed if speed > CLOSE else ref.R_WS[i, 0]
    cross(n, v, u)
    for i in range(3):
        out.axes[i, 0], out.axes[i, 1], out.axes[i, 2] = v[i], u[i], n[i]
    friction = me.friction * push / total
    out.contact[0], out.contact[1] = friction * (speed if speed > CLOSE else 0.0), 0.0
    out.contact[2] = push - friction * along


@helper
def is_free(me: Any, est: Any, cmd: Any, want: Any) -> bool:
    """Return whether the desired values are within all limits."""
    for i in range(me.n):
        if want.thrust[i] < me.t_min[i] - CLOSE or want.thrust[i] > me.t_max[i] + CLOSE:
            return False
    for j in range(me.m):
        room_down, room_up = est.q[j] - me.q_min[j], me.q_max[j] - est.q[j]
        if abs(want.qdd[j]) > me.a_max[j] or not (
            -me.stop_rate * room_down - CLOSE <= cmd.qd[j] <= me.stop_rate * room_up + CLOSE
        ):
            return False  # law (2) already limits the motor speeds
    worst = 0.0
    for k in range(FACETS):
        worst = max(worst, find_slip(me, want, k))
    return worst <= CLOSE


@helper
def find_slip(me: Any, want: Any, k: int) -> float:
    """Return by how much (N) the desired contact force exceeds side `k` of the pyramid."""
    f = want.contact
    return EDGE[k, 0] * f[0] + EDGE[k, 1] * f[1] - me.mu * APOTHEM * f[2]


@helper
def solve_task(me: Any, est: Any, body: Any, cmd: Any, want: Any, thrust: Any) -> float:
    """Fill `thrust` (n,) N and change `cmd.qd` to the solution; return its kind.

    1: within all limits; 2: joint limits are violated; 3: no solution, and nothing is changed.
    """
    n, m = me.n, me.m
    size = n + m + 3
    fill_cost(me, est, body, want, table(me.H, size, size))
    fill_rows(me, est, cmd, want)
    first, rows = size, 2 * m  # of the joints
    bound = 1.0
    set_senses(me.sense, size + rows + FACETS, 0, 0, 0)
    solve(me.solver, me.problem, me.result)
    flag = read_flag(me.result)
    if flag != OPTIMAL:
        bound = 2.0
        set_senses(me.sense, size + rows + FACETS, first, rows, SOFT)
        solve(me.solver, me.problem, me.result)
        flag = read_flag(me.result)
    x, total = words(me.x, size), 0.0
    for i in range(size):
        total += x[i]
    if flag < OPTIMAL or flag > SOFT_OPTIMAL or not math.isfinite(total):
        return 3.0
    for i in range(n):
        thrust[i] = min(max(want.thrust[i] + x[i], me.t_min[i]), me.t_max[i])
    for j in range(m):
        cmd.qd[j] += me.T_v[j] * x[n + j]
    return bound


@helper
def fill_cost(me: Any, est: Any, body: Any, want: Any, H: Any) -> None:
    """Fill H (n + m + 3 squared): weighted rows of the dynamics, and weights of the variables."""
    n, m = me.n, me.m
    size, weight = n + m + 3, body.mass * body.gravity
    J, W = local(6, MAX_VARIABLES), local(6)
    column, arm, moment, turned = local(3), local(3), local(3), local(3)
    for k in range(6):
        rank = 1 if k < 2 else 0 if k == 2 else 2 if k < 5 else 3
        W[k] = me.weight[rank] / (weight if k < 3 else weight * me.lever)
    for i in range(n):
        for r in range(3):
            column[r] = me.B[r, i]
        cross(body.p_BC, column, moment)
        mat_vec(est.R_WB, column, turned)
        for r in range(3):
            J[r, i], J[r + 3, i] = turned[r], me.B[r + 3, i] - moment[r]
    for j in range(m):
        for r in range(3):
            column[r] = want.L[r, j]
        mat_vec(est.R_WB, column, turned)
        for r in range(3):
            J[r, n + j], J[r + 3, n + j] = -turned[r], -want.L[r + 3, j]
    touches = 1.0 if want.contact[2] > 0.0 else 0.0
    for r in range(3):
        arm[r] = body.p_BT[r] - body.p_BC[r]
    for k in range(3):
        for r in range(3):
            column[r] = touches * want.axes[r, k]
        mat_t_vec(est.R_WB, column, turned)
        cross(arm, turned, moment)
        for r in range(3):
            J[r, n + m + k], J[r + 3, n + m + k] = column[r], moment[r]
    for a in range(size):
        for b in range(a, size):
            total = 0.0
            for k in range(6):
                total += W[k] * W[k] * J[k, a] * J[k, b]
            H[a, b] = H[b, a] = total
    for i in range(n):
        H[i, i] += (THRUST_WEIGHT * n / weight) ** 2
    for j in range(m):
        H[n + j, n + j] += (me.weight[5] / me.a_max[j]) ** 2
    for k in range(3):
        H[n + m + k, n + m + k] += (me.weight[4] / weight) ** 2


@helper
def fill_rows(me: Any, est: Any, cmd: Any, want: Any) -> None:
    """Fill the limits less the desired values: rotors, joints, contact; stops, motors, cone."""
    n, m = me.n, me.m
    size = n + m + 3
    rows = 2 * m + FACETS
    low, high, A = (
        words(me.lower, size + rows),
        words(me.upper, size + rows),
        table(me.A, rows, size),
    )
    for r in range(rows):
        for i in range(size):
            A[r, i] = 0.0
    for i in range(n):
        low[i], high[i] = me.t_min[i] - want.thrust[i], me.t_max[i] - want.thrust[i]
    for j in range(m):
        low[n + j], high[n + j] = -me.a_max[j] - want.qdd[j], me.a_max[j] - want.qdd[j]
        A[j, n + j] = me.T_v[j]
        low[size + j] = me.stop_rate * (me.q_min[j] - est.q[j]) - cmd.qd[j]
        high[size + j] = me.stop_rate * (me.q_max[j] - est.q[j]) - cmd.qd[j]
        told = 0.0
        for i in range(m):
            A[m + j, n + i] = me.belt_inv[j, i] * me.T_v[i]
            told += me.belt_inv[j, i] * cmd.qd[i]
        low[size + m + j] = -me.motor_speed_max[j] - told
        high[size + m + j] = me.motor_speed_max[j] - told
    at, touches = n + m, want.contact[2] > 0.0
    for k in range(3):
        low[at + k], high[at + k] = -UNBOUNDED, UNBOUNDED
    if touches:
        low[at + 2] = -want.contact[2]
    for k in range(FACETS):
        r = 2 * m + k
        A[r, at], A[r, at + 1], A[r, at + 2] = EDGE[k, 0], EDGE[k, 1], -me.mu * APOTHEM
        slip = find_slip(me, want, k)
        low[size + r] = -UNBOUNDED
        high[size + r] = (0.0 if abs(slip) < CLOSE else -slip) if touches else UNBOUNDED
