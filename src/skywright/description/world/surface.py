"""The pipe's surface: its frame, its points and its unrolled coordinates.

P is at the pipe's centre with y along the axis. A surface point at axial position s and
circumferential angle phi is p_WP + R_WP (-R cos phi, s, R sin phi): phi = 0 faces -x_P and
increases towards the top. Unrolled coordinates are (s, c) with c = R phi.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.core.user_code import njit
from skywright.description.world.spec import Pipe, Weld


class Cylinder(NamedTuple):
    """A pipe for compiled code."""

    p_WP: Array  # (3,) m
    R_WP: Array  # (3, 3)
    radius: float
    half_length: float


def build_cylinder(pipe: Pipe) -> Cylinder:
    """Return the pipe's frame and size; `inclination_deg` raises the +y end."""
    r = rot_z(math.radians(pipe.yaw_deg)) @ rot_x(math.radians(pipe.inclination_deg))
    r = r @ rot_y(math.radians(pipe.roll_deg))
    p = np.array([pipe.x_m, pipe.y_m, pipe.z_m])
    return Cylinder(p, np.ascontiguousarray(r), pipe.diameter_m / 2, pipe.length_m / 2)


def level_axes(R_WP: Array) -> Array:
    """Return axes (3, 3) of a pipe by gravity: x level, y along it, z up; R_WP if vertical."""
    axis = R_WP[:, 1]
    level = np.cross(axis, [0.0, 0.0, 1.0])
    size = float(np.linalg.norm(level))
    if size < 1e-6:
        return R_WP
    level /= size
    return np.ascontiguousarray(np.column_stack([level, axis, np.cross(level, axis)]))


@helper
def surface_point(cyl: Cylinder, s: float, phi: float, p: Array, n: Array) -> None:
    """Fill the point `p` (3,) in W and the outward normal `n` (3,) at (s, phi)."""
    a, b = -math.cos(phi), math.sin(phi)
    for i in range(3):
        n[i] = cyl.R_WP[i, 0] * a + cyl.R_WP[i, 2] * b
        p[i] = cyl.p_WP[i] + cyl.R_WP[i, 1] * s + cyl.radius * n[i]


def roll_points(cyl: Cylinder, s: Array | float, c: Array | float) -> tuple[Array, Array]:
    """Return points and outward normals (n, 3) in W of unrolled coordinates (s, c), m."""
    along, phi = np.broadcast_arrays(np.asarray(s, float), np.asarray(c, float) / cyl.radius)
    local = np.column_stack([-np.cos(phi), np.zeros_like(phi), np.sin(phi)])
    normals = local @ cyl.R_WP.T
    return cyl.p_WP + along.reshape(-1, 1) * cyl.R_WP[:, 1] + cyl.radius * normals, normals


def unroll_points(cyl: Cylinder, p: Array, near: Array | float = 0.0) -> tuple[Array, Array, Array]:
    """Return (s, c, distance to the surface) in m, each (n,), of points (n, 3) in W.

    c is within half a turn of `near` (m), so that there is no seam close to it.
    """
    local = (np.asarray(p, float) - cyl.p_WP) @ cyl.R_WP
    c = cyl.radius * np.arctan2(local[:, 2], -local[:, 0])
    c = wrap(c, cyl.radius, near)
    return local[:, 1], c, np.hypot(local[:, 0], local[:, 2]) - cyl.radius


def wrap(c: Array | float, radius: float, near: Array | float = 0.0) -> Array:
    """Return places `c` (m) around a pipe within half a turn of `near`; unchanged for a plane."""
    if not math.isfinite(radius):
        return np.asarray(c)
    turn = 2.0 * math.pi * radius
    return np.asarray(c - turn * np.round((c - near) / turn))


def flatten(c: Array, radius: float) -> tuple[Array, Array]:
    """Return u and w (m) for distances `c` (m) around the pipe; c and zero for a plane."""
    if not math.isfinite(radius):
        return np.asarray(c), np.zeros(np.shape(c))
    return radius * np.sin(c / radius), radius * (1.0 - np.cos(c / radius))


def find_middle(c: Array, radius: float) -> float:
    """Return the place (m) around a pipe opposite the largest gap between places `c` (n,) m.

    Places within half a turn of it are cut in that gap, so neighbours are not separated. Returns 0
    for a plane or no places.
    """
    if not c.size or not math.isfinite(radius):
        return 0.0
    turn = 2.0 * math.pi * radius
    around = np.sort(wrap(c, radius))
    gaps = np.diff(around, append=around[0] + turn)
    k = int(np.argmax(gaps))
    return float(wrap(around[k] + 0.5 * (gaps[k] + turn), radius))


