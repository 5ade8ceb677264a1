"""Static limits of a rotor set: largest wrench along a ray before a rotor reaches its limit.

Six independent rotors, and more with a preload, have one thrust vector per wrench, so the limit
along a ray of wrenches is a closed form (the ray against the box of thrust limits). Any other
layout is a linear programme. A test compares the closed form with the linear programme. Frame B, SI
units, torques about B's origin.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_diag
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from skywright.core.arrays import Array
from skywright.models.allocation import Allocator, build_allocator, usable_limit
from skywright.models.rotors import RotorSet

UP = np.array([0.0, 0.0, 1.0])

COARSE = tuple(math.radians(x) for x in range(10, 91, 10))
"""rad; tilts at which the search for a robot's tilt limit starts."""

TOLERANCE = 1e-9
"""Newtons by which round-off may exceed a thrust limit."""


class Layout(NamedTuple):
    """Rotors with the thrust range that a mission may use."""

    rotors: RotorSet
    B: Array  # (6, n)
    P: Array  # (n, 6)
    t_min: Array  # (n,) N, minus the preload
    t_max: Array  # (n,) N, after the thrust fraction, minus the preload
    full: bool  # six independent components
    exact: bool  # one thrust vector per wrench: six rotors, or a preload, and `full`
    preload: Array  # (n,) N, of the allocation


class Interval(NamedTuple):
    """Range [lo, hi] of a scale; empty when lo > hi (then both are NaN)."""

    lo: float
    hi: float


NONE = Interval(math.nan, math.nan)


def build_layout(
    rotors: RotorSet, thrust_fraction: float = 1.0, allocator: Allocator | None = None
) -> Layout:
    """Return the rotors with `thrust_fraction` of the upper limit in use."""
    a = allocator or build_allocator(rotors)
    one = bool(a.full) and (a.P.shape[0] == 6 or bool(np.any(a.preload)))
    t_max = usable_limit(a, thrust_fraction)
    return Layout(rotors, a.B, a.P, a.t_min, t_max, bool(a.full), one, a.preload)


def wrench_at(force: Array, point: Array) -> Array:
    """Return the wrench (6,) about B's origin of a force (3,) N at a point (3,) m."""
    return np.concatenate([force, np.cross(point, force)])


def compute_ray(layout: Layout, w0: Array, w1: Array) -> Interval:
    """Return the range of s for which the rotors can produce the wrench w0 + s w1.

    It is a closed form if `layout.exact`, else the linear programme.
    """
    if not layout.exact:
        return compute_ray_lp(layout, w0, w1)
    lo, hi = compute_rays(layout, w0[None, :], w1[None, :])
    return Interval(float(lo[0]), float(hi[0]))


def compute_rays(layout: Layout, w0: Array, w1: Array) -> tuple[Array, Array]:
    """Closed form of `compute_ray` for many rays (m, 6); NaN for a ray that misses the box."""
    base, ray = w0 @ layout.P.T, w1 @ layout.P.T
    flat = np.abs(ray) < 1e-12
    safe = np.where(flat, 1.0, ray)
    a = (layout.t_min - TOLERANCE - base) / safe
    b = (layout.t_max + TOLERANCE - base) / safe
    lo = np.where(flat, -np.inf, np.minimum(a, b)).max(axis=1)
    hi = np.where(flat, np.inf, np.maximum(a, b)).min(axis=1)
    outside = (base < layout.t_min - TOLERANCE) | (base > layout.t_max + TOLERANCE)
    missed = (flat & outside).any(axis=1) | (lo > hi)
    return np.where(missed, np.nan, lo), np.where(missed, np.nan, hi)


def compute_ray_lp(layout: Layout, w0: Array, w1: Array) -> Interval:
    """`compute_ray` as a linear programme over (T, s): B T = w0 + s w1 within the limits."""
    ends: list[float] = []
    for sign in (1.0, -1.0):
        found = _solve_ends(layout, w0, np.asarray(w1)[None], sign)
        if found.status == 3:
            ends.append(-sign * math.inf)
        elif found.status != 0:
            return NONE
        else:
            ends.append(float(found.x[-1]))
    return Interval(ends[0], ends[1])


