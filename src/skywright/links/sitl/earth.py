"""The earth's magnetic field and the standard atmosphere, for simulated sensors of an autopilot.

The field is the spherical harmonics of the international reference field of 2020 up to degree 3
(IGRF-13, Alken et al. 2021, Earth, Planets and Space 73:49, table 2): autopilots compare direction
and strength with tables of their own, within 20 deg and 0.2 gauss.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skywright.description.world.origin import Origin

Array = NDArray[np.float64]

HOME = Origin(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)
"""Default position of worlds without an origin: PX4's own default."""
RADIUS = 6371.2e3  # m, of the reference field
FIELD = {
    (1, 0): (-29404.8, 0.0), (1, 1): (-1450.9, 4652.5),
    (2, 0): (-2499.6, 0.0), (2, 1): (2982.0, -2991.6), (2, 2): (1677.0, -734.6),
    (3, 0): (1363.2, 0.0), (3, 1): (-2381.2, -82.1), (3, 2): (1236.2, 241.9),
    (3, 3): (525.7, -543.4),
}  # fmt: skip
"""(n, m) -> g, h in nT, Schmidt semi-normalised."""
STEP = 1e-6  # rad or share of the radius, of the numerical gradient


def compute_field(origin: Origin) -> Array:
    """Return the magnetic field (3,) gauss at a position: north, east, down."""
    colatitude = math.radians(90.0 - origin.latitude_deg)
    colatitude = min(max(colatitude, 1e-3), math.pi - 1e-3)
    longitude, r = math.radians(origin.longitude_deg), RADIUS + origin.altitude_m
    at = (r, colatitude, longitude)
    slopes = []
    for i, size in enumerate((STEP * r, STEP, STEP)):
        ahead, behind = list(at), list(at)
        ahead[i], behind[i] = at[i] + size, at[i] - size
        slopes.append((_compute_potential(*ahead) - _compute_potential(*behind)) / (2.0 * size))
    down, north = slopes[0], slopes[1] / r  # B = -grad V, and r points up, colatitude south
    east = -slopes[2] / (r * math.sin(colatitude))
    return 1e-5 * np.array([north, east, down])


def _compute_potential(r: float, colatitude: float, longitude: float) -> float:
    """Return V (nT m)."""
    c, s = math.cos(colatitude), math.sin(colatitude)
    P = {
        (1, 0): c, (1, 1): s,
        (2, 0): 1.5 * c * c - 0.5, (2, 1): math.sqrt(3.0) * c * s,
        (2, 2): 0.5 * math.sqrt(3.0) * s * s,
        (3, 0): 2.5 * c**3 - 1.5 * c, (3, 1): math.sqrt(3.0 / 8.0) * s * (5.0 * c * c - 1.0),
        (3, 2): 0.5 * math.sqrt(15.0) * c * s * s, (3, 3): math.sqrt(5.0 / 8.0) * s**3,
    }  # fmt: skip
    total = 0.0
    for (n, m), (g, h) in FIELD.items():
        along = g * math.cos(m * longitude) + h * math.sin(m * longitude)
        total += RADIUS * (RADIUS / r) ** (n + 1) * along * P[n, m]
    return total


def compute_pressure(altitude: float) -> float:
    """Return the pressure (Pa) of the standard atmosphere (ISO 2533) below 11 km."""
    return float(101325.0 * (1.0 - 0.0065 * altitude / 288.15) ** 5.25588)
