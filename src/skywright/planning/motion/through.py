"""Search for a first path through narrow places, one place after the other along an axis.

Trees that grow from start and goal reach narrow places by chance, and most of their edges end at an
obstacle. The scene determines where these places are: obstacles in line along an axis, with gaps
shorter than the platform, form one place. The search looks for a posture that passes a whole place
unchanged: a free state inside, from which the robot can move straight out on both sides. Short
motions in free space then link these passes from start to goal.

The axis may be x, y or z, for a gap in a wall or a shaft: each translation in which start and goal
differ has its own places, and they take turns.

This is the idea of growing local trees where sampling is hard (Strandberg, ICRA 2004) and of local
planners that rotate first and translate after (rotate-at-s: Amato et al., WAFR 1998). It is not
complete: a place that no single posture passes is left to the trees (`connect`).
"""

from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.compiled import helper
from skywright.models.kinematic_tree import BOX
from skywright.planning.motion.edges import is_edge_free, is_placed_free, place_shapes
from skywright.planning.motion.rng import State, pick, uniform
from skywright.planning.motion.space import ScratchRecord, Space, SpaceRecord, X, Z

DRAWS = 60
"""Number of states that are tried at one position in a place."""
PER_POSTURE = 4
"""Number of platform positions per posture: only the posture's kinematics are costly."""
PASSES = 24
"""Number of passes through one place that are kept."""
MAX_PLACES = 24
AGAIN = 0.2
"""Fraction of the draws that search for another pass through a place that was reached."""


class Places(NamedTuple):
    """Places of obstacles between start and goal, for each axis."""

    coordinate: Ints  # (w,) index of the translation among the space's coordinates
    axis: Ints  # (w,) X, Y or Z
    number: Ints  # (w,) number of places of each axis
    span: Array  # (w, MAX_PLACES, 2) m, in the order from start to goal


def compute_places(space: Space, start: Array, goal: Array) -> Places:
    """Return the places of all axes; the axis with the smallest covered fraction comes first."""
    r = space[0]
    ways = []
    for coordinate in range(int(r["n_move"])):
        axes = np.flatnonzero(r["map"][X : Z + 1, coordinate])
        if len(axes) != 1 or start[coordinate] == goal[coordinate]:
            continue
        axis, ends = int(axes[0]), (float(start[coordinate]), float(goal[coordinate]))
        spans = _list_spans(r, axis, *ends)
        if 0 < len(spans) <= MAX_PLACES:
            inside = np.clip(spans, min(ends), max(ends))
            share = float(np.sum(inside[:, 1] - inside[:, 0])) / abs(ends[1] - ends[0])
            ways.append((share, coordinate, axis, spans))
    ways.sort(key=lambda way: way[0])
    out = np.zeros((len(ways), MAX_PLACES, 2))
    for way, (_, _, _, spans) in zip(out, ways, strict=True):
        way[: len(spans)] = spans
    return Places(
        np.array([way[1] for way in ways], dtype=np.int64),
        np.array([way[2] for way in ways], dtype=np.int64),
        np.array([len(way[3]) for way in ways], dtype=np.int64),
        out,
    )


def _list_spans(r: Any, axis: int, start: float, goal: float) -> Array:
    """Return (k, 2) m, the extents along one axis of the places between both ends."""
    count = int(r["nw"])
    reach = r["w_radius"][:count] + np.einsum(
        "ij,ij->i", np.abs(r["w_rot"][:count, axis]), r["w_half"][:count]
    )
    ends = np.stack([r["w_p0"][:count, axis], r["w_p1"][:count, axis]])
    low, high = ends.min(axis=0) - reach, ends.max(axis=0) + reach
    first, last = sorted((start, goal))
    length = 2.0 * float(r["s_half"][0, axis])
    places: list[list[float]] = []
    for i in np.argsort(low):
        if high[i] <= first or low[i] >= last:
            continue
        if places and low[i] - places[-1][1] < length:
            places[-1][1] = max(places[-1][1], float(high[i]))
        else:
            places.append([float(low[i]), float(high[i])])
    return np.array(places if goal > start else places[::-1]).reshape(-1, 2)


@helper
def _draw_inside(
    space: SpaceRecord,
    state: State,
    along: int,
    low: float,
    high: float,
    out: Array,
    k: ScratchRecord,
) -> bool:
    """Draw a free state with coordinate `along` in [low, high]; its shapes stay placed."""
    out[along] = low + uniform(state) * (high - low)
    for i in range(space.n):
        k.d[i] = 0.0
    for draw in range(DRAWS):
        if draw % PER_POSTURE == 0:
            for i in range(space.n):
                if i != along:
                    out[i] = space.low[i] + uniform(state) * (space.high[i] - space.low[i])
            place_shapes(space, out, k.d, k)
        else:
            for i in range(space.n_move):
                if i == along:
                    continue
                to = space.low[i] + uniform(state) * (space.high[i] - space.low[i])
                _translate(space, i, to - out[i], k)
                out[i] = to
        if is_placed_free(space, k):
            return True
    return False


