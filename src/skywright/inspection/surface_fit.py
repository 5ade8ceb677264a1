"""Fit a cylinder to measured contact points, with its uncertainty.

A contact scan covers only a sector. Over 40 deg of a 0.4 m pipe the surface bends by 12 mm, so
noise of 0.3 mm moves the radius by several millimetres. The standard deviations show this.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from skywright.core.arrays import Array
from skywright.description.world.surface import Cylinder
from skywright.errors import InputError
from skywright.inspection.calibration import read_numbers, read_table

MAX_FIT_POINTS = 1500
MIN_FIT_POINTS = 12


class SurfaceFit(NamedTuple):
    """A cylinder and its standard deviations (zero if the cylinder was given)."""

    cylinder: Cylinder
    std_radius: float  # m
    std_axis_point: float  # m, of the axis perpendicular to itself, at the middle of the points
    std_axis: float  # rad, of the direction of the axis
    rms: float  # m, of the distances of the points from the cylinder
    fitted: bool


def build_surface(axis_point: Array, axis: Array, radius: float, p: Array) -> Cylinder:
    """Return a cylinder whose line c = 0 faces the middle of the points `p` (n, 3) m in W.

    The sign of the axis makes its largest component positive. s = 0 is at `axis_point`. The
    unrolled picture then has the scan in its middle, and no seam cuts the scan.
    """
    y = np.asarray(axis, float) / np.linalg.norm(axis)
    if y[np.argmax(np.abs(y))] < 0:
        y = -y
    radial = np.asarray(p, float) - axis_point
    radial = radial - np.outer(radial @ y, y)
    length = np.linalg.norm(radial, axis=1)
    radial = radial[length > 1e-12] / length[length > 1e-12, None]
    middle = radial.mean(axis=0) if radial.size else np.zeros(3)
    if np.linalg.norm(middle) < 0.05:  # points all around: any fixed direction is valid
        middle = np.eye(3)[np.argmin(np.abs(y))]
        middle = middle - (middle @ y) * y
    x = -middle / np.linalg.norm(middle)
    r_wp = np.stack([x, y, np.cross(x, y)], axis=1)
    half_length = float(np.max(np.abs((np.asarray(p) - axis_point) @ y))) if len(p) else 0.0
    return Cylinder(np.asarray(axis_point, float), r_wp, float(radius), half_length)


def _fit_circle(u: Array, v: Array) -> tuple[float, float, float]:
    """Return centre and radius of a circle fit (Kasa, IEEE Trans. Instrum. Meas. 25, 8 (1976))."""
    a = np.stack([u, v, np.ones_like(u)], axis=1)
    sol, *_ = np.linalg.lstsq(a, u * u + v * v, rcond=None)
    cu, cv = sol[0] / 2, sol[1] / 2
    return cu, cv, math.sqrt(max(sol[2] + cu * cu + cv * cv, 0.0))


def _plane_basis(axis: Array) -> tuple[Array, Array]:
    e = np.eye(3)[np.argmin(np.abs(axis))]
    u = np.cross(axis, e)
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)


def _start_candidates(p: Array, count: int = 3) -> list[tuple[float, Array, Array, float]]:
    """Return the best starts (cost, axis, point, radius) over a hemisphere of axis directions."""
    n = 150
    i = np.arange(n) + 0.5
    z, azimuth = i / n, math.pi * (1 + math.sqrt(5)) * i
    r = np.sqrt(1 - z * z)
    found = []
    for axis in np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1):
        u, v = _plane_basis(axis)
        pu, pv = p @ u, p @ v
        cu, cv, radius = _fit_circle(pu, pv)
        cost = float(np.mean((np.hypot(pu - cu, pv - cv) - radius) ** 2))
        if radius > 0 and math.isfinite(cost):
            found.append((cost, axis, cu * u + cv * v, radius))
    found.sort(key=lambda item: item[0])
    return found[:count]


def _effective_share(residual: Array) -> float:
    """Return the share of independent samples in a residual, from its autocorrelation time."""
    x = residual - residual.mean()
    power = float(x @ x)
    if power == 0 or x.size < 10:
        return 1.0
    total = 1.0
    for lag in range(1, x.size // 4):
        rho = float(x[lag:] @ x[:-lag]) / power
        if rho < 0.05:
            break
        total += 2 * rho
    return 1.0 / total


def fit_cylinder(p: Array) -> SurfaceFit:
    """Fit a cylinder to contact points (n, 3) m in W, in time order, by least squares.

    The fit is robust (soft L1), minimizes the geometric distance and uses several starts. The
    standard deviations account for the correlation of the residuals. Raises InputError if the
    points do not determine a cylinder.
    """
    p = np.asarray(p, float)
    if len(p) < MIN_FIT_POINTS:
        raise InputError(
            f"cylinder fit: {len(p)} contact points; at least {MIN_FIT_POINTS} are "
            "required; give the surface with --surface FILE"
        )
    p = p[:: max(1, len(p) // MAX_FIT_POINTS)]
    middle = p.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((p - middle) ** 2, axis=1))))
    if not 1e-3 < size < 1e4:
        raise InputError(
            f"cylinder fit: the contact points extend over {size:.3g} m; check the unit of "
            "the positions or give the surface with --surface FILE"
        )
    q = (p - middle) / size

    best = None
    for _, axis0, point0, radius0 in _start_candidates(q):
        u, v = _plane_basis(axis0)

        def residual(
            x: Array, axis0: Array = axis0, point0: Array = point0, u: Array = u, v: Array = v
        ) -> Array:
            axis = axis0 + x[0] * u + x[1] * v
            axis = axis / np.linalg.norm(axis)
            d = q - (point0 + x[2] * u + x[3] * v)
            d = d - np.outer(d @ axis, axis)
            return np.asarray(np.sqrt(np.einsum("ij,ij->i", d, d)) - x[4])

        noise = max(
            1.4826 * float(np.median(np.abs(residual(np.array([0, 0, 0, 0, radius0]))))), 1e-6
        )
        fit = least_squares(
            residual, [0, 0, 0, 0, radius0], loss="soft_l1", f_scale=3 * noise, max_nfev=200
        )
        if best is None or fit.cost < best[0].cost:
            axis = axis0 + fit.x[0] * u + fit.x[1] * v
            best = (
                fit,
                axis / np.linalg.norm(axis),
                point0 + fit.x[2] * u + fit.x[3] * v,
                residual,
            )
    if best is None:
        raise InputError("cylinder fit: no cylinder found; give the surface with --surface FILE")
    fit, axis, point, residual = best
    r = residual(fit.x)
    share = _effective_share(r)
    dof = max(len(q) * share - 5, 1.0)
    variance = float(r @ r) * share / dof
    normal = fit.jac.T @ fit.jac * share
    try:
        cov = variance * np.linalg.inv(normal)
    except np.linalg.LinAlgError:
        cov = np.full((5, 5), math.inf)
    with np.errstate(invalid="ignore"):
        std = np.sqrt(np.abs(np.diag(cov)))
    radius = abs(float(fit.x[4]))
    if not np.all(np.isfinite(std)) or std[4] > 0.25 * radius or radius * size > 10.0:
        raise InputError(
            f"cylinder fit: the contact points do not determine a cylinder (radius "
            f"{radius * size:.3g} m, standard deviation {std[4] * size:.3g} m); give the surface "
            "with --surface FILE"
        )
    point = point - (point @ axis) * axis  # s = 0 at the middle of the points
    cylinder = build_surface(middle + size * point, axis, radius * size, p)
    return SurfaceFit(
        cylinder,
        std_radius=float(std[4] * size),
        std_axis_point=float(math.hypot(std[2], std[3]) * size),
        std_axis=float(math.hypot(std[0], std[1])),
        rms=float(np.sqrt(np.mean(r * r)) * size),
        fitted=True,
    )


def load_surface(path: Path, p: Array) -> SurfaceFit:
    """Read a surface file (TOML or JSON: axis_point_m, axis, radius_m); c = 0 faces `p`."""
    data = read_table(path)
    valid = ("axis_point_m", "axis", "radius_m")
    for key in data:
        if key not in valid:
            raise InputError(f"{path}: unknown key {key}; valid: {', '.join(valid)}")
    point = np.array(read_numbers(data, "axis_point_m", 3, path))
    axis = np.array(read_numbers(data, "axis", 3, path))
    radius = read_numbers(data, "radius_m", 1, path)[0]
    length = float(np.linalg.norm(axis))
    if not (1e-9 < length < 1e9):
        raise InputError(f"{path}: axis = {axis.tolist()}; valid: a direction other than zero")
    if not 1e-4 <= radius <= 1e3 or float(np.max(np.abs(point))) > 1e6:
        raise InputError(
            f"{path}: radius_m = {radius}, axis_point_m = {point.tolist()}; valid: a radius of "
            "0.0001 to 1000 m and a point within 1000 km"
        )
    return SurfaceFit(build_surface(point, axis, radius, p), 0.0, 0.0, 0.0, 0.0, fitted=False)
