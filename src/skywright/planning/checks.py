"""Constraints of a nominal state: joints, motors, speed, tilt, rotors and clearance."""

import math
from typing import Annotated

import numpy as np

from skywright.core.compiled import helper
from skywright.core.record import Array, Record
from skywright.core.rotations import mat_t_vec, norm
from skywright.core.types import MAX_JOINTS, MAX_ROTORS
from skywright.models.geometry import FAR, query_clearance, query_self
from skywright.planning.inverse_dynamics import compute_thrusts, compute_wrench
from skywright.planning.inverse_kinematics import State
from skywright.planning.problem import (
    ACCELERATION,
    JOINT,
    MOTOR,
    OK,
    ROTOR,
    SPEED,
    TILT,
    Problem,
)


class Trace(Record):
    """Quantities of the checks per row, for plots."""

    clearance: float  # m, at the last check
    rotor_margin: float  # fraction of the usable range
    thrust: Annotated[Array, MAX_ROTORS]  # N
    task_error: float  # m


@helper
def check_dynamics(
    prob: Problem, state: State, u: Array, f_tip_W: Array, trace: Trace, found: Array
) -> int:
    """Check joints, motors, speed, acceleration, tilt and rotors; fill `trace`.

    On failure `found` holds (value, limit, which). Kinematics must be up to date.
    """
    m, k, lim = prob.model[0], prob.kinematics[0], prob.limits
    nj = m.n_joints
    qdd = np.zeros(MAX_JOINTS)
    for j in range(nj):
        qdd[j] = u[6 + j]
    for j in range(nj):
        low = state.q[j] < m.q_min[j] - 1e-6
        if low or state.q[j] > m.q_max[j] + 1e-6:
            found[0], found[1], found[2] = state.q[j], m.q_min[j] if low else m.q_max[j], j
            return JOINT
        speed = 0.0
        for i in range(nj):
            speed += m.belt_inv[j, i] * state.qd[i]
        if abs(speed) > m.motor_speed_max[j] > 0.0:
            found[0], found[1], found[2] = speed, m.motor_speed_max[j], j
            return MOTOR
    speed = norm(state.v)
    if speed > 1.01 * lim.speed:
        found[0], found[1], found[2] = speed, lim.speed, -1
        return SPEED
    acc = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    if acc > 1.01 * lim.acceleration:
        found[0], found[1], found[2] = acc, lim.acceleration, -1
        return ACCELERATION
    tilt = math.acos(max(-1.0, min(1.0, state.R[2, 2])))
    if tilt > lim.tilt + 1e-6:
        found[0], found[1], found[2] = tilt, lim.tilt, -1
        return TILT
    w_B = np.empty(3)
    wd_B = np.empty(3)
    tmp = np.empty(3)
    f = np.empty(3)
    t = np.empty(3)
    for i in range(3):
        tmp[i] = u[3 + i]
    mat_t_vec(state.R, state.w, w_B)
    mat_t_vec(state.R, tmp, wd_B)
    for i in range(3):
        tmp[i] = u[i]
    compute_wrench(
        m, k, state.R, w_B, wd_B, tmp, state.qd, qdd, f_tip_W, prob.motion, f, t
    )  # fmt: skip
    n = prob.loads.P.shape[0]
    thrust = trace.thrust[:n]
    margin, worst = compute_thrusts(prob.loads, state.R, state.v, w_B, f, t, thrust)
    trace.rotor_margin = margin
    if margin < lim.rotor_margin:
        span = prob.loads.t_max[worst] - prob.loads.t_min[worst]
        lo = prob.loads.t_min[worst] + lim.rotor_margin * span
        hi = prob.loads.t_max[worst] - lim.rotor_margin * span
        found[0], found[2] = thrust[worst], worst
        found[1] = lo if thrust[worst] < lo else hi
        return ROTOR
    return OK


@helper
def check_clearance(
    prob: Problem, p: Array, R: Array, q: Array, back: float, n_W: Array, probe_slack: float,
    margin: float, far: float, found: Array,
) -> tuple[float, float, bool]:  # fmt: skip
    """Return (clearance m, own m, allowed) at a pose and at that of the real robot, `back` m along
    n_W.

    `own` is the clearance between parts of the robot, resolved up to `far` (m). On failure `found`
    holds (value, limit, pair).
    """
    d, pair = query_clearance(prob.clearance, p, R, q, probe_slack, FAR)
    if back > 0.0:
        real = np.empty(3)
        for i in range(3):
            real[i] = p[i] + back * n_W[i]
        d2, pair2 = query_clearance(prob.clearance, real, R, q, probe_slack, d)
        if d2 < d:
            d, pair = d2, pair2
    found[0], found[1], found[2] = d, margin, pair
    if not d >= margin:
        return d, 0.0, False
    least = prob.limits.margin_self
    own, pair = query_self(prob.clearance, max(far, least))
    if own < least:
        found[0], found[1], found[2] = own, least, pair
    return d, own, own >= least
