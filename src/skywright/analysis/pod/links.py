"""Link functions of a curve, and axes of a flaw's size."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import special

from skywright.core.arrays import Array

CONFIDENCE = 0.95
"""Default one-sided confidence of bounds."""


class Link(NamedTuple):
    """A distribution function F of the linear predictor, with the functions that fits require."""

    name: str
    cdf: Callable[[Array], Array]
    log_cdf: Callable[[Array], Array]
    pdf: Callable[[Array], Array]
    quantile: Callable[[float], float]


def _logistic_pdf(eta: Array) -> Array:
    return np.asarray(special.expit(eta) * special.expit(-eta))


def _normal_pdf(eta: Array) -> Array:
    return np.asarray(np.exp(-0.5 * eta**2) / np.sqrt(2.0 * np.pi))


LOGIT = Link(
    "logit", special.expit, special.log_expit, _logistic_pdf, lambda p: float(special.logit(p))
)
PROBIT = Link(
    "probit", special.ndtr, special.log_ndtr, _normal_pdf, lambda p: float(special.ndtri(p))
)
LINKS = {link.name: link for link in (LOGIT, PROBIT)}
AXES = ("linear", "log")
BOUNDS = ("wald", "likelihood")


def to_axis(size: Array, axis: str) -> Array:
    """Return x of sizes: the size itself, or its natural logarithm."""
    return np.log(size) if axis == "log" else np.asarray(size, dtype=float)


def from_axis(x: float | None, axis: str) -> float | None:
    """Return the size of an x; None if x is None or the size is not finite."""
    if x is None or not np.isfinite(x):
        return None
    with np.errstate(over="ignore"):
        size = float(np.exp(x)) if axis == "log" else float(x)
    return size if np.isfinite(size) else None
