"""The force that a compliant arm exerts with its hand, from the deflection of its springs.

Two estimators (robot.control.force_estimator). "cartesian" is Suarez 2020, (25)-(28), as printed:
the displacement of the hand between the arm with rigid joints and the real one, times a Cartesian
stiffness. It reads the arm's own weight as a force, is linear in angles that are not small, and
diverges as the arm stretches. "torque" is the static equilibrium of the links: spring torque =
gravity torque + J^T f, with f the force on what the hand touches.

Only joints whose deflection is measured say anything; with two of them f lies in the arm's plane.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import mat_t_vec, mat_vec, solve3
from skywright.models.springs import joint_torque

Record = Any

SINGULAR = 1e-3
"""m, lever below which a direction of force is taken as unobservable."""
TARE_TIME = 0.5
"""s, over which the forces that are called zero are averaged."""


@njit(cache=True, error_model="numpy")
def estimate_contact_force(b: Record) -> None:
    """Fill `arms.f_WH` (N, in W) of every hand; while `ref.tare` is set, `arms.tare` as well."""
    arms = b.arms
    f_B = np.empty(3)
    gain = 1.0 - math.exp(-arms.dt / TARE_TIME)
    for h in range(arms.n_hands):
        if arms.estimator > 0.5:
            force_from_torques(b, h, f_B)
        else:
            force_from_displacement(b, h, f_B)
        mat_vec(b.est.R_WB, f_B, arms.f_WH[h])
        for a in range(3):
            if b.ref.tare > 0.5:
                arms.tare[h, a] += gain * (arms.f_WH[h, a] - arms.tare[h, a])
            arms.f_WH[h, a] -= arms.tare[h, a]


@njit(cache=True, error_model="numpy")
def force_from_displacement(b: Record, h: int, f_B: Any) -> None:
    """Fill f_B (N) with (25)-(28): F = K_C dl, K_C = J^-T K_p J^-1, in x and z of the arms' base.

    J is 2 x 2, of the shoulder's pitch and the elbow (the arm's own is 3 x 4, which has no
    inverse). Where the arm is stretched J has none either: then this returns zero.
    """
    arms = b.arms
    shoulder, elbow = arms.first[h], arms.first[h] + arms.n - 1
    dl, dl_B, f_A = np.empty(3), np.empty(3), np.zeros(3)
    J, column, column_B = np.empty((2, 2)), np.empty(3), np.empty(3)
    for a in range(3):
        dl_B[a] = arms.p_BH_stiff[h, a] - arms.p_BH[h, a]  # (25)
    mat_t_vec(arms.R_BA, dl_B, dl)
    for i in range(2):
        for a in range(3):
            column_B[a] = arms.J_BH[h, a, shoulder if i == 0 else elbow]
        mat_t_vec(arms.R_BA, column_B, column)
        J[0, i], J[1, i] = column[0], column[2]
    det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
    if abs(det) > 1e-9:
        # J^-1 dl, times K_p (28), then J^-T: (26), (27)
        t0 = arms.k[shoulder] * (J[1, 1] * dl[0] - J[0, 1] * dl[2]) / det
        t1 = arms.k[elbow] * (J[0, 0] * dl[2] - J[1, 0] * dl[0]) / det
        f_A[0] = (J[1, 1] * t0 - J[1, 0] * t1) / det
        f_A[2] = (J[0, 0] * t1 - J[0, 1] * t0) / det
    mat_vec(arms.R_BA, f_A, f_B)


@njit(cache=True, error_model="numpy")
def force_from_torques(b: Record, h: int, f_B: Any) -> None:
    """Fill f_B (N): least squares of J^T f = spring torque - gravity torque, measured joints.

    J is that of the centre of the hand's ball, through which a force on it passes (one across the
    hand's end would have 6 % more lever). Damped: (J J^T + l^2 1) f = J dt, so that directions in
    which the arm has no lever read zero.
    """
    arms = b.arms
    first = arms.first[h]
    M, y = np.zeros((3, 3)), np.zeros(3)
    for j in range(first, first + arms.n):
        if arms.sensed[j] == 0.0 or arms.k[j] == 0.0:
            continue
        t = joint_torque(arms, j, arms.deflection[j]) - arms.t_gravity[j]
        for a in range(3):
            y[a] += arms.J_BP[h, a, j] * t
            for c in range(3):
                M[a, c] += arms.J_BP[h, a, j] * arms.J_BP[h, c, j]
    for a in range(3):
        M[a, a] += SINGULAR * SINGULAR
    solve3(M, y, f_B)
