"""The force that a compliant arm exerts with its hand, from the deflection of its springs.

Static equilibrium of the output links: spring torque = gravity torque + J^T f, with f the force on
what the hand touches (Suarez 2020, section V-D, leaves out the gravity torque). Only joints whose
deflection is measured say anything; with two of them f lies in the arm's plane.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import mat_vec, solve3
from skywright.models.compliant_arms import spring_torque

Record = Any

SINGULAR = 1e-3
"""m, lever below which a direction of force is taken as unobservable."""


@njit(cache=True, error_model="numpy")
def estimate_contact_force(b: Record) -> None:
    """Fill `arms.f_WH` (N, in W) of every hand."""
    arms = b.arms
    f_B = np.empty(3)
    for h in range(arms.n_hands):
        force_from_torques(b, h, f_B)
        mat_vec(b.est.R_WB, f_B, arms.f_WH[h])
        for a in range(3):
            arms.f_WH[h, a] -= arms.tare[h, a]


@njit(cache=True, error_model="numpy")
def force_from_torques(b: Record, h: int, f_B: Any) -> None:
    """Least squares of J^T f = spring torque - gravity torque over the measured joints of arm h.

    Damped: (J J^T + l^2 1) f = J dt, so that directions in which the arm has no lever read zero.
    """
    arms = b.arms
    first = arms.first[h]
    M, y = np.zeros((3, 3)), np.zeros(3)
    for j in range(first, first + arms.n):
        if arms.sensed[j] == 0.0 or arms.k[j] == 0.0:
            continue
        t = spring_torque(arms.k[j], arms.linear[j], arms.hardening[j], arms.deflection[j])
        t -= arms.t_gravity[j]
        for a in range(3):
            y[a] += arms.J_BH[h, a, j] * t
            for c in range(3):
                M[a, c] += arms.J_BH[h, a, j] * arms.J_BH[h, c, j]
    for a in range(3):
        M[a, a] += SINGULAR * SINGULAR
    solve3(M, y, f_B)
