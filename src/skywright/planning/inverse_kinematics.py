"""Second-order inverse kinematics of platform and arm: the local planner's controller.

The state is the platform's pose and the joints; the unknowns are the accelerations u = (a_WB, wd_WB
in W, qdd). Tasks in order of priority, each with feed-forward and PD feedback:

1. tip on its desired path and probe axis on its desired direction (5 rows),
2. platform level (2 rows),
3. heading and arm posture (1 + n rows), which use the redundancy.

The priorities are widely separated weights in one damped least-squares problem (Nakamura and
Hanafusa 1986). A robot with too few joints therefore violates the level task rather than the tip
task, and no rank decision is required. (Tognon et al. 2018, section IV; the local planner of their
reference 18.)
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import cross, dot, exp_so3, mat_mat, mat_t_vec, mat_vec
from skywright.core.types import MAX_JOINTS
from skywright.models.body_records import BodyModel, Kinematics
from skywright.models.link_motion import Motion, fill_motion
from skywright.models.rigid_body import fill_kinematics

WEIGHT_TASK, WEIGHT_LEVEL, WEIGHT_POSTURE, DAMPING = 1.0, 1e-4, 1e-8, 1e-11
WN = 10.0
"""rad/s, bandwidth of the closed loop (critically damped)."""


class State(NamedTuple):
    """State of platform and arm, with velocities."""

    p: Array  # (3,) m, p_WB
    v: Array  # (3,) m/s
    R: Array  # (3, 3) R_WB
    w: Array  # (3,) rad/s, in W
    q: Array  # (MAX_JOINTS,)
    qd: Array  # (MAX_JOINTS,)


class Target(NamedTuple):
    """References of the tasks at one instant."""

    p: Array  # (3,) m, tip
    v: Array
    a: Array
    z: Array  # (3,) probe axis
    zd: Array
    zdd: Array
    yaw: Array  # (3,) rad, rad/s, rad/s^2
    q: Array  # (3, MAX_JOINTS) posture and its two derivatives


def build_state(p: Array, R: Array, q: Array) -> State:
    """Return a state at rest (copies its arguments)."""
    full = np.zeros(MAX_JOINTS)
    full[: len(q)] = q
    return State(
        np.array(p, dtype=float), np.zeros(3), np.array(R, dtype=float), np.zeros(3),
        full, np.zeros(MAX_JOINTS),
    )  # fmt: skip


def build_target() -> Target:
    """Return scratch memory for a target."""
    p, v, a, z, zd, zdd, yaw = (np.zeros(3) for _ in range(7))
    return Target(p, v, a, z, zd, zdd, yaw, np.zeros((3, MAX_JOINTS)))


@helper
def solve_spd(h: Array, g: Array, n: int) -> bool:
    """Solve h x = g in place (x in g) by Cholesky, leading n x n block; False if singular."""
    for j in range(n):
        s = h[j, j]
        for k in range(j):
            s -= h[j, k] * h[j, k]
        if s <= 0.0:
            return False
        d = math.sqrt(s)
        h[j, j] = d
        for i in range(j + 1, n):
            s = h[i, j]
            for k in range(j):
                s -= h[i, k] * h[j, k]
            h[i, j] = s / d
    for i in range(n):
        s = g[i]
        for k in range(i):
            s -= h[i, k] * g[k]
        g[i] = s / h[i, i]
    for i in range(n - 1, -1, -1):
        s = g[i]
        for k in range(i + 1, n):
            s -= h[k, i] * g[k]
        g[i] = s / h[i, i]
    return True


@helper
def _add_row(h: Array, g: Array, row: Array, b: float, weight: float, n: int) -> None:
    """Add weight |row u - b|^2 to the normal equations (lower triangle)."""
    for i in range(n):
        ri = weight * row[i]
        if ri != 0.0:
            g[i] += ri * b
            for j in range(i + 1):
                h[i, j] += ri * row[j]


@helper
def wrap(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


@helper
def solve_accelerations(
    m: BodyModel, k: Kinematics, state: State, target: Target, motion: Motion, u: Array
) -> bool:
    """Fill u (6 + MAX_JOINTS,): a_WB, wd_WB in W, qdd. `k` holds the kinematics at state.q."""
    nj = m.n_joints
    n = 6 + nj
    R = state.R
    h = np.zeros((n, n))
    g = np.zeros(n)
    row = np.zeros(n)
    kp, kd = WN * WN, 2.0 * WN
    r = np.empty(3)
    zero = np.zeros(3)
    w_B = np.empty(3)
    tmp = np.empty(3)
    tmp2 = np.empty(3)
    jv = np.zeros((nj, 3))  # columns of the tip's Jacobians, in W
    jw = np.zeros((nj, 3))
    mat_vec(R, k.p_BT, r)
    R_WT = np.empty((3, 3))
    mat_mat(R, k.R_BT, R_WT)
    for j in range(nj):
        for i in range(3):
            tmp[i] = k.J_BT[i, j]
            tmp2[i] = k.Jw_BT[i, j]
        mat_vec(R, tmp, jv[j])
        mat_vec(R, tmp2, jw[j])
    # drift: the tip's accelerations at u = 0
    mat_t_vec(R, state.w, w_B)
    fill_motion(m, k, w_B, zero, zero, state.qd, np.zeros(MAX_JOINTS), motion)
    drift = np.zeros(3)
    wdrift = np.zeros(3)
    v_tip = np.empty(3)
    w_tip = np.empty(3)
    tip = m.tip_link
    if tip >= 0:
        off = np.empty(3)
        mat_vec(k.R[tip], m.tip_offset, off)
        cross(motion.w[tip], off, tmp)
        cross(motion.w[tip], tmp, tmp2)
        cross(motion.wd[tip], off, tmp)
        for i in range(3):
            tmp[i] += motion.a[tip, i] + tmp2[i]
        mat_vec(R, tmp, drift)
        mat_vec(R, motion.wd[tip], wdrift)
    cross(state.w, r, tmp)
    for i in range(3):
        v_tip[i] = state.v[i] + tmp[i]
        w_tip[i] = state.w[i]
        for j in range(nj):
            v_tip[i] += jv[j, i] * state.qd[j]
            w_tip[i] += jw[j, i] * state.qd[j]
    # 1a. tip position: a + wd x r + J qdd + drift
    for i in range(3):
        for c in range(n):
            row[c] = 0.0
        row[i] = 1.0
        a, b = (i + 1) % 3, (i + 2) % 3
        row[3 + a] = r[b]  # (wd x r)_i = wd_a r_b - wd_b r_a
        row[3 + b] = -r[a]
        for j in range(nj):
            row[6 + j] = jv[j, i]
        want = target.a[i] + kd * (target.v[i] - v_tip[i])
        want += kp * (target.p[i] - state.p[i] - r[i]) - drift[i]
        _add_row(h, g, row, want, WEIGHT_TASK, n)
    # 1b. probe axis: angular acceleration across it
    z = R_WT[:, 2].copy()
    w_ref = np.empty(3)
    wd_ref = np.empty(3)
    err = np.empty(3)
    cross(target.z, target.zd, w_ref)
    cross(target.z, target.zdd, wd_ref)
    cross(z, target.z, err)
    for i in range(3):
        wd_ref[i] += kd * (w_ref[i] - w_tip[i]) + kp * err[i] - wdrift[i]
    for axis in range(2):
        x = R_WT[:, axis].copy()
        for c in range(3):
            row[c] = 0.0
            row[3 + c] = x[c]
        for j in range(nj):
            row[6 + j] = dot(x, jw[j])
        _add_row(h, g, row, dot(x, wd_ref), WEIGHT_TASK, n)
    # 2. level
    err[0], err[1], err[2] = R[1, 2], -R[0, 2], 0.0  # z_B x z_W
    for axis in range(2):
        x = R[:, axis].copy()
        for c in range(n):
            row[c] = 0.0
        for c in range(3):
            row[3 + c] = x[c]
        _add_row(h, g, row, kp * dot(x, err) - kd * dot(x, state.w), WEIGHT_LEVEL, n)
    # 3. heading and posture
    for c in range(n):
        row[c] = 0.0
    row[5] = 1.0
    yaw = math.atan2(R[1, 0], R[0, 0])
    want = target.yaw[2] + kd * (target.yaw[1] - state.w[2]) + kp * wrap(target.yaw[0] - yaw)
    _add_row(h, g, row, want, WEIGHT_POSTURE, n)
    row[5] = 0.0
    for j in range(nj):
        row[6 + j] = 1.0
        want = target.q[2, j] + kd * (target.q[1, j] - state.qd[j])
        want += kp * (target.q[0, j] - state.q[j])
        _add_row(h, g, row, want, WEIGHT_POSTURE, n)
        row[6 + j] = 0.0
    for i in range(n):
        h[i, i] += DAMPING
    if not solve_spd(h, g, n):
        return False
    for i in range(n):
        u[i] = g[i]
    return True


@helper
def step_state(state: State, u: Array, nj: int, dt: float) -> None:
    """Advance the state by dt (s) at constant accelerations u."""
    turn = np.empty(3)
    d = np.empty((3, 3))
    old = state.R.copy()
    for i in range(3):
        state.p[i] += dt * state.v[i] + 0.5 * dt * dt * u[i]
        state.v[i] += dt * u[i]
        turn[i] = dt * state.w[i] + 0.5 * dt * dt * u[3 + i]
        state.w[i] += dt * u[3 + i]
    exp_so3(turn, d)
    mat_mat(d, old, state.R)
    for j in range(nj):
        state.q[j] += dt * state.qd[j] + 0.5 * dt * dt * u[6 + j]
        state.qd[j] += dt * u[6 + j]


@helper
def settle_posture(
    m: BodyModel, k: Kinematics, R: Array, q: Array, z: Array, iterations: int
) -> float:
    """Rotate platform and joints until the probe axis points along z (3,); return the error (rad).

    Newton steps on (platform rotation, joints) with the same priorities: axis exactly, level as far
    as possible, then the nearest posture. R and q are changed in place.
    """
    nj = m.n_joints
    n = 3 + nj
    h = np.empty((n, n))
    g = np.empty(n)
    row = np.empty(n)
    err = np.empty(3)
    tmp = np.empty(3)
    d = np.empty((3, 3))
    col = np.empty(3)
    R_WT = np.empty((3, 3))
    for _ in range(iterations):
        fill_kinematics(m, q, k)
        mat_mat(R, k.R_BT, R_WT)
        axis = R_WT[:, 2].copy()
        cross(axis, z, err)
        if dot(axis, z) < 0.0:  # beyond a right angle the sine decreases again
            size = math.sqrt(dot(err, err))
            for i in range(3):
                err[i] = err[i] / size if size > 1e-9 else R_WT[i, 1]
        h[:] = 0.0
        g[:] = 0.0
        for a in range(2):
            x = R_WT[:, a].copy()
            for c in range(3):
                row[c] = x[c]
            for j in range(nj):
                for i in range(3):
                    tmp[i] = k.Jw_BT[i, j]
                mat_vec(R, tmp, col)
                row[3 + j] = dot(x, col)
            _add_row(h, g, row, dot(x, err), 1.0, n)
        tmp[0], tmp[1], tmp[2] = R[1, 2], -R[0, 2], 0.0
        for a in range(2):
            x = R[:, a].copy()
            row[:] = 0.0
            for c in range(3):
                row[c] = x[c]
            _add_row(h, g, row, dot(x, tmp), 1e-4, n)
        for c in range(n):
            h[c, c] += 1e-9
        if not solve_spd(h, g, n):
            return math.pi
        size = math.sqrt(dot(g, g))
        scale = min(1.0, 0.6 / size) if size > 1e-12 else 1.0
        for i in range(3):
            tmp[i] = scale * g[i]
        exp_so3(tmp, d)
        old = R.copy()
        mat_mat(d, old, R)
        for j in range(nj):
            q[j] += max(-0.6, min(0.6, g[3 + j]))
    fill_kinematics(m, q, k)
    mat_mat(R, k.R_BT, R_WT)
    axis = R_WT[:, 2].copy()
    cross(axis, z, err)
    return math.atan2(math.sqrt(dot(err, err)), dot(axis, z))
