"""Reduction of a path's cost by shortcuts and moves of its corners, with certified edges.

A path is rows of coordinates; every edge between neighbours is free. Moves that would raise the
cost (6) are rejected before the collision check, so that most of the work goes into relevant edges:

- shortcut: a straight line between two random points of the path;
- partial shortcut: the same for the platform or for one angle only, the rest unchanged;
- corners: a sequence of corners moves by the same random step, whose size adapts to success.
"""

import math

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.planning.motion.cost import displacement_cost
from skywright.planning.motion.edges import is_edge_free
from skywright.planning.motion.rng import State, normal, pick, uniform
from skywright.planning.motion.space import ScratchRecord, SpaceRecord

MAX_ROWS = 160
"""Largest number of rows of a path."""
SAME = 1e-9
"""Rows closer than this in cost are merged."""
CLOSE = 0.05
"""Corners closer than this are removed if the path stays free."""
MOST = 24
"""Number of corners beyond which none are added."""
GAIN = 1e-7
"""Least reduction of the cost for which a move is checked."""
LARGER = 1.5
"""Growth of a step that succeeded."""
SPREAD = 1.0
"""Standard deviation of the logarithm of the step sizes around the adapted one."""


@helper
def _copy_row(a: Array, i: int, b: Array, j: int, n: int) -> None:
    for c in range(n):
        b[j, c] = a[i, c]


@helper
def _point(path: Array, i: int, t: float, out: Array, row: int, n: int) -> None:
    for c in range(n):
        out[row, c] = path[i, c] + t * (path[i + 1, c] - path[i, c])


@helper
def remove_doubles(space: SpaceRecord, path: Array, count: int) -> int:
    """Remove rows that repeat the one before; the ends stay."""
    n, out = space.n, 1
    for i in range(1, count):
        if displacement_cost(space, path[out - 1], path[i]) > SAME:
            _copy_row(path, i, path, out, n)
            out += 1
        elif i == count - 1:
            _copy_row(path, i, path, out - 1, n)
    if out == 1:
        _copy_row(path, 0, path, 1, n)
        out = 2
    return out


@helper
def drop_corners(space: SpaceRecord, path: Array, count: int, k: ScratchRecord) -> int:
    """Remove every corner whose neighbours can be connected directly."""
    i = 1
    while i < count - 1:
        if is_edge_free(space, path[i - 1], path[i + 1], k):
            for j in range(i, count - 1):
                _copy_row(path, j + 1, path, j, space.n)
            count -= 1
            i = max(i - 1, 1)
        else:
            i += 1
    return count


@helper
def shortcut(
    space: SpaceRecord, path: Array, count: int, state: State, k: ScratchRecord, work: Array
) -> int:
    """Try one shortcut, whole or partial; return the new number of rows."""
    n, last = space.n, count - 1
    a, b = uniform(state) * last, uniform(state) * last
    if a > b:
        a, b = b, a
    i, j = min(int(a), last - 1), min(int(b), last - 1)
    if i == j:
        return count
    ta, tb = a - i, b - j
    kind = pick(state, 2 + n - space.n_move)  # whole, platform, or one angle
    # rows of the new piece: the two points, and for a partial one the rows between them
    m = j - i if kind > 0 else 0
    if i + 1 + m + 2 + (count - j - 1) > path.shape[0]:
        return count
    _point(path, i, ta, work, 0, n)
    for r in range(m):
        _copy_row(path, i + 1 + r, work, 1 + r, n)
    _point(path, j, tb, work, m + 1, n)
    before = displacement_cost(space, work[0], path[i + 1])
    for r in range(i + 1, j):
        before += displacement_cost(space, path[r], path[r + 1])
    before += displacement_cost(space, path[j], work[m + 1])
    if m > 0:
        low, high = 0, space.n_move
        if kind > 1:
            low = space.n_move + kind - 2
            high = low + 1
        for r in range(1, m + 1):
            # distributed over the rows by path fraction, so that motions stay in synchrony
            t = (i + r - a) / (b - a)
            for c in range(low, high):
                work[r, c] = work[0, c] + t * (work[m + 1, c] - work[0, c])
    after = 0.0
    for r in range(m + 1):
        after += displacement_cost(space, work[r], work[r + 1])
    # many close corners obstruct each other: a small gain does not justify another one
    if after > before - (1e-9 if m + 2 <= j - i else 2e-4 * count):
        return count
    for r in range(m + 1):
        if not is_edge_free(space, work[r], work[r + 1], k):
            return count
    # path[..i], work[0..m+1], path[j+1..]
    rest, first = count - (j + 1), i + 1
    shift = first + m + 2 - (j + 1)
    if shift > 0:
        for r in range(rest - 1, -1, -1):
            _copy_row(path, j + 1 + r, path, j + 1 + r + shift, n)
    elif shift < 0:
        for r in range(rest):
            _copy_row(path, j + 1 + r, path, j + 1 + r + shift, n)
    for r in range(m + 2):
        _copy_row(work, r, path, first + r, n)
    return remove_doubles(space, path, first + m + 2 + rest)


