"""The time-consistent frame: pose of the station from known terrain points.

Sanchez-Cuevas 2020, section 3: fixed points of the terrain are measured once and stored. On another
day the station measures them from another position, and least squares yields its pose in the old
frame. Points that have moved or are confused with others must not bias the frame: residuals are
tested against their standard deviation, and the worst point is excluded until the rest fits (data
snooping, Baarda 1968; here with the three coordinates of a point together).
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from skywright.core.arrays import Array, Mask
from skywright.errors import InputError
from skywright.models.localisation.frame_alignment import estimate_level, estimate_similarity

SIGNIFICANCE = 0.001
"""Probability that a good point is rejected (Baarda's usual choice)."""
POWER = 0.8
"""Probability that the smallest detectable offset is found (Baarda's usual choice)."""
LEAST_POINTS = 3
POINT_STD = 2e-3
"""m per axis: measurement of a fixed point by a total station, and centring on the point."""


class StationPoint(NamedTuple):
    """A terrain point after the adjustment."""

    name: str
    residual: Array  # (3,) m: known minus measured, in W
    statistic: float  # squared, normalised; compared with `StationPose.critical`
    redundancy: float  # 0: not checked by other points, 1: fully checked
    detectable: float  # m, offset that the test finds in 80 of 100 cases; inf without redundancy
    used: bool


class StationPose(NamedTuple):
    """The station's frame S in the time-consistent frame W: p_W = R_WS p_S + p_WS."""

    R_WS: Array  # (3, 3)
    p_WS: Array  # (3,) m
    covariance: Array  # (6, 6): rotation (rad, about W's axes, at `centre`) and position (m)
    centre: Array  # (3,) m, mean of the used points in W
    sigma: float  # m, standard deviation of a coordinate, from the residuals
    chi2: float  # sum of squared, normalised residuals of the used points
    redundancy: int
    chi2_limit: float  # at SIGNIFICANCE
    critical: float  # of a point's statistic
    points: tuple[StationPoint, ...]
    level: bool
    notes: tuple[str, ...]

    def apply(self, p_S: Array) -> Array:
        """Transform points (n, 3) from the station's frame to W."""
        return np.asarray(p_S @ self.R_WS.T + self.p_WS)

    def predict_std(self, p_W: Array) -> float:
        """Return the standard deviation (m, 3-D) of a point (3,) in W due to the frame's
        uncertainty."""
        J = _jacobian((p_W - self.centre)[None])[0]
        return float(np.sqrt(np.trace(J @ self.covariance @ J.T)))


def _jacobian(arm: Array) -> Array:
    """Derivatives (n, 3, 6) of points at `arm` (n, 3) from the centre by rotation and
    translation."""
    J = np.zeros((len(arm), 3, 6))
    for i in range(3):
        axis = np.zeros(3)
        axis[i] = 1.0
        J[:, :, i] = np.cross(axis, arm)
        J[:, i, 3 + i] = 1.0
    return J


def estimate_station_pose(
    names: list[str],
    known: Array,
    measured: Array,
    *,
    std: float = POINT_STD,
    level: bool = True,
    significance: float = SIGNIFICANCE,
) -> StationPose:
    """Estimate the station's pose from points known in W (n, 3) m and measured in S (n, 3) m.

    `std` (m) is that of a coordinate of the difference. `level`: the station is levelled, so its z
    axis is vertical and only its heading is estimated. Raises InputError if fewer than three points
    are given, or if they are too close together or to a line to determine the frame.
    """
    n = len(names)
    if n < LEAST_POINTS:
        raise InputError(f"{n} common points; the station's frame requires at least {LEAST_POINTS}")
    used = np.ones(n, dtype=bool)
    notes: list[str] = []
    free, ambiguous = 4 if level else 6, False
    while True:
        fit = _adjust(known[used], measured[used], std, level)
        R, p, cov, centre = fit
        r = known - (measured @ R.T + p)
        statistic, share = _test_points(r, known - centre, cov, std, used)
        redundancy = 3 * int(used.sum()) - free
        total = float(np.sum(r[used] ** 2)) / std**2
        limit = float(chi2.isf(significance, redundancy)) if redundancy > 0 else 0.0
        # one test per point: Bonferroni keeps the probability of any false alarm
        critical = float(chi2.isf(significance / max(int(used.sum()), 1), 3))
        worst = int(np.argmax(np.where(used, statistic, -1.0)))
        if statistic[worst] <= critical:
            break
        if used.sum() <= LEAST_POINTS + 1:
            notes.append(
                f"point {names[worst]!r} is inconsistent, but with {int(used.sum())} "
                "points the wrong one cannot be identified: measure more points"
            )
            ambiguous = True
            break
        used[worst] = False
        notes.append(
            f"point {names[worst]!r} left out: {1e3 * float(np.linalg.norm(r[worst])):.0f} mm off"
        )
    if redundancy > 0 and total > limit and not ambiguous:
        notes.append(
            f"the residuals exceed {1000.0 * std:.1f} mm per coordinate (chi squared "
            f"{total:.1f}, at most {limit:.1f})"
        )
    sigma = math.sqrt(total * std**2 / redundancy) if redundancy > 0 else 0.0
    shift = _find_detectable_shift(critical)
    points = tuple(
        StationPoint(
            names[i], r[i], float(statistic[i]), float(share[i]),
            _compute_detectable(float(share[i]), std, shift), bool(used[i]),
        )
        for i in range(n)
    )  # fmt: skip
    return StationPose(
        R, p, cov, centre, sigma, total, redundancy, limit, critical, points, level, tuple(notes)
    )


def _adjust(known: Array, measured: Array, std: float, level: bool
            ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Return the least-squares rotation, position, covariance (6, 6) and centre."""
    if len(known) >= 4:
        frame = (estimate_level(measured, known, with_scale=False) if level
                 else estimate_similarity(measured, known, with_scale=False))  # fmt: skip
    else:  # the closed forms require four pairs; duplicated points have the same solution
        twice = np.concatenate([measured, measured]), np.concatenate([known, known])
        frame = (estimate_level(*twice, with_scale=False) if level
                 else estimate_similarity(*twice, with_scale=False))  # fmt: skip
    centre: Array = known.mean(axis=0)
    J = _jacobian(known - centre).reshape(-1, 6)
    H = J.T @ J / std**2
    if level:
        H[:2, :], H[:, :2] = 0.0, 0.0
        H[0, 0] = H[1, 1] = 1e18  # no rotation about the level axes
    spread = np.linalg.svd(known - centre, compute_uv=False) / math.sqrt(len(known))
    fixed = float(np.max(np.linalg.norm((known - centre)[:, :2], axis=1))) if level else spread[1]
    if fixed < max(20.0 * std, 0.05):
        what = "one place" if level else "one line"
        raise InputError(
            f"the points are too close to {what} ({fixed:.2f} m apart) to determine the "
            "station's frame"
        )
    return frame.matrix, frame.offset, np.asarray(np.linalg.inv(H)), centre


def _test_points(r: Array, arm: Array, cov: Array, std: float, used: Mask
                 ) -> tuple[Array, Array]:  # fmt: skip
    """Return each point's squared normalised residual (n,) and redundancy (n,)."""
    n = len(r)
    statistic, share = np.zeros(n), np.zeros(n)
    J = _jacobian(arm)
    for i in range(n):
        spread = J[i] @ cov @ J[i].T
        # a used point has biased the frame towards itself; an excluded one has not
        Q = std**2 * np.eye(3) + (-spread if used[i] else spread)
        values, vectors = np.linalg.eigh(Q)
        keep = values > 1e-6 * std**2
        along = (vectors.T @ r[i])[keep]
        statistic[i] = float(np.sum(along**2 / values[keep]))
        share[i] = float(np.trace(Q)) / (3.0 * std**2) if used[i] else 1.0
    return statistic, share


def _find_detectable_shift(critical: float) -> float:
    """Return the shift, in standard deviations of the residual, found with probability POWER.

    The statistic of a shifted point has a noncentral chi-squared distribution of three degrees of
    freedom; the test compares it with `critical`.
    """

    def excess_power(shift: float) -> float:
        return float(ncx2.sf(critical, 3, shift**2)) - POWER

    return float(brentq(excess_power, 1e-3, math.sqrt(critical) + 10.0))


def _compute_detectable(redundancy: float, std: float, shift: float) -> float:
    """Return the offset (m) of a point with this mean redundancy that shifts its residual so."""
    return shift * std / math.sqrt(redundancy) if redundancy >= 1e-3 else math.inf
