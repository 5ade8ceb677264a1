"""Distance of a point to the surface of a structure, and its normal there; compiled."""

import math
from typing import Annotated, Any

from skywright.core.compiled import helper
from skywright.core.record import Array, Mat3, Record, Vec3
from skywright.core.scratch import local
from skywright.description.world.structure import ARCH, CYLINDER, PLANE, Structure, Surface


class StructureShape(Record):
    """A structure's surface (description/world/structure.py)."""

    p_WS: Vec3
    R_WS: Mat3
    shape: int  # PLANE, CYLINDER, ARCH
    radius: float  # m
    along: int  # column of R_WS along the axis of a curved surface
    half: Annotated[Array, 2]  # m, of the surface along x_S and y_S


def fill_structure(s: Any, structure: Structure, found: Surface) -> None:
    """Fill a StructureShape from a structure and its surface."""
    s["p_WS"], s["R_WS"], s["shape"] = found.p_WS, found.R_WS, found.shape
    s["radius"], s["along"] = found.radius, found.along
    s["half"] = [0.5 * structure.length_m, 0.5 * structure.width_m]


@helper
def measure_surface(s: Any, p: Array, normal: Array) -> float:
    """Return the distance (m) of p (3,) to the surface, negative inside; fill its normal (3,)."""
    x = local(3)
    for i in range(3):
        x[i] = 0.0
        for j in range(3):
            x[i] += s.R_WS[j, i] * (p[j] - s.p_WS[j])
    if s.shape == PLANE:
        for i in range(3):
            normal[i] = s.R_WS[i, 2]
        return float(x[2])
    out = 1.0 if s.shape == CYLINDER else -1.0
    across = 1 - s.along
    height = x[2] + out * s.radius
    far = max(math.sqrt(x[across] * x[across] + height * height), 1e-9)
    for i in range(3):
        normal[i] = out * (x[across] * s.R_WS[i, across] + height * s.R_WS[i, 2]) / far
    return float(out * (far - s.radius))


@helper
def is_below(s: Any, p: Array) -> bool:
    """Whether the point projects onto the surface, within the edges of a plane or pillar."""
    if s.shape == ARCH:
        return True
    for c in range(2):
        x = 0.0
        for i in range(3):
            x += s.R_WS[i, c] * (p[i] - s.p_WS[i])
        if abs(x) > s.half[c]:
            return False
    return True
