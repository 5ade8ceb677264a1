"""Models of the wind: the mean jet of a fan, and the scales of Dryden turbulence.

The plant draws its gusts from these numbers (vehicle/effects/wind.py); limits and planners use the
same means and standard deviations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.description.world.spec import Dryden, Wind

Array = NDArray[np.float64]

SPREAD = 0.094
"""Growth of the jet's half-width with distance (Pope 2000, Turbulent Flows, table 5.1)."""
OUTLET = math.sqrt(math.log(2.0) / 2.0)
"""Half-width of the Gaussian with the outlet's momentum, relative to the outlet's diameter."""

FOOT = 0.3048
KNOT = 1852.0 / 3600.0
SEVERITY_W20 = {"light": 15.0 * KNOT, "moderate": 30.0 * KNOT, "severe": 45.0 * KNOT}
"""m/s, wind at 20 ft of MIL-F-8785C's classes of turbulence."""
ROUGHNESS_FT = 0.15  # of the log profile, take-off and landing (MIL-F-8785C, 3.7.3.2)


class DrydenScales(NamedTuple):
    """Lengths (m) and rms (m/s) of turbulence along the wind, across it, and upwards."""

    length: Array  # (3,)
    sigma: Array  # (3,)


@helper
def jet_speed(along: float, across: float, diameter: float, outlet_speed: float) -> float:
    """Return the mean speed (m/s) in a free round turbulent jet, `along` and `across` its axis (m).

    Gaussian profile U_c exp(-ln 2 (r / r_h)^2) with half-width r_h = 0.094 x and, by conservation
    of momentum, U_c / U_0 = 6.3 d / x (Pope 2000, section 5.1; Hussein et al. 1994 measure 5.8). In
    the core, up to 6.3 d, the axis keeps the outlet's speed; the true profile is flatter there. The
    speed behind the outlet is zero: the model omits the inflow.
    """
    if along < 0.0:
        return 0.0
    half_width = max(OUTLET * diameter, SPREAD * along)
    r = across / half_width
    return outlet_speed * OUTLET * diameter / half_width * math.exp(-math.log(2.0) * r * r)


@njit(cache=True)
def jet_velocity(
    place: Array, axis: Array, diameter: float, outlet_speed: float, p: Array, v_out: Array
) -> None:
    """Write the mean air velocity (3,) m/s at p (3,) of a jet from `place` along the unit `axis`.

    Streamlines are parallel to the axis; the model omits entrainment (a few per cent).
    """
    along = square = 0.0
    for i in range(3):
        d = p[i] - place[i]
        along += d * axis[i]
        square += d * d
    across = math.sqrt(max(square - along * along, 0.0))
    speed = jet_speed(along, across, diameter, outlet_speed)
    for i in range(3):
        v_out[i] = speed * axis[i]


def compute_direction(wind: Wind, turn: float = 0.0) -> Array:
    """Return the wind's direction, a unit vector (3,) in W, rotated by `turn` (rad) about z.

    Points along +x without wind.
    """
    toward = math.radians(wind.toward_deg) + turn
    v = np.array([
        wind.mean_mps * math.cos(toward), wind.mean_mps * math.sin(toward), wind.vertical_mps
    ])  # fmt: skip
    size = float(np.linalg.norm(v))
    return v / size if size > 0.0 else np.array([math.cos(toward), math.sin(toward), 0.0])


def compute_speed(wind: Wind) -> float:
    """Return the mean speed (m/s), at the outlet of a fan; 0 for kind "none"."""
    return 0.0 if wind.kind == "none" else math.hypot(wind.mean_mps, wind.vertical_mps)


def compute_mean_wind(wind: Wind, p_W: Array, turn: float = 0.0) -> Array:
    """Return the mean air velocity (n, 3) m/s in W at the positions p_W (n, 3) m.

    `turn` (rad) is the present direction of an oscillating fan, from the middle of its sweep.
    """
    points = np.ascontiguousarray(np.atleast_2d(p_W), dtype=np.float64)
    speed = compute_speed(wind)
    if wind.kind != "fan":
        return np.tile(speed * compute_direction(wind), (len(points), 1))
    out, place = np.zeros_like(points), np.array([wind.fan.x_m, wind.fan.y_m, wind.fan.z_m])
    axis = compute_direction(wind, turn)
    for p, v in zip(points, out, strict=True):
        jet_velocity(place, axis, wind.fan.diameter_m, speed, p, v)
    return out


def compute_dryden_scales(wind: Wind) -> DrydenScales:
    """Return the scales of MIL-F-8785C, 3.7.3.4, below 1000 ft.

    h is in feet, sigma follows from the wind at 20 ft. L_w = h, L_u = L_v = h / (0.177 + 0.000823
    h)^1.2; sigma_w = 0.1 W20, sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4.
    """
    d = wind.dryden
    h = d.height_m / FOOT
    shape = 0.177 + 0.000823 * h
    ratio = shape**-0.4
    sigma_u = d.sigma_mps if d.sigma_mps is not None else 0.1 * _wind_at_20_ft(wind, d) * ratio
    length_u = h / shape**1.2 * FOOT
    return DrydenScales(
        np.array([length_u, length_u, d.height_m]), np.array([sigma_u, sigma_u, sigma_u / ratio])
    )


def _wind_at_20_ft(wind: Wind, d: Dryden) -> float:
    if d.w20_mps is not None:
        return d.w20_mps
    if d.severity != "mean":
        return SEVERITY_W20[d.severity]
    # the log profile: u(h) = W20 ln(h / z0) / ln(20 ft / z0)
    profile = math.log(20.0 / ROUGHNESS_FT) / math.log(d.height_m / FOOT / ROUGHNESS_FT)
    return wind.mean_mps * profile


def compute_gust_scales(wind: Wind, speed: float) -> tuple[Array, Array]:
    """Return rms (3,) m/s and time scale L / V (3,) s of the gusts, along, across and above.

    `speed` (m/s) is the mean speed. The rms is zero without gusts.
    """
    if wind.kind == "dryden":
        length, sigma = compute_dryden_scales(wind)
    elif wind.kind == "fan":
        length = np.full(3, wind.fan.turbulence_length_m)
        sigma = np.full(3, wind.fan.turbulence * speed)
    else:
        return np.zeros(3), np.ones(3)
    return sigma, length / max(speed, 1e-9)


def compute_gust_sigma(wind: Wind, speed: float, bandwidth: float = math.inf) -> Array:
    """Return the rms (3,) m/s of the gusts along, across and above a mean `speed` (m/s).

    Only the part below `bandwidth` (rad/s, first order) is included, against which a robot has to
    hold its position. Gusts of the time T = L / V are first order, too, so 1 / (1 + 1 / (T w)) of
    the variance remains.
    """
    sigma, lag = compute_gust_scales(wind, speed)
    return np.asarray(sigma / np.sqrt(1.0 + 1.0 / (lag * bandwidth)))
