"""Search for a first path: RRT-Connect with certified edges (Kuffner and LaValle, ICRA 2000)."""

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.planning.motion.cost import displacement_cost
from skywright.planning.motion.edges import is_edge_free, is_state_free
from skywright.planning.motion.rng import State, uniform
from skywright.planning.motion.space import ScratchRecord, SpaceRecord

TREE_SIZE = 2000
"""Largest number of nodes of a tree before the search restarts."""
REDRAWS = 15
"""Number of draws of the other coordinates before a position is discarded."""
SHORTER = 2
"""Number of lengths that are tried for an edge."""
STEP = 4.0
"""Longest edge of a tree, in units of cost (6), between ends at most `EDGES` such edges apart."""
EDGES = 80
"""Number of edges of a straight path beyond which the edges become longer than `STEP`: a path
with many corners then still fits into the planner's rows."""


@njit(cache=True, error_model="numpy")
def draw_coordinates(space: SpaceRecord, state: State, out: Array) -> None:
    """Draw coordinates uniformly within their limits."""
    for i in range(space.n):
        out[i] = space.low[i] + uniform(state) * (space.high[i] - space.low[i])


@helper
def draw_free(space: SpaceRecord, state: State, along: int, out: Array, k: ScratchRecord) -> None:
    """Draw coordinates that keep all margins, with the one `along` the path uniform.

    This coordinate is fixed while the others are drawn again. A position at which only few postures
    fit thus receives as many samples as an open one, which narrow passages require.
    """
    draw_coordinates(space, state, out)
    for _ in range(REDRAWS):
        if is_state_free(space, out, k):
            return
        for i in range(space.n):
            if i != along:
                out[i] = space.low[i] + uniform(state) * (space.high[i] - space.low[i])


@helper
def _extend(
    space: SpaceRecord, nodes: Array, parent: Ints, count: int, target: Array, longest: float,
    new: Array, k: ScratchRecord, hits: Ints,
) -> int:  # fmt: skip
    """Add a node towards `target`, at most `longest` (cost (6)) away from its parent.

    Returns 0 trapped, 1 advanced, 2 reached.
    """
    best, near = 1e18, 0
    for i in range(count):
        d = displacement_cost(space, nodes[i], target)
        if d < best:
            best, near = d, i
    share = 1.0 if best <= longest else longest / best
    free = False
    for _ in range(SHORTER):  # a blocked edge is tried again shorter: partial progress counts
        for j in range(space.n):
            new[j] = nodes[near, j] + share * (target[j] - nodes[near, j])
        free = is_edge_free(space, nodes[near], new, k)
        if free:
            break
        hits[k.blocked] += 1
        share *= 0.3
    if not free:
        return 0
    for j in range(space.n):
        nodes[count, j] = new[j]
    parent[count] = near
    return 2 if share == 1.0 else 1


@helper
def _count_rows(parent: Ints, i: int) -> int:
    """Return the number of nodes from node i to the root of its tree."""
    count = 0
    while i >= 0:
        count += 1
        i = parent[i]
    return count


@helper
def connect(
    space: SpaceRecord, start: Array, goal: Array, state: State, along: int, trees: Array,
    parents: Ints, counts: Ints, tries: int, path: Array, k: ScratchRecord, hits: Ints,
) -> int:  # fmt: skip
    """Grow two trees with at most `tries` samples; return the number of rows in `path`, or 0.

    `trees` (2, TREE_SIZE, n), `parents` and `counts` (2,) keep the search between calls; counts of
    zero start a new one. Samples are uniform in coordinate `along`. `hits` (pairs,) counts the
    pairs that blocked edges. A path with more rows than `path` has is discarded.
    """
    n = space.n
    longest = max(STEP, displacement_cost(space, start, goal) / EDGES)
    if counts[0] == 0:
        for j in range(n):
            trees[0, 0, j], trees[1, 0, j] = start[j], goal[j]
        parents[0, 0] = parents[1, 0] = -1
        counts[0] = counts[1] = 1
    sample, new = np.empty(n), np.empty(n)
    for _ in range(tries):
        a = 0 if counts[0] <= counts[1] else 1
        b = 1 - a
        if counts[a] >= TREE_SIZE - 1 or counts[b] >= TREE_SIZE - 64:
            counts[0] = counts[1] = 0
            return 0
        draw_free(space, state, along, sample, k)
        if _extend(space, trees[a], parents[a], counts[a], sample, longest, new, k, hits) == 0:
            continue
        counts[a] += 1
        for j in range(n):
            sample[j] = trees[a, counts[a] - 1, j]
        got = 1
        while got == 1 and counts[b] < TREE_SIZE - 1:
            got = _extend(space, trees[b], parents[b], counts[b], sample, longest, new, k, hits)
            if got > 0:
                counts[b] += 1
        if got != 2:
            continue
        first = _count_rows(parents[0], counts[0] - 1)
        length = first + _count_rows(parents[1], counts[1] - 1)
        if length > path.shape[0]:
            counts[0] = counts[1] = 0
            return 0
        row, i = first, counts[0] - 1
        while i >= 0:  # from the meeting point back to the start
            row -= 1
            for j in range(n):
                path[row, j] = trees[0, i, j]
            i = parents[0, i]
        row, i = first, counts[1] - 1
        while i >= 0:
            for j in range(n):
                path[row, j] = trees[1, i, j]
            row += 1
            i = parents[1, i]
        counts[0] = counts[1] = 0
        return length
    return 0
