"""Hit/miss data: a binary regression with an optional ceiling, by maximum likelihood.

    POD(a) = c F(b0 + b1 x),   x = a or ln a

F is logistic or normal (links.py). c is the ceiling: 1, a given number, or estimated. Bounds are
Wald bounds on the linear predictor, or from the profile likelihood (MIL-HDBK-1823A, appendix G; the
constrained maximum of Venzon and Moolgavkar, Appl. Statist. 37, 1988).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from skywright.analysis.pod.links import CONFIDENCE, Link
from skywright.core.arrays import Array
from skywright.errors import InputError

STEEPEST = 500.0
"""Slope per standard deviation of x from which it counts as unbounded."""
FARTHEST = 20.0
"""Search range of a bound beyond the data, as a multiple of the range of x."""
CEILINGS = np.linspace(0.3, 1.0, 29)
UNBOUNDED = (
    "the slope of the curve is not bounded by the data: between the largest size that is always "
    "missed and the smallest that is found there are too few flaws; add sizes there"
)


class HitMiss(NamedTuple):
    """A fitted curve; `covariance` is of (b0, b1), or of (b0, b1, c) with a ceiling below 1.

    An estimated ceiling of 1 is at its boundary: Wald bounds then treat it as known, likelihood
    bounds do not.
    """

    link: Link
    x: Array  # (n,)
    hit: Array  # (n,) 0 or 1
    b0: float
    b1: float
    ceiling: float
    ceiling_fitted: bool
    covariance: Array
    log_likelihood: float

    @property
    def parameters(self) -> int:
        """Number of estimated parameters."""
        return 3 if self.ceiling_fitted else 2

    def compute(self, x: Array) -> Array:
        """Return the POD (n,) at x (n,)."""
        return self.ceiling * self.link.cdf(self.b0 + self.b1 * np.asarray(x, float))

    def find(self, p: float) -> float | None:
        """Return the x at which the POD is p; None at or above the ceiling."""
        if p >= self.ceiling:
            return None
        return (self.link.quantile(p / self.ceiling) - self.b0) / self.b1

    def compute_lower(self, x: Array, bounds: str, confidence: float = CONFIDENCE) -> Array:
        """Return the one-sided lower bound (n,) of the POD at x (n,)."""
        x = np.atleast_1d(np.asarray(x, float))
        if bounds == "wald":
            return self._compute_wald(x, float(stats.norm.ppf(confidence)))
        return np.array([self._compute_profile(at, confidence) for at in x])

    def find_bound(self, p: float, bounds: str, confidence: float = CONFIDENCE) -> float | None:
        """Return the minimum x at which the lower bound of the POD reaches p; None if it never
        does."""
        start = self.find(p)
        if start is None:
            return None
        width = max(float(np.ptp(self.x)), 1e-9)
        if bounds == "wald":
            z = float(stats.norm.ppf(confidence))
            grid = start + FARTHEST * width * np.linspace(0.0, 1.0, 4001)
            over = np.flatnonzero(self._compute_wald(grid, z) >= p)
            if over.size == 0:
                return None
            if over[0] == 0:
                return start
            return float(optimize.brentq(
                lambda x: self._compute_wald(np.array([x]), z)[0] - p,
                grid[over[0] - 1], grid[over[0]], xtol=1e-12, rtol=1e-13,
            ))  # fmt: skip
        drop = 0.5 * float(stats.norm.ppf(confidence)) ** 2

        def excess(x: float) -> float:
            return self.log_likelihood - self._maximise(x, p) - drop

        step, low = 0.02 * width, start
        while step < FARTHEST * width:
            if excess(start + step) > 0:
                return float(optimize.brentq(excess, low, start + step, xtol=1e-10))
            low, step = start + step, 1.5 * step
        return None

    def compute_ceiling_lower(self, confidence: float = CONFIDENCE) -> float:
        """Return the one-sided lower bound of the ceiling, by the profile likelihood."""
        if not self.ceiling_fitted:
            return self.ceiling
        drop = 0.5 * float(stats.norm.ppf(confidence)) ** 2

        def excess(c: float) -> float:
            best = _fit_fixed(self.link, self.x, self.hit, c)
            return self.log_likelihood - best[2] - drop

        low = 0.01
        if excess(low) <= 0:
            return low
        return float(optimize.brentq(excess, low, self.ceiling, xtol=1e-6))

    def _compute_wald(self, x: Array, z: float) -> Array:
        eta = self.b0 + self.b1 * x
        gradient = np.stack([np.ones_like(x), x], axis=1)
        if len(self.covariance) == 2:
            spread = np.sqrt(np.einsum("ni,ij,nj->n", gradient, self.covariance, gradient))
            return self.ceiling * self.link.cdf(eta - z * spread)
        p = np.clip(self.compute(x), 1e-300, 1.0 - 1e-15)
        total = np.array([self.link.quantile(float(v)) for v in p])
        slope = self.ceiling * self.link.pdf(eta)[:, None] * gradient
        full = np.concatenate([slope, self.link.cdf(eta)[:, None]], axis=1)
        scale = np.maximum(self.link.pdf(total), 1e-300)
        spread = np.sqrt(np.einsum("ni,ij,nj->n", full, self.covariance, full)) / scale
        return np.asarray(self.link.cdf(total - z * spread))

    def _compute_profile(self, x: float, confidence: float) -> float:
        drop = 0.5 * float(stats.norm.ppf(confidence)) ** 2
        top = float(self.compute(np.array([x]))[0])

        def excess(eta: float) -> float:
            p = float(self.link.cdf(np.array(eta))) * self.ceiling
            return self.log_likelihood - self._maximise(x, p) - drop

        high = self.link.quantile(min(max(top / self.ceiling, 1e-12), 1.0 - 1e-12))
        low, step = high, 0.5
        while excess(low) < 0 and step < 1e3:
            low, step = low - step, 2.0 * step
        if step >= 1e3:
            return 0.0
        eta = optimize.brentq(excess, low, high, xtol=1e-8) if low < high else high
        return float(self.link.cdf(np.array(eta))) * self.ceiling

    def _maximise(self, x: float, p: float) -> float:
        """Return the log-likelihood with POD(x) = p, maximized over the other parameters."""
        if not self.ceiling_fitted:
            return self._maximise_slope(x, self.link.quantile(p / self.ceiling), self.ceiling)
        found = optimize.minimize_scalar(
            lambda c: -self._maximise_slope(x, self.link.quantile(p / c), c),
            bounds=(min(p * (1 + 1e-9) + 1e-12, 1.0 - 1e-9), 1.0), method="bounded",
            options={"xatol": 1e-5},
        )  # fmt: skip
        ends = self._maximise_slope(x, self.link.quantile(min(p, 1.0 - 1e-12)), 1.0)
        return max(-float(found.fun), ends)

    def _maximise_slope(self, x: float, eta: float, c: float) -> float:
        away = self.x - x
        scale = max(float(np.std(self.x)), 1e-12)

        def cost(b: float) -> float:
            return -_compute_log_likelihood(self.link, eta + b / scale * away, self.hit, c)

        found = optimize.minimize_scalar(
            cost, bracket=(0.5 * self.b1 * scale, self.b1 * scale), tol=1e-10
        )
        return -float(found.fun)


def _compute_log_likelihood(link: Link, eta: Array, hit: Array, c: float) -> float:
    with np.errstate(divide="ignore", over="ignore"):  # trial steps may be huge
        miss = np.logaddexp(np.log1p(-c), np.log(c) + link.log_cdf(-eta))
        return float(np.sum(np.where(hit > 0, np.log(c) + link.log_cdf(eta), miss)))


def _fit_fixed(link: Link, x: Array, hit: Array, c: float) -> tuple[float, float, float]:
    """Return (b0, b1, log-likelihood) at a given ceiling."""
    centre, scale = float(np.mean(x)), float(np.std(x))
    u = (x - centre) / scale
    share = float(np.clip(np.mean(hit) / c, 0.05, 0.95))
    b = np.array([link.quantile(share), 1.0])
    design = np.stack([np.ones_like(u), u], axis=1)

    def log_likelihood(b: Array) -> float:
        return _compute_log_likelihood(link, b[0] + b[1] * u, hit, c)

    best = log_likelihood(b)
    for _ in range(200):  # Fisher scoring with halved steps
        eta = b[0] + b[1] * u
        p, rest = _compute_shares(link, eta, c)
        density, variance = c * link.pdf(eta), p * rest
        score = design.T @ (density * np.where(hit > 0, 1.0 / p, -1.0 / rest))
        information = (design * (density**2 / variance)[:, None]).T @ design
        step = np.linalg.lstsq(information, score, rcond=None)[0]
        rate, now = 1.0, log_likelihood(b + step)
        while rate > 1e-6 and not now >= best:
            rate *= 0.5
            now = log_likelihood(b + rate * step)
        b = b + rate * step
        gained, best = now - best, now
        if abs(b[1]) > STEEPEST or (gained < 1e-12 * (1.0 + abs(best)) and rate > 1e-6):
            break
        if rate <= 1e-6:
            break
    return float(b[0] - b[1] * centre / scale), float(b[1] / scale), best


def _compute_covariance(link: Link, x: Array, fit: tuple[float, float], c: float, n: int) -> Array:
    eta = fit[0] + fit[1] * x
    density = link.pdf(eta)
    p, rest = _compute_shares(link, eta, c)
    gradient = np.stack([c * density, c * density * x, link.cdf(eta)][:n], axis=1)
    return np.asarray(np.linalg.inv((gradient / (p * rest)[:, None]).T @ gradient))


def _compute_shares(link: Link, eta: Array, c: float) -> tuple[Array, Array]:
    """Return POD and 1 - POD, each without cancellation and above 0. F(-eta) = 1 - F(eta)."""
    eta = np.clip(eta, -35.0, 35.0)
    return c * link.cdf(eta), (1.0 - c) + c * link.cdf(-eta)


def _is_step(x: Array, hit: Array, c: float, log_likelihood: float) -> bool:
    """Return whether a step from 0 to the ceiling is as likely as the fitted curve.

    The step is the limit of curves of growing slope. It lies at the smallest size that was found,
    where its POD has any value up to the ceiling.
    """
    at = x == np.min(x[hit > 0])
    beyond = x > np.min(x[hit > 0])
    p = min(float(np.mean(hit[at])), c)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.concatenate([
            np.where(hit[at] > 0, np.log(p), np.log1p(-p)),
            np.where(hit[beyond] > 0, np.log(c), np.log1p(-c)),
        ])  # fmt: skip
    return bool(np.sum(step) >= log_likelihood - 1e-6)


def estimate_ceiling(x: Array, hit: Array, link: Link) -> tuple[float, float]:
    """Return the most likely ceiling, and the log-likelihood with it.

    The log-likelihood is maximized over the slope, which it need not bound.
    """
    costs = [-_fit_fixed(link, x, hit, float(c))[2] for c in CEILINGS]
    k = int(np.argmin(costs))
    span = CEILINGS[max(k - 1, 0)], CEILINGS[min(k + 1, len(CEILINGS) - 1)]
    found = optimize.minimize_scalar(
        lambda c: -_fit_fixed(link, x, hit, c)[2], bounds=span, method="bounded",
        options={"xatol": 1e-7},
    )  # fmt: skip
    if found.fun < costs[-1] - 1e-9:
        return float(found.x), -float(found.fun)
    return 1.0, -costs[-1]


def fit_hit_miss(x: Array, hit: Array, link: Link, ceiling: float | None = 1.0) -> HitMiss:
    """Fit a curve to x (n,) and hit (n,) of 0 and 1; with `ceiling` None, the ceiling is estimated.

    Raises InputError if the data do not determine a curve: one size, only hits or only misses,
    separation, or a POD that decreases with size.
    """
    check_hit_miss(x, hit)
    if ceiling is not None:
        return fit_below(x, hit, link, ceiling)
    return fit_below(x, hit, link, estimate_ceiling(x, hit, link)[0], estimated=True)


def fit_below(x: Array, hit: Array, link: Link, c: float, estimated: bool = False) -> HitMiss:
    """Fit a curve with the ceiling `c` to x (n,) and hit (n,), which `check_hit_miss` accepts.

    `estimated`: the ceiling is the most likely one, a parameter of the curve with a variance.
    Raises InputError if the slope is not bounded or not positive.
    """
    b0, b1, best = _fit_fixed(link, x, hit, c)
    if abs(b1) * float(np.std(x)) > STEEPEST or _is_step(x, hit, c, best):
        raise InputError(UNBOUNDED)
    if b1 <= 0:
        raise InputError(
            f"the share of flaws that are found does not grow with size (slope {b1:.3g}); "
            "no size is found with a probability of 90 %: check the columns"
        )
    # at the boundary the ceiling has no variance: the curve has two parameters
    free = estimated and c < 1.0 - 1e-6
    try:
        covariance = _compute_covariance(link, x, (b0, b1), c, 3 if free else 2)
    except np.linalg.LinAlgError:
        raise InputError(UNBOUNDED) from None
    at = 1.0 if estimated and not free else c
    return HitMiss(link, x, hit, b0, b1, at, estimated, covariance, best)


def check_hit_miss(x: Array, hit: Array) -> None:
    """Raise InputError for data without a curve, with one line that states what they show."""
    n, found = len(x), int(np.sum(hit))
    if n and found in (0, n):
        what = "found" if found else "missed"
        shown = (
            f"; this shows a POD of at least {bound_share(n, n)[0]:.3f} over these sizes with "
            f"{CONFIDENCE:.0%} confidence"
        )
        raise InputError(
            f"all {n} flaws were {what}: a curve requires hits and misses{shown if found else ''}"
        )
    if len(np.unique(x)) < 2:
        low = bound_share(found, n)[0]
        raise InputError(
            f"all {n} flaws have one size: a curve requires several; of this size {found} of {n} "
            f"were found, a POD of at least {low:.3f} with {CONFIDENCE:.0%} confidence"
        )
    hits, misses = x[hit > 0], x[hit == 0]
    if misses.max() <= hits.min():
        raise InputError(
            "hits and misses are separated by size: no flaw that was missed is larger than one "
            "that was found, so the slope of the curve is not bounded; add flaws around that size"
        )


def bound_share(found: int, of: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return one-sided bounds (lower, upper) of a share (Clopper and Pearson, Biometrika 26,
    1934)."""
    low = 0.0 if found == 0 else float(stats.beta.ppf(1.0 - confidence, found, of - found + 1))
    high = 1.0 if found == of else float(stats.beta.ppf(confidence, found + 1, of - found))
    return low, high