@helper
def _translate(space: SpaceRecord, i: int, by: float, k: ScratchRecord) -> None:
    """Move all shapes with coordinate i, a translation of the platform."""
    for axis in range(X, Z + 1):
        step = space.map[axis, i] * by
        if step != 0.0:
            for s in range(space.ns):
                k.p0[s, axis] += step
                k.p1[s, axis] += step
                k.mid[s, axis] += step


@helper
def _extent(space: SpaceRecord, axis: int, x: float, k: ScratchRecord) -> tuple[float, float]:
    """Return how far (m) the placed robot extends behind and ahead of x along an axis."""
    behind = ahead = 0.0
    for s in range(space.ns):
        r = space.s_radius[s]
        if space.s_kind[s] == BOX:
            for i in range(3):
                r += abs(k.box[s, axis, i]) * space.s_half[s, i]
        behind = max(behind, x - min(k.p0[s, axis], k.p1[s, axis]) + r)
        ahead = max(ahead, max(k.p0[s, axis], k.p1[s, axis]) - x + r)
    return behind, ahead


@helper
def _link(space: SpaceRecord, a: Array, b: Array, via: Array, k: ScratchRecord, hits: Ints) -> int:
    """Connect a and b; return 1: straight, 2: over `via`, angles or platform first, 0: blocked."""
    if is_edge_free(space, a, b, k):
        return 1
    hits[k.blocked] += 1
    for angles_first in (True, False):
        for j in range(space.n):
            via[j] = b[j] if (j >= space.n_move) == angles_first else a[j]
        if is_edge_free(space, a, via, k) and is_edge_free(space, via, b, k):
            return 2
    return 0


@helper
def pass_through(
    space: SpaceRecord, start: Array, goal: Array, places: Array, along: int, axis: int,
    state: State, tries: int, path: Array, k: ScratchRecord, hits: Ints,
) -> int:  # fmt: skip
    """Search for a path through all places with `tries` draws; return its rows in `path`, or 0.

    `places` (k, 2) are those of one axis of `compute_places`, along a coordinate that moves the
    platform along it. `hits` (pairs,) counts the pairs that blocked edges.
    """
    n, count = space.n, places.shape[0]
    # a pass: entry, state inside, exit; the pass of the place before; the corner of the link
    ways = np.empty((count, PASSES, 3, n))
    corner = np.empty((count, PASSES, n))
    before = np.zeros((count, PASSES), dtype=np.int64)
    bent = np.zeros((count, PASSES), dtype=np.bool_)
    filled = np.zeros(count, dtype=np.int64)
    via = np.empty(n)
    reached = 0
    forward = goal[along] > start[along]
    margin = 0.0
    for i in range(space.n_pairs):
        margin = max(margin, space.margin[i])
    for _ in range(tries):
        at = reached
        if reached == count or uniform(state) < AGAIN:
            at = pick(state, min(reached + 1, count))
        if filled[at] == PASSES:
            continue
        way = ways[at, filled[at]]
        if not _draw_inside(space, state, along, places[at, 0], places[at, 1], way[1], k):
            continue
        behind, ahead = _extent(space, axis, way[1, along], k)
        low, high = places[at, 0] - ahead - margin, places[at, 1] + behind + margin
        left, right = (at - 1, at + 1) if forward else (at + 1, at - 1)
        if 0 <= left < count:
            low = max(low, 0.5 * (places[left, 1] + places[at, 0]))
        if 0 <= right < count:
            high = min(high, 0.5 * (places[right, 0] + places[at, 1]))
        low, high = max(low, space.low[along]), min(high, space.high[along])
        for j in range(n):
            way[0, j] = way[2, j] = way[1, j]
        way[0, along], way[2, along] = (low, high) if forward else (high, low)
        free = is_edge_free(space, way[1], way[0], k) and is_edge_free(space, way[1], way[2], k)
        if not free:
            hits[k.blocked] += 1
            continue
        got = 0
        if at == 0:
            got = _link(space, start, way[0], via, k, hits)
        else:
            for other in range(filled[at - 1] - 1, -1, -1):
                got = _link(space, ways[at - 1, other, 2], way[0], via, k, hits)
                if got > 0:
                    before[at, filled[at]] = other
                    break
        if got == 0:
            continue
        which = filled[at]
        bent[at, which] = got == 2
        for j in range(n):
            corner[at, which, j] = via[j]
        filled[at] += 1
        reached = max(reached, at + 1)
        if at < count - 1:
            continue
        got = _link(space, way[2], goal, via, k, hits)
        if got == 0:
            continue
        rows = 2 + (1 if got == 2 else 0)
        index = which
        for p in range(count - 1, -1, -1):
            rows += 4 if bent[p, index] else 3
            index = before[p, index]
        if rows > path.shape[0]:
            return 0
        _put(path, rows - 1, goal, n)
        row = rows - 2
        if got == 2:
            _put(path, row, via, n)
            row -= 1
        for p in range(count - 1, -1, -1):
            for part in range(2, -1, -1):
                _put(path, row, ways[p, which, part], n)
                row -= 1
            if bent[p, which]:
                _put(path, row, corner[p, which], n)
                row -= 1
            which = before[p, which]
        _put(path, 0, start, n)
        return rows
    return 0


@helper
def _put(path: Array, row: int, c: Array, n: int) -> None:
    for j in range(n):
        path[row, j] = c[j]
