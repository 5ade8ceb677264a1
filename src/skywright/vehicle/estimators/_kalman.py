"""Measurement update of an error-state Kalman filter, for up to six scalars at once.

The first 15 errors are common to all filters here: position, velocity, attitude, gyroscope bias and
accelerometer bias (filter.py).
"""

from __future__ import annotations

import math
from typing import Any

from skywright.core.rotations import exp_so3, mat_mat, mat_vec
from skywright.core.scratch import local
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._strapdown import BA_, BG_, P_, R_, V_

MOST_NUMBERS, MOST_STATES = 6, 25


@helper
def correct(P: Any, H: Any, nu: Any, r: Any, gate: float, dx: Any) -> float:
    """Correct `P` (n, n) by innovations `nu` (m,) with the Jacobian `H` (m, n).

    `r` (m,) are the variances of independent noise. Writes the estimated error into `dx` (n,) and
    returns the squared normalised innovation. If this exceeds `gate`, P does not change and `dx` is
    zero. `nu` is whitened in place.
    """
    m, n = H.shape
    W, S = local(MOST_NUMBERS, MOST_STATES), local(MOST_NUMBERS, MOST_NUMBERS)
    for a in range(m):
        for c in range(n):
            W[a, c] = 0.0
        for k in range(n):
            h = H[a, k]
            if h != 0.0:
                for c in range(n):
                    W[a, c] += h * P[k, c]
    for a in range(m):
        for b in range(a + 1):
            s = 0.0
            for k in range(n):
                s += W[a, k] * H[b, k]
            S[a, b] = s
        S[a, a] += r[a]
    size = 0.0
    for a in range(m):  # Cholesky factor L in place, then nu <- L^-1 nu, W <- L^-1 W
        for b in range(a):
            s = S[a, b]
            for k in range(b):
                s -= S[a, k] * S[b, k]
            S[a, b] = s / S[b, b]
        s = S[a, a]
        for k in range(a):
            s -= S[a, k] * S[a, k]
        S[a, a] = math.sqrt(s)
        for k in range(a):
            nu[a] -= S[a, k] * nu[k]
        nu[a] /= S[a, a]
        size += nu[a] * nu[a]
    for i in range(n):
        dx[i] = 0.0
    if not size < gate:
        return size
    for a in range(m):
        for k in range(a):
            for c in range(n):
                W[a, c] -= S[a, k] * W[k, c]
        w = 1.0 / S[a, a]
        for c in range(n):
            W[a, c] *= w
            dx[c] += W[a, c] * nu[a]
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for a in range(m):
                s += W[a, i] * W[a, j]
            P[i, j] -= s
            P[j, i] = P[i, j]
    return size


@helper
def inject(me: Any, dx: Any) -> None:
    """Add the estimated error `dx` (15 or more,) to the state at the horizon."""
    turn, rot, old = local(3), local(3, 3), local(3, 3)
    for i in range(3):
        me.p_f[i] += dx[P_ + i]
        me.v_f[i] += dx[V_ + i]
        me.bg[i] += dx[BG_ + i]
        me.ba[i] += dx[BA_ + i]
        turn[i] = dx[R_ + i]
    exp_so3(turn, rot)
    for i in range(3):
        for j in range(3):
            old[i, j] = me.R_f[i, j]
    mat_mat(rot, old, me.R_f)


@helper
def place_point(me: Any, p_B: Any, H: Any, out: Any) -> None:
    """Write the vector (m) in W from the inertial unit to the point p_B of B into `out` (3,).

    The Jacobian of the point's position is written to rows 0 to 2 of `H`, which must be zero.
    """
    d = local(3)
    for i in range(3):
        d[i] = p_B[i] - me.p_BI[i]
    mat_vec(me.R_f, d, out)
    for i in range(3):
        H[i, P_ + i] = 1.0
    H[0, R_ + 1], H[0, R_ + 2] = out[2], -out[1]  # turn x lever
    H[1, R_], H[1, R_ + 2] = -out[2], out[0]
    H[2, R_], H[2, R_ + 1] = out[1], -out[0]
