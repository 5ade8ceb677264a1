"""The paper's collision check, section III-B: samples along a branch, links in angular space.

The check is planar, in the vertical plane of the motion. The platform is a rectangle; it collides
if its centre lies inside an obstacle enlarged by the rectangle. A link is a segment; it collides if
its angle lies between the smallest and largest angle at which it would touch the obstacle (figure
5). Obstacles are circles or rectangles: parts within the half width of platform, arms or bar are
projected onto the plane, so each of the three has its own obstacles (the green and red regions of
figure 6).
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.user_code import njit
from skywright.models.kinematic_tree import BOX
from skywright.planning.motion.edges import place_shapes
from skywright.planning.motion.space import ScratchRecord, Space, SpaceRecord

ROUND, RECTANGLE = range(2)


class AngularMap(NamedTuple):
    """Projected obstacles: x, z, half sizes (a circle has its radius in both), kind, class."""

    obstacles: Array  # (m, 6): x, z, half x, half z, kind, class (0 platform, 1 link, 2 across)
    area: Array  # (2, 2) m, limits of x and z
    margin: float
    link_class: Ints  # (ns,) class of each shape


def build_angular_map(space: Space) -> AngularMap:
    """Project the obstacles of a space for the three widths.

    A pipe across the plane becomes a circle, any other its bounding rectangle.
    """
    r = space[0]
    margin = float(r["margin"][0])
    ns, nw = int(r["ns"]), int(r["nw"])
    across = np.abs(r["s_p1"][:ns, 1] - r["s_p0"][:ns, 1]) > 1e-6  # the bar
    kind = np.where(r["s_kind"][:ns] == BOX, 0, np.where(across, 2, 1))
    widths = np.zeros(3)
    for s in range(ns):
        half = r["s_half"][s, 1] if kind[s] == 0 else abs(r["s_p1"][s, 1] - r["s_p0"][s, 1]) / 2
        body, y = int(r["s_body"][s]), 0.5 * (r["s_p0"][s, 1] + r["s_p1"][s, 1])
        while body >= 0:
            y += r["pos"][body, 1]
            body = int(r["parent"][body])
        widths[kind[s]] = max(widths[kind[s]], abs(y) + half + r["s_radius"][s])
    rows = []
    for w in range(nw):
        p0, p1, radius = r["w_p0"][w], r["w_p1"][w], float(r["w_radius"][w])
        half = np.abs(r["w_rot"][w]) @ r["w_half"][w]
        for c in range(3):
            part = _clip(p0 - half, p1 + half, widths[c] + margin + radius)
            if part is None:
                continue
            (x0, z0), (x1, z1) = part
            hx, hz = abs(x1 - x0) / 2 + radius, abs(z1 - z0) / 2 + radius
            form = ROUND if max(hx, hz) < radius + 1e-6 else RECTANGLE
            rows.append([(x0 + x1) / 2, (z0 + z1) / 2, hx, hz, form, c])
    return AngularMap(
        np.array(rows).reshape(-1, 6), np.ascontiguousarray(r["area"][[0, 2]]), margin,
        kind.astype(np.int64),
    )  # fmt: skip


def _clip(a: Array, b: Array, half_width: float) -> tuple[Array, Array] | None:
    """Return the part of segment ab with |y| <= half_width, as two points (x, z)."""
    low, high = 0.0, 1.0
    dy = b[1] - a[1]
    if abs(dy) < 1e-12:
        if abs(a[1]) > half_width:
            return None
    else:
        t0, t1 = sorted(((-half_width - a[1]) / dy, (half_width - a[1]) / dy))
        low, high = max(low, t0), min(high, t1)
        if low > high:
            return None
    return (a + low * (b - a))[[0, 2]], (a + high * (b - a))[[0, 2]]


@njit(cache=True, error_model="numpy")
def _wrap(angle: float) -> float:
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@njit(cache=True, error_model="numpy")
def blocked_by_circle(
    x: float, z: float, length: float, angle: float, cx: float, cz: float, radius: float
) -> bool:
    """Return whether a segment from (x, z) at `angle` meets a circle, by its angle (figure 5)."""
    dx, dz = cx - x, cz - z
    d = math.sqrt(dx * dx + dz * dz)
    if d <= radius:
        return True
    if d >= radius + length:
        return False
    tangent = math.sqrt(d * d - radius * radius)
    if length >= tangent:
        half = math.asin(radius / d)
    else:
        half = math.acos((d * d + length * length - radius * radius) / (2.0 * d * length))
    off = _wrap(angle - math.atan2(dz, dx))
    return abs(off) <= half


@njit(cache=True, error_model="numpy")
def blocked_by_rectangle(
    x: float, z: float, length: float, angle: float, cx: float, cz: float, hx: float, hz: float
) -> bool:
    """Return the same for an upright rectangle, from the extreme angles of its points in reach.

    The extreme angles belong to corners within reach, or to points where the circle of the
    segment's length cuts an edge.
    """
    px, pz = cx - x, cz - z
    if abs(px) <= hx and abs(pz) <= hz:
        return True
    middle = math.atan2(pz, px)
    low, high, any_point = 0.0, 0.0, False
    for side in range(4):
        # edges: x = px -+ hx, z = pz -+ hz
        upright = side < 2
        sign = 1.0 if side % 2 else -1.0
        at = px + sign * hx if upright else pz + sign * hz
        c, h = (pz, hz) if upright else (px, hx)
        for end in range(4):
            if end < 2:
                other = c + (h if end else -h)
                if at * at + other * other > length * length:
                    continue
            else:
                square = length * length - at * at
                if square < 0.0:
                    continue
                other = math.sqrt(square) * (1.0 if end == 3 else -1.0)
                if abs(other - c) > h:
                    continue
            ex, ez = (at, other) if upright else (other, at)
            off = _wrap(math.atan2(ez, ex) - middle)
            if not any_point:
                low, high, any_point = off, off, True
            else:
                low, high = min(low, off), max(high, off)
    if not any_point:
        # no corner and no intersection in reach: at most the nearest point of an edge touches
        return False
    off = _wrap(angle - middle)
    return low <= off <= high


@njit(cache=True, error_model="numpy")
def is_state_free_angular(
    space: SpaceRecord, world: AngularMap, c: Array, k: ScratchRecord
) -> bool:
    """Return whether one configuration is free by the paper's check."""
    k.d[:] = 0.0
    place_shapes(space, c, k.d, k)
    for s in range(space.ns):
        kind = world.link_class[s]
        grow = world.margin + space.s_radius[s]
        x0, z0, x1, z1 = k.p0[s, 0], k.p0[s, 2], k.p1[s, 0], k.p1[s, 2]
        ex = ez = 0.0
        if kind == 0:
            ex, ez = space.s_half[s, 0], space.s_half[s, 2]
        for axis in range(2):
            extent = grow + (ex if axis == 0 else ez)
            low = min(x0, x1) if axis == 0 else min(z0, z1)
            high = max(x0, x1) if axis == 0 else max(z0, z1)
            if low - extent < world.area[axis, 0] or high + extent > world.area[axis, 1]:
                return False
        length = math.sqrt((x1 - x0) ** 2 + (z1 - z0) ** 2)
        angle = math.atan2(z1 - z0, x1 - x0)
        for i in range(world.obstacles.shape[0]):
            o = world.obstacles[i]
            if o[5] != kind:
                continue
            hx, hz = o[2] + grow, o[3] + grow
            if kind == 0 or length < 1e-9:
                if abs(x0 - o[0]) <= hx + ex and abs(z0 - o[1]) <= hz + ez:
                    return False
            elif o[4] == ROUND:
                if blocked_by_circle(x0, z0, length, angle, o[0], o[1], hx):
                    return False
            elif blocked_by_rectangle(x0, z0, length, angle, o[0], o[1], hx, hz):
                return False
    return True


@njit(cache=True, error_model="numpy")
def is_edge_free_angular(
    space: SpaceRecord, world: AngularMap, a: Array, b: Array, resolution: float, k: ScratchRecord
) -> bool:
    """Negated COLLISION of Algorithm 1: samples every `resolution` (m or rad) of a branch."""
    n = space.n
    far = 0.0
    for j in range(n):
        far = max(far, abs(b[j] - a[j]))
    count = max(math.ceil(far / resolution), 1)
    for i in range(1, count + 1):
        for j in range(n):
            k.c[j] = a[j] + i / count * (b[j] - a[j])
        if not is_state_free_angular(space, world, k.c, k):
            return False
    return True
