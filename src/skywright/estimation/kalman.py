"""The Kalman filter's correction of an error state by a few numbers at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

Array = Any


@njit(cache=True, error_model="numpy")
def correct(P: Array, H: Array, nu: Array, r: Array, gate: float, dx: Array) -> float:
    """Correct `P` (n, n) by innovations `nu` (m,) with the Jacobian `H` (m, n).

    `r` (m,) are the variances of the independent noise. Writes the error's estimate into `dx` (n,)
    and returns the squared normalised innovation; beyond `gate` nothing changes and `dx` is zero.
    `nu` is whitened in place.
    """
    m, n = H.shape
    W, S = np.zeros((m, n)), np.empty((m, m))
    for a in range(m):
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
