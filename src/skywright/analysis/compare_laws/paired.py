"""Paired differences of two laws on the same runs: size and significance.

Both laws fly run i with the same seed and the same drawn conditions. The difference of a metric
within a run therefore excludes the variation between runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # scipy loads scipy.stats (1 s) at its first use

from skywright.core.arrays import Array
from skywright.run.rows import CONFIDENCE, Row

FEWEST = 6
"""Minimum number of pairs for a p-value and an interval. The exact test of 5 pairs cannot fall
below 0.0625, and the bootstrap interval of so few has too little coverage. With 6 pairs a
difference is significant only if most tests of the page agree; 10 pairs suffice for a single one in
25 tests."""
RESAMPLES = 2000
RESPONSE = "response."
"""Beginning of the names of the metrics of a response to a fault."""


class Difference(NamedTuple):
    """Difference of a metric between a law and the reference law, over the runs that both flew."""

    law: str
    case: str
    metric: str
    pairs: int
    reference: float  # median of the reference law over these runs
    median: float  # of the differences; negative: the law has the smaller value
    low: float  # 95 % interval of that median, bootstrap; NaN below FEWEST pairs
    high: float
    p: float  # Wilcoxon's signed-rank test, two-sided; NaN below FEWEST pairs
    is_zero: bool  # whether the difference is zero in every run


def pair_rows(reference: Sequence[Row], rows: Sequence[Row], metric: str) -> tuple[Array, Array]:
    """Return the metric's values (n,) of both laws, for the runs that both completed.

    Metrics of the response to a fault judge the flight to its end, also where the fault ended the
    mission: they are paired in these runs too.
    """
    ended = metric.startswith(RESPONSE)
    known = {r.run: r.metrics.get(metric, math.nan) for r in reference if r.completed or ended}
    both = [
        (known[r.run], r.metrics.get(metric, math.nan))
        for r in rows
        if r.run in known and (r.completed or ended)
    ]
    values = np.array([pair for pair in both if all(map(math.isfinite, pair))]).reshape(-1, 2)
    return values[:, 0], values[:, 1]


def compare_metric(
    law: str, case: str, metric: str, reference: Array, values: Array
) -> Difference | None:
    """Compare paired values (n,); return None without pairs."""
    n = len(values)
    if n == 0:
        return None
    d = values - reference
    median = float(np.median(d))
    low = high = median if n >= FEWEST else math.nan
    if n >= FEWEST and np.ptp(d) > 0.0:
        found = scipy.stats.bootstrap(
            (d,), np.median, confidence_level=CONFIDENCE, n_resamples=RESAMPLES,
            method="percentile", rng=np.random.default_rng(0),
        ).confidence_interval  # fmt: skip
        low, high = float(found.low), float(found.high)
    p = math.nan
    if n >= FEWEST:
        p = float(scipy.stats.wilcoxon(d).pvalue) if np.any(d != 0.0) else 1.0
    return Difference(
        law, case, metric, n, float(np.median(reference)), median, low, high, p, not np.any(d)
    )


def find_significant(differences: Sequence[Difference]) -> set[tuple[str, str, str]]:
    """Return (law, case, metric) of the significant differences.

    The procedure of Benjamini and Hochberg over all tests limits the false discovery rate to 5 %.
    Differences that are zero in all runs are not tested.
    """
    tested = [d for d in differences if math.isfinite(d.p) and not d.is_zero]
    if not tested:
        return set()
    adjusted = scipy.stats.false_discovery_control([d.p for d in tested])
    return {
        (d.law, d.case, d.metric)
        for d, p in zip(tested, adjusted, strict=True)
        if p <= 1.0 - CONFIDENCE
    }
