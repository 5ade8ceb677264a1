"""Input (a session) and output (rows) of a benchmark."""

import math
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from skywright.errors import InputError

T = TypeVar("T")

Effort = Literal["quick", "default", "full"]
"""quick: seconds, a functional check; default: minutes; full: unlimited."""


class Session(NamedTuple):
    """Settings that all benchmarks of one call share."""

    effort: Effort
    scratch: Path
    """An empty folder that is removed at the end."""
    workers: int = 1
    """Number of processes for work that can be shared; single-process timings ignore it."""
    resume: Path | None = None
    """Folder that keeps finished parts of long benchmarks."""

    def pick(self, quick: T, default: T, full: T) -> T:
        """Choose a value by the effort."""
        return {"quick": quick, "default": default, "full": full}[self.effort]


class Row(NamedTuple):
    """One measured value, with a name such as `benchmark.what_unit`, as for metrics."""

    name: str
    value: float | None
    """Median of the repetitions; None if it could not be measured (`note` gives the reason)."""
    unit: str
    limit: float | None
    sense: str
    """Comparison of value and limit: "<=" or ">="; empty without a limit."""
    passed: bool | None
    low: float | None
    """Lower quartile of the repetitions; None for a single one."""
    high: float | None
    repetitions: int
    note: str

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright bench --json`, with five digits."""

        def short(x: object) -> object:
            return float(f"{x:.5g}") if isinstance(x, float) else x

        return {k: short(v) for k, v in self._asdict().items()}


def build_row(
    name: str,
    values: float | Sequence[float],
    unit: str = "",
    *,
    limit: float | None = None,
    sense: Literal["<=", ">="] = "<=",
    note: str = "",
) -> Row:
    """Build a row from one value or from repetitions. A ratio has no unit.

    Raises InputError if a value is not finite.
    """
    many = [float(v) for v in np.atleast_1d(np.asarray(values, dtype=float))]
    if not many or not all(math.isfinite(v) for v in many):
        raise InputError(f"benchmark row {name!r}: not a finite number: {many}")
    value = statistics.median(many)
    low, high = None, None
    if len(many) > 1:
        low, high = (float(x) for x in np.quantile(many, (0.25, 0.75)))
    passed = None
    if limit is not None:
        passed = value <= limit if sense == "<=" else value >= limit
    return Row(
        name, value, unit, limit, sense if limit is not None else "", passed, low, high,
        len(many), note,
    )  # fmt: skip


def build_unmeasured_row(name: str, why: str, *, failed: bool = False) -> Row:
    """Build the row of a value that is unavailable here, or of a benchmark that failed."""
    return Row(name, None, "", None, "", False if failed else None, None, None, 0, why)
