"""Options of the fit of a curve, and their defaults from the table."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skywright.analysis.pod.links import AXES, BOUNDS, LINKS
from skywright.analysis.pod.table import Inspections
from skywright.errors import InputError


class Method(NamedTuple):
    """Options of the user; None: chosen from the data."""

    model: str | None = None  # "hit-miss" or "a-hat"
    link: str = "logit"
    size_axis: str | None = None
    signal_axis: str | None = None
    bounds: str = "wald"
    decision: float | None = None
    left: float | None = None
    right: float | None = None
    ceiling: float | str | None = None  # a number, "fit" or "contact"


def check_method(table: Inspections, method: Method) -> Method:
    """Return the method with model and ceiling. Raises InputError if the table does not suit
    them."""
    for name, value, valid in (
        ("--link", method.link, tuple(LINKS)), ("--bounds", method.bounds, BOUNDS),
        ("--size-axis", method.size_axis or AXES[0], AXES),
        ("--signal-axis", method.signal_axis or AXES[0], AXES),
    ):  # fmt: skip
        if value not in valid:
            raise InputError(f"{name} {value!r}; valid: {', '.join(valid)}")
    model = method.model
    if model is None:
        model = "hit-miss" if table.signal is None or (
            table.hit is not None and method.decision is None
        ) else "a-hat"  # fmt: skip
    if model == "a-hat":
        if table.signal is None:
            raise InputError("--model a-hat: the table has no column of signals")
        if method.decision is None or not math.isfinite(method.decision):
            raise InputError(
                "a-hat data require --decision Y: a flaw is called from this signal on"
            )
        if method.ceiling == "fit":
            raise InputError("--ceiling fit: valid for hit/miss data; give contact or a number")
        for name, limit in (("--left", method.left), ("--right", method.right)):
            if limit is not None and not math.isfinite(limit):
                raise InputError(f"{name} {limit:g}; valid: a finite signal")
        left, right = method.left, method.right
        if left is not None and right is not None and left >= right:
            raise InputError(f"--left {left:g} is not below --right {right:g}")
        low, high = -math.inf if left is None else left, math.inf if right is None else right
        if not low <= method.decision <= high:
            raise InputError(
                f"--decision {method.decision:g} lies outside --left and --right: no signal there "
                "was read"
            )
    elif model == "hit-miss":
        if table.hit is None:
            raise InputError("--model hit-miss: the table has no column of hits")
        if any(v is not None for v in (method.decision, method.left, method.right)):
            raise InputError("--decision, --left and --right are valid for a-hat data only")
    else:
        raise InputError(f"--model {model!r}; valid: hit-miss, a-hat")
    ceiling = method.ceiling
    if ceiling is None and table.contact is not None:
        ceiling = "contact"
    if ceiling == "contact" and table.contact is None:
        raise InputError("--ceiling contact: the table has no column contact of 0 and 1")
    if isinstance(ceiling, float) and not 0.0 < ceiling <= 1.0:
        raise InputError(f"--ceiling {ceiling:g}; valid: above 0, at most 1, fit or contact")
    return method._replace(model=model, ceiling=ceiling)


def list_variants(method: Method, table: Inspections) -> list[Method]:
    """Return the variants to fit: axes that are not given, and both links for comparison."""
    sizes = AXES if method.size_axis is None else (method.size_axis,)
    if method.model == "hit-miss":
        links = (method.link, *(name for name in LINKS if name != method.link))
        return [method._replace(link=link, size_axis=axis) for link in links for axis in sizes]
    signals = AXES if method.signal_axis is None else (method.signal_axis,)
    assert table.signal is not None and method.decision is not None
    least = float(np.min(table.signal))
    lowest = min(least if method.left is None else max(least, method.left), method.decision)
    if lowest <= 0:
        if method.signal_axis == "log":
            raise InputError(
                f"--signal-axis log: the least signal or limit is {lowest:g}; valid: above 0, "
                "or --left Y"
            )
        signals = ("linear",)
    return [method._replace(size_axis=x, signal_axis=y) for x in sizes for y in signals]
