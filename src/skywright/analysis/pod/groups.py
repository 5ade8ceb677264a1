"""Comparison of groups of inspections: robots, laws, winds, inspectors."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from skywright.analysis.pod.method import Method
from skywright.analysis.pod.pod import Curve, Pod, compute_pod
from skywright.analysis.pod.table import Inspections
from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.recordings.text_table import read_number


class Compared(NamedTuple):
    """Curves of groups, and a test of whether they differ."""

    column: str
    groups: dict[str, Pod | str]  # a text is the reason why a group has no curve
    p_same: float
    """p-value of the hypothesis that all groups have one curve (likelihood-ratio test).

    Inspections of different groups count as independent, also those of one flaw.
    """

    def to_json(self) -> dict[str, Any]:
        """Return the part of `skywright pod --group --json` for the groups."""
        groups = {k: v.to_json() if isinstance(v, Pod) else v for k, v in self.groups.items()}
        return {"column": self.column, "p_same": self.p_same, "curves": groups}


PARTS, MANY = 3, 6
"""Number of ranges of a numeric column, and of distinct values from which it is divided."""


def divide(cells: tuple[str, ...]) -> NDArray[np.str_]:
    """Return the group (n,) of each row: its cell, or its range if there are many distinct
    numbers."""
    numbers = np.array([read_number(cell) for cell in cells])
    known = np.unique(numbers[np.isfinite(numbers)])
    if len(known) < MANY or not all(np.isfinite(numbers) | (np.array(cells) == "")):
        return np.array(cells)
    edges = np.quantile(numbers[np.isfinite(numbers)], np.linspace(0.0, 1.0, PARTS + 1))
    names = [f"{a} to {b}" for a, b in pairwise(_write_apart(edges))]
    part = np.clip(np.searchsorted(edges[1:-1], numbers, side="right"), 0, PARTS - 1)
    return np.array(
        [names[k] if np.isfinite(x) else "" for k, x in zip(part, numbers, strict=True)]
    )


def _write_apart(numbers: Array) -> list[str]:
    """Return numbers (n,) with three digits, or with the fewest that keep different ones apart."""
    different = len(np.unique(numbers))
    for digits in range(3, 17):
        written = [f"{x:.{digits}g}" for x in numbers]
        if len(set(written)) == different:
            return written
    return [repr(float(x)) for x in numbers]


def _sort_key(name: str) -> tuple[float, str]:
    """Sort numbers and ranges by value, before names."""
    number = read_number(name.partition(" ")[0])
    return number if np.isfinite(number) else np.inf, name


def _name_apart(table: Inspections, cells: NDArray[np.str_]) -> Inspections:
    """Return the table with other names of flaws in each group (n,).

    Passes over a flaw are then merged within a group only: the common curve and the curves of the
    groups are fitted to the same data.
    """
    if table.flaw is None:
        return table
    pairs = zip(table.flaw, cells.tolist(), strict=True)
    return table._replace(flaw=tuple(f"{cell}\0{name}" if name else "" for name, cell in pairs))


def compare_groups(table: Inspections, column: str, method: Method | None = None) -> Compared:
    """Fit a curve to each group of rows with one value of `column`, with the axes of all rows.

    Raises InputError if the column does not exist, or fewer than two groups yield a curve.
    """
    if column not in table.others:
        names = ", ".join(table.others) or "-"
        raise InputError(f"--group {column!r}: no such column; valid: {names}")
    whole = compute_pod(table, method)
    c = whole.curve
    fixed = (method or Method())._replace(
        size_axis=c.size_axis, signal_axis=c.signal_axis or None, model=c.model
    )
    cells = divide(table.others[column])
    groups: dict[str, Pod | str] = {}
    curves, used = list[Curve](), np.zeros(len(cells), bool)
    for value in sorted(set(cells.tolist()) - {""}, key=_sort_key):
        try:
            one = compute_pod(table.select(cells == value), fixed)
        except InputError as error:
            groups[value] = str(error)
            continue
        groups[value] = one
        curves.append(one.curve)
        used |= cells == value
    if len(curves) < 2:
        raise InputError(
            f"--group {column}: {len(curves)} of {len(groups)} groups give a curve; at least 2 are "
            "needed" + "".join(f"; {k}: {v}" for k, v in groups.items() if isinstance(v, str))[:300]
        )
    common = compute_pod(_name_apart(table, cells).select(used), fixed).curve
    gained = sum(one.log_likelihood for one in curves) - common.log_likelihood
    degrees = sum(one.parameters for one in curves) - common.parameters
    p = float(stats.chi2.sf(max(2.0 * gained, 0.0), degrees))
    return Compared(column, groups, p)
