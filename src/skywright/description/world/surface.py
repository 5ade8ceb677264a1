"""The pipe's surface: its frame, its points and its unrolled coordinates.

P sits at the pipe's centre with y along the axis. A surface point at axial position s and
circumferential angle phi is p_WP + R_WP (-R cos phi, s, R sin phi): phi = 0 faces -x_P and grows
towards the top. Unrolled coordinates are (s, c) with c = R phi.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from skywright.core.arrays import Array
from skywright.core.rotations import rot_x, rot_z
from skywright.description.world.spec import Pipe, Weld


class Cylinder(NamedTuple):
    """A pipe as compiled code sees it."""

    p_WP: Array  # (3,) m
    R_WP: Array  # (3, 3)
    radius: float
    half_length: float


def build_cylinder(pipe: Pipe) -> Cylinder:
    """Return the pipe's frame and size; `inclination_deg` lifts the +y end."""
    r = rot_z(math.radians(pipe.yaw_deg)) @ rot_x(math.radians(pipe.inclination_deg))
    p = np.array([pipe.x_m, pipe.y_m, pipe.z_m])
    return Cylinder(p, np.ascontiguousarray(r), pipe.diameter_m / 2, pipe.length_m / 2)


@njit(cache=True)
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


def unroll_points(cyl: Cylinder, p: Array) -> tuple[Array, Array, Array]:
    """Return (s, c, distance to the surface) in m, each (n,), of points (n, 3) in W."""
    local = (np.asarray(p, float) - cyl.p_WP) @ cyl.R_WP
    c = cyl.radius * np.arctan2(local[:, 2], -local[:, 0])
    return local[:, 1], c, np.hypot(local[:, 0], local[:, 2]) - cyl.radius


@njit(cache=True)
def surface_frame(cyl: Cylinder, phi: float, out: Array) -> None:
    """Fill R_WS (3, 3): x along the axis, y along growing phi reversed, z = outward normal."""
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
    angle: float  # rad, from the circumferential direction; positive: s grows with c

    @property
    def normal(self) -> tuple[float, float]:
        """Unit vector (s, c) across the line, towards +s."""
        return math.cos(self.angle), -math.sin(self.angle)

    def follow(self, way: Array) -> tuple[Array, Array]:
        """Return (s, c), each (n,) m, at distances `way` (n,) m along the line."""
        return self.s + way * math.sin(self.angle), self.c + way * math.cos(self.angle)

    def measure_distance(self, s: Array | float, c: Array | float) -> Array:
        """Return the signed distance (m) of points from the line across itself."""
        n_s, n_c = self.normal
        return np.asarray(n_s * (np.asarray(s) - self.s) + n_c * (np.asarray(c) - self.c))

    def clip(self, s_min: float, s_max: float, c_min: float, c_max: float) -> Array | None:
        """Return the ends (2, 2) of (s, c) of the line inside a box; None where it passes by."""
        low, high = -1e3, 1e3
        for origin, step, a, b in (
            (self.s, math.sin(self.angle), s_min, s_max),
            (self.c, math.cos(self.angle), c_min, c_max),
        ):
            if abs(step) < 1e-9:
                if not a <= origin <= b:
                    return None
                continue
            ends = sorted(((a - origin) / step, (b - origin) / step))
            low, high = max(low, ends[0]), min(high, ends[1])
        return np.column_stack(self.follow(np.array([low, high]))) if low < high else None


def build_weld_line(weld: Weld) -> SurfaceLine:
    """Return the middle of a weld; at 90 deg it runs along the axis and `offset_m` is its c."""
    along = weld.angle_deg == 90.0
    place = (0.0, weld.offset_m) if along else (weld.offset_m, 0.0)
    return SurfaceLine(*place, math.radians(weld.angle_deg))


def find_weld_on_pipe(pipe: Pipe, weld: Weld, count: int = 2001) -> tuple[Array, Array]:
    """Return (s, c), each (count,) m, along a weld's middle; NaN where it has left the pipe."""
    around, half = 0.5 * math.pi * pipe.diameter_m, 0.5 * pipe.length_m
    reach = around + 2.0 * half + abs(weld.offset_m)
    s, c = build_weld_line(weld).follow(np.linspace(-reach, reach, count))
    outside = (np.abs(s) > half) | (np.abs(c) > around)
    s[outside], c[outside] = np.nan, np.nan
    return s, c
