"""A straight weld line through crossings on the unrolled surface, with an honest uncertainty.

Total least squares in normal form, so that a seam along the axis is no special case; consensus of
all pairs against false crossings (Fischler and Bolles, Commun. ACM 24, 381 (1981)); Huber weights;
a signal that lags the position shifts crossings along the direction of motion, so the lag is a
third parameter with a prior: passes in opposite directions determine it, passes in one direction
leave it to widen the uncertainty.
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.spec import Weld
from skywright.description.world.surface import SurfaceLine, build_weld_line

LAG_PRIOR = 0.03
"""s, standard deviation of the unknown lag between probe signal and position."""
SCALE_PRIOR_COUNT = 4.0
"""How many residuals the crossings' own standard deviations count for, against what is seen."""
HUBER = 2.0
INLIER = 0.006
"""m, least distance at which a crossing is called off the line."""
WIDEST = 0.02
"""m, largest such distance: however uncertain, a place further away says nothing of this line."""


class WeldLine(NamedTuple):
    """The line through (s, c) whose direction is `angle` from the circumferential direction.

    `std_offset` is that of the line across itself at (s, c), the middle of its crossings, where
    offset and angle are uncorrelated.
    """

    s: float  # m
    c: float  # m
    angle: float  # rad, in (-pi/2, pi/2]; positive: s grows with c
    std_offset: float  # m
    std_angle: float  # rad
    lag: float  # s, by which the signal follows the position
    std_lag: float  # s
    inliers: tuple[int, ...]  # indices of the crossings on the line

    @property
    def line(self) -> SurfaceLine:
        """The line alone."""
        return SurfaceLine(self.s, self.c, self.angle)


def _wrap_angle(angle: float) -> float:
    angle = math.remainder(angle, math.pi)
    return math.pi / 2 if angle <= -math.pi / 2 + 1e-12 else angle


def _consensus(q: Array, std: Array) -> Array:
    """Boolean (n,): the largest set of points that one line through two of them explains."""
    n = len(q)
    limit = np.clip(3.0 * std, INLIER, WIDEST)
    best, best_score = np.ones(n, bool), -math.inf
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n)]
    if len(pairs) > 2000:
        pairs = [pairs[k] for k in np.linspace(0, len(pairs) - 1, 2000).astype(int)]
    for i, j in pairs:
        d = q[j] - q[i]
        length = float(np.hypot(d[0], d[1]))
        if length < 1e-3:
            continue
        r = np.abs((q - q[i]) @ np.array([-d[1], d[0]]) / length) / limit
        score = float(np.sum(1 - np.minimum(r, 1) ** 2)) + 1e-3 * length
        if score > best_score:
            best, best_score = r < 1.0, score
    return best


def estimate_weld_line(s: Array, c: Array, v_s: Array, v_c: Array, std: Array) -> WeldLine | None:
    """Line through crossings at (s, c) m, passed at velocity (v_s, v_c) m/s.

    `std` (n,) m is each crossing's own standard deviation along its motion. None where fewer
    than two crossings stand apart (an angle needs two).
    """
    q = np.stack([np.asarray(c, float), np.asarray(s, float)], axis=1)
    v = np.stack([np.asarray(v_c, float), np.asarray(v_s, float)], axis=1)
    std = np.maximum(np.asarray(std, float), 5e-5)
    if len(q) < 2 or not np.all(np.isfinite(q)):
        return None
    inlier = _consensus(q, std) if len(q) >= 3 else np.ones(len(q), bool)
    q, v, std = q[inlier], v[inlier], std[inlier]
    weight = 1 / std**2
    middle = np.average(q, axis=0, weights=weight)
    if len(q) < 2 or float(np.max(np.hypot(*(q - middle).T))) < 2.5 * float(np.median(std)):
        return None

    d = q - middle
    _, vectors = np.linalg.eigh((d * weight[:, None]).T @ d)
    angle = math.atan2(vectors[1, -1], vectors[0, -1])
    offset = lag = 0.0
    huber = np.ones(len(q))
    for _ in range(30):
        t = np.array([math.cos(angle), math.sin(angle)])
        n = np.array([-t[1], t[0]])
        residual = d @ n - offset - lag * (v @ n)
        jac = np.stack([np.ones(len(q)), d @ t - lag * (v @ t), v @ n], axis=1)
        scale = math.sqrt(
            (SCALE_PRIOR_COUNT + float(np.sum(huber * (residual / std) ** 2)))
            / (SCALE_PRIOR_COUNT + max(len(q) - 2, 0))
        )
        z = np.abs(residual) / (std * max(scale, 0.3))
        huber = np.where(z > HUBER, HUBER / np.maximum(z, 1e-12), 1.0)
        w = huber / (std * scale) ** 2
        normal = (jac * w[:, None]).T @ jac
        normal[2, 2] += 1 / LAG_PRIOR**2
        gradient = jac.T @ (w * residual)
        gradient[2] -= lag / LAG_PRIOR**2
        step = np.linalg.solve(normal, gradient)
        offset += step[0]
        angle += step[1]
        lag += step[2]
        if abs(step[0]) < 1e-9 and abs(step[1]) < 1e-9:
            break
    cov = np.linalg.inv(normal)
    # move the reference along the line to where offset and angle are uncorrelated
    t = np.array([math.cos(angle), math.sin(angle)])
    n = np.array([-t[1], t[0]])
    slide = -cov[0, 1] / cov[1, 1]
    point = middle + offset * n + slide * t
    return WeldLine(
        s=float(point[1]),
        c=float(point[0]),
        angle=_wrap_angle(angle),
        std_offset=math.sqrt(max(cov[0, 0] - cov[0, 1] ** 2 / cov[1, 1], 0.0)),
        std_angle=math.sqrt(cov[1, 1]),
        lag=float(lag),
        std_lag=math.sqrt(cov[2, 2]),
        inliers=tuple(int(i) for i in np.flatnonzero(inlier)),
    )


def compute_line_error(line: WeldLine, weld: Weld) -> tuple[float, float]:
    """(offset, angle) errors (m, rad) of an estimated line against the true weld.

    The offset is the distance of the line's reference point, the middle of its crossings, from
    the true line: s at c = 0 would mix in the angle's error where the scan is far from c = 0.
    """
    true = build_weld_line(weld)
    offset = float(true.measure_distance(line.s, line.c))
    return offset, math.remainder(line.angle - true.angle, math.pi)
