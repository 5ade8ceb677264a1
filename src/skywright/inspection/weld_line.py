"""Estimate a weld line through crossings on the unrolled surface, with its uncertainty.

A weld is the intersection of a plane and the pipe: s = s0 + tan(angle) u + lean w with
u = R sin phi and w = R (1 - cos phi). phi is measured from the middle of the crossings. Over u the
weld is straight except for its lean, a parameter with a prior. A line along the axis, or nearly so,
is a seam. It has no lean and is straight on the unrolled surface, s over c, where c is within half
a turn of the line: over u, a seam coincides with its mirror on the other side of the pipe.
The method is total least squares in normal form, which is the same for both kinds. A consensus of
all pairs rejects false crossings (Fischler and Bolles, Commun. ACM 24, 381 (1981)); the fit uses
Huber weights. A signal that lags the position shifts crossings along the direction of motion. The
lag is therefore a further parameter with a prior. Passes in opposite directions determine it; with
passes in one direction it increases the uncertainty.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.description.world.spec import Weld
from skywright.description.world.surface import build_weld_curve, flatten, wrap

LEAN_PRIOR = math.tan(math.radians(10.0))
"""Standard deviation of the lean."""
LEANS = tuple(LEAN_PRIOR * k for k in (0.0, -0.7, 0.7, -1.4, 1.4, -2.1, 2.1))
"""Values of the lean that the consensus tries."""
LAG_PRIOR = 0.03
"""s, standard deviation of the unknown lag between probe signal and position."""
LAG_STEPS = (0, -2, 2, -4, 4, -6, 6)
"""Lags that the consensus tries if `lag_std` is above LAG_PRIOR, in multiples of `lag_std`."""
LAG_LOSS = 2.0
"""Points subtracted in the consensus per second of lag: a lag also explains two welds that each
lack a crossing."""
SCALE_PRIOR_COUNT = 4.0
"""Weight, in residuals, of the crossings' own standard deviations in the scale of the residuals."""
SEAM = 0.1
"""A line through two crossings whose angle has a cosine below this is a seam along the axis."""
HALF_WIDTH = 0.005
"""m; least standard deviation of a point on a weld that was not crossed from side to side."""
SLANT = 0.01
"""Points subtracted in the consensus for a line at 45 deg to the pipe's axis; it breaks ties."""
ALONG = math.cos(math.radians(10.0))
AT_ONCE = 200
"""Number of lines that the consensus compares at a time."""
HUBER = 2.0
INLIER = 0.006
"""m, lower bound of the distance at which a crossing no longer belongs to a line."""
WIDEST = 0.02
"""m, upper bound of that distance: a crossing beyond it is not on the line, even if uncertain."""


class WeldLine(NamedTuple):
    """A line through (s, c), at `angle` from the circumferential direction at that point.

    `std_offset` is the standard deviation of the line normal to itself at (s, c). This is the
    middle of its crossings, where offset and angle are uncorrelated.
    """

    s: float  # m
    c: float  # m
    angle: float  # rad, in (-pi/2, pi/2]; positive: s grows with c
    std_offset: float  # m
    std_angle: float  # rad
    lag: float  # s, of the signal behind the position
    std_lag: float  # s
    inliers: tuple[int, ...]  # indices of the crossings on the line
    lean: float = 0.0
    radius: float = math.inf  # m, of the pipe
    is_seam: bool = False  # straight on the unrolled surface, and without lean

    @property
    def turn(self) -> float:
        """Distance (m) around the pipe after which `measure_distance` jumps; inf: never."""
        return 2.0 * math.pi * self.radius if self.is_seam else math.inf

    def measure_distance(self, s: Array | float, c: Array | float) -> Array:
        """Return the signed distance (m) of points from the line, normal to it.

        That from a seam jumps on the opposite side of the pipe.
        """
        around, s = np.asarray(c) - self.c, np.asarray(s) - self.s
        if self.is_seam:
            u, w = wrap(around, self.radius), np.zeros(np.shape(around))
        else:
            u, w = flatten(around, self.radius)
        return np.asarray((s - self.lean * w) * math.cos(self.angle) - u * math.sin(self.angle))

    def find_ways(self, s: Array, c: Array) -> Array:
        """Return the distances (n,) m along the tangent of points (s, c), (n,) m each."""
        around = np.asarray(c) - self.c
        around = wrap(around, self.radius) if self.is_seam else around
        along = (np.asarray(s) - self.s) * math.sin(self.angle)
        return np.asarray(along + around * math.cos(self.angle))

    def follow(self, way: Array) -> tuple[Array, Array]:
        """Return (s, c), (n,) m each, at distances `way` (n,) m along the line's tangent."""
        around = way * math.cos(self.angle)
        if self.is_seam:
            return self.s + way * math.sin(self.angle), self.c + around
        _, w = flatten(around, self.radius)
        climb = way * math.sin(self.angle) * np.sinc(around / self.radius / math.pi)
        return self.s + climb + self.lean * w, self.c + around


