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
from numpy.typing import NDArray

from skywright.core.rotations import rot_x, rot_z
from skywright.description.world.spec import Pipe

Array = NDArray[np.float64]


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


@njit(cache=True)
def unroll(cyl: Cylinder, p: Array) -> tuple[float, float, float]:
    """Return (s, phi, distance to the surface) of a point in W; inside is negative."""
    x = y = z = 0.0
    for i in range(3):
        d = p[i] - cyl.p_WP[i]
        x += cyl.R_WP[i, 0] * d
        y += cyl.R_WP[i, 1] * d
        z += cyl.R_WP[i, 2] * d
    return y, math.atan2(z, -x), math.sqrt(x * x + z * z) - cyl.radius


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
