"""Estimate pose and size of a surface from touches: Bayesian least squares with the map as prior.

A touch gives the centre of the tip's sphere, one tip radius from the surface. Parameters that
touches cannot determine keep the map's value: the position of a cylinder along its axis, its
rotation about the axis, and the position of a plane along itself. Over a short arc touches hardly
determine the radius, and it stays near the map's value without a special rule.

One touch may be false (a gust, a cable, a bracket). If all touches together contradict the map and
the stated deviations (chi-square at 0.999), the fit leaves out the touch whose removal reduces the
cost most.
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
"""Probability that a survey without a false touch passes the chi-square test."""
LEAST = 1e-6
"""m, rad; least standard deviation of a prior, also for a map error of zero."""


class MapError(NamedTuple):
    """Bounds of the map's error; the error is uniformly distributed within +- each bound."""

    place: float  # m, along each axis
    turn: float  # rad, about each axis
    size: float  # m, radius


class TouchFit(NamedTuple):
    """A surface fitted to touches, and its uncertainty."""

    x: Array  # (k,) estimated differences from the map
    covariance: Array  # (k, k)
    residuals: Array  # (n,) m, of all touches; positive: outside the surface
    used: Mask  # (n,)
    consistent: bool  # whether map, touches and deviations agree with at most one touch left out


class FoundCylinder(NamedTuple):
    """A cylinder fitted to touches; x is (rotation about x_P, about z_P, position along x_P, along
    z_P, radius) in the map's frame.
    """

    cylinder: Cylinder
    fit: TouchFit


class FoundPlane(NamedTuple):
    """A plane fitted to touches; x is (rotation about x_S, about y_S, position along z_S)."""

    p_WS: Array  # (3,) m
    R_WS: Array  # (3, 3)
    fit: TouchFit


def fit_cylinder_touches(
    known: Cylinder, error: MapError, centres: Array, tip_radius: float, std: float
) -> FoundCylinder:
    """Fit a cylinder to the centres `centres` (n, 3) m, in W, of the tip's sphere at its touches.

    `known` is the map. `std` (m) is the standard deviation of a touch normal to the surface. Raises
    InputError if a centre is not finite.
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
    """Fit a plane to touches.

    The map's plane contains `p_WS` (3,) m; its outward normal is z of `R_WS` (3, 3). The other
    parameters are those of `fit_cylinder_touches`.
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
    """Return the standard deviation (m) of a cylinder along its normal at the map's (s, phi)."""
    c, b = -math.cos(phi), math.sin(phi)
    # outward motion: position along the normal, radius, and rotations times the lever s
    gradient = np.array([s * b, -s * c, c, b, 1.0])
    return math.sqrt(float(gradient @ found.fit.covariance @ gradient))


def _fit(off: Callable[[Array], Array], prior: Array, n: int, std: float) -> TouchFit:
    """Fit all touches, or all except the one that contradicts the others."""
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
    """Return estimate, covariance (J' J)^-1 and sum of squares; the prior is included."""

    def residual(z: Array) -> Array:
        return np.concatenate([off(prior * z)[used] / std, z])

    found = least_squares(residual, np.zeros(len(prior)), method="lm", xtol=1e-12, ftol=1e-12)
    information = found.jac.T @ found.jac
    covariance = np.linalg.inv(information) * np.outer(prior, prior)
    return prior * found.x, covariance, 2.0 * float(found.cost)


def _spread(bounds: list[float]) -> Array:
    """Return the standard deviations of uniform distributions within +- the bounds."""
    return np.maximum(np.array(bounds) / math.sqrt(3.0), LEAST)


def _turn(x: float, y: float, z: float) -> Array:
    R = np.empty((3, 3))
    exp_so3(np.array([x, y, z]), R)
    return R


def _check(centres: Array) -> Array:
    centres = np.asarray(centres, float).reshape(-1, 3)
    if not np.all(np.isfinite(centres)):
        bad = int(np.argmin(np.all(np.isfinite(centres), axis=1)))
        raise InputError(
            f"touches: place {bad} is {centres[bad].tolist()}; valid: finite x, y, z (m)"
        )
    return centres
