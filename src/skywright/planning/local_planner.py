"""The local planner: one motion between two configurations at rest, simulated and checked.

On the surface the second-order inverse kinematics runs in closed loop on the nominal model. In free
flight the platform and the joints follow a straight line. Both fill rows of REFERENCE on a 20 ms
grid and stop at the first row that violates a limit.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import exp_so3, log_so3, mat_mat, mat_t_mat, mat_t_vec, mat_vec, norm
from skywright.core.types import MAX_JOINTS, REFERENCE, ReferenceRow
from skywright.core.user_code import njit
from skywright.description.world.surface import surface_frame
from skywright.models.geometry import FAR
from skywright.models.rigid_body import fill_kinematics
from skywright.planning.checks import Trace, check_clearance, check_dynamics
from skywright.planning.inverse_kinematics import (
    State,
    Target,
    build_target,
    solve_accelerations,
    step_state,
    wrap,
)
from skywright.planning.patterns import TimeLaw, eval_time_law
from skywright.planning.problem import (
    CLEARANCE,
    IN_FLIGHT,
    OK,
    ON_SURFACE,
    SINGULAR,
    TASK,
    Failure,
    Problem,
)

ROW = 0.02
"""s between rows of a plan."""
SUBSTEPS = 2
"""Steps of the inverse kinematics between rows."""


class Edge(NamedTuple):
    """A checked motion. `rows` and `trace` end at the failure, if there is one."""

    rows: NDArray[Any]  # REFERENCE
    trace: NDArray[Any]  # TRACE
    failure: Failure | None
    state: State  # at the end, at rest


@helper
def fill_target(prob: Problem, s: Array, phi: Array, gap: Array, target: Target) -> None:
    """Fill the tip's task from (value, rate, acceleration) of s, phi and gap (positive outward)."""
    cyl, axes = prob.cylinder, prob.R_WA
    c, b = math.cos(phi[0]), math.sin(phi[0])
    rho = cyl.radius + gap[0]
    for i in range(3):
        x, y, z = cyl.R_WP[i, 0], cyl.R_WP[i, 1], cyl.R_WP[i, 2]
        n = -c * x + b * z
        dn = b * x + c * z  # dn/dphi; the second derivative is -n
        ndd = dn * phi[2] - n * phi[1] * phi[1]
        target.p[i] = cyl.p_WP[i] + y * s[0] + rho * n
        target.v[i] = y * s[1] + gap[1] * n + rho * dn * phi[1]
        target.a[i] = y * s[2] + gap[2] * n + 2.0 * gap[1] * phi[1] * dn + rho * ndd
        n = -c * axes[i, 0] + b * axes[i, 2]
        dn = b * axes[i, 0] + c * axes[i, 2]
        target.z[i] = -n
        target.zd[i] = -dn * phi[1]
        target.zdd[i] = n * phi[1] * phi[1] - dn * phi[2]


@helper
def fill_row(prob: Problem, state: State, u: Array, t: float, row: ReferenceRow) -> None:
    """Fill a row of REFERENCE from the nominal state; kinematics must be up to date."""
    k, m = prob.kinematics[0], prob.model[0]
    nj = m.n_joints
    tmp = np.empty(3)
    w_B = np.empty(3)
    wd_B = np.empty(3)
    rot = np.empty((3, 3))
    row.t = t
    mat_t_vec(state.R, state.w, w_B)
    for i in range(3):
        tmp[i] = u[3 + i]
    mat_t_vec(state.R, tmp, wd_B)
    mat_mat(state.R, k.R_BT, rot)
    for i in range(3):
        row.p_WB[i] = state.p[i]
        row.v_WB[i] = state.v[i]
        row.a_WB[i] = u[i]
        row.w_WB_B[i] = w_B[i]
        row.wd_WB_B[i] = wd_B[i]
        for j in range(3):
            row.R_WB[i, j] = state.R[i, j]
            row.R_WT[i, j] = rot[i, j]
            row.R_WS[i, j] = 1.0 if i == j else 0.0
    for j in range(MAX_JOINTS):
        row.q[j] = state.q[j] if j < nj else 0.0
        row.qd[j] = state.qd[j] if j < nj else 0.0
    # tip: p + R p_BT, v + R (w x p_BT + J qd)
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        tmp[i] = w_B[a] * k.p_BT[b] - w_B[b] * k.p_BT[a]
        for j in range(nj):
            tmp[i] += k.J_BT[i, j] * state.qd[j]
    mat_vec(state.R, tmp, w_B)
    mat_vec(state.R, k.p_BT, tmp)
    for i in range(3):
        row.p_WT[i] = state.p[i] + tmp[i]
        row.v_WT[i] = state.v[i] + w_B[i]
    row.dead_zone = 0.0
    row.track_tip = 0.0
    row.active = 1.0


