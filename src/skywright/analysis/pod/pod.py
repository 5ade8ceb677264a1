"""Probability of detection from a table of inspections: curves, bounds, false calls, warnings."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.analysis.pod import a_hat
from skywright.analysis.pod.a_hat import AHat, Residuals, fit_a_hat, judge_residuals
from skywright.analysis.pod.hit_miss import (
    HitMiss,
    bound_share,
    estimate_ceiling,
    fit_below,
    fit_hit_miss,
)
from skywright.analysis.pod.links import AXES, CONFIDENCE, LINKS, from_axis, to_axis
from skywright.analysis.pod.method import Method, check_method, list_variants
from skywright.analysis.pod.samples import (
    Counted,
    FalseCalls,
    count_false_calls,
    merge_passes,
    warn_of_samples,
)
from skywright.analysis.pod.table import Inspections
from skywright.core.arrays import Array
from skywright.errors import InputError

LEVELS = (0.5, 0.9)
POINTS, FEWER_POINTS = 80, 30
"""Number of points of a drawn curve: with Wald bounds, and with likelihood bounds."""
CEILING_DROP = 2.706
"""Twice the gain of log-likelihood from which a ceiling below one is reported (5 %, one-sided)."""


class Ceiling(NamedTuple):
    """The POD that large sizes approach, because contact may be lost."""

    value: float
    lower: float  # one-sided 95 %
    source: str  # "given", "fit" or "contact"


class Curve(NamedTuple):
    """A fitted curve and its characteristic sizes in the unit of the table; None: none exists."""

    model: str
    link: str
    size_axis: str
    signal_axis: str  # "" for hit/miss
    bounds: str
    coefficients: dict[str, float]
    standard_errors: dict[str, float]
    log_likelihood: float
    parameters: int
    """Number of estimated parameters."""
    aic: float  # for the original signals: comparable between axes
    a50: float | None
    a90: float | None
    a90_95: float | None
    conditional: dict[str, float | None] | None  # the same three sizes, given contact
    ceiling: Ceiling | None
    sizes: Array  # (k,) of the drawn curve
    pod: Array  # (k,)
    lower: Array  # (k,)
    residuals: Residuals | None


class Pod(NamedTuple):
    """Result for a table of inspections."""

    unit: str
    inspections: Inspections  # one row per flaw or site, passes merged
    counted: Counted
    curve: Curve
    tried: list[dict[str, Any]]
    """Curves on other axes and with the other link, for comparison."""
    false_calls: FalseCalls | None
    warnings: list[str]

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright pod --json`."""
        c = self.curve
        return _clean({
            "model": c.model, "link": c.link, "size_axis": c.size_axis,
            "signal_axis": c.signal_axis or None, "bounds": c.bounds, "confidence": CONFIDENCE,
            "unit": self.unit, **self.counted._asdict(), "coefficients": c.coefficients,
            "standard_errors": c.standard_errors, "log_likelihood": c.log_likelihood, "aic": c.aic,
            "a50": c.a50, "a90": c.a90, "a90_95": c.a90_95, "conditional": c.conditional,
            "ceiling": None if c.ceiling is None else c.ceiling._asdict(),
            "false_calls": None if self.false_calls is None else self.false_calls._asdict(),
            "residuals": None if c.residuals is None else c.residuals._asdict(),
            "curve": {"size": c.sizes.tolist(), "pod": c.pod.tolist(), "lower": c.lower.tolist()},
            "tried": self.tried, "warnings": self.warnings,
        })  # fmt: skip