def compute_thrust(layout: Layout, w: Array) -> Array | None:
    """Return thrusts (n,) N of the rotors that produce the wrench within the limits, or None.

    They are the least-squares solution if it is feasible, else (redundant rotors) that of lowest
    peak load.
    """
    thrust = layout.P @ w
    made = np.allclose(layout.B @ thrust, w, atol=1e-6)
    inside = np.all(thrust >= layout.t_min - 1e-6) and np.all(thrust <= layout.t_max + 1e-6)
    if made and inside:
        return np.clip(thrust, layout.t_min, layout.t_max) + layout.preload
    if layout.exact:
        return None
    n = len(thrust)
    cost = np.zeros(n + 1)
    cost[-1] = 1.0  # peak load as a fraction of the limit
    below = np.hstack([np.eye(n) / layout.t_max[:, None], -np.ones((n, 1))])
    found = linprog(
        cost,
        A_ub=below,
        b_ub=np.zeros(n),
        A_eq=np.hstack([layout.B, np.zeros((6, 1))]),
        b_eq=w,
        bounds=[*zip(layout.t_min, layout.t_max, strict=True), (0.0, 1.0)],
        method="highs",
    )
    return np.asarray(found.x[:n]) if found.status == 0 else None


def compute_lateral_forces(layout: Layout, weight: float, p_BC: Array, directions: Array) -> Array:
    """Return the largest force (m,) N toward each direction (m,) rad at level attitude.

    The rotors carry the weight, and the force has no torque about the centre of mass
    (Sanchez-Cuevas et al. 2020, section III). NaN if hover itself is infeasible.
    """
    level = wrench_at(weight * UP, p_BC)
    flat = np.column_stack([np.cos(directions), np.sin(directions), np.zeros(len(directions))])
    rays = np.hstack([flat, np.cross(p_BC, flat)])
    if layout.exact:
        lo, hi = compute_rays(layout, np.broadcast_to(level, rays.shape), rays)
        return np.where(lo <= 1e-6, np.maximum(hi, 0.0), np.nan)
    if compute_thrust(layout, level) is None:
        return np.full(len(directions), np.nan)
    if np.allclose(layout.B[:2], 0.0, atol=1e-12):  # coplanar: every force is along z_B
        return np.zeros(len(directions))
    return np.maximum(_compute_ends(layout, level, rays), 0.0)


def _compute_ends(layout: Layout, w0: Array, rays: Array) -> Array:
    """Return `compute_ray(...).hi` of many rays (m, 6) from a feasible wrench (6,)."""
    n = layout.B.shape[1]
    if len(rays) == 0:
        return np.zeros(0)
    found = _solve_ends(layout, w0, rays, -1.0)
    if found.status != 0:  # a ray of zero length has no end
        return np.array([compute_ray_lp(layout, w0, ray).hi for ray in rays])
    return np.asarray(found.x[n :: n + 1])


def _solve_ends(layout: Layout, w0: Array, rays: Array, sign: float) -> Any:
    """Solve the linear programmes over (T, s) of rays (m, 6): least sum of sign * s.

    Each has B T = w0 + s ray, with T within the limits. They are the diagonal blocks of one.
    """
    m, n = len(rays), layout.B.shape[1]
    equal = block_diag([np.hstack([layout.B, -ray[:, None]]) for ray in rays])
    one = np.vstack([np.column_stack([layout.t_min, layout.t_max]), [-np.inf, np.inf]])
    cost = np.tile(np.append(np.zeros(n), sign), m)
    return linprog(
        cost, A_eq=equal, b_eq=np.tile(w0, m), bounds=np.tile(one, (m, 1)), method="highs"
    )


def compute_tilt_limit(layout: Layout, weight: float, p_BC: Array, axis_B: Array) -> float:
    """Return the largest tilt (rad, at most pi/2) about the horizontal `axis_B` at which the robot
    holds its position: total rotor force vertical, no torque about the centre of mass.

    For six independent rotors each thrust is A cos(tilt) + C sin(tilt), so each limit is a closed
    form. Zero for robots without lateral force; NaN if hover is infeasible.
    """
    side = -np.cross(axis_B, UP)  # R^T z = z cos + side sin for R = rot(axis, tilt)
    level = wrench_at(weight * UP, p_BC)
    if compute_thrust(layout, level) is None:
        return math.nan
    if not layout.full:
        return 0.0
    lean = wrench_at(weight * side, p_BC)
    if not layout.exact:
        return _cut_tilt(layout, level, lean)
    a, c = layout.P @ level, layout.P @ lean
    radius, phase = np.hypot(a, c), np.arctan2(c, a)
    best = math.pi / 2
    for limit in (layout.t_min, layout.t_max):
        ratio = limit / np.maximum(radius, 1e-12)
        for i in np.flatnonzero(np.abs(ratio) <= 1.0):
            turn = math.acos(ratio[i])
            for theta in ((phase[i] + turn) % (2 * math.pi), (phase[i] - turn) % (2 * math.pi)):
                # a limit reached at level counts only if the thrust moves beyond it
                slope = -radius[i] * math.sin(theta - phase[i])
                leaves = slope < 0 if limit is layout.t_min else slope > 0
                if leaves:
                    best = min(best, theta)
    return best