@njit(cache=True, error_model="numpy")
def simulate_surface(
    prob: Problem,
    state: State,
    target: Target,
    start: Array,
    end: Array,
    law: TimeLaw,
    yaw_end: float,
    q_end: Array,
    touching: bool,
    dead_zone: float,
    rows: NDArray[Any],
    trace: NDArray[Any],
    found: Array,
) -> tuple[int, int]:
    """Simulate the tip's motion from `start` to `end` (s, phi, gap); return (code, rows filled).

    `law` is over a length of 1. Heading and posture move along with it to `yaw_end` and `q_end`.
    The probe may be close to the pipe throughout. `touching`: the controller receives the surface
    frame, and inside the surface the dead zone and the push force apply.
    """
    m, k, lim = prob.model[0], prob.kinematics[0], prob.limits
    nj = m.n_joints
    u = np.zeros(6 + MAX_JOINTS)
    q0 = state.q.copy()
    yaw0 = math.atan2(state.R[1, 0], state.R[0, 0])
    turn = wrap(yaw_end - yaw0)
    span = np.empty(3)
    for i in range(3):
        span[i] = end[i] - start[i]
    s = np.empty(3)
    phi = np.empty(3)
    gap = np.empty(3)
    n_W = np.empty(3)
    f_tip = np.zeros(3)
    moved = 1e9  # check at once
    steps = (rows.shape[0] - 1) * SUBSTEPS
    dt = ROW / SUBSTEPS
    last = 1e9
    for step in range(steps + 1):
        x, xd, xdd = eval_time_law(law, step * dt)
        s[0], s[1], s[2] = start[0] + span[0] * x, span[0] * xd, span[0] * xdd
        phi[0], phi[1], phi[2] = start[1] + span[1] * x, span[1] * xd, span[1] * xdd
        gap[0], gap[1], gap[2] = start[2] + span[2] * x, span[2] * xd, span[2] * xdd
        fill_target(prob, s, phi, gap, target)
        target.yaw[0], target.yaw[1], target.yaw[2] = yaw0 + turn * x, turn * xd, turn * xdd
        for j in range(nj):
            d = q_end[j] - q0[j]
            target.q[0, j] = q0[j] + d * x
            target.q[1, j] = d * xd
            target.q[2, j] = d * xdd
        fill_kinematics(m, state.q, k)
        found[3], found[4] = s[0], phi[0]
        if not solve_accelerations(m, k, state, target, prob.motion, u):
            return SINGULAR, step // SUBSTEPS
        if step == steps:  # rest: remove the loop's residual
            for i in range(3):
                state.v[i] = state.w[i] = 0.0
            for j in range(nj):
                state.qd[j] = 0.0
            for j in range(6 + nj):
                u[j] = 0.0
        if step % SUBSTEPS == 0:
            i_row = step // SUBSTEPS
            row, tr = rows[i_row], trace[i_row]
            fill_row(prob, state, u, i_row * ROW, row)
            row.track_tip = 1.0
            inside = touching and gap[0] < 0.0
            for i in range(3):
                n_W[i] = -target.z[i]
                f_tip[i] = prob.push_force * n_W[i] if inside else 0.0
            if touching:
                surface_frame(prob.cylinder, phi[0], row.R_WS)
                row.dead_zone = dead_zone if inside else 0.0
            err = 0.0
            along = 0.0
            for i in range(3):
                err += (row.p_WT[i] - target.p[i]) ** 2
                along += row.R_WT[i, 2] * target.z[i]
            tr.task_error = math.sqrt(err)
            if not (tr.task_error <= lim.task_error and along >= math.cos(lim.axis_error)):
                found[0], found[1], found[2] = tr.task_error, lim.task_error, -1
                return TASK, i_row + 1
            code = check_dynamics(prob, state, u, f_tip, tr, found)
            if code != OK:
                return code, i_row + 1
            if moved > lim.resolution or step == steps:
                moved = 0.0
                back = -gap[0] if inside else 0.0
                last, _, allowed = check_clearance(
                    prob, state.p, state.R, state.q, back, n_W, FAR, lim.margin, 0.0, found
                )  # fmt: skip
                if not allowed:
                    return CLEARANCE, i_row + 1
            tr.clearance = last
        if step < steps:
            rate = norm(state.v) + prob.reach * norm(state.w)
            for j in range(nj):
                rate += prob.reach * abs(state.qd[j])
            moved += rate * dt
            step_state(state, u, nj, dt)
    return OK, rows.shape[0]