@helper
def surface_frame(cyl: Cylinder, phi: float, out: Array) -> None:
    """Fill R_WS (3, 3): x along the axis, z the outward normal, y along decreasing phi."""
    a, b = -math.cos(phi), math.sin(phi)
    for i in range(3):
        out[i, 0] = cyl.R_WP[i, 1]
        out[i, 2] = cyl.R_WP[i, 0] * a + cyl.R_WP[i, 2] * b
    # y = z x x completes a right-handed frame
    out[0, 1] = out[1, 2] * out[2, 0] - out[2, 2] * out[1, 0]
    out[1, 1] = out[2, 2] * out[0, 0] - out[0, 2] * out[2, 0]
    out[2, 1] = out[0, 2] * out[1, 0] - out[1, 2] * out[0, 0]


class SurfaceLine(NamedTuple):
    """A straight line on the unrolled surface, through (s, c) m."""

    s: float
    c: float
    angle: float  # rad, from the circumferential direction; positive: s increases with c

    def follow(self, way: Array) -> tuple[Array, Array]:
        """Return (s, c), each (n,) m, at distances `way` (n,) m along the line."""
        return self.s + way * math.sin(self.angle), self.c + way * math.cos(self.angle)

    def find_nearest(self, s: float, c: float) -> float:
        """Return the distance (m) along the line of its point nearest to (s, c) m."""
        return (s - self.s) * math.sin(self.angle) + (c - self.c) * math.cos(self.angle)


@njit(cache=True, error_model="numpy")
def weld_distance(
    offset: float, slope: float, around: float, radius: float, s: float, c: float
) -> float:
    """Return the signed distance (m) of (s, c) m from a weld's centre line; others as in WeldCurve.

    Accurate to first order in the distance over the line's radius of curvature.
    """
    phi = c / radius - around
    if math.isinf(slope):
        phi -= offset / radius
        return -radius * (phi - 2.0 * math.pi * np.floor(phi / (2.0 * math.pi) + 0.5))
    steep = slope * np.cos(phi)
    return (s - offset - radius * slope * np.sin(phi)) / np.sqrt(1.0 + steep * steep)


class WeldCurve(NamedTuple):
    """The centre line of a weld: the pipe's intersection with an oblique plane, or an axial seam.

    s = offset + radius slope sin(c / radius - around) is closed around the pipe. An infinite slope
    is the seam c = offset + radius around.
    """

    offset: float  # m
    slope: float  # tan of the angle from the circumferential direction, at c = radius around
    around: float  # rad
    radius: float  # m, of the pipe

    def place(self, c: Array | float) -> Array:
        """Return s (m) of the line at `c` (m); NaN for a seam along the axis."""
        if math.isinf(self.slope):
            return np.full(np.shape(c), np.nan)
        phi = np.asarray(c) / self.radius - self.around
        return np.asarray(self.offset + self.radius * self.slope * np.sin(phi))

    def touch(self, c: float) -> SurfaceLine:
        """Return the tangent of the weld at `c` (m)."""
        if math.isinf(self.slope):
            return SurfaceLine(0.0, self.offset + self.radius * self.around, math.pi / 2)
        steep = self.slope * math.cos(c / self.radius - self.around)
        return SurfaceLine(float(self.place(c)), c, math.atan(steep))

    def measure_distance(self, s: Array | float, c: Array | float) -> Array:
        """Return the signed distance (m) of points (s, c) m normal to the line."""
        return np.asarray(weld_distance.py_func(*self, np.asarray(s), np.asarray(c)))

    def follow(self, half_length: float, count: int) -> tuple[Array, Array]:
        """Return (s, c), each (count,) m, once around a pipe, or from end to end of a seam."""
        if math.isinf(self.slope):
            return np.linspace(-half_length, half_length, count), np.full(count, self.touch(0.0).c)
        c = self.radius * np.linspace(-math.pi, math.pi, count)
        return self.place(c), c


def build_weld_curve(weld: Weld, radius: float) -> WeldCurve:
    """Return the centre line of a weld on a pipe of `radius` (m)."""
    slope = math.inf if weld.angle_deg == 90.0 else math.tan(math.radians(weld.angle_deg))
    return WeldCurve(weld.offset_m, slope, math.radians(weld.around_deg), radius)


def find_weld_on_pipe(pipe: Pipe, weld: Weld, count: int = 2001) -> tuple[Array, Array]:
    """Return (s, c), each (count,) m, along a weld's centre line; NaN beyond the pipe's ends."""
    s, c = build_weld_curve(weld, pipe.diameter_m / 2).follow(pipe.length_m / 2, count)
    outside = np.abs(s) > pipe.length_m / 2
    s[outside], c[outside] = np.nan, np.nan
    return s, c