class _Points(NamedTuple):
    """Crossings in the coordinates in which their line is straight."""

    q: Array  # (n, 2) m, around and along the pipe
    bow: Array  # (n,) m, along the pipe per unit of lean
    v: Array  # (n, 2) m/s


class _Crossings(NamedTuple):
    s: Array  # (n,) m
    c: Array  # (n,) m
    v: Array  # (n, 2) m/s, around and along the pipe
    std: Array  # (n,) m
    radius: float  # m

    def unroll(self, c0: float) -> _Points:
        """Return s over c, within half a turn of `c0` (m)."""
        around = wrap(self.c - c0, self.radius)
        return _Points(np.stack([around, self.s], axis=1), np.zeros(len(self.s)), self.v)

    def flatten(self, c0: float) -> _Points:
        """Return s over u, from `c0` (m)."""
        u, bow = flatten(self.c - c0, self.radius)
        v = self.v * np.stack([np.cos((self.c - c0) / self.radius), np.ones(len(u))], axis=1)
        return _Points(np.stack([u, self.s], axis=1), bow, v)


class _Fit(NamedTuple):
    middle: Array  # (2,) m, u and s
    offset: float  # m, of the line from `middle`, normal to itself
    angle: float  # rad
    lag: float  # s
    lean: float
    cov: Array  # (4, 4) of offset, angle, lag, lean

    @property
    def t(self) -> Array:
        return np.array([math.cos(self.angle), math.sin(self.angle)])

    @property
    def n(self) -> Array:
        return np.array([-math.sin(self.angle), math.cos(self.angle)])

    def measure(self, q: Array, bow: Array, v: Array) -> Array:
        """Return the signed distances (m) of crossings from the line."""
        n = self.n
        out = (q - self.middle) @ n - self.offset - self.lag * (v @ n) - self.lean * bow * n[1]
        return np.asarray(out)


def _wrap_angle(angle: float) -> float:
    angle = math.remainder(angle, math.pi)
    return math.pi / 2 if angle <= -math.pi / 2 + 1e-12 else angle


def _get_limit(std: Array) -> Array:
    return np.asarray(np.clip(3.0 * std, INLIER, WIDEST))


