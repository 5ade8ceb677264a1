"""A lower bound on the cost (6) of every path of a planar problem, for any planner.

Any path from start to goal takes the platform through every x between them. It therefore crosses
each of the slices x = x_1 < x_2 < ... < x_K at some free (z, angles), and its cost is at least

    min over free s_1, ..., s_K of  c(start, s_1) + c(s_1, s_2) + ... + c(s_K, goal)

with the metric c of (6), which satisfies the triangle inequality. The free set of a slice is
covered by cells; a cell is omitted only if every configuration in it violates a margin. The cost
between cells is the smallest one, so nothing is overestimated. More slices and smaller cells
tighten the bound, and any choice is valid.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.errors import InputError
from skywright.planning.motion.edges import pair_distance, place_shapes
from skywright.planning.motion.pairs import PAIR_SELF
from skywright.planning.motion.space import (
    JOINT0,
    Scratch,
    ScratchRecord,
    Space,
    SpaceRecord,
    build_scratch,
)


class Grid(NamedTuple):
    """Cells of a slice: centres and sizes of z and the two angles."""

    z: Array
    a: Array
    b: Array
    size_z: float
    size_angle: float


def _axis(low: float, high: float, size: float) -> Array:
    count = max(math.ceil((high - low) / size - 1e-9), 1)
    return np.asarray(low + (np.arange(count) + 0.5) * size, dtype=np.float64)


@njit(cache=True, error_model="numpy")
def _fill_free(spaces: Space, scratch: Scratch, x: float, grid: Grid, V: Array) -> None:
    """Set V (nz, na, nb) to inf where a whole cell violates a margin.

    A pair violates its margin in a whole cell if the distance of its nearest points at the centre,
    plus the largest motion of a point of the shape within the cell, is below the margin. This
    motion is at most the sum over the coordinates of its speed at the centre times half the cell,
    and A / 2.
    """
    space, k = spaces[0], scratch[0]
    n = space.n
    c, d = np.zeros(n), np.zeros(n)
    ns = space.ns
    move = np.zeros(ns)
    half = np.array([0.0, 0.5 * grid.size_z, 0.5 * grid.size_angle, 0.5 * grid.size_angle])
    c[0] = x
    for ia in range(grid.a.shape[0]):
        for ib in range(grid.b.shape[0]):
            c[2], c[3] = grid.a[ia], grid.b[ib]
            for s in range(ns):
                move[s] = 0.0
            for j in range(1, 4):
                for i in range(n):
                    d[i] = half[j] if i == j else 0.0
                place_shapes(space, c, d, k)
                for s in range(ns):
                    v0 = math.sqrt(k.v0[s, 0] ** 2 + k.v0[s, 1] ** 2 + k.v0[s, 2] ** 2)
                    v1 = math.sqrt(k.v1[s, 0] ** 2 + k.v1[s, 1] ** 2 + k.v1[s, 2] ** 2)
                    move[s] += max(v0, v1)
            _add_curvature(space, half, move, k)
            at = 0.0
            for iz in range(grid.z.shape[0]):
                for s in range(ns):  # shapes only translate with z
                    k.p0[s, 2] += grid.z[iz] - at
                    k.p1[s, 2] += grid.z[iz] - at
                    k.mid[s, 2] += grid.z[iz] - at
                at = grid.z[iz]
                for i in range(space.n_pairs):
                    shape = space.pairs[i, 0]
                    if space.pairs[i, 2] == PAIR_SELF:
                        continue
                    if pair_distance(space, k, i) + move[shape] < space.margin[i]:
                        V[iz, ia, ib] = np.inf
                        break


@helper
def _add_curvature(space: SpaceRecord, half: Array, move: Array, k: ScratchRecord) -> None:
    """Add A / 2 of every shape for the largest step from a cell's centre; see `edges`."""
    first = turn = extra = 0.0
    rate = np.zeros(space.nb)
    for b in range(1, space.nb):
        joint = space.joint[b]
        if joint >= 0 and b != space.passive:
            for j in range(2, space.n):
                rate[b] += abs(space.map[JOINT0 + joint, j]) * half[j]
            first += rate[b] * space.moment[b]
            turn += rate[b]
    if space.passive >= 0:
        first /= space.moment_min
        extra = turn * first + first * first
        rate[space.passive] = first
    for s in range(space.ns):
        omega, swings = 0.0, 0.0
        for b in range(1, space.nb):
            if space.chain[s, b] == 1:
                omega += rate[b]
                if b == space.passive:
                    swings = extra
        move[s] += 0.5 * space.reach[s] * (omega * omega + swings)


