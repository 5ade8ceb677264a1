"""Counts of a table: passes over a flaw, false calls, and warnings about the sample size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skywright.analysis.pod.hit_miss import bound_share
from skywright.analysis.pod.table import Inspections
from skywright.core.arrays import Array
from skywright.errors import InputError

ENOUGH = {"hit-miss": 60, "a-hat": 40}
"""Minimum number of flaws of MIL-HDBK-1823A."""
CLEAN_SITES = 3
"""Minimum number of sites without a flaw per flaw."""


class Counted(NamedTuple):
    """Counts of a table."""

    rows: int
    flaws: int
    passes_merged: int
    """Rows that were further passes over a flaw; a flaw counts once."""
    clean_sites: int
    found: int


class FalseCalls(NamedTuple):
    """Calls at sites without a flaw."""

    sites: int
    calls: int
    rate: float
    upper_95: float


def count_false_calls(called: Array) -> FalseCalls:
    """Count false calls in `called` (n,) of 0 and 1."""
    n, k = len(called), int(called.sum())
    return FalseCalls(n, k, k / n, bound_share(k, n)[1])


def merge_passes(
    table: Inspections, model: str, decision: float | None
) -> tuple[Inspections, Counted]:
    """Return one row per flaw: found if any pass found it, with the largest signal.

    It had contact if any pass had contact. Rows without a name in the column `flaw` are not merged.
    Raises InputError if passes over one flaw have different sizes.
    """
    n, merged = len(table.size), table
    if table.flaw is not None:
        groups: dict[str, list[int]] = {}
        for i, name in enumerate(table.flaw):
            groups.setdefault(name or f"\0{i}", []).append(i)
        for name, rows in groups.items():
            sizes = table.size[rows]
            if np.ptp(sizes) > 0:
                raise InputError(
                    f"flaw {name!r} has the sizes {sizes.min():g} and {sizes.max():g}; rows with "
                    "one name are passes over one flaw"
                )
        first = np.zeros(n, bool)
        first[[rows[0] for rows in groups.values()]] = True

        def largest(column: Array | None) -> Array | None:
            if column is None:
                return None
            return np.array([column[rows].max() for rows in groups.values()])

        merged = table.select(first)._replace(
            hit=largest(table.hit), signal=largest(table.signal), contact=largest(table.contact)
        )
    flawed = merged.size > 0
    called = merged.hit
    if model == "a-hat" and merged.signal is not None and decision is not None:
        called = np.asarray(merged.signal >= decision, float)
    found = 0 if called is None else int(called[flawed].sum())
    flaws = int(flawed.sum())
    return merged, Counted(n, flaws, n - len(merged.size), len(merged.size) - flaws, found)


def warn_of_samples(
    table: Inspections, counted: Counted, model: str, a90: float | None, a90_95: float | None
) -> list[str]:
    """Return warnings about the sample, one sentence each."""
    out = []
    if counted.flaws < ENOUGH[model]:
        out.append(f"{counted.flaws} flaws; {model} data should have at least {ENOUGH[model]}")
    if counted.clean_sites < CLEAN_SITES * counted.flaws:
        out.append(
            f"{counted.clean_sites} sites without a flaw; there should be at least "
            f"{CLEAN_SITES} for each of the {counted.flaws} flaws to estimate the rate of "
            "false calls (rows of size 0)"
        )
    sizes = table.size[table.size > 0]
    if a90_95 is not None and a90_95 > sizes.max():
        out.append(f"a90/95 lies beyond the largest flaw ({sizes.max():.4g}): it is extrapolated")
    elif a90 is not None and (a90 > sizes.max() or a90 < sizes.min()):
        out.append("a90 lies outside the sizes of the flaws: it is extrapolated")
    if len(np.unique(sizes)) < 5:
        out.append(f"{len(np.unique(sizes))} different sizes; at least 5 are recommended")
    return out