def _consensus(x: _Crossings, c0: float, lag_std: float) -> tuple[Mask, float | None]:
    """Flag (n,) the largest set of points that one line through two of them explains.

    Returns the flags, and the c (m) of a point of the line if it is a seam, else None. Of sets of
    equal size, the one along or across the pipe's axis is chosen, because most welds are girths or
    seams. A line through two crossings of one pass is excluded, because a path does not cross a
    line that it follows.
    """
    flat, std = x.flatten(c0), x.std
    limit, phi = _get_limit(std), (x.c - c0) / x.radius
    best, best_score, seam = np.zeros(len(x.s), bool), -math.inf, None
    pairs = np.stack(np.triu_indices(len(x.s), 1), axis=1)
    if len(pairs) > 2000:
        pairs = pairs[np.linspace(0, len(pairs) - 1, 2000).astype(int)]
    sure = np.maximum(*std[pairs.T]) < HALF_WIDTH
    lags = [k * lag_std for k in LAG_STEPS] if lag_std > LAG_PRIOR else [0.0]
    for lean, lag in product(LEANS if np.any(flat.bow) else LEANS[:1], lags):
        oblique = flat.q - np.outer(flat.bow, [0.0, lean]) - lag * flat.v
        axial = np.stack([x.c, x.s], axis=1) - lag * x.v
        for is_seam in (False, True) if lean == 0.0 else (False,):
            at = axial if is_seam else oblique
            d = at[pairs[:, 1]] - at[pairs[:, 0]]
            if is_seam:
                d[:, 0] = wrap(d[:, 0], x.radius)
            length = np.hypot(d[:, 0], d[:, 1])
            use = (length >= 1e-3) & ((np.abs(d[:, 0]) < SEAM * length) == is_seam)
            for end in pairs.T:
                bent = d if is_seam else _bend(d, lean, phi[end])
                use &= ~(sure & _is_along(bent, x.v[end]))
            left = np.flatnonzero(use)
            for part in (left[i : i + AT_ONCE] for i in range(0, len(left), AT_ONCE)):
                (du, ds), span = d[part].T, length[part]
                off = at - at[pairs[part, :1]]  # (pairs, crossings, 2)
                if is_seam:
                    off[..., 0] = wrap(off[..., 0], x.radius)
                r = np.abs(off[..., 1] * du[:, None] - off[..., 0] * ds[:, None])
                r /= span[:, None] * limit
                score = np.sum(1 - np.minimum(r, 1) ** 2, axis=1) + 1e-3 * (span - abs(lean))
                score -= SLANT * 2.0 * np.abs(du * ds) / span**2 + LAG_LOSS * abs(lag)
                k = int(np.argmax(score))
                if score[k] > best_score:
                    best, best_score = r[k] < 1.0, float(score[k])
                    seam = float(x.c[pairs[part[k], 0]]) if is_seam else None
    return best, seam


def _bend(d: Array, lean: float, phi: Array) -> Array:
    """Return the directions (n, 2), on the unrolled surface at angles phi (n,) around the pipe, of
    lines with the directions `d` (n, 2) over u."""
    return np.stack([d[:, 0], d[:, 1] * np.cos(phi) + lean * d[:, 0] * np.sin(phi)], axis=1)


def _is_along(d: Array, v: Array) -> Mask:
    """Return whether each motion `v` (n, 2) is along the direction `d` (n, 2)."""
    along = np.abs(np.sum(d * v, axis=1))
    return np.asarray(along > ALONG * np.hypot(*d.T) * np.hypot(*v.T))


def estimate_weld_line(
    s: Array,
    c: Array,
    v_s: Array,
    v_c: Array,
    std: Array,
    *,
    radius: float = math.inf,
    lag_std: float = LAG_PRIOR,
) -> WeldLine | None:
    """Return the line through crossings at (s, c) m, crossed at velocity (v_s, v_c) m/s.

    `std` (n,) m is each crossing's own standard deviation along its motion, `radius` (m) that of
    the pipe (infinite for a plane), and `lag_std` (s) the standard deviation of the lag. Returns
    None if fewer than two crossings are far enough apart, because an angle requires two.
    """
    s, c = np.asarray(s, float), np.asarray(c, float)
    motion = np.stack([np.asarray(v_c, float), np.asarray(v_s, float)], axis=1)
    x = _Crossings(s, c, motion, np.maximum(np.asarray(std, float), 5e-5), radius)
    if len(s) < 2 or not np.all(np.isfinite([s, c])):
        return None
    c0 = float(np.median(c))
    inlier, seam = _consensus(x, c0, lag_std)
    if seam is not None:
        c0 = seam
    points = x.flatten(c0) if seam is None else x.unroll(c0)
    fit = None
    for _ in range(3):  # crossings that the lag or lean explains become inliers again
        if np.count_nonzero(inlier) < 2:
            return None
        q, bow, v = (column[inlier] for column in points)
        fit = _solve(q, bow, v, x.std[inlier], lag_std)
        if fit is None:
            return None
        off = np.abs(fit.measure(*points))
        again = inlier | (off < _get_limit(x.std))
        if np.array_equal(again, inlier):
            break
        inlier = again
    assert fit is not None
    way = (points.q[inlier] - fit.middle) @ fit.t
    line = _refer(fit, way, c0, radius if seam is None else math.inf)
    return line._replace(
        inliers=tuple(int(i) for i in np.flatnonzero(inlier)),
        radius=radius, is_seam=seam is not None,
    )  # fmt: skip