@helper
def move_corners(
    space: SpaceRecord,
    path: Array,
    count: int,
    state: State,
    scale: Array,
    k: ScratchRecord,
    work: Array,
) -> bool:
    """Try to move a sequence of corners equally; `scale` (1,) in units of cost adapts."""
    if count < 3:
        return False
    n = space.n
    i = 1 + pick(state, count - 2)
    j = i
    if uniform(state) < 0.5:  # a sequence, so that a height or an angle can change as a whole
        j = 1 + pick(state, count - 2)
        if j < i:
            i, j = j, i
    kind = uniform(state)
    m = j - i + 1
    for r in range(m):
        _copy_row(path, i + r, work, 1 + r, n)
    _copy_row(path, i - 1, work, 0, n)
    _copy_row(path, j + 1, work, m + 1, n)
    if kind < 0.2:  # towards the straight line between the neighbours
        share = uniform(state) * min(1.0, 20.0 * scale[0])
        for r in range(1, m + 1):
            t = r / (m + 1.0)
            for c in range(n):
                chord = work[0, c] + t * (work[m + 1, c] - work[0, c])
                work[r, c] += share * (chord - work[r, c])
    else:
        # a subset of the coordinates: a gain along a margin, such as height for an angle, requires
        # two to move together, while a third would only add cost
        step = scale[0] * math.exp(SPREAD * normal(state))
        sure = pick(state, n)
        for c in range(n):
            if c == sure or uniform(state) < 0.4:
                _shift(work, m, c, step * normal(state) / space.weight[c])
    before = 0.0
    for r in range(m + 1):
        before += displacement_cost(space, path[i - 1 + r], path[i + r])
    moved = False
    while True:
        for r in range(1, m + 1):
            for c in range(n):
                work[r, c] = min(max(work[r, c], space.low[c]), space.high[c])
        after = 0.0
        for r in range(m + 1):
            after += displacement_cost(space, work[r], work[r + 1])
        if after >= before - GAIN:
            return moved
        for r in range(m + 1):
            if not is_edge_free(space, work[r], work[r + 1], k):
                if not moved:
                    scale[0] = max(scale[0] * 0.96, 1e-4)
                return moved
        scale[0] = min(scale[0] * 1.4, 0.3)
        before, moved = after, True
        for r in range(1, m + 1):  # a successful step is repeated, larger
            for c in range(n):
                step = work[r, c] - path[i - 1 + r, c]
                path[i - 1 + r, c] = work[r, c]
                work[r, c] += LARGER * step


@helper
def _shift(rows: Array, m: int, c: int, by: float) -> None:
    for r in range(1, m + 1):
        rows[r, c] += by


@helper
def thin_out(space: SpaceRecord, path: Array, count: int, k: ScratchRecord) -> int:
    """Remove corners close to the one before if the path stays free."""
    i = 1
    while i < count - 1:
        near = displacement_cost(space, path[i - 1], path[i]) < CLOSE
        if near and is_edge_free(space, path[i - 1], path[i + 1], k):
            for j in range(i, count - 1):
                _copy_row(path, j + 1, path, j, space.n)
            count -= 1
        else:
            i += 1
    return count


@helper
def improve(
    space: SpaceRecord, path: Array, count: int, state: State, scale: Array, tries: int,
    k: ScratchRecord, work: Array,
) -> int:  # fmt: skip
    """Try `tries` moves; return the new number of rows."""
    for _ in range(tries):
        u = uniform(state)
        if u < 0.2:
            count = shortcut(space, path, count, state, k, work)
        elif u < 0.97:
            move_corners(space, path, count, state, scale, k, work)
        elif u < 0.985:
            if count < MOST:  # a new corner on a long edge, for later moves
                i = pick(state, count - 1)
                if displacement_cost(space, path[i], path[i + 1]) > 4.0 * CLOSE:
                    for r in range(count, i + 1, -1):
                        _copy_row(path, r - 1, path, r, space.n)
                    _point(path, i, 0.2 + 0.6 * uniform(state), work, 0, space.n)
                    _copy_row(work, 0, path, i + 1, space.n)
                    count += 1
        else:
            count = thin_out(space, path, drop_corners(space, path, count, k), k)
    return count
