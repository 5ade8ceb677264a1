"""Exact distances between capsules and boxes, with the direction between the nearest points.

All functions return (distance m between the cores, parameter t along the first segment) and fill
`n` (3,) with the unit vector from the second shape to the first. Cores are segments and boxes; the
caller subtracts the radii. Intersecting cores have distance 0 and n = 0.
"""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.user_code import njit

Vector = tuple[float, float, float]


@njit(cache=True, error_model="numpy", inline="always")
def _clip(x: float, low: float, high: float) -> float:
    return low if x < low else (high if x > high else x)


@helper
def segment_segment(a0: Array, a1: Array, b0: Array, b1: Array, n: Array) -> tuple[float, float]:
    """Return the distance of two segments (Ericson, Real-Time Collision Detection, sec. 5.1.9).

    Of segments within 1e-6 rad of parallel it may be too large by 1e-6 of the first one's length.
    """
    ux, uy, uz = a1[0] - a0[0], a1[1] - a0[1], a1[2] - a0[2]
    vx, vy, vz = b1[0] - b0[0], b1[1] - b0[1], b1[2] - b0[2]
    wx, wy, wz = a0[0] - b0[0], a0[1] - b0[1], a0[2] - b0[2]
    a = ux * ux + uy * uy + uz * uz
    e = vx * vx + vy * vy + vz * vz
    f = vx * wx + vy * wy + vz * wz
    c = ux * wx + uy * wy + uz * wz
    if a < 1e-18:
        s = 0.0
        t = _clip(f / e, 0.0, 1.0) if e > 1e-18 else 0.0
    elif e < 1e-18:
        t = 0.0
        s = _clip(-c / a, 0.0, 1.0)
    else:
        b = ux * vx + uy * vy + uz * vz
        det = a * e - b * b
        s = _clip((b * f - c * e) / det, 0.0, 1.0) if det > 1e-12 * a * e else 0.0
        t = (b * s + f) / e
        if t < 0.0:
            t = 0.0
            s = _clip(-c / a, 0.0, 1.0)
        elif t > 1.0:
            t = 1.0
            s = _clip((b - c) / a, 0.0, 1.0)
    dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    k = 1.0 / d if d > 1e-12 else 0.0
    n[0], n[1], n[2] = k * dx, k * dy, k * dz
    return d, s


@helper
def _excess(p: float, h: float) -> float:
    return p - h if p > h else (p + h if p < -h else 0.0)


@helper
def _slope(p: Vector, u: Vector, h: Array, t: float) -> float:
    return (
        u[0] * _excess(p[0] + t * u[0], h[0])
        + u[1] * _excess(p[1] + t * u[1], h[1])
        + u[2] * _excess(p[2] + t * u[2], h[2])
    )


@helper
def segment_box(
    a0: Array, a1: Array, centre: Array, rot: Array, half: Array, n: Array
) -> tuple[float, float]:
    """Return the distance between a segment and a box with axes `rot` (columns), half sizes `half`.

    The squared distance along the segment is convex and piecewise quadratic; its derivative is
    linear between the (at most six) points where the segment crosses a face's plane.
    """
    x, y, z = a0[0] - centre[0], a0[1] - centre[1], a0[2] - centre[2]
    p = (
        rot[0, 0] * x + rot[1, 0] * y + rot[2, 0] * z,
        rot[0, 1] * x + rot[1, 1] * y + rot[2, 1] * z,
        rot[0, 2] * x + rot[1, 2] * y + rot[2, 2] * z,
    )
    x, y, z = a1[0] - a0[0], a1[1] - a0[1], a1[2] - a0[2]
    u = (
        rot[0, 0] * x + rot[1, 0] * y + rot[2, 0] * z,
        rot[0, 1] * x + rot[1, 1] * y + rot[2, 1] * z,
        rot[0, 2] * x + rot[1, 2] * y + rot[2, 2] * z,
    )
    low, high = 0.0, 1.0
    for i in range(3):
        if abs(u[i]) > 1e-12:
            for sign in (-1.0, 1.0):
                t = (sign * half[i] - p[i]) / u[i]
                if low < t < high:
                    if _slope(p, u, half, t) > 0.0:
                        high = t
                    else:
                        low = t
    at_low, at_high = _slope(p, u, half, low), _slope(p, u, half, high)
    if at_low >= 0.0:
        t = low
    elif at_high <= 0.0:
        t = high
    else:
        t = low - at_low * (high - low) / (at_high - at_low)
    e0 = _excess(p[0] + t * u[0], half[0])
    e1 = _excess(p[1] + t * u[1], half[1])
    e2 = _excess(p[2] + t * u[2], half[2])
    d = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    k = 1.0 / d if d > 1e-12 else 0.0
    for i in range(3):
        n[i] = k * (rot[i, 0] * e0 + rot[i, 1] * e1 + rot[i, 2] * e2)
    return d, t


@helper
def _corner(centre: Array, rot: Array, half: Array, i: int, out: Array) -> None:
    x = half[0] if i & 1 else -half[0]
    y = half[1] if i & 2 else -half[1]
    z = half[2] if i & 4 else -half[2]
    for j in range(3):
        out[j] = centre[j] + rot[j, 0] * x + rot[j, 1] * y + rot[j, 2] * z


@helper
def box_box(
    ca: Array, ra: Array, ha: Array, cb: Array, rb: Array, hb: Array, n: Array
) -> tuple[float, float]:
    """Return the distance between two boxes: every edge of one with the other; t is 0."""
    best = 1e18
    p, q, m = np.empty(3), np.empty(3), np.empty(3)
    for swap in range(2):
        for i in range(8):
            for axis in range(3):
                k = 1 << axis
                if i & k:
                    continue
                if swap == 0:
                    _corner(ca, ra, ha, i, p)
                    _corner(ca, ra, ha, i | k, q)
                    d, _ = segment_box(p, q, cb, rb, hb, m)
                else:
                    _corner(cb, rb, hb, i, p)
                    _corner(cb, rb, hb, i | k, q)
                    d, _ = segment_box(p, q, ca, ra, ha, m)
                if d < best:
                    best = d
                    sign = 1.0 if swap == 0 else -1.0
                    for j in range(3):
                        n[j] = sign * m[j]
    return best, 0.0
