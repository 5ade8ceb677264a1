"""Alignment of the camera's frame C with the station's frame W, from paired points.

The paper's method is a general matrix and an offset, twelve numbers by least squares
(Sanchez-Cuevas 2020, eq. (3) to (5)). Nine of them form a matrix that the paper calls a rotation,
but which includes scale and shear, and fits noise in a direction without motion in the calibration.
The default is a similarity (Umeyama 1991): rotation, scale and offset, seven numbers, which a plane
determines. `level` is for frames whose z axes are both vertical: five numbers, which a straight
line determines.
"""

import math
from typing import Literal, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError

Method = Literal["similarity", "rigid", "level", "affine"]
METHODS: tuple[Method, ...] = ("similarity", "rigid", "level", "affine")
LEAST_POINTS = 4
"""Least number of point pairs: the affine matrix has 12 unknowns."""

UNKNOWN_ROTATION = math.pi / math.sqrt(3.0)
"""rad, standard deviation of an angle that is not determined: uniform over a full turn."""
VERTICAL = 0.95
"""Least z component of a direction that counts as vertical."""

FLAT = 0.1
"""Ratio of smallest to largest extent below which the points count as a plane, or a line."""


class FrameAlignment(NamedTuple):
    """x_W = matrix x_C + offset."""

    method: Method
    matrix: Array  # (3, 3), scale included
    offset: Array  # (3,) m

    @property
    def scale(self) -> float:
        """Metres per unit of length in C: the mean over the directions."""
        return float(abs(np.linalg.det(self.matrix)) ** (1.0 / 3.0))

    @property
    def rotation(self) -> Array:
        """R_WC (3, 3): the rotation nearest to the matrix."""
        u, _, vt = np.linalg.svd(self.matrix)
        return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)

    @property
    def shear(self) -> float:
        """Deviation from a scaled rotation: largest over smallest stretch, minus 1."""
        stretch = np.linalg.svd(self.matrix, compute_uv=False)
        return float(stretch[0] / max(stretch[2], 1e-300) - 1.0)

    def apply(self, x: Array) -> Array:
        """Transform points (n, 3) from C to W."""
        return np.asarray(x @ self.matrix.T + self.offset)


def estimate_affine(x: Array, y: Array) -> FrameAlignment:
    """Estimate the paper's twelve numbers: y = T x + P_0, least squares over all pairs, eq. (3) to
    (5).

    x, y (n, 3) m. The stacked system (4) separates into four unknowns per row of T; a direction
    without motion is zero (the least-norm solution).
    """
    _check(x, y)
    middle = x.mean(axis=0)  # the same solution, better conditioned
    rows = np.column_stack([x - middle, np.ones(len(x))])
    u = np.linalg.lstsq(rows, y, rcond=None)[0]
    return FrameAlignment("affine", u[:3].T.copy(), u[3] - u[:3].T @ middle)


def estimate_similarity(x: Array, y: Array, *, with_scale: bool = True) -> FrameAlignment:
    """Estimate rotation, scale and offset that minimise sum |y - s R x - t|^2 (Umeyama 1991, eq.
    40-42).

    x, y (n, 3) m. Never a reflection. `with_scale` False keeps s = 1.
    """
    _check(x, y)
    mx, my = x.mean(axis=0), y.mean(axis=0)
    cov = (y - my).T @ (x - mx) / len(x)
    u, d, vt = np.linalg.svd(cov)
    sign = np.array([1.0, 1.0, 1.0 if np.linalg.det(u) * np.linalg.det(vt) > 0 else -1.0])
    R = u @ np.diag(sign) @ vt
    spread = float(np.mean(np.sum((x - mx) ** 2, axis=1)))
    scale = float(d @ sign) / spread if with_scale and spread > 0 else 1.0
    matrix = scale * R
    return FrameAlignment(
        "similarity" if with_scale else "rigid", np.asarray(matrix), my - matrix @ mx
    )