def _refer(fit: _Fit, way: Array, c0: float, radius: float) -> WeldLine:
    """Return the line with its reference, within `way`, where offset and angle are uncorrelated.

    `radius` (m) is infinite for a line that is straight on the unrolled surface.
    """
    cov, cos, sin = fit.cov, math.cos(fit.angle), math.sin(fit.angle)
    slide = float(np.clip(-cov[0, 1] / cov[1, 1], np.min(way), np.max(way)))
    point = fit.middle + fit.offset * fit.n + slide * fit.t
    turn = 0.0  # rad about the pipe, from c0
    if math.isfinite(radius):
        turn = math.asin(min(max(float(point[0]) / radius, -1.0), 1.0))
    around = radius * turn if math.isfinite(radius) else float(point[0])
    bow = float(flatten(np.asarray(around), radius)[1])
    # slope and lean of s0 + A u + B w at that point
    climb = sin * math.cos(turn) + fit.lean * cos * math.sin(turn)
    angle = math.atan2(climb, cos)
    lean = fit.lean
    if turn:
        lean = fit.lean * math.cos(turn) - sin / cos * math.sin(turn)
    across = np.array([1.0, slide, 0.0, bow * cos])
    aside = np.array([0.0, 1.0, 0.0, cos**2 * math.sin(turn)])
    return WeldLine(
        s=float(point[1]) + fit.lean * bow,
        c=c0 + around,
        angle=_wrap_angle(angle),
        std_offset=math.sqrt(max(float(across @ cov @ across), 0.0)),
        std_angle=math.sqrt(max(float(aside @ cov @ aside), 0.0)),
        lag=fit.lag,
        std_lag=math.sqrt(cov[2, 2]),
        inliers=(),
        lean=lean,
        radius=radius,
    )


def _solve(q: Array, bow: Array, v: Array, std: Array, lag_std: float) -> _Fit | None:
    weight = 1 / std**2
    middle = np.average(q, axis=0, weights=weight)
    if len(q) < 2 or float(np.max(np.hypot(*(q - middle).T))) < 2.5 * float(np.median(std)):
        return None

    d = q - middle
    _, vectors = np.linalg.eigh((d * weight[:, None]).T @ d)
    angle = math.atan2(vectors[1, -1], vectors[0, -1])
    offset = lag = lean = 0.0
    huber = np.ones(len(q))
    for _ in range(30):
        t = np.array([math.cos(angle), math.sin(angle)])
        n = np.array([-t[1], t[0]])
        rise = bow * n[1]  # normal to the line, per unit of lean
        residual = d @ n - offset - lag * (v @ n) - lean * rise
        jac = np.stack([np.ones(len(q)), d @ t - lag * (v @ t), v @ n, rise], axis=1)
        scale = math.sqrt(
            (SCALE_PRIOR_COUNT + float(np.sum(huber * (residual / std) ** 2)))
            / (SCALE_PRIOR_COUNT + max(len(q) - 2, 0))
        )
        z = np.abs(residual) / (std * max(scale, 0.3))
        huber = np.where(z > HUBER, HUBER / np.maximum(z, 1e-12), 1.0)
        w = huber / (std * scale) ** 2
        normal = (jac * w[:, None]).T @ jac
        normal[2, 2] += 1 / lag_std**2
        normal[3, 3] += 1 / LEAN_PRIOR**2
        gradient = jac.T @ (w * residual)
        gradient[2] -= lag / lag_std**2
        gradient[3] -= lean / LEAN_PRIOR**2
        step = np.linalg.solve(normal, gradient)
        offset += step[0]
        angle += step[1]
        lag += step[2]
        lean += step[3]
        if abs(step[0]) < 1e-9 and abs(step[1]) < 1e-9:
            break
    cov = np.linalg.inv(normal)
    return _Fit(middle, float(offset), float(angle), float(lag), float(lean), cov)


def compute_line_error(line: WeldLine, weld: Weld, radius: float) -> tuple[float, float]:
    """Return the (offset, angle) errors (m, rad) of an estimated line against a pipe's true weld.

    Both are taken at the line's reference point, the middle of its crossings. Elsewhere the offset
    would include the angle's error.
    """
    true = build_weld_curve(weld, radius)
    offset = float(true.measure_distance(line.s, line.c))
    return offset, math.remainder(line.angle - true.touch(line.c).angle, math.pi)