@njit(cache=True, error_model="numpy")
def _spread_angle(V: Array, axis: int, per_cell: float) -> None:
    """Compute the min over the angle of V + cost; adjacent cells touch: the first step is free."""
    n = V.shape[axis]
    first, last = (V.shape[0], V.shape[2]) if axis == 1 else (V.shape[0], V.shape[1])
    row, out = np.empty(n), np.empty(n)
    for i in range(first):
        for j in range(last):
            for m in range(n):
                row[m] = V[i, m, j] if axis == 1 else V[i, j, m]
            for m in range(n):
                out[m] = min(row[max(m - 1, 0)], row[m], row[min(m + 1, n - 1)])
            for m in range(1, n):
                out[m] = min(out[m], out[m - 1] + per_cell)
            for m in range(n - 2, -1, -1):
                out[m] = min(out[m], out[m + 1] + per_cell)
            for m in range(n):
                if axis == 1:
                    V[i, m, j] = out[m]
                else:
                    V[i, j, m] = out[m]


@njit(cache=True, error_model="numpy")
def _advance(V: Array, dx: float, size_z: float, p1: float) -> Array:
    """Return the min over z of V + p1 times the smallest distance between the cells."""
    nz, na, nb = V.shape
    out = np.full((nz, na, nb), np.inf)
    for to in range(nz):
        for at in range(nz):
            gap = max(abs(to - at) - 1, 0) * size_z
            step = p1 * math.sqrt(dx * dx + gap * gap)
            for a in range(na):
                for b in range(nb):
                    v = V[at, a, b] + step
                    if v < out[to, a, b]:
                        out[to, a, b] = v
    return out


def _from_point(space: Space, grid: Grid, c: Array, x: float) -> Array:
    """Return the smallest cost (6) between configuration c and every cell of the slice at x."""
    w = space[0]["weight"]

    def gap(axis: Array, value: float, size: float) -> Array:
        return np.maximum(np.abs(axis - value) - size / 2, 0.0)

    move = w[0] * np.hypot(x - c[0], gap(grid.z, c[1], grid.size_z))
    turn_a = w[2] * gap(grid.a, c[2], grid.size_angle)
    turn_b = w[3] * gap(grid.b, c[3], grid.size_angle)
    return move[:, None, None] + turn_a[None, :, None] + turn_b[None, None, :]


def compute_lower_bound(
    space: Space,
    start: Array,
    goal: Array,
    slices: Sequence[float],
    size_z: float = 0.02,
    size_angle: float = math.radians(3.0),
) -> float:
    """Return a lower bound on the cost (6) between `start` and `goal` (x, z, angle, angle).

    `slices` are values of x (m) between them; the corners of a good path are a good choice. Returns
    inf if a slice is closed: no path exists. Raises InputError for other spaces.
    """
    r = space[0]
    if int(r["n"]) != 4 or int(r["n_move"]) != 2 or float(r["weight"][0]) != float(r["weight"][1]):
        raise InputError(
            f"lower bound: the space has {int(r['n'])} coordinates, {int(r['n_move'])} of them "
            "translations; valid: x, z and two angles, with x and z weighted equally"
        )
    w = r["weight"]
    low, high = r["low"], r["high"]
    grid = Grid(
        _axis(low[1], high[1], size_z), _axis(low[2], high[2], size_angle),
        _axis(low[3], high[3], size_angle), size_z, size_angle,
    )  # fmt: skip
    forward = float(np.sign(goal[0] - start[0]))
    inside = sorted({x for x in slices if min(start[0], goal[0]) < x < max(start[0], goal[0])})
    places = inside if forward > 0 else inside[::-1]
    scratch = build_scratch(space)
    V, last = np.zeros((0, 0, 0)), float(start[0])
    for i, x in enumerate(places):
        if i == 0:
            V = _from_point(space, grid, start, x)
        else:
            _spread_angle(V, 1, float(w[2]) * size_angle)
            _spread_angle(V, 2, float(w[3]) * size_angle)
            V = _advance(V, x - last, size_z, float(w[0]))
        _fill_free(space, scratch, x, grid, V)
        last = x
    if not places:
        turn = float(np.abs(goal[2:] - start[2:]) @ w[2:4])
        return float(w[0]) * math.hypot(goal[0] - start[0], goal[1] - start[1]) + turn
    return float(np.min(V + _from_point(space, grid, goal, last)))


def choose_slices(rows: Array, least: float = 0.15, most: int = 8) -> list[float]:
    """Return the x of a path's corners, at least `least` m apart, the sharpest corners first."""
    chosen: list[float] = []
    bends = []
    for a, b, c in zip(rows[:-2], rows[1:-1], rows[2:], strict=True):
        share = (b[0] - a[0]) / (c[0] - a[0]) if abs(c[0] - a[0]) > 1e-9 else 0.5
        chord = a + min(max(share, 0.0), 1.0) * (c - a)
        bends.append((float(np.sum(np.abs(b - chord)[1:])), float(b[0])))
    for _, x in sorted(bends, reverse=True):
        if len(chosen) < most and all(abs(x - other) >= least for other in chosen):
            chosen.append(x)
    return sorted(chosen)
