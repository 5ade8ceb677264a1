"""Registration of a flight: pose of its frame in the frame of the asset, from datum points.

A datum point is a mark on the asset (a punch mark, a bolt, the corner of a plate). Its position in
the frame of the asset is known with u95. A flight measures the same mark in its own frame. With p
the position in the frame of the flight and p' the position in the frame of the asset,

    p' = m + t + exp([w]x) (p - m)        (rotation by w about the mean m of the datum points)

Weighted least squares (Gauss-Newton) determine t and w with a prior: the stated registration error
of the flight for t, TURN_STD for w. One point determines the translation t; several points also
determine the rotation w. The covariance of t and w gives the standard deviation of every
transformed position, which grows with the distance from the datum points (Gauss-Markov; F.
Gustafsson, Statistical Sensor Fusion, ch. 2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from skywright.core.arrays import Array
from skywright.core.rotations import exp_so3, log_so3
from skywright.errors import InputError
from skywright.inspection.history.entries import COVERAGE, Datum
from skywright.models.vectors import build_cross_matrix

TURN_STD = math.radians(3.0)
"""rad, prior standard deviation of each component of the rotation: error of map and heading."""
SHIFT_STD = 0.1
"""m, prior standard deviation of the translation if the flight states no registration error."""
FALSE_ALARM = 5e-4
"""Probability that the notes name a datum point of a flight in which none has moved."""
LEAST_REDUNDANCY = 0.01
"""Least variance of a residual along a direction, relative to that of the point, that is tested."""
LARGEST_TURN = math.radians(15.0)
"""rad, largest valid rotation. A larger one means that names or frames are mixed up."""
MISFIT = 0.1
"""Largest valid rms residual, relative to the rms extent of the points (see LARGEST_TURN)."""
STEPS = 6
"""Gauss-Newton iterations; three suffice for LARGEST_TURN."""


class Registration(NamedTuple):
    """Pose of a flight's frame in the frame of its asset."""

    shift: Array  # (3,) m, translation t
    turn: Array  # (3,) rad, rotation vector w
    middle: Array  # (3,) m, mean of the datum points in the flight's frame
    covariance: Array  # (6, 6) of shift and turn
    points: int
    residual_m: float  # rms over the datum points
    notes: tuple[str, ...]  # on datum points that do not fit, and on an undetermined turn

    def to_json(self) -> dict[str, Any]:
        """Return plain JSON."""
        std = np.sqrt(np.diag(self.covariance))
        return {
            "points": self.points, "shift_m": self.shift.tolist(),
            "turn_deg": np.degrees(self.turn).tolist(), "middle_m": self.middle.tolist(),
            "shift_std_m": std[:3].tolist(), "turn_std_deg": np.degrees(std[3:]).tolist(),
            "residual_m": self.residual_m, "notes": list(self.notes),
        }  # fmt: skip

    def carry(self, p: Array) -> tuple[Array, float]:
        """Return a position (3,) m in the frame of the asset, and its standard deviation (m).

        The standard deviation is the largest over all directions. It excludes the error of `p` in
        the flight's frame.
        """
        lever = _turn(self.turn) @ (np.asarray(p, float) - self.middle)
        J = np.hstack([np.eye(3), -build_cross_matrix(lever)])
        spread = J @ self.covariance @ J.T
        std = math.sqrt(max(float(np.linalg.eigvalsh(spread)[-1]), 0.0))
        return self.middle + self.shift + lever, std


