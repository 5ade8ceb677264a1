"""Where a surface is, from touches: Bayesian least squares on what the map says of it.

A touch tells where the middle of the tip's sphere was: a tip's radius off the surface. The map is
the prior. What touches cannot show stays as the map has it: a cylinder's place along its axis and
its turn about it, a plane's place along itself. Over a short arc the radius hardly shows either, so
it stays near the map's value without a rule of its own.

One touch may be false (a gust, a cable, a bracket): when all together contradict map and stated
deviations (chi-square at 0.999), the one whose absence explains most is left out.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtri

from skywright.core.arrays import Array, Mask
from skywright.core.rotations import exp_so3
from skywright.description.world.surface import Cylinder
from skywright.errors import InputError

CONFIDENCE = 0.999
"""Share of surveys without a false touch that pass as such."""
LEAST = 1e-6
"""m, rad: least deviation of a prior; a map error of zero is known that well."""


class MapError(NamedTuple):
    """How far a surface may be from its map, either way, evenly spread: the bounds."""

    place: float  # m, each axis
    turn: float  # rad, about each axis
    size: float  # m, radius


class TouchFit(NamedTuple):
    """A surface through touches, and how well it is known."""

    x: Array  # (k,) the estimate: differences from the map
    covariance: Array  # (k, k)
    residuals: Array  # (n,) m, of all touches; positive: off the surface
    used: Mask  # (n,)
    consistent: bool  # whether map, touches and deviations agree, at most one touch left out


class FoundCylinder(NamedTuple):
    """A cylinder as touches show it; x is (turn about x_P, about z_P, place along x_P, z_P, radius)
    in the map's frame.
    """

    cylinder: Cylinder
    fit: TouchFit


class FoundPlane(NamedTuple):
    """A plane as touches show it; x is (turn about x_S, about y_S, place along z_S)."""

    p_WS: Array  # (3,) m
    R_WS: Array  # (3, 3)
    fit: TouchFit


def fit_cylinder_touches(
    known: Cylinder, error: MapError, centres: Array, tip_radius: float, std: float
) -> FoundCylinder:
    """Fit a cylinder to the middles `centres` (n, 3) m, in W, of the tip's sphere at its touches.

    `known` is the map; `std` (m) is the deviation of a touch across the surface. Raises InputError
    where a number is not finite.
    """
    local = (_check(centres) - known.p_WP) @ known.R_WP
    prior = _spread([error.turn, error.turn, error.place, error.place, error.size])

    def off(x: Array) -> Array:
        axis = _turn(x[0], 0.0, x[1])[:, 1]
        d = local - [x[2], 0.0, x[3]]
        d = d - np.outer(d @ axis, axis)
        return np.asarray(np.linalg.norm(d, axis=1) - (known.radius + x[4]) - tip_radius)

    fit = _fit(off, prior, len(local), std)
    x = fit.x
    found = Cylinder(
        known.p_WP + known.R_WP @ [x[2], 0.0, x[3]],
        np.ascontiguousarray(known.R_WP @ _turn(x[0], 0.0, x[1])),
        known.radius + float(x[4]), known.half_length,
    )  # fmt: skip
    return FoundCylinder(found, fit)


def fit_plane_touches(
    p_WS: Array, R_WS: Array, error: MapError, centres: Array, tip_radius: float, std: float
) -> FoundPlane:
    """Fit a plane, by the map through `p_WS` (3,) m with outward normal z of `R_WS` (3, 3).

    See `fit_cylinder_touches`.
    """
    local = (_check(centres) - p_WS) @ R_WS
    prior = _spread([error.turn, error.turn, error.place])

    def off(x: Array) -> Array:
        normal = _turn(x[0], x[1], 0.0)[:, 2]
        return np.asarray((local - [0.0, 0.0, x[2]]) @ normal - tip_radius)

    fit = _fit(off, prior, len(local), std)
    x = fit.x
    return FoundPlane(p_WS + R_WS @ [0.0, 0.0, x[2]], R_WS @ _turn(x[0], x[1], 0.0), fit)


def compute_normal_std(found: FoundCylinder, phi: float, s: float = 0.0) -> float:
    """Return the deviation (m) of the surface across itself at (s, phi) of the map's frame."""
    c, b = -math.cos(phi), math.sin(phi)
    # moving outward: place along the normal, radius, and turns times the lever along the axis
    gradient = np.array([s * b, -s * c, c, b, 1.0])
    return math.sqrt(float(gradient @ found.fit.covariance @ gradient))


def _fit(off: Callable[[Array], Array], prior: Array, n: int, std: float) -> TouchFit:
    """Fit all touches, or all but the one that contradicts the others."""
    used = np.ones(n, bool)
    x, covariance, cost = _solve(off, prior, used, std)
    consistent = cost <= chdtri(max(n, 1), 1.0 - CONFIDENCE)
    if not consistent and n > 2:
        fits = []
        for i in range(n):
            keep = np.arange(n) != i
            fits.append((*_solve(off, prior, keep, std), keep))
        x, covariance, cost, used = min(fits, key=lambda f: f[2])
        consistent = cost <= chdtri(n - 1, 1.0 - CONFIDENCE)
    return TouchFit(x, covariance, off(x), used, bool(consistent))


def _solve(
    off: Callable[[Array], Array], prior: Array, used: Mask, std: float
) -> tuple[Array, Array, float]:
    """Return estimate, covariance (J' J)^-1 and the sum of squares, prior included."""

    def residual(z: Array) -> Array:
        return np.concatenate([off(prior * z)[used] / std, z])

    found = least_squares(residual, np.zeros(len(prior)), method="lm", xtol=1e-12, ftol=1e-12)
    information = found.jac.T @ found.jac
    covariance = np.linalg.inv(information) * np.outer(prior, prior)
    return prior * found.x, covariance, 2.0 * float(found.cost)


def _spread(bounds: list[float]) -> Array:
    """Standard deviations of even distributions within +- the bounds."""
    return np.maximum(np.array(bounds) / math.sqrt(3.0), LEAST)


def _turn(x: float, y: float, z: float) -> Array:
    R = np.empty((3, 3))
    exp_so3(np.array([x, y, z]), R)
    return R


def _check(centres: Array) -> Array:
    centres = np.asarray(centres, float).reshape(-1, 3)
    if not np.all(np.isfinite(centres)):
        raise InputError("touches: a place is not finite")
    return centres
