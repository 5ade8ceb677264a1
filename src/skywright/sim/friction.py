"""Friction that varies along the surface: a stationary random field, read where the tip is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.description.world.spec import Pipe

Array = NDArray[np.float64]
Record = Any

MODES = 32
NEAR = 0.005  # m, gap beyond which the coefficient does not matter

FRICTION = np.dtype(
    [
        ("mean", np.float64),
        ("sigma", np.float64),  # of the logarithm; 0 leaves MuJoCo's value alone
        ("ks", np.float64, MODES),  # rad/m along the axis
        ("kc", np.float64, MODES),  # rad/m around it
        ("phase", np.float64, MODES),
    ]
)


def fill_friction(f: Any, pipe: Pipe, rng: np.random.Generator) -> None:
    """Fill a FRICTION record: log-normal, mean and relative deviation as in the pipe's file.

    The logarithm is a sum of MODES random Fourier modes of the Gaussian covariance
    exp(-d^2 / (2 l^2)) on the unrolled surface (Rahimi and Recht 2007).
    """
    f["mean"] = pipe.friction
    f["sigma"] = math.sqrt(math.log1p(pipe.friction_variation**2))
    k = rng.standard_normal((2, MODES)) / pipe.friction_length_m
    f["ks"], f["kc"] = k
    f["phase"] = rng.uniform(0.0, 2.0 * math.pi, MODES)


@njit(cache=True, error_model="numpy")
def compute_friction(f: Record, s: float, c: float) -> float:
    """Return the friction coefficient at (s, c) m of the unrolled surface."""
    g = 0.0
    for m in range(MODES):
        g += math.cos(f.ks[m] * s + f.kc[m] * c + f.phase[m])
    g *= math.sqrt(2.0 / MODES)
    return f.mean * math.exp(f.sigma * g - 0.5 * f.sigma * f.sigma)


@njit(cache=True, error_model="numpy")
def rub(f: Record, s: float, c: float, gap: float, pair_friction: Array) -> None:
    """Write the coefficient under the tip into MuJoCo's contact pair (n_pairs, 5)."""
    if f.sigma > 0.0 and gap < NEAR and pair_friction.shape[0] > 0:
        mu = max(compute_friction(f, s, c), 1e-4)
        pair_friction[0, 0] = mu
        pair_friction[0, 1] = mu