def register_flight(
    asset: Mapping[str, Datum], flight: Mapping[str, Datum], prior_std_m: float | None = None
) -> Registration | None:
    """Return the registration of a flight by its asset's datum points; None if they share none.

    `prior_std_m` is the registration error that the flight states. Raises InputError if the points
    do not fit: the rotation exceeds LARGEST_TURN, or the residual exceeds MISFIT.
    """
    names = [name for name in asset if name in flight]
    if not names:
        return None
    p, q = (np.array([d[n].place for n in names]) for d in (flight, asset))
    std = np.array([math.hypot(asset[n].u95_m, flight[n].u95_m) / COVERAGE for n in names])
    middle = p.mean(axis=0)
    weight = np.repeat(1.0 / np.maximum(std, 1e-6) ** 2, 3)
    shift_std = SHIFT_STD if prior_std_m is None else max(prior_std_m, 1e-6)
    prior = np.array([1.0 / shift_std**2] * 3 + [1.0 / TURN_STD**2] * 3)
    x = np.zeros(6)
    for _ in range(STEPS):
        levers = (p - middle) @ _turn(x[3:]).T
        J = np.vstack([np.hstack([np.eye(3), -build_cross_matrix(v)]) for v in levers])
        off = q - (middle + x[:3] + levers)
        covariance = np.linalg.inv(J.T @ (weight[:, None] * J) + np.diag(prior))
        step = covariance @ (J.T @ (weight * off.ravel()) - prior * x)
        x = np.concatenate([x[:3] + step[:3], _find_turn(_turn(step[3:]) @ _turn(x[3:]))])
    off = q - (middle + x[:3] + (p - middle) @ _turn(x[3:]).T)
    residual = math.sqrt(float(np.mean(np.sum(off**2, axis=1))))
    extent = math.sqrt(float(np.mean(np.sum((p - middle) ** 2, axis=1))))
    turned = float(np.linalg.norm(x[3:]))
    if turned > LARGEST_TURN or residual > MISFIT * extent > 0.0:
        raise InputError(
            f"datum points {', '.join(names)}: turned by {math.degrees(turned):.0f} deg they still "
            f"differ by {1e3 * residual:.0f} mm rms; valid: up to "
            f"{math.degrees(LARGEST_TURN):.0f} deg and {MISFIT:.0%} of their extent; check their "
            "names and frames"
        )
    moved = _list_moved(names, off, std, J, covariance)
    notes = moved + _list_open(len(names), covariance)
    if moved:
        # the misfit increases the covariance, as Birge's ratio does
        chi = float(np.sum((off / std[:, None]) ** 2)) / max(3 * len(names) - 6, 1)
        covariance = covariance * max(chi, 1.0)
    return Registration(
        x[:3], x[3:], middle, covariance, len(names),
        residual, tuple(notes),
    )  # fmt: skip


def _list_moved(names: list[str], off: Array, std: Array, J: Array, covariance: Array) -> list[str]:
    """Return a note for each datum point that does not fit.

    `off` (n, 3) m are the residuals, `std` (n,) m the standard deviations of the points.
    """
    notes = []
    for k, name in enumerate(names):
        rows = J[3 * k : 3 * k + 3]
        # covariance of the residual of a point that is part of the fit
        expected = std[k] ** 2 * np.eye(3) - rows @ covariance @ rows.T
        variances, directions = np.linalg.eigh(expected)
        # along the other directions the fit follows the point: its error leaves no residual there
        tested = variances > LEAST_REDUNDANCY * std[k] ** 2
        along = (directions.T @ off[k])[tested]
        statistic = float(np.sum(along**2 / variances[tested]))
        # one test per point: Bonferroni keeps the probability of any false alarm
        limit = float(chdtri(tested.sum(), FALSE_ALARM / len(names)))
        if tested.any() and statistic > limit:
            notes.append(
                f"datum {name} is {1e3 * float(np.linalg.norm(off[k])):.1f} mm from where "
                "the others place it: it has moved, or it was mistaken for another"
            )
    return notes


def _list_open(n: int, covariance: Array) -> list[str]:
    """Return a note if `n` datum points do not determine the rotation."""
    free = np.sqrt(np.diag(covariance)[3:])
    if not np.any(free > 0.5 * TURN_STD):
        return []
    points = "1 datum point does" if n == 1 else f"{n} datum points do"
    return [
        f"{points} not determine the rotation (standard deviation up to "
        f"{math.degrees(float(np.max(free))):.1f} deg): positions far from them are less certain"
    ]


def _turn(w: Array) -> Array:
    """Return exp([w]x) (3, 3)."""
    R = np.empty((3, 3))
    exp_so3(np.ascontiguousarray(w), R)
    return R


def _find_turn(R: Array) -> Array:
    """Return w (3,) rad of a rotation matrix R (3, 3)."""
    w = np.empty(3)
    log_so3(np.ascontiguousarray(R), w)
    return w
