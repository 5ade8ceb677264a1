"""Free flight between two platform poses with the arm held still: RRT-Connect over (p, yaw).

Edges are checked by conservative advancement: a step is never longer than the clearance in
reserve, so nothing thin is jumped over. (Kuffner and LaValle, ICRA 2000.)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import rot_about
from skywright.models.geometry import FAR, query_clearance
from skywright.planning.inverse_kinematics import wrap
from skywright.planning.problem import CLEARANCE, Failure, Problem

Array = NDArray[np.float64]

YAW_WEIGHT = 0.5
"""m/rad in the distance between poses."""


class Transit(NamedTuple):
    """Way-points of a free flight, or what is in the way."""

    poses: Array  # (n, 4) x, y, z, yaw; start and goal included
    failure: Failure | None
    nodes: int  # of the search trees


@njit(cache=True)
def _pose_clearance(prob: Problem, x: Array, q: Array, R: Array) -> tuple[float, int]:
    rot_about(2, x[3], R)
    return query_clearance(prob.clearance, x[:3], R, q, 0.0, FAR)


@njit(cache=True)
def is_edge_free(prob: Problem, a: Array, b: Array, q: Array, margin: float) -> bool:
    """Whether the straight motion between poses a, b (4,) keeps `margin` (m) everywhere."""
    R = np.empty((3, 3))
    x = np.empty(4)
    turn = wrap(b[3] - a[3])
    length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    travel = length + abs(turn) * prob.reach  # of the fastest point
    done = 0.0
    while True:
        for i in range(3):
            x[i] = a[i] + done * (b[i] - a[i])
        x[3] = a[3] + done * turn
        d, _ = _pose_clearance(prob, x, q, R)
        if d < margin:
            return False
        if done >= 1.0 or travel < 1e-9:
            return True
        done = min(1.0, done + max(d - margin, prob.limits.resolution) / travel)


@njit(cache=True)
def _distance(a: Array, b: Array) -> float:
    d = YAW_WEIGHT * abs(wrap(b[3] - a[3]))
    return d + math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)


@njit(cache=True)
def _nearest(tree: Array, count: int, x: Array) -> int:
    best, which = 1e18, 0
    for i in range(count):
        d = _distance(tree[i], x)
        if d < best:
            best, which = d, i
    return which


@njit(cache=True)
def _extend(
    prob: Problem, tree: Array, parent: NDArray[np.int64], count: int, x: Array, step: float,
    q: Array, margin: float, new: Array,
) -> int:  # fmt: skip
    """Add a node towards x; return 0 trapped, 1 advanced, 2 reached."""
    near = _nearest(tree, count, x)
    a = tree[near]
    d = _distance(a, x)
    share = 1.0 if d <= step else step / d
    for i in range(3):
        new[i] = a[i] + share * (x[i] - a[i])
    new[3] = a[3] + share * wrap(x[3] - a[3])
    if not is_edge_free(prob, a, new, q, margin):
        return 0
    tree[count] = new
    parent[count] = near
    return 2 if share == 1.0 else 1


@njit(cache=True)
def connect(
    prob: Problem, start: Array, goal: Array, q: Array, margin: float, samples: Array,
    step: float, path: Array,
) -> tuple[int, int]:  # fmt: skip
    """Grow two trees; return (poses written into `path`, nodes); 0 poses: not found."""
    size = 40 * samples.shape[0] + 2
    trees = np.empty((2, size, 4))
    parents = np.empty((2, size), dtype=np.int64)
    counts = np.ones(2, dtype=np.int64)
    trees[0, 0] = start
    trees[1, 0] = goal
    parents[:, 0] = -1
    new = np.empty(4)
    for n in range(samples.shape[0]):
        a = n % 2
        b = 1 - a
        if _extend(prob, trees[a], parents[a], counts[a], samples[n], step, q, margin, new) == 0:
            continue
        counts[a] += 1
        target = trees[a, counts[a] - 1].copy()
        got = 1
        tries = 0
        while got == 1 and tries < 39:
            got = _extend(prob, trees[b], parents[b], counts[b], target, step, q, margin, new)
            if got > 0:
                counts[b] += 1
            tries += 1
        if got != 2:
            continue
        # from the start's tree outwards, then down the goal's tree
        length = 0
        i = counts[0] - 1
        while i >= 0:
            path[length] = trees[0, i]
            length += 1
            i = parents[0, i]
        for j in range(length // 2):
            tmp = path[j].copy()
            path[j] = path[length - 1 - j]
            path[length - 1 - j] = tmp
        i = parents[1, counts[1] - 1]
        while i >= 0:
            path[length] = trees[1, i]
            length += 1
            i = parents[1, i]
        return length, counts[0] + counts[1]
    return 0, counts[0] + counts[1]


@njit(cache=True)
def shorten(prob: Problem, path: Array, count: int, q: Array, margin: float, picks: Array) -> int:
    """Cut corners between random points of the path in place; return the new number of poses."""
    a = np.empty(4)
    b = np.empty(4)
    for n in range(picks.shape[0]):
        if count <= 2:
            return count
        i = int(picks[n, 0] * (count - 1))
        j = int(picks[n, 1] * (count - 1))
        if i > j:
            i, j = j, i
        if i == j:
            continue
        u, v = picks[n, 2], picks[n, 3]
        if n % 2 == 0:  # every other try between existing poses, which removes one
            u, v = 0.0, 1.0
        for c in range(3):
            a[c] = path[i, c] + u * (path[i + 1, c] - path[i, c])
            b[c] = path[j, c] + v * (path[j + 1, c] - path[j, c])
        a[3] = path[i, 3] + u * wrap(path[i + 1, 3] - path[i, 3])
        b[3] = path[j, 3] + v * wrap(path[j + 1, 3] - path[j, 3])
        old = _distance(path[i], a) + 0.0
        before = 0.0
        for c in range(i, j + 1):
            before += _distance(path[c], path[c + 1])
        after = old + _distance(a, b) + _distance(b, path[j + 1])
        if after > before - 0.02 and j - i < 2:
            continue
        if not is_edge_free(prob, a, b, q, margin):
            continue
        # path[..i], a, b, path[j+1..]
        head = i + 1 if u > 1e-6 else i
        tail = j + 1 if v < 1.0 - 1e-6 else j + 2
        rest = count - tail
        if head + 2 + rest > path.shape[0]:
            continue
        keep = path[tail:count].copy()
        path[head] = a
        path[head + 1] = b
        path[head + 2 : head + 2 + rest] = keep
        count = head + 2 + rest
    return count


def plan_transit(
    prob: Problem, start: Array, goal: Array, q: Array, margin: float, rng: np.random.Generator,
    attempts: int = 4,
) -> Transit:  # fmt: skip
    """Return way-points from `start` to `goal` (x, y, z, yaw), the arm held at `q`.

    The straight line is tried first. The search box holds start, goal and what lies between, with
    room to go around. `failure` names the blocked end, or what blocks the straight line.
    """
    R = np.empty((3, 3))
    for pose in (start, goal):
        d, pair = _pose_clearance(prob, pose, q, R)
        if d < margin:
            bad = Failure(CLEARANCE, d, margin, pair, math.nan, math.nan, pose[:3])
            return Transit(np.zeros((0, 4)), bad, 0)
    if is_edge_free(prob, start, goal, q, margin):
        return Transit(np.array([start, goal]), None, 2)
    centre = prob.cylinder.p_WP
    ends = np.array([start[:3], goal[:3], centre])
    lo, hi = ends.min(axis=0) - 1.5, ends.max(axis=0) + 1.5
    lo[2] = max(lo[2], prob.limits.ground)
    path = np.zeros((4096, 4))
    nodes = 0
    for _ in range(attempts):
        samples = np.empty((400, 4))
        samples[:, :3] = rng.uniform(lo, hi, (400, 3))
        samples[:, 3] = goal[3] + rng.uniform(-math.pi, math.pi, 400)
        half = rng.random(400) < 0.7  # most often the heading of the line between the two ends
        share = rng.random(400)
        samples[half, 3] = (start[3] + share * wrap(goal[3] - start[3]))[half]
        count, grown = connect(prob, start, goal, q, margin, samples, 0.6, path)
        nodes += grown
        if count:
            count = shorten(prob, path, count, q, margin, rng.random((80, 4)))
            return Transit(path[:count].copy(), None, nodes)
    bad = _blocking(prob, start, goal, q, margin)
    return Transit(np.zeros((0, 4)), bad, nodes)


def _blocking(prob: Problem, start: Array, goal: Array, q: Array, margin: float) -> Failure:
    """Return the worst clearance on the straight line."""
    worst = Failure(CLEARANCE, math.inf, margin, -1, math.nan, math.nan, goal[:3])
    R = np.empty((3, 3))
    for x in np.linspace(0.0, 1.0, 60):
        pose = start + x * (goal - start)
        pose[3] = start[3] + x * wrap(goal[3] - start[3])
        d, pair = _pose_clearance(prob, pose, q, R)
        if d < worst.value:
            worst = Failure(CLEARANCE, d, margin, pair, math.nan, math.nan, pose[:3].copy())
    return worst
