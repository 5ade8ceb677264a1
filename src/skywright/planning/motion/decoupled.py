"""Decoupled planning, the usual simplification: first the platform, then the arms.

The platform's path is planned with the arms in their initial posture, which its collision check
includes; the arms move at the goal. A planner that alternates between platform and arms, as those
that Caballero et al. 2018 use for comparison, has no other opportunity to move the arms.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.user_code import njit
from skywright.planning.motion.cost import path_cost
from skywright.planning.motion.planner import plan_path
from skywright.planning.motion.space import Space


class Decoupled(NamedTuple):
    """The platform's path followed by the arms' motion, or the reason why there is none."""

    rows: Array  # (m, n) coordinates; empty: none
    cost: float
    reason: str


@njit(cache=True, error_model="numpy")
def _cost(space: Space, rows: Array) -> float:
    return path_cost(space[0], rows, rows.shape[0])


def plan_decoupled(
    space: Space,
    start: Array,
    goal: Array,
    rng: np.random.Generator,
    time_s: float = 1.0,
    clock: Callable[[], float] = time.perf_counter,
) -> Decoupled:
    """Plan the platform with the arms at their initial posture, then the arms at the goal."""
    n, n_move = int(space["n"][0]), int(space["n_move"][0])
    held = space.copy()
    # the angles are fixed: their limits enclose the start
    held[0]["low"][n_move:n] = np.asarray(start)[n_move:] - 1e-9
    held[0]["high"][n_move:n] = np.asarray(start)[n_move:] + 1e-9
    there = np.concatenate([np.asarray(goal)[:n_move], np.asarray(start)[n_move:]])
    platform = plan_path(held, np.asarray(start), there, rng, time_s / 2, clock=clock)
    if not len(platform.rows):
        return Decoupled(
            np.zeros((0, n)),
            np.inf,
            "no path for the platform with the arms in their initial posture",
        )
    still = space.copy()
    still[0]["low"][:n_move] = there[:n_move] - 1e-9
    still[0]["high"][:n_move] = there[:n_move] + 1e-9
    arms = plan_path(still, there, np.asarray(goal), rng, time_s / 2, clock=clock)
    if not len(arms.rows):
        return Decoupled(np.zeros((0, n)), np.inf, "no path for the arms at the goal")
    rows = np.vstack([platform.rows, arms.rows[1:]])
    return Decoupled(rows, float(_cost(space, rows)), "")