@njit(cache=True, error_model="numpy")
def simulate_free(
    prob: Problem,
    state: State,
    p_end: Array,
    R_end: Array,
    q_end: Array,
    law: TimeLaw,
    margin: float,
    rows: NDArray[Any],
    trace: NDArray[Any],
    found: Array,
) -> tuple[int, int]:
    """Move platform and joints straight to the end configuration; return (code, rows filled)."""
    m, k, lim = prob.model[0], prob.kinematics[0], prob.limits
    nj = m.n_joints
    u = np.zeros(6 + MAX_JOINTS)
    p0 = state.p.copy()
    R0 = state.R.copy()
    q0 = state.q.copy()
    rel = np.empty((3, 3))
    rotvec = np.empty(3)
    part = np.empty(3)
    turn = np.empty(3)
    zero = np.zeros(3)
    mat_t_mat(R0, R_end, rel)
    log_so3(rel, rotvec)  # constant direction in B
    mat_vec(R0, rotvec, turn)
    moved = folded = 1e9  # m: of any point in W, and relative to the platform
    last = own = 1e9
    found[3] = found[4] = math.nan
    for i_row in range(rows.shape[0]):
        x, xd, xdd = eval_time_law(law, i_row * ROW)
        for i in range(3):
            d = p_end[i] - p0[i]
            state.p[i], state.v[i], u[i] = p0[i] + d * x, d * xd, d * xdd
            state.w[i], u[3 + i] = turn[i] * xd, turn[i] * xdd
            part[i] = rotvec[i] * x
        exp_so3(part, rel)
        mat_mat(R0, rel, state.R)
        rate = 0.0
        for j in range(nj):
            d = q_end[j] - q0[j]
            state.q[j], state.qd[j], u[6 + j] = q0[j] + d * x, d * xd, d * xdd
            rate += prob.reach * abs(state.qd[j])
        folded += rate * ROW
        moved += (rate + norm(state.v) + prob.reach * norm(state.w)) * ROW
        fill_kinematics(m, state.q, k)
        row, tr = rows[i_row], trace[i_row]
        fill_row(prob, state, u, i_row * ROW, row)
        tr.task_error = 0.0
        code = check_dynamics(prob, state, u, zero, tr, found)
        if code != OK:
            return code, i_row + 1
        # coarse steps suffice far away: between two checks no point moves more than the reserve
        due = moved > max(lim.resolution, 0.5 * (last - margin))
        due = due or folded > max(lim.resolution, 0.5 * (own - lim.margin_self))
        if due or i_row == rows.shape[0] - 1:
            moved = folded = 0.0
            last, own, allowed = check_clearance(
                prob, state.p, state.R, state.q, 0.0, zero, 0.0, margin, FAR, found
            )
            if not allowed:
                return CLEARANCE, i_row + 1
        tr.clearance = last
    return OK, rows.shape[0]


def _finish(
    code: int, count: int, rows: Any, trace: Any, found: Array, state: State, margin_key: str
) -> Edge:
    failure = None
    if code != OK:
        failure = Failure(
            code, float(found[0]), float(found[1]), int(found[2]), float(found[3]),
            float(found[4]), state.p.copy(), margin_key,
        )  # fmt: skip
    return Edge(rows[:count], trace[:count], failure, state)


def _allocate(law: TimeLaw) -> tuple[NDArray[Any], NDArray[Any]]:
    count = round(law.duration / ROW) + 1
    return np.zeros(count, REFERENCE), np.zeros(count, Trace.dtype)


def copy_state(state: State) -> State:
    """Return a deep copy."""
    return State(*(a.copy() for a in state))


def plan_surface_edge(
    prob: Problem, state: State, start: Array, end: Array, law: TimeLaw, yaw_end: float,
    q_end: Array, touching: bool, dead_zone: float,
) -> Edge:  # fmt: skip
    """Simulate and check a motion of the tip over the surface (see `simulate_surface`)."""
    state = copy_state(state)
    rows, trace = _allocate(law)
    found = np.zeros(5)
    unit = TimeLaw(1.0, law.speed / max(law.length, 1e-12), law.ramp, law.duration)
    code, count = simulate_surface(
        prob, state, build_target(), start, end, unit, yaw_end, q_end, touching, dead_zone,
        rows, trace, found,
    )  # fmt: skip
    return _finish(code, count, rows, trace, found, state, ON_SURFACE)


def plan_free_edge(
    prob: Problem, state: State, p_end: Array, R_end: Array, q_end: Array, law: TimeLaw,
    margin: float, margin_key: str = IN_FLIGHT,
) -> Edge:  # fmt: skip
    """Simulate and check a straight motion in free flight (see `simulate_free`).

    `margin_key` names the key that sets `margin` (m).
    """
    state = copy_state(state)
    rows, trace = _allocate(law)
    found = np.zeros(5)
    unit = TimeLaw(1.0, law.speed / max(law.length, 1e-12), law.ramp, law.duration)
    code, count = simulate_free(prob, state, p_end, R_end, q_end, unit, margin, rows, trace, found)
    return _finish(code, count, rows, trace, found, state, margin_key)


def join_edges(edges: list[Edge]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return rows and trace of consecutive edges; time starts at 0, shared rows appear once."""
    rows, traces, t = [], [], 0.0
    for i, edge in enumerate(edges):
        part = edge.rows[1 if i else 0 :].copy()
        part["t"] += t
        t = float(part["t"][-1]) if len(part) else t
        rows.append(part)
        traces.append(edge.trace[1 if i else 0 :])
    return np.concatenate(rows), np.concatenate(traces)