def _clean(value: Any) -> Any:
    """Replace NaN by None, recursively."""
    if isinstance(value, dict):
        return {key: _clean(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_clean(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def compute_pod(table: Inspections, method: Method | None = None) -> Pod:
    """Fit a curve to a table. Raises InputError if table and method do not determine one."""
    method = check_method(table, method or Method())
    merged, counted = merge_passes(table, method.model or "", method.decision)
    flawed = merged.select(merged.size > 0)
    if len(flawed.size) == 0:
        raise InputError("every size is 0: a curve requires flaws")
    calls = None
    if len(flawed.size) < len(merged.size):
        clean = merged.select(merged.size == 0)
        called = clean.hit if method.model == "hit-miss" else None
        if called is None:
            assert clean.signal is not None and method.decision is not None
            called = np.asarray(clean.signal >= method.decision, float)
        calls = count_false_calls(called)
    variants = list(list_variants(method, flawed))
    tried: list[dict[str, Any]] = []
    best: tuple[Method, Curve] | None = None
    refused: InputError | None = None
    for variant in variants:
        try:
            curve = _fit(flawed, variant)
        except InputError as error:
            refused = refused or error
            continue
        tried.append({
            "link": curve.link, "size_axis": curve.size_axis,
            "signal_axis": curve.signal_axis or None, "aic": curve.aic, "a90": curve.a90,
            "a90_95": curve.a90_95,
        })  # fmt: skip
        chosen = variant.link == method.link
        if chosen and (best is None or curve.aic < best[1].aic):
            best = variant, curve
    if best is None:
        assert refused is not None
        raise refused
    curve = _draw(flawed, *best)
    tried.sort(key=lambda one: float(one["aic"]))
    warnings = list(table.notes)
    warnings += warn_of_samples(merged, counted, method.model or "", curve.a90, curve.a90_95)
    warnings += _warn_of_curve(flawed, best[0], curve, tried)
    return Pod(table.unit, merged, counted, curve, tried, calls, warnings)


def _fit_conditional(table: Inspections, method: Method) -> HitMiss | AHat:
    """Fit the curve of the flaws with contact, or of all."""
    if method.ceiling == "contact":
        assert table.contact is not None
        table = table.select(table.contact > 0)
        if len(table.size) == 0:
            raise InputError("no flaw was inspected in contact (column contact)")
    assert method.size_axis is not None
    x = to_axis(table.size, method.size_axis)
    if method.model == "hit-miss":
        assert table.hit is not None
        given = method.ceiling if isinstance(method.ceiling, float) else 1.0
        return fit_hit_miss(
            x, table.hit, LINKS[method.link], None if method.ceiling == "fit" else given
        )
    assert table.signal is not None and method.signal_axis is not None
    assert method.decision is not None
    y = table.signal
    side = np.full(len(y), a_hat.OBSERVED)
    if method.left is not None:
        side[y <= method.left] = a_hat.LEFT
        y = np.maximum(y, method.left)
    if method.right is not None:
        side[y >= method.right] = a_hat.RIGHT
        y = np.minimum(y, method.right)
    decision = float(to_axis(np.array(method.decision), method.signal_axis))
    return fit_a_hat(x, to_axis(y, method.signal_axis), side, decision)


def _find_ceiling(table: Inspections, method: Method, fit: HitMiss | AHat) -> Ceiling | None:
    if method.ceiling == "contact":
        assert table.contact is not None
        held, n = int(table.contact.sum()), len(table.contact)
        return Ceiling(held / n, bound_share(held, n)[0], "contact")
    if method.ceiling == "fit" and isinstance(fit, HitMiss):
        return Ceiling(fit.ceiling, fit.compute_ceiling_lower(), "fit")
    if isinstance(method.ceiling, float) and method.ceiling < 1.0:
        return Ceiling(method.ceiling, method.ceiling, "given")
    return None


def _fit(table: Inspections, method: Method) -> Curve:
    """Fit one variant, without the points of the drawn curve."""
    fit = _fit_conditional(table, method)
    ceiling = _find_ceiling(table, method, fit)
    axis = method.size_axis or AXES[0]
    a50, a90, bound = (from_axis(x, axis) for x in _read_off(fit, ceiling, method, table))
    conditional = None
    if ceiling is not None:
        inner, c = fit, 1.0
        if isinstance(fit, HitMiss):  # the curve below its ceiling c is F = POD / c
            # without the row of an estimated c, the covariance is that of F, with c's uncertainty
            scaled = fit.covariance[:2, :2]
            inner, c = fit._replace(ceiling_fitted=False, covariance=scaled), fit.ceiling
        bounds = "wald" if ceiling.source == "fit" else method.bounds
        sizes = [inner.find(level * c) for level in LEVELS]
        sizes.append(inner.find_bound(LEVELS[1] * c, bounds))
        keys = ("a50", "a90", "a90_95")
        conditional = {key: from_axis(x, axis) for key, x in zip(keys, sizes, strict=True)}
    names = ("b0", "b1", "ceiling") if isinstance(fit, HitMiss) else ("b0", "b1", "ln_s")
    errors = dict(zip(names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=False))
    coefficients = {"b0": fit.b0, "b1": fit.b1}
    jacobian = 0.0
    if isinstance(fit, AHat):
        coefficients |= {"s": fit.s, "mu": fit.mu, "sigma": fit.sigma}
        if method.signal_axis == "log":  # densities of the signal instead of its logarithm
            jacobian = -float(np.sum(fit.y[fit.censored == a_hat.OBSERVED]))
    log_likelihood = fit.log_likelihood + jacobian
    none = np.empty(0)
    return Curve(
        method.model or "", method.link if isinstance(fit, HitMiss) else "probit", axis,
        method.signal_axis or "" if isinstance(fit, AHat) else "", method.bounds, coefficients,
        errors, log_likelihood, fit.parameters, 2.0 * fit.parameters - 2.0 * log_likelihood,
        a50, a90, bound, conditional, ceiling, none, none, none,
        judge_residuals(fit) if isinstance(fit, AHat) else None,
    )  # fmt: skip


def _split_confidence(ceiling: Ceiling | None, table: Inspections) -> tuple[float, float]:
    """Return (confidence of the conditional bound, lower bound of the ceiling as its factor).

    Contact and detection are bounded separately, each with half of the risk (Bonferroni).
    """
    if ceiling is None or ceiling.source == "fit":
        return CONFIDENCE, 1.0
    if ceiling.source == "given":
        return CONFIDENCE, 1.0
    assert table.contact is not None
    half = 1.0 - 0.5 * (1.0 - CONFIDENCE)
    return half, bound_share(int(table.contact.sum()), len(table.contact), half)[0]


def _read_off(
    fit: HitMiss | AHat, ceiling: Ceiling | None, method: Method, table: Inspections
) -> tuple[float | None, float | None, float | None]:
    """Return x for 50 % and 90 % of the total POD, and the 95 % bound of the latter."""
    confidence, lowest = _split_confidence(ceiling, table)
    if ceiling is not None and (ceiling.source == "contact" or isinstance(fit, AHat)):
        c, low = ceiling.value, lowest if ceiling.source == "contact" else ceiling.value
        a50 = fit.find(LEVELS[0] / c) if c > LEVELS[0] else None
        if ceiling.lower <= LEVELS[1]:
            return a50, None, None
        a90 = fit.find(LEVELS[1] / c)
        bound = fit.find_bound(LEVELS[1] / low, method.bounds, confidence) if (
            low > LEVELS[1]
        ) else None  # fmt: skip
        return a50, a90, bound
    a50 = fit.find(LEVELS[0])
    if ceiling is not None and ceiling.lower <= LEVELS[1]:
        return a50, None, None
    return a50, fit.find(LEVELS[1]), fit.find_bound(LEVELS[1], method.bounds)


def _draw(table: Inspections, method: Method, curve: Curve) -> Curve:
    """Return the curve with the points to draw."""
    fit = _fit_conditional(table, method)
    points = POINTS if method.bounds == "wald" else FEWER_POINTS
    low, high = float(table.size.min()), float(table.size.max())
    high = max(high, *(v for v in (curve.a90, curve.a90_95) if v is not None and v < 3 * high), 0.0)
    low = 0.8 * low if curve.size_axis == "log" else 0.0
    sizes = np.linspace(low, 1.05 * high, points)
    if curve.size_axis == "log":
        sizes = np.geomspace(max(low, 1e-9 * high), 1.05 * high, points)
    x = to_axis(sizes, curve.size_axis)
    confidence, lowest = _split_confidence(curve.ceiling, table)
    pod, lower = fit.compute(x), fit.compute_lower(x, method.bounds, confidence)
    c = curve.ceiling
    if c is not None and (c.source == "contact" or isinstance(fit, AHat)):
        pod = c.value * pod
        lower = (lowest if c.source == "contact" else c.value) * lower
    return curve._replace(sizes=sizes, pod=pod, lower=lower)


def _warn_of_ceiling(table: Inspections, method: Method, curve: Curve) -> list[str]:
    """Return a warning if a ceiling explains hits and misses better than the curve without one."""
    assert table.hit is not None and method.size_axis is not None
    x = to_axis(table.size, method.size_axis)
    ceiling, log_likelihood = estimate_ceiling(x, table.hit, LINKS[method.link])
    if 2.0 * (log_likelihood - curve.log_likelihood) <= CEILING_DROP:
        return []
    what = f"a ceiling of {ceiling:.3f} fits the misses of large flaws better; without it a90 "
    try:
        fit_below(x, table.hit, LINKS[method.link], ceiling, estimated=True)
    except InputError as error:
        return [f"{what}misleads, and with it {error}"]
    return [f"{what}misleads: use --ceiling fit, or a column contact"]


def _warn_of_curve(
    table: Inspections, method: Method, curve: Curve, tried: list[dict[str, Any]]
) -> list[str]:
    """Return warnings about the form of the curve."""
    out = []
    if curve.ceiling is not None and curve.ceiling.lower <= LEVELS[1]:
        out.append(
            f"the POD has a ceiling of {curve.ceiling.value:.3f} (at least "
            f"{curve.ceiling.lower:.3f} with {CONFIDENCE:.0%} confidence): no a90 of the total "
            "POD exists"
        )
    if method.ceiling is None and method.model == "hit-miss":
        out += _warn_of_ceiling(table, method, curve)
    if curve.a90 is not None and curve.a90_95 is None:
        out.append("no a90/95 exists: the lower bound never reaches 90 %; more flaws are needed")
    if curve.residuals is not None:
        for p, what in zip(
            curve.residuals,
            ("are not normal", "grow or shrink with size", "bend about the line"), strict=True,
        ):  # fmt: skip
            if p < 0.01:
                out.append(f"the residuals {what} (p = {p:.2g}): try other axes")
    values = [one["a90_95"] for one in tried if one["aic"] < tried[0]["aic"] + 4.0]
    known = [v for v in values if v is not None]
    if len(known) > 1 and max(known) > 1.2 * min(known):
        out.append(
            f"models that fit about as well give an a90/95 of {min(known):.4g} to "
            f"{max(known):.4g}: state the model with the result"
        )
    return out
