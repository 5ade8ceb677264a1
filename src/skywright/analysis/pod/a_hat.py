"""Signal against size: a linear regression with censored signals, by maximum likelihood.

    y = b0 + b1 x + e,  e ~ N(0, s^2),   POD(x) = Phi((x - mu) / sigma)
    mu = (y_dec - b0) / b1,  sigma = s / b1

x is the size or its logarithm, y the signal or its logarithm (MIL-HDBK-1823A, appendix G).
A censored signal contributes the probability of lying beyond its limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import optimize, stats
from scipy.special import log_ndtr, ndtr, ndtri

from skywright.analysis.pod.hit_miss import FARTHEST
from skywright.analysis.pod.links import CONFIDENCE
from skywright.core.arrays import Array
from skywright.errors import InputError

GRID = ndtri(np.linspace(0.02, 0.995, 40))
LEFT, OBSERVED, RIGHT = -1, 0, 1


class AHat(NamedTuple):
    """A fitted line; `covariance` is that of (b0, b1, ln s)."""

    x: Array  # (n,)
    y: Array  # (n,)
    censored: Array  # (n,) LEFT, OBSERVED or RIGHT: y is then the limit
    decision: float  # in the units of y
    b0: float
    b1: float
    s: float
    covariance: Array
    log_likelihood: float

    @property
    def parameters(self) -> int:
        """Number of estimated parameters."""
        return 3

    @property
    def mu(self) -> float:
        """x at which the POD is one half."""
        return (self.decision - self.b0) / self.b1

    @property
    def sigma(self) -> float:
        """Width of the curve in x."""
        return self.s / self.b1

    def compute(self, x: Array) -> Array:
        """Return the POD (n,) at x (n,)."""
        return np.asarray(ndtr((np.asarray(x, float) - self.mu) / self.sigma))

    def find(self, p: float) -> float | None:
        """Return the x at which the POD is p; None for p of 1 and more."""
        return None if p >= 1.0 else self.mu + float(ndtri(p)) * self.sigma

    def compute_lower(self, x: Array, bounds: str, confidence: float = CONFIDENCE) -> Array:
        """Return a one-sided lower bound (n,) of the POD at x (n,), by inverting the bound of
        sizes.

        It is interpolated between 40 quantiles (20 for the likelihood).
        """
        grid = GRID if bounds == "wald" else GRID[::2]
        at = [self.find_bound(float(ndtr(q)), bounds, confidence) for q in grid]
        known = [(b, q) for b, q in zip(at, grid, strict=True) if b is not None]
        if not known:
            return np.zeros(np.shape(x))
        xs, qs = np.maximum.accumulate([b for b, _ in known]), np.array([q for _, q in known])
        slope = (qs[1] - qs[0]) / max(xs[1] - xs[0], 1e-300) if len(xs) > 1 else 0.0
        eta = np.interp(x, xs, qs)
        return np.asarray(ndtr(np.where(x < xs[0], qs[0] + slope * (x - xs[0]), eta)))

    def find_bound(self, p: float, bounds: str, confidence: float = CONFIDENCE) -> float | None:
        """Return the upper bound of the x at which the POD is p; None if there is none."""
        start = self.find(p)
        if start is None:
            return None
        z, q = float(stats.norm.ppf(confidence)), float(ndtri(p))
        if bounds == "wald":
            gradient = np.array([-1.0, -start, q * self.s]) / self.b1
            return start + z * float(np.sqrt(gradient @ self.covariance @ gradient))
        drop, width = 0.5 * z**2, max(float(np.ptp(self.x)), 1e-9)

        def excess(x: float) -> float:
            return self.log_likelihood - self._maximise(x, q) - drop

        step, low = 0.01 * width, start
        while step < FARTHEST * width:
            if excess(start + step) > 0:
                return float(optimize.brentq(excess, low, start + step, xtol=1e-10))
            low, step = start + step, 1.6 * step
        return None

    def _maximise(self, x: float, q: float) -> float:
        """Return the log-likelihood with quantile q of the curve at x, maximized over slope and
        s."""

        def cost(free: Array) -> tuple[float, Array]:
            s = float(np.exp(free[1]))
            theta = np.array([self.decision + q * s - free[0] * x, free[0], free[1]])
            value, g, _ = _differentiate(theta, self.x, self.y, self.censored)
            return -value, -np.array([g[1] - x * g[0], g[2] + q * s * g[0]])

        found = optimize.minimize(cost, [self.b1, np.log(self.s)], jac=True, method="BFGS")
        return -float(found.fun)


def _differentiate(theta: Array, x: Array, y: Array, side: Array) -> tuple[float, Array, Array]:
    """Return the log-likelihood with gradient (3,) and Hessian (3, 3) in (b0, b1, ln s)."""
    s = float(np.exp(theta[2]))
    r = (y - theta[0] - theta[1] * x) / s
    seen = side == OBSERVED
    sign = np.where(side == RIGHT, -1.0, 1.0)  # of r in the normal integral
    v = sign * r
    h = np.exp(-0.5 * v**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(v))  # the inverse Mills ratio
    h1 = -h * (v + h)
    value = np.where(seen, -theta[2] - 0.5 * r**2 - 0.5 * np.log(2.0 * np.pi), log_ndtr(v))
    dm = np.where(seen, r, -sign * h) / s
    ds = np.where(seen, r**2 - 1.0, -v * h)
    mm = np.where(seen, -1.0, h1) / s**2
    ms = np.where(seen, -2.0 * r, sign * (v * h1 + h)) / s
    ss = np.where(seen, -2.0 * r**2, v * h + v**2 * h1)
    design = np.stack([np.ones_like(x), x], axis=1)
    gradient = np.concatenate([design.T @ dm, [ds.sum()]])
    hessian = np.empty((3, 3))
    hessian[:2, :2] = (design * mm[:, None]).T @ design
    hessian[2, :2] = hessian[:2, 2] = design.T @ ms
    hessian[2, 2] = ss.sum()
    return float(value.sum()), gradient, hessian


def fit_a_hat(x: Array, y: Array, censored: Array, decision: float) -> AHat:
    """Fit a line to x (n,), y (n,), both in axis units, like `decision`.

    Raises InputError if the data do not determine a line.
    """
    if len(np.unique(x)) < 2:
        raise InputError(f"all {len(x)} flaws have one size: a curve requires several")
    if np.count_nonzero(censored == OBSERVED) < 3 or len(np.unique(x[censored == OBSERVED])) < 2:
        raise InputError(
            f"{np.count_nonzero(censored == OBSERVED)} of {len(x)} signals lie within --left and "
            "--right; a line requires three of them, of two sizes"
        )
    b1, b0 = np.polyfit(x, y, 1)
    s = float(np.std(y - b0 - b1 * x))
    if not s > 1e-9 * max(float(np.ptp(y)), 1e-300):
        raise InputError("the signals lie on a line without any scatter; no bound can be computed")
    theta = np.array([b0, b1, np.log(s)])
    value, gradient, hessian = _differentiate(theta, x, y, censored)
    for _ in range(200):
        damped = -hessian
        try:
            np.linalg.cholesky(damped)
        except np.linalg.LinAlgError:  # far from the maximum: shift the Hessian to be definite
            damped = damped + (abs(np.linalg.eigvalsh(damped)[0]) * 2.0 + 1e-9) * np.eye(3)
        step, rate = np.linalg.solve(damped, gradient), 1.0
        while rate > 1e-8 and not _differentiate(theta + rate * step, x, y, censored)[0] >= value:
            rate *= 0.5
        theta = theta + rate * step
        before = value
        value, gradient, hessian = _differentiate(theta, x, y, censored)
        if rate <= 1e-8 or value - before < 1e-13 * (1.0 + abs(value)):
            break
    if theta[1] <= 0:
        raise InputError(
            f"the signal does not grow with size (slope {theta[1]:.3g}); check the columns"
        )
    covariance = np.asarray(np.linalg.inv(-hessian), float)
    return AHat(
        x, y, censored, decision, float(theta[0]), float(theta[1]), float(np.exp(theta[2])),
        covariance, value,
    )  # fmt: skip


class Residuals(NamedTuple):
    """p-values of tests that the line suits the data."""

    normal_p: float  # Shapiro and Wilk, Biometrika 52, 1965
    equal_variance_p: float  # Breusch and Pagan with Koenker's n R^2, J. Econometrics 17, 1981
    straight_p: float  # t of a quadratic term


def judge_residuals(fit: AHat) -> Residuals:
    """Test the residuals of the uncensored signals; NaN if they are too few."""
    seen = fit.censored == OBSERVED
    x, r = fit.x[seen], (fit.y - fit.b0 - fit.b1 * fit.x)[seen]
    if len(r) < 8 or len(np.unique(x)) < 3:
        return Residuals(np.nan, np.nan, np.nan)
    squared = r**2
    share = np.corrcoef(x, squared)[0, 1] ** 2
    u = (x - x.mean()) / x.std()
    design = np.stack([np.ones_like(u), u, u**2], axis=1)
    b, *_ = np.linalg.lstsq(design, fit.y[seen], rcond=None)
    left = fit.y[seen] - design @ b
    variance = float(left @ left) / (len(r) - 3) * np.linalg.inv(design.T @ design)[2, 2]
    curved = 2.0 * stats.t.sf(abs(b[2]) / np.sqrt(variance), len(r) - 3)
    return Residuals(
        float(stats.shapiro(r[:5000]).pvalue), float(stats.chi2.sf(len(r) * share, 1)),
        float(curved),
    )  # fmt: skip
