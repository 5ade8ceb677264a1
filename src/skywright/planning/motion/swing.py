"""The passive joint's swing along a timed motion, by the planar model of Caballero et al. 2018.

Platform (level) and arms move as planned; the joint follows its row of (3) with the bearing's
damping. The swing is the distance from the static equilibrium of the present arm posture.
"""

import math
from collections.abc import Callable

import numpy as np

from skywright.core.arrays import Array
from skywright.core.user_code import njit
from skywright.models.planar import PlanarLrm, fill_equations, fill_terms

STEP = 0.004  # s, of the integration
SETTLE = 2.0  # s of simulation after the end of the motion


def add_bar(model: PlanarLrm, mass: float, hand: float) -> PlanarLrm:
    """Return the model with half of a bar's mass (kg) in each hand, `hand` (m) from its elbow."""
    share = mass / 2
    total = model.m_f + share
    c = (model.m_f * model.c_f + share * hand) / total
    inertia = model.i_f + model.m_f * (c - model.c_f) ** 2 + share * (hand - c) ** 2
    return model._replace(m_f=total, c_f=c, i_f=inertia)


def build_swing(
    model: PlanarLrm, gravity: float, damping: float
) -> Callable[[Array, Array, Array, Array], float]:
    """Return the swing function for `timing.assign_times`; coordinates (x, z, shoulders, elbows).

    `damping` (N m s/rad) is the bearing's.
    """

    def swing(t: Array, c: Array, cd: Array, cdd: Array) -> float:
        return float(_largest_swing(model, gravity, damping, t, c, cd, cdd))

    return swing


@njit(cache=True, error_model="numpy")
def equilibrium(p: PlanarLrm, shoulder: float, elbow: float) -> float:
    """Return the static angle of the passive joint (rad), equal arms, level platform."""
    forward = 2.0 * (
        p.m_u * p.c_u * math.sin(shoulder)
        + p.m_f * (p.l_u * math.sin(shoulder) + p.c_f * math.sin(shoulder + elbow))
    )
    down = p.m_b * p.c_b + 2.0 * (p.m_u + p.m_f) * p.l_b
    down += 2.0 * (
        p.m_u * p.c_u * math.cos(shoulder)
        + p.m_f * (p.l_u * math.cos(shoulder) + p.c_f * math.cos(shoulder + elbow))
    )
    return -math.atan2(forward, down)


@njit(cache=True, error_model="numpy")
def compute_period(p: PlanarLrm, shoulder: float, elbow: float, g: float) -> float:
    """Return the period (s) of a small swing about the equilibrium while the platform is held."""
    q, M, rhs, step = np.zeros(8), np.zeros((8, 8)), np.zeros((8, 24)), 1e-4
    terms, none, torque = np.zeros(24), np.zeros(6), np.zeros(2)
    q[4] = q[6] = shoulder
    q[5] = q[7] = elbow
    rest = equilibrium(p, shoulder, elbow)
    fill_terms(np.zeros(8), none, g, terms)
    for i in range(2):
        q[3] = rest + (2 * i - 1) * step
        fill_equations(p, q, M, rhs)
        for j in range(24):
            torque[i] += rhs[3, j] * terms[j]
    return 2.0 * math.pi * math.sqrt(M[3, 3] * 2.0 * step / (torque[0] - torque[1]))


@njit(cache=True, error_model="numpy")
def compute_passive_rate(
    p: PlanarLrm, q: Array, u: Array, rates: Array, g: float, damping: float
) -> float:
    """Return du0/dt from its row of (3), given all other rates; no actuator acts on it."""
    M, rhs, terms, none = np.zeros((8, 8)), np.zeros((8, 24)), np.zeros(24), np.zeros(6)
    fill_equations(p, q, M, rhs)
    fill_terms(u, none, g, terms)
    total = -damping * u[3]
    for j in range(24):
        total += rhs[3, j] * terms[j]
    for j in range(8):
        if j != 3:
            total -= M[3, j] * rates[j]
    return total / M[3, 3]


@njit(cache=True, error_model="numpy")
def _largest_swing(
    p: PlanarLrm, g: float, damping: float, t: Array, c: Array, cd: Array, cdd: Array
) -> float:
    q, u, rates = np.zeros(8), np.zeros(8), np.zeros(8)
    q[3] = equilibrium(p, c[0, 2], c[0, 3])
    count = int((t[-1] + SETTLE) / STEP)
    largest, row = 0.0, 0
    for step in range(count):
        now = step * STEP
        while row < t.shape[0] - 2 and t[row + 1] <= now:
            row += 1
        moving = now < t[-1]
        share = (now - t[row]) / max(t[row + 1] - t[row], 1e-9) if moving else 1.0
        share = min(max(share, 0.0), 1.0)
        for i, j in ((0, 0), (1, 1), (4, 2), (5, 3), (6, 2), (7, 3)):
            q[i] = c[row, j] + share * (c[row + 1, j] - c[row, j])
            u[i] = cd[row, j] + share * (cd[row + 1, j] - cd[row, j]) if moving else 0.0
            rates[i] = cdd[row, j] + share * (cdd[row + 1, j] - cdd[row, j]) if moving else 0.0
        u[3] += STEP * compute_passive_rate(p, q, u, rates, g, damping)
        q[3] += STEP * u[3]
        largest = max(largest, abs(q[3] - equilibrium(p, q[4], q[5])))
    return largest
