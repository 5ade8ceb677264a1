"""What a benchmark is given (a session) and what it returns (rows)."""

import math
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from skywright.errors import InputError

T = TypeVar("T")

Effort = Literal["quick", "default", "full"]
"""quick: seconds, to see that everything works; default: minutes; full: as long as it takes."""


class Session(NamedTuple):
    """What every benchmark of one call shares."""

    effort: Effort
    scratch: Path
    """An empty folder that is removed at the end."""
    workers: int = 1
    """Processes that a benchmark may share its work among; those that time one process do not."""
    resume: Path | None = None
    """Folder that keeps finished parts of long benchmarks."""

    def pick(self, quick: T, default: T, full: T) -> T:
        """Choose by effort."""
        return {"quick": quick, "default": default, "full": full}[self.effort]


class Row(NamedTuple):
    """One measured number. Names are `benchmark.what_unit`, as those of metrics."""

    name: str
    value: float | None
    """Median of the repetitions; None where it could not be measured (`note` says why)."""
    unit: str
    limit: float | None
    sense: str
    """How value and limit compare: "<=" or ">="; empty without a limit."""
    passed: bool | None
    low: float | None
    """Lower quartile of the repetitions; None of a single one."""
    high: float | None
    repetitions: int
    note: str

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright bench --json`, numbers with five digits."""

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

    A value that is not finite raises InputError: it was not measured, and nobody should read it.
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
    """Build the row of a number that does not exist here, or of a benchmark that failed."""
    return Row(name, None, "", None, "", False if failed else None, None, None, 0, why)
