"""Metrics and costs of Caballero et al. 2018 over a configuration space.

The printed equations include both arms' joints; a coordinate that drives two joints counts twice in
the sums and once in the maxima.
"""

import math

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.planning.motion.space import SpaceRecord


@njit(cache=True, error_model="numpy")
def displacement_cost(space: SpaceRecord, a: Array, b: Array) -> float:
    """CF_E of (6): p1 rho_UAV + p2 sigma_ARMS, from a to b."""
    move = turn = 0.0
    for i in range(space.n_move):
        d = space.weight[i] * (b[i] - a[i])
        move += d * d
    for i in range(space.n_move, space.n):
        turn += space.weight[i] * abs(b[i] - a[i])
    return math.sqrt(move) + turn


@njit(cache=True, error_model="numpy")
def rho_uav(space: SpaceRecord, a: Array, b: Array) -> float:
    """rho_UAV of (5): distance that the platform moves, m."""
    move = 0.0
    for i in range(space.n_move):
        move += (b[i] - a[i]) ** 2
    return math.sqrt(move)


@njit(cache=True, error_model="numpy")
def rho_arms(space: SpaceRecord, a: Array, b: Array) -> float:
    """rho_ARMS of (5): largest change of an angle, rad."""
    turn = 0.0
    for i in range(space.n_move, space.n):
        turn = max(turn, abs(b[i] - a[i]))
    return turn


@njit(cache=True, error_model="numpy")
def time_cost(space: SpaceRecord, a: Array, b: Array, u_ref: float, w_ref: float) -> float:
    """CF_T of (6), the metric inside (4): max(t_UAV, t_ARMS), s. (4) prints min for argmin."""
    return max(rho_uav(space, a, b) / u_ref, rho_arms(space, a, b) / w_ref)


@helper
def path_cost(space: SpaceRecord, path: Array, count: int) -> float:
    """Sum of `displacement_cost` over the first `count` rows of `path`."""
    total = 0.0
    for i in range(count - 1):
        total += displacement_cost(space, path[i], path[i + 1])
    return total
