"""Configurations that hold the tip at a point of the surface: sampling of the redundancy.

Candidates are sampled over headings and arm postures, projected onto the task (probe along the
inward normal, platform level) and scored by rotor margin, clearance, manipulability, power and
distance from the preferred posture.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import mat_vec
from skywright.core.types import MAX_JOINTS
from skywright.core.user_code import njit
from skywright.description.world.surface import level_axes
from skywright.models.body_records import Kinematics
from skywright.models.geometry import FAR
from skywright.models.rigid_body import fill_kinematics
from skywright.models.rotors import compute_power
from skywright.planning.checks import Trace, check_clearance, check_dynamics
from skywright.planning.inverse_kinematics import (
    State,
    build_state,
    settle_posture,
    wrap,
)
from skywright.planning.problem import CLEARANCE, OK, ON_SURFACE, ROTOR, TASK, Failure, Problem

HOME_PULL = 0.4
"""1/rad^2, weight of the distance from the working posture (scores are of the order of 1)."""


class Candidates(NamedTuple):
    """Feasible configurations at a surface point, best first."""

    p: Array  # (n, 3) m
    R: Array  # (n, 3, 3)
    q: Array  # (n, MAX_JOINTS)
    score: Array  # (n,)
    failure: Failure | None  # smallest violation, if there is no candidate


@helper
def compute_manipulability(k: Kinematics, nj: int) -> float:
    """Return the product of the singular values of the tip's Jacobian (Yoshikawa).

    Computed by Gram-Schmidt over the joints that add a direction.
    """
    basis = np.zeros((3, 3))
    count, volume = 0, 1.0
    v = np.empty(3)
    for j in range(nj):
        for i in range(3):
            v[i] = k.J_BT[i, j]
        for c in range(count):
            d = v[0] * basis[c, 0] + v[1] * basis[c, 1] + v[2] * basis[c, 2]
            for i in range(3):
                v[i] -= d * basis[c, i]
        size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if count < 3 and size > 1e-9:
            for i in range(3):
                basis[count, i] = v[i] / size
            count += 1
            volume *= size
        elif count < min(nj, 2):
            return 0.0
    return volume if count > 0 else 0.0


@njit(cache=True, error_model="numpy")
def rate_configurations(
    prob: Problem,
    tip: Array,
    n_W: Array,
    back: float,
    yaws: Array,
    postures: Array,
    q_home: Array,
    home_pull: float,
    q_last: Array,
    yaw_last: float,
    last_pull: float,
    p_out: Array,
    R_out: Array,
    q_out: Array,
    score: Array,
    miss: Array,
    trace: NDArray[Any],
) -> None:
    """Project, check and score every (yaw, posture) pair at one surface point.

    tip, n_W (3,): desired tip and outward normal; `back` m: depth of the tip inside the surface.
    q_home: preferred posture; q_last and yaw_last: configuration to stay near; home_pull and
    last_pull (1/rad^2): weights of the distances from them. score is -inf if a limit is violated;
    `miss` (n, 6) then holds (code, value, limit, which, violation, 0).
    """
    m, k, lim = prob.model[0], prob.kinematics[0], prob.limits
    nj = m.n_joints
    z = -n_W
    u = np.zeros(6 + MAX_JOINTS)
    f_tip = prob.push_force * n_W
    found = np.zeros(5)
    r = np.empty(3)
    zero3 = np.zeros(3)
    zero8 = np.zeros(MAX_JOINTS)
    c = 0
    for iy in range(yaws.shape[0]):
        for ip in range(postures.shape[0]):
            R, q = R_out[c], q_out[c]
            cy, sy = math.cos(yaws[iy]), math.sin(yaws[iy])
            R[:] = 0.0
            R[0, 0], R[0, 1], R[1, 0], R[1, 1], R[2, 2] = cy, -sy, sy, cy, 1.0
            q[:] = 0.0
            for j in range(nj):
                q[j] = postures[ip, j]
            err = settle_posture(m, k, R, q, z, 12)
            for j in range(nj):  # rotations by 360 deg are the same posture
                while q[j] > m.q_max[j] and q[j] - 2.0 * math.pi >= m.q_min[j]:
                    q[j] -= 2.0 * math.pi
                while q[j] < m.q_min[j] and q[j] + 2.0 * math.pi <= m.q_max[j]:
                    q[j] += 2.0 * math.pi
            fill_kinematics(m, q, k)
            mat_vec(R, k.p_BT, r)
            p = p_out[c]
            for i in range(3):
                p[i] = tip[i] - r[i]
            score[c] = -math.inf
            miss[c, 0] = TASK
            miss[c, 1], miss[c, 2], miss[c, 3], miss[c, 4] = err, lim.axis_error, -1.0, 10.0 + err
            c += 1
            i = c - 1
            if err > 1e-4:
                continue
            state = State(p, zero3, R, zero3, q, zero8)
            code = check_dynamics(prob, state, u, f_tip, trace[0], found)
            margin = trace[0].rotor_margin
            miss[i, 4] = 0.0
            if code != OK:
                miss[i, 0], miss[i, 1], miss[i, 2], miss[i, 3] = code, found[0], found[1], found[2]
                # the rotors are not checked yet if a joint or the tilt fails before them
                miss[i, 4] = 0.5 * abs(found[0] - found[1])
                if code != ROTOR:
                    miss[i, 4] += 2.0
            gap, _, allowed = check_clearance(prob, p, R, q, back, n_W, FAR, lim.margin, 0.0, found)
            if not allowed:
                deficit = (found[1] - found[0]) / 0.1
                if deficit > miss[i, 4]:  # report the larger of two violations
                    miss[i, 0] = CLEARANCE
                    miss[i, 1], miss[i, 2], miss[i, 3] = found[0], found[1], found[2]
                miss[i, 4] += deficit
            if code != OK or not allowed:
                continue
            n = prob.loads.P.shape[0]
            power = compute_power(trace[0].thrust, n, 1.0)
            yaw = math.atan2(R[1, 0], R[0, 0])
            away = last_pull * wrap(yaw - yaw_last) ** 2
            for j in range(nj):
                away += last_pull * (q[j] - q_last[j]) ** 2 + home_pull * (q[j] - q_home[j]) ** 2
            score[i] = (
                4.0 * min(margin, 0.25)
                + 1.5 * min((gap - lim.margin) / 0.06, 1.0)
                + 2.0 * min(compute_manipulability(k, nj), 0.1)
                - 0.01 * power
                - away
            )


def halton(count: int, dimensions: int) -> Array:
    """Return (count, dimensions) points of the Halton sequence in [0, 1)."""
    primes = [2, 3, 5, 7, 11, 13, 17, 19, 23]  # MAX_JOINTS
    out = np.zeros((count, dimensions))
    for d in range(dimensions):
        base = primes[d]
        for i in range(count):
            f, n = 1.0, i + 1
            while n > 0:
                f /= base
                out[i, d] += f * (n % base)
                n //= base
    return out


def sample_postures(prob: Problem, unit: Array) -> Array:
    """Map (n, n_joints) points of the unit cube to joint angles within the limits."""
    m = prob.model[0]
    nj = int(m["n_joints"])
    return m["q_min"][:nj] + unit * (m["q_max"][:nj] - m["q_min"][:nj])


def compute_headings(n_W: Array, R_WP: Array) -> Array:
    """Return the candidate headings (rad): into the surface, and in the pipe's planes.

    For a near-vertical normal any heading is possible; with the four of the pipe (across and along)
    a sector requires no turn.
    """
    found: list[float] = []

    def add(x: float, y: float) -> None:
        yaw = math.atan2(y, x)
        if all(abs(wrap(yaw - other)) > 0.02 for other in found):
            found.append(yaw)

    if math.hypot(n_W[0], n_W[1]) > 0.02:
        add(-n_W[0], -n_W[1])
        add(n_W[0], n_W[1])
    if abs(n_W[2]) > 0.5:
        for x, y, _ in level_axes(R_WP)[:, :2].T:
            if math.hypot(x, y) > 0.1:
                add(x, y)
                add(-x, -y)
    return np.array(found)


def find_configurations(
    prob: Problem,
    tip: Array,
    n_W: Array,
    depth: float,
    yaws: Array,
    postures: Array,
    q_home: Array,
    q_last: Array,
    yaw_last: float,
    last_pull: float,
    where: tuple[float, float],
) -> Candidates:
    """Return the feasible configurations at a surface point `where` (s, phi), best first."""
    count = len(yaws) * len(postures)
    p, R = np.zeros((count, 3)), np.zeros((count, 3, 3))
    q, score = np.zeros((count, MAX_JOINTS)), np.full(count, -np.inf)
    miss = np.zeros((count, 6))
    home, last = np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS)
    home[: len(q_home)], last[: len(q_last)] = q_home, q_last
    rate_configurations(
        prob, tip, n_W, depth, yaws, np.ascontiguousarray(postures), home, HOME_PULL, last,
        yaw_last, last_pull, p, R, q, score, miss, np.zeros(1, Trace.dtype),
    )  # fmt: skip
    order = np.argsort(-score, kind="stable")
    order = order[np.isfinite(score[order])]
    failure = None
    if len(order) == 0:
        near = int(np.argmin(miss[:, 4]))
        code, value, limit, which = miss[near, :4]
        failure = Failure(
            int(code), value, limit, int(which), where[0], where[1], p[near], ON_SURFACE
        )
    return Candidates(p[order], R[order], q[order], score[order], failure)


def resting(c: Candidates, i: int) -> State:
    """Return candidate `i` as a state at rest."""
    return build_state(c.p[i], c.R[i], c.q[i])
