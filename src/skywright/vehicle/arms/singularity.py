"""Distance of an arm from its singularity, and the platform displacement that restores it.

The stretched arm of Suarez 2020 has no lever along its own line: a force in this direction causes
no joint torque, and no joint displacement produces it (the failed trial of section VI-B). The
measure is the lever of the joints in the direction of the task,

    l = 1 / sqrt(n^T (J J^T)^-1 n)    (m: speed of the hand along n, joints at 1 rad/s)

An error of 0.2 deg of a deflection encoder at the strongest spring (10 mN m) is a force of 0.1 N at
a lever of 0.1 m. The `singular` flag is set at this lever, a fifth of the arm's reach.
"""

from __future__ import annotations

import math
from typing import Any

from skywright.core.rotations import mat_t_vec, mat_vec, norm, solve3
from skywright.core.scratch import local
from skywright.vehicle.arms.view import ArmsView
from skywright.vehicle.component import helper

NEAR, CLEAR = 0.2, 0.3
"""Ratios of lever to reach below which `singular` is set, and above which it is cleared."""


@helper
def lever_along(J: Any, first: int, n: int, way: Any) -> float:
    """Return the lever (m) of joints first..first+n of J (3, m) along the unit vector `way`."""
    M, x = local(3, 3), local(3)
    for a in range(3):
        for c in range(3):
            M[a, c] = 1e-8 if a == c else 0.0
            for j in range(first, first + n):
                M[a, c] += J[a, j] * J[c, j]
    solve3(M, way, x)
    return 1.0 / math.sqrt(way[0] * x[0] + way[1] * x[1] + way[2] * x[2])


@helper
def watch_singularity(v: ArmsView, h: int, way_W: Any) -> None:
    """Fill lever, singular and shift_W of hand h for a task along way_W (zero: along the arm)."""
    along_A, p_B, way_B = local(3), local(3), local(3)
    for a in range(3):
        p_B[a] = v.hands.p_BH[h, a] - v.hands.p_BA[a]
    mat_t_vec(v.hands.R_BA, p_B, along_A)
    for a in range(3):
        along_A[a] -= v.arm.p_BS[h, a]  # shoulder to hand
    size, rho = norm(way_W), max(norm(along_A), 1e-9)
    mat_vec(v.hands.R_BA, along_A, p_B)
    mat_t_vec(v.est.R_WB, way_W, way_B)
    for a in range(3):
        way_B[a] = way_B[a] / size if size > 0.0 else p_B[a] / rho
    v.state.lever[h] = lever_along(v.hands.J_BH[h], v.arm.first[h], v.arm.n, way_B)
    share = v.state.lever[h] / (v.arm.upper + v.arm.fore)
    if share < NEAR:
        v.state.singular[h] = 1.0
    elif share > CLEAR:
        v.state.singular[h] = 0.0
    # for a right angle at the elbow with a fixed hand, the shoulder moves along the arm
    good = math.sqrt(v.arm.upper * v.arm.upper + v.arm.fore * v.arm.fore)
    for a in range(3):
        way_B[a] = p_B[a] * (1.0 - good / rho)
    mat_vec(v.est.R_WB, way_B, v.state.shift_W[h])
