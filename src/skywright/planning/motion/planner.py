"""The any-time planner: a fast first path, then cheaper ones until the time limit.

Many short searches find different paths around the obstacles; each path is shortened, and the best
few are improved further. All of it is compiled; Python reads the clock between short slices.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.planning.motion.connect import TREE_SIZE, connect
from skywright.planning.motion.cost import displacement_cost, path_cost
from skywright.planning.motion.edges import is_edge_free, is_state_free, state_clearance
from skywright.planning.motion.improve import MAX_ROWS, drop_corners, improve, remove_doubles
from skywright.planning.motion.rng import State, build_state, uniform
from skywright.planning.motion.space import Scratch, Space, SpaceRecord, build_scratch
from skywright.planning.motion.through import Places, compute_places, pass_through

POOL = 6
"""Number of paths that are kept and improved."""
SEARCH = 0.15
"""Fraction of the slices that search for another path after the first."""


class Path(NamedTuple):
    """A path in configuration space, or what blocks it."""

    rows: Array  # (m, n) coordinates, the ends included; empty: none found
    cost: float  # of (6)
    first_s: float  # time until the first path
    first_cost: float
    plan_s: float
    history: Array  # (h, 2) time s and cost of each improvement
    hits: Ints  # (pairs,) number of search edges that each pair blocked
    blocked: int  # pair that blocks an end; -1: none


@njit(cache=True, error_model="numpy")
def _slice(
    spaces: Space, scratch: Scratch, start: Array, goal: Array, state: State, trees: Array,
    parents: Ints, counts: Ints, pool: Array, sizes: Ints, costs: Array, scales: Array,
    work: Array, hits: Ints, tries: int, places: Places, done: int,
) -> None:  # fmt: skip
    """Run one slice of work: continue the search, or improve a path of the pool (best first)."""
    space, k = spaces[0], scratch[0]
    fresh = POOL  # the slot after the pool holds the present path
    found = 0
    filled = 0
    while filled < POOL and sizes[filled] > 0:
        filled += 1
    # some slices search for other paths; before the first path, all do
    if filled == 0 or uniform(state) < SEARCH:
        # from place to place, or with trees without places; the axes take turns
        ways = places.number.shape[0]
        way = done % max(ways, 1)
        if ways > 0 and (done < ways or uniform(state) < 0.5):
            found = pass_through(
                space, start, goal, places.span[way, : places.number[way]], places.coordinate[way],
                places.axis[way], state, tries, pool[fresh], k, hits,
            )  # fmt: skip
        else:
            along = places.coordinate[way] if ways > 0 else 0
            found = connect(
                space, start, goal, state, along, trees, parents, counts, tries, pool[fresh], k,
                hits,
            )  # fmt: skip
        if found == 0:
            return
        found = drop_corners(space, pool[fresh], remove_doubles(space, pool[fresh], found), k)
        if filled > 0:
            scales[fresh] = 0.1
            found = improve(
                space, pool[fresh], found, state, scales[fresh : fresh + 1], 60, k, work
            )
        costs[fresh] = path_cost(space, pool[fresh], found)
        sizes[fresh] = found
        slot = filled if filled < POOL else POOL - 1
        if filled == POOL and costs[fresh] >= costs[slot]:
            return
        _move(space, pool, sizes, costs, scales, fresh, slot)
        scales[slot] = 0.1
    else:
        # better paths are chosen more often
        slot = min(int(filled * uniform(state) ** 4), filled - 1)
        count = improve(
            space, pool[slot], sizes[slot], state, scales[slot : slot + 1], tries, k, work
        )
        sizes[slot] = count
        costs[slot] = path_cost(space, pool[slot], count)
    while slot > 0 and costs[slot] < costs[slot - 1]:
        _swap(space, pool, sizes, costs, scales, slot, slot - 1)
        slot -= 1


@helper
def _move(
    space: SpaceRecord, pool: Array, sizes: Ints, costs: Array, scales: Array, a: int, b: int
) -> None:
    for i in range(sizes[a]):
        for c in range(space.n):
            pool[b, i, c] = pool[a, i, c]
    sizes[b], costs[b], scales[b] = sizes[a], costs[a], scales[a]


@helper
def _swap(
    space: SpaceRecord, pool: Array, sizes: Ints, costs: Array, scales: Array, a: int, b: int
) -> None:
    for i in range(max(sizes[a], sizes[b])):
        for c in range(space.n):
            pool[a, i, c], pool[b, i, c] = pool[b, i, c], pool[a, i, c]
    sizes[a], sizes[b] = sizes[b], sizes[a]
    costs[a], costs[b] = costs[b], costs[a]
    scales[a], scales[b] = scales[b], scales[a]


def plan_path(
    space: Space,
    start: Array,
    goal: Array,
    rng: np.random.Generator,
    time_s: float = 1.0,
    *,
    first: bool = False,
    slices: int | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Path:
    """Plan from `start` to `goal` (n,) for `time_s`, or with `first` until any path is found.

    `slices` ends the search after this number of slices instead of by the clock, so that the same
    `rng` gives the same path on every machine. `clock` measures all times (a benchmark on a busy
    machine uses the thread's processor time). If the straight line is free, it is the cheapest path
    and ends the search at once.
    """
    n = int(space["n"][0])
    scratch = build_scratch(space)
    start, goal = np.array(start, dtype=float), np.array(goal, dtype=float)
    hits = np.zeros(int(space["n_pairs"][0]), dtype=np.int64)
    began = clock()
    blocked, straight, cost = _check_ends(space, start, goal, scratch)
    if blocked >= 0:
        return Path(np.zeros((0, n)), np.inf, np.nan, np.inf, 0.0, np.zeros((0, 2)), hits, blocked)
    if straight:
        rows, now = np.array([start, goal]), clock() - began
        return Path(rows, cost, now, cost, now, np.array([[now, cost]]), hits, -1)
    hits[int(scratch[0]["blocked"])] += 1
    state = build_state(rng)
    trees = np.empty((2, TREE_SIZE, n))
    parents = np.empty((2, TREE_SIZE), dtype=np.int64)
    counts = np.zeros(2, dtype=np.int64)
    pool = np.zeros((POOL + 1, MAX_ROWS + 2, n))
    sizes = np.zeros(POOL + 1, dtype=np.int64)
    costs, scales = np.full(POOL + 1, np.inf), np.full(POOL + 1, 0.1)
    work = np.zeros((MAX_ROWS + 4, n))
    places = compute_places(space, start, goal)
    history: list[tuple[float, float]] = []
    done, now = 0, 0.0
    while True:
        _slice(
            space, scratch, start, goal, state, trees, parents, counts, pool, sizes, costs,
            scales, work, hits, 50, places, done,
        )  # fmt: skip
        done += 1
        now = clock() - began
        if sizes[0] > 0 and (not history or costs[0] < history[-1][1] - 1e-9):
            history.append((now, float(costs[0])))
        if (first and history) or (slices is not None and done >= slices):
            break
        if slices is None and now >= time_s:
            break
    rows = pool[0, : sizes[0]].copy()
    return Path(
        rows, float(costs[0]), history[0][0] if history else np.nan,
        history[0][1] if history else np.inf, now, np.array(history).reshape(-1, 2), hits, -1,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _check_ends(
    spaces: Space, start: Array, goal: Array, scratch: Scratch
) -> tuple[int, bool, float]:
    """Return (pair that blocks an end or -1, whether the straight line is free, its cost)."""
    space, k = spaces[0], scratch[0]
    cost = displacement_cost(space, start, goal)
    if not (is_state_free(space, start, k) and is_state_free(space, goal, k)):
        return k.blocked, False, cost
    return -1, is_edge_free(space, start, goal, k), cost


@njit(cache=True, error_model="numpy")
def check_state(space: Space, c: Array, scratch: Scratch) -> bool:
    """Return whether all margins hold at c, within its limits; see `edges.is_state_free`."""
    return is_state_free(space[0], c, scratch[0])


@njit(cache=True, error_model="numpy")
def sample_reserve(space: Space, scratch: Scratch, rows: Array, step: float) -> tuple[float, int]:
    """Return (smallest clearance above the margins m, pair) along a path, each `step` of cost."""
    r, k = space[0], scratch[0]
    best, which = np.inf, -1
    c = np.empty(r.n)
    for i in range(rows.shape[0] - 1):
        count = max(int(np.ceil(path_cost(r, rows[i : i + 2], 2) / step)), 1)
        for s in range(count + 1):
            for j in range(r.n):
                c[j] = rows[i, j] + s / count * (rows[i + 1, j] - rows[i, j])
            d, pair = state_clearance(r, c, k)
            if d < best:
                best, which = d, pair
    return best, which