def _cut_tilt(layout: Layout, level: Array, lean: Array) -> float:
    """Return the largest tilt (rad, at most pi/2) at which the rotors can produce the wrench.

    The wrenches that they can produce are a convex set that contains `level`. While the wrench at a
    tilt is outside, the ray from `level` to it leaves the set through a face, and the next tilt is
    where the arc of wrenches crosses the plane of that face. The tilts decrease to the limit, from
    the first of COARSE that is outside, because the arc may enter the set again.
    """

    def holds(tilt: float) -> bool:
        return compute_thrust(layout, math.cos(tilt) * level + math.sin(tilt) * lean) is not None

    tilt = next((t for t in COARSE if not holds(t)), math.pi)
    if tilt > math.pi / 2:
        return math.pi / 2
    for _ in range(50):
        ray = math.cos(tilt) * level + math.sin(tilt) * lean - level
        found = _find_face(layout, level, ray)
        if found is None:  # `level` itself is at the limit
            return 0.0
        end, normal = found
        if end >= 1.0 - 1e-9:
            break
        # inside, normal . (level cos + lean sin) <= a + end: from 0 on up to `phase - half`
        a, c = float(normal @ level), float(normal @ lean)
        phase, half = math.atan2(c, a), math.acos(min(max((a + end) / math.hypot(a, c), -1.0), 1.0))
        crossing = max(math.remainder(phase - half, 2.0 * math.pi), 0.0)
        before, tilt = tilt, min(crossing, tilt)
        if before - tilt < 1e-12:
            break
    return tilt


def _find_face(layout: Layout, w0: Array, w1: Array) -> tuple[float, Array] | None:
    """Return the end s of the ray w0 + s w1 and a vector y (6,); None if w0 is infeasible.

    y . (w - w0) <= s for every wrench w that the rotors can produce, and y . w1 = 1.
    """
    found = _solve_ends(layout, w0, w1[None], -1.0)
    return (float(found.x[-1]), found.eqlin.marginals) if found.status == 0 else None


def compute_polytope(layout: Layout, w0: Array, map_: Array) -> Array:
    """Return vertices (v, 3) of {x: the rotors can produce w0 + map_ x} with map_ (6, 3).

    Six independent rotors: the 12 half-spaces of the thrust limits. Otherwise: the support points
    of 48 directions by linear programme (an inner approximation; flat sets stay flat).
    """
    if layout.exact:
        base, slope = layout.P @ w0, layout.P @ map_
        centre = _chebyshev_centre(layout, base, slope)
        if centre is None:
            return np.zeros((0, 3))
        half = np.vstack(
            [
                np.column_stack([slope, base - layout.t_max]),
                np.column_stack([-slope, layout.t_min - base]),
            ]
        )
        points = HalfspaceIntersection(half, centre).intersections
        return np.unique(points.round(9), axis=0)
    n = layout.B.shape[1]
    bounds = [*zip(layout.t_min, layout.t_max, strict=True), *([(None, None)] * 3)]
    points_lp = []
    for direction in _sphere(48):
        cost = np.concatenate([np.zeros(n), -direction])
        found = linprog(
            cost, A_eq=np.hstack([layout.B, -map_]), b_eq=w0, bounds=bounds, method="highs"
        )
        if found.status == 0:
            points_lp.append(found.x[n:])
    if not points_lp:
        return np.zeros((0, 3))
    points = np.unique(np.round(points_lp, 6), axis=0)
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # flat or a segment
        return np.asarray(points)


def _chebyshev_centre(layout: Layout, base: Array, slope: Array) -> Array | None:
    """Return an interior point of the polytope (largest inscribed ball), or None if it is empty."""
    norm = np.linalg.norm(slope, axis=1)[:, None]
    found = linprog(
        np.array([0.0, 0.0, 0.0, -1.0]),
        A_ub=np.vstack([np.hstack([slope, norm]), np.hstack([-slope, norm])]),
        b_ub=np.concatenate([layout.t_max - base, base - layout.t_min]),
        bounds=[(None, None)] * 3 + [(0.0, None)],
        method="highs",
    )
    return np.asarray(found.x[:3]) if found.status == 0 and found.x[3] > 1e-9 else None


def _sphere(count: int) -> Array:
    """Return evenly spread unit directions (count, 3): the Fibonacci sphere, plus the six axes."""
    i = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * i / count), math.pi * (1 + 5**0.5) * i
    spread = np.column_stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
    )
    return np.vstack([spread, np.eye(3), -np.eye(3)])