def estimate_level(x: Array, y: Array, *, with_scale: bool = True) -> FrameAlignment:
    """Estimate heading, scale and offset: both frames have a vertical z axis.

    x, y (n, 3) m. Minimises the same sum over rotations about z only.
    """
    _check(x, y)
    mx, my = x.mean(axis=0), y.mean(axis=0)
    a, b = x - mx, y - my
    cross = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    along = float(np.sum(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]))
    angle = math.atan2(cross, along)
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    spread = float(np.sum(a * a))
    scale = float(np.sum(b * (a @ R.T))) / spread if with_scale and spread > 0 else 1.0
    return FrameAlignment("level", scale * R, my - scale * R @ mx)


def estimate_frame(method: str, x: Array, y: Array) -> FrameAlignment:
    """Align by the named method. Raises InputError for an unknown name or for too few pairs."""
    if method == "affine":
        return estimate_affine(x, y)
    if method == "similarity":
        return estimate_similarity(x, y)
    if method == "rigid":
        return estimate_similarity(x, y, with_scale=False)
    if method == "level":
        return estimate_level(x, y)
    raise InputError(f"unknown alignment {method!r}; valid: {', '.join(METHODS)}")


def _check(x: Array, y: Array) -> None:
    if x.shape != y.shape or len(x) < LEAST_POINTS:
        raise InputError(
            f"{len(x)} pairs of points; an alignment of frames requires at least {LEAST_POINTS}"
        )


class Geometry(NamedTuple):
    """Parameters that a calibration's points determine."""

    kind: Literal["full", "planar", "linear", "point"]
    extent: Array  # (3,) m, standard deviation along the principal directions, largest first
    directions: Array  # (3, 3), principal directions as rows
    open_axes: Array  # (k, 3), unit vectors in W about which the rotation is not determined
    note: str  # empty if all are determined


def diagnose_geometry(y: Array, noise: float, method: str = "similarity") -> Geometry:
    """Check the geometry of the points (n, 3) m of a calibration with the uncertainty `noise` (m).

    A plane does not determine the affine matrix across it, a line not the rotation about it, and a
    point only the offset.
    """
    a = y - y.mean(axis=0)
    _, d, directions = np.linalg.svd(a, full_matrices=False)
    extent = d / math.sqrt(len(y))
    if len(extent) < 3:
        extent = np.pad(extent, (0, 3 - len(extent)))
    large, middle, small = extent
    vertical = abs(float(directions[0, 2])) > VERTICAL
    every = np.eye(3)
    open_axes = np.zeros((0, 3))
    if large < 3.0 * noise:
        kind: Literal["full", "planar", "linear", "point"] = "point"
        open_axes = every[2:] if method == "level" else every
        note = (
            f"no motion in the calibration: its points spread by {1000.0 * large:.0f} mm, "
            f"their noise is {1000.0 * noise:.0f} mm; rotation and scale are not determined"
        )
    elif middle < max(FLAT * large, 3.0 * noise):
        kind = "linear"
        if method != "level":
            open_axes = directions[:1]
        elif vertical:
            open_axes = every[2:]
        shape = f"(spread {large:.2f} m along, {middle:.2f} m across)"
        if not len(open_axes):
            note = ""
        elif vertical:
            note = (
                f"the calibration is nearly a vertical line {shape}: the heading is not "
                "determined; move sideways too"
            )
        else:
            note = (
                f"the calibration is nearly a straight line {shape}: the rotation about it is not "
                "determined; move in a second direction, or use --align level where both frames "
                "have a vertical z axis"
            )
    elif small < max(FLAT * large, 3.0 * noise):
        kind = "planar"
        note = ""
        if method == "affine":
            note = (
                f"the calibration is nearly flat (spread {large:.2f} m along, {small:.2f} m "
                "across): the affine matrix is extrapolated across the plane, to 1 m from a spread "
                f"of {small:.2f} m; move in three directions, or use --align similarity, "
                "which a plane determines"
            )
    else:
        kind, note = "full", ""
    return Geometry(kind, np.asarray(extent), np.asarray(directions), open_axes, note)
