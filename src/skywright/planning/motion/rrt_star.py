"""RRT* as printed in Caballero et al. 2018: Algorithm 1, metric (4), near set (5), costs (6).

A reference for comparison, not the default planner. Quantities that the paper does not state are
parameters with plausible values: reference speeds, thresholds, step, goal bias. Its check samples
an edge (see `angular.py`), so an edge can pass a thin obstacle between two samples; `certified`
replaces it by the certified check.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.user_code import njit
from skywright.planning.motion.angular import AngularMap, is_edge_free_angular
from skywright.planning.motion.connect import draw_coordinates
from skywright.planning.motion.cost import displacement_cost, rho_arms, rho_uav, time_cost
from skywright.planning.motion.edges import is_edge_free
from skywright.planning.motion.rng import State, build_state, uniform
from skywright.planning.motion.space import (
    Scratch,
    ScratchRecord,
    Space,
    SpaceRecord,
    build_scratch,
)


class RrtStar(NamedTuple):
    """Parameters that the paper does not state."""

    u_ref: float = 0.5  # m/s, reference speed of the platform in (4)
    w_ref: float = 0.5  # rad/s, of the joints
    gamma_uav: float = 1.0  # m, thresholds of (5)
    gamma_arms: float = 0.6  # rad
    step_s: float = 1.0  # longest branch, in the metric (4)
    goal_bias: float = 0.05  # fraction of samples at the goal
    minimise_time: bool = False  # CF_T of (6) instead of CF_E
    certified: bool = False  # the certified edge check instead of the sampled angular one
    resolution: float = 0.05  # m or rad, between the samples along a branch


class RrtStarResult(NamedTuple):
    """The tree's best path, and its history."""

    rows: Array  # (m, n), empty: none found
    cost: float
    nodes: int
    history: Array  # (h, 2) time s, cost


@njit(cache=True, error_model="numpy")
def _cost(space: SpaceRecord, par: RrtStar, a: Array, b: Array) -> float:
    if par.minimise_time:
        return time_cost(space, a, b, par.u_ref, par.w_ref)
    return displacement_cost(space, a, b)


@njit(cache=True, error_model="numpy")
def _collision(
    space: SpaceRecord, par: RrtStar, world: AngularMap, a: Array, b: Array, k: ScratchRecord
) -> bool:
    if par.certified:
        return not is_edge_free(space, a, b, k)
    return not is_edge_free_angular(space, world, a, b, par.resolution, k)


@njit(cache=True, error_model="numpy")
def _grow(
    spaces: Space, scratch: Scratch, par: RrtStar, world: AngularMap, goal: Array, state: State,
    nodes: Array, parent: Ints, cost: Array, count: Ints, goal_node: Ints, tries: int,
    near: Ints,
) -> None:  # fmt: skip
    """Algorithm 1, lines 3 to 10, `tries` times."""
    space, k = spaces[0], scratch[0]
    n = space.n
    rand, new = np.empty(n), np.empty(n)
    for _ in range(tries):
        if count[0] >= nodes.shape[0]:
            return
        # SAMPLE
        if uniform(state) < par.goal_bias:
            for j in range(n):
                rand[j] = goal[j]
        else:
            draw_coordinates(space, state, rand)
        # NEAREST (4)
        best, nearest = 1e18, 0
        for i in range(count[0]):
            d = time_cost(space, nodes[i], rand, par.u_ref, par.w_ref)
            if d < best:
                best, nearest = d, i
        if best == 0.0:
            continue
        # STEER
        share = min(1.0, par.step_s / best)
        for j in range(n):
            new[j] = nodes[nearest, j] + share * (rand[j] - nodes[nearest, j])
        if _collision(space, par, world, nodes[nearest], new, k):
            continue
        # NEAR (5)
        found = 0
        for i in range(count[0]):
            if (
                rho_uav(space, nodes[i], new) <= par.gamma_uav
                and rho_arms(space, nodes[i], new) <= par.gamma_arms
            ):
                near[found] = i
                found += 1
        # ADD: the parent with the least cost of the new node
        up, least = nearest, cost[nearest] + _cost(space, par, nodes[nearest], new)
        for m in range(found):
            c = cost[near[m]] + _cost(space, par, nodes[near[m]], new)
            if c < least and not _collision(space, par, world, nodes[near[m]], new, k):
                up, least = near[m], c
        x = count[0]
        for j in range(n):
            nodes[x, j] = new[j]
        parent[x], cost[x] = up, least
        count[0] += 1
        # REWIRE
        for m in range(found):
            i = near[m]
            c = least + _cost(space, par, new, nodes[i])
            if c < cost[i] - 1e-12 and not _collision(space, par, world, new, nodes[i], k):
                saved = cost[i] - c
                parent[i] = x
                _lower(cost, parent, count[0], i, saved)
        at_goal = True
        for j in range(n):
            if abs(new[j] - goal[j]) > 1e-12:
                at_goal = False
        if at_goal and (goal_node[0] < 0 or cost[x] < cost[goal_node[0]]):
            goal_node[0] = x


@njit(cache=True, error_model="numpy")
def _lower(cost: Array, parent: Ints, count: int, root: int, by: float) -> None:
    """Lower the cost of `root` and of all its descendants.

    After rewiring a parent may have a higher index than its child, so passes repeat until nothing
    changes.
    """
    mark = np.zeros(count, dtype=np.bool_)
    mark[root] = True
    cost[root] -= by
    changed = True
    while changed:
        changed = False
        for i in range(count):
            if not mark[i] and parent[i] >= 0 and mark[parent[i]]:
                mark[i] = True
                cost[i] -= by
                changed = True


def plan_rrt_star(
    space: Space,
    world: AngularMap,
    start: Array,
    goal: Array,
    rng: np.random.Generator,
    time_s: float,
    parameters: RrtStar | None = None,
    *,
    iterations: int | None = None,
    max_nodes: int = 60_000,
    clock: Callable[[], float] = time.perf_counter,
) -> RrtStarResult:
    """Run the paper's planner until `time_s`, `iterations` or `max_nodes` is reached."""
    par = parameters or RrtStar()
    n = len(start)
    nodes, parent = np.zeros((max_nodes, n)), np.full(max_nodes, -1, dtype=np.int64)
    cost, near = np.zeros(max_nodes), np.zeros(max_nodes, dtype=np.int64)
    nodes[0] = start
    count, goal_node = np.ones(1, np.int64), np.full(1, -1, np.int64)
    scratch, state = build_scratch(space), build_state(rng)
    began, done = clock(), 0
    history: list[tuple[float, float]] = []
    while True:
        chunk = 50 if iterations is None else min(50, iterations - done)
        _grow(
            space, scratch, par, world, np.asarray(goal, dtype=float), state, nodes, parent, cost,
            count, goal_node, chunk, near,
        )  # fmt: skip
        done += chunk
        now = clock() - began
        if goal_node[0] >= 0:
            best = float(cost[goal_node[0]])
            if not history or best < history[-1][1] - 1e-9:
                history.append((now, best))
        over = now >= time_s if iterations is None else done >= iterations
        if over or count[0] >= max_nodes:
            break
    rows: list[Array] = []
    i = int(goal_node[0])
    while i >= 0:
        rows.append(nodes[i].copy())
        i = int(parent[i])
    return RrtStarResult(
        np.array(rows[::-1]).reshape(-1, n), history[-1][1] if history else np.inf, int(count[0]),
        np.array(history).reshape(-1, 2),
    )  # fmt: skip
