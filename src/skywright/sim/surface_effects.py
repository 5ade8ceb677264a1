"""Thrust near surfaces: the ground below a rotor, the inspected structure above it; compiled.

Ground: T / T_inf = 1 / (1 - (R / 4 z)^2), z the height of the rotor (Cheeseman and Bennett 1955),
no nearer than half a radius. Ceiling: T / T_inf = 1 / (1 - (R / (z + c2 R))^2 / c1), z the distance
from the rotor to the surface: the form that the group of Sanchez-Cuevas 2020 fits to benches in
earlier work; its constants could not be had, c1 = 7 and c2 = 0.1 are ours (a rotor of 0.12 m gains
16 % at one radius, 1 % at the docking gear's 0.45 m). A sloped surface acts with the cosine of its
slope. Each rotor for itself: no fountain, no neighbours.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.description.world.spec import World
from skywright.description.world.structure import ARCH, CYLINDER, PLANE, build_surface

Array = NDArray[np.float64]
Record = Any

CEILING_C1, CEILING_C2 = 7.0, 0.1
NEAREST = 0.5  # radii
FARTHEST = 8.0  # radii, beyond which a surface is not felt

SURFACE = np.dtype(
    [
        ("on", np.int64),  # 1: there is a structure; rotors feel it and the ground
        ("p_WS", np.float64, 3),
        ("R_WS", np.float64, (3, 3)),
        ("shape", np.int64),
        ("radius", np.float64),
        ("along", np.int64),
        ("half", np.float64, 2),  # m, of the surface along x_S and y_S
        ("disc", np.float64),  # m, radius of a rotor
        ("gain", np.float64, 12),  # T / T_inf of each rotor now
    ]
)
"""The structure's surface, and what it does to the rotors."""


def fill_surface(s: Any, world: World, disc: float) -> None:
    """Fill a SURFACE record; `disc` is the rotors' radius (m)."""
    s["gain"] = 1.0
    if world.structure is None:
        return
    found = build_surface(world.structure)
    s["on"] = 1
    s["p_WS"], s["R_WS"], s["shape"] = found.p_WS, found.R_WS, found.shape
    s["radius"], s["along"], s["disc"] = found.radius, found.along, disc
    s["half"] = [0.5 * world.structure.length_m, 0.5 * world.structure.width_m]


@njit(cache=True, error_model="numpy")
def compute_ground_gain(z: float, radius: float) -> float:
    """T / T_inf of a rotor at the height z (m) over ground (Cheeseman and Bennett 1955)."""
    near = max(z, NEAREST * radius)
    return 1.0 / (1.0 - (radius / (4.0 * near)) ** 2)


@njit(cache=True, error_model="numpy")
def compute_ceiling_gain(z: float, radius: float) -> float:
    """T / T_inf of a rotor z (m) below a ceiling."""
    near = max(z, NEAREST * radius) + CEILING_C2 * radius
    return 1.0 / (1.0 - (radius / near) ** 2 / CEILING_C1)


@njit(cache=True, error_model="numpy")
def measure_surface(s: Record, p: Array, normal: Array) -> float:
    """Return the distance (m) of p (3,) to the surface, negative inside; fill its normal (3,)."""
    x = np.empty(3)
    for i in range(3):
        x[i] = 0.0
        for j in range(3):
            x[i] += s.R_WS[j, i] * (p[j] - s.p_WS[j])
    if s.shape == PLANE:
        for i in range(3):
            normal[i] = s.R_WS[i, 2]
        return x[2]
    out = 1.0 if s.shape == CYLINDER else -1.0
    across = 1 - s.along
    height = x[2] + out * s.radius
    far = max(math.sqrt(x[across] * x[across] + height * height), 1e-9)
    for i in range(3):
        normal[i] = out * (x[across] * s.R_WS[i, across] + height * s.R_WS[i, 2]) / far
    return out * (far - s.radius)


@njit(cache=True, error_model="numpy")
def find_gains(
    s: Record, p_WB: Array, R_WB: Array, rotor_p: Array, rotor_axis: Array, n: int
) -> None:
    """Write each rotor's T / T_inf at the robot's pose."""
    hub, normal = np.empty(3), np.empty(3)
    for k in range(n):
        up = 0.0
        for i in range(3):
            hub[i] = p_WB[i]
            for j in range(3):
                hub[i] += R_WB[i, j] * rotor_p[k, j]
        gain = compute_ground_gain(hub[2], s.disc) if hub[2] < FARTHEST * s.disc else 1.0
        z = measure_surface(s, hub, normal)
        if 0.0 < z < FARTHEST * s.disc and _is_below(s, hub):
            for i in range(3):
                for j in range(3):
                    up -= normal[i] * R_WB[i, j] * rotor_axis[k, j]
            if up > 0.0:
                gain *= 1.0 + up * (compute_ceiling_gain(z, s.disc) - 1.0)
        s.gain[k] = gain


@njit(cache=True, error_model="numpy")
def _is_below(s: Record, p: Array) -> bool:
    """Whether a plane's edge does not pass beside the point."""
    if s.shape == ARCH:
        return True
    for c in range(2):
        x = 0.0
        for i in range(3):
            x += s.R_WS[i, c] * (p[i] - s.p_WS[i])
        if abs(x) > s.half[c]:
            return False
    return True
