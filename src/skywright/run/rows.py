"""A run of a campaign as one row, and statistics of rows: success rate, failures, sensitivities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads scipy.stats (1 s) at its first use
from numpy.typing import NDArray

from skywright.description.mission.spec import Requirement
from skywright.run.flight import NO_TAKE_OFF

Value = float | int | str | bool
Array = NDArray[np.float64]

CONFIDENCE = 0.95
"""Confidence of every interval; one minus it is the false discovery rate of the sensitivities."""

FEWEST = 10
"""Rows below which no sensitivity is computed."""


class Row(NamedTuple):
    """One run of a campaign: conditions, outcome and metrics. NaN stands for "not measured"."""

    run: int
    seed: int
    outcome: str
    """succeeded, failed, aborted, diverged; infeasible (no plan), refused (inconsistent values),
    crashed (the process died or the program failed)."""
    requirement: str
    """First requirement that failed, "evaluation" if that failed instead; the outcome if the
    mission was not completed; else ""."""
    failed: tuple[str, ...]
    """Every requirement that failed."""
    reason: str
    varied: dict[str, Value]
    metrics: dict[str, float]
    timing: dict[str, float]
    attempts: int
    command: str
    """Command that repeats this run alone."""
    inspected: dict[str, Any] | None = None
    """Detection results for the flaws of the true world, in the format of run/inspected.py."""

    @property
    def succeeded(self) -> bool:
        """Whether every requirement was met."""
        return self.outcome == "succeeded"

    @property
    def took_off(self) -> bool:
        """Whether it was flown: there was a plan, and no check on the ground ended it."""
        refused = self.outcome in ("infeasible", "refused")
        return not refused and not self.reason.startswith(NO_TAKE_OFF)

    @property
    def completed(self) -> bool:
        """Whether the mission came to its end; other metrics cover only a part of it."""
        return self.outcome in ("succeeded", "failed")


class Sensitivity(NamedTuple):
    """How a metric depends on a varied key over all rows."""

    metric: str
    key: str
    rho: float
    """Spearman's rank correlation; NaN if the key is not a number."""
    share: float
    """Share of the metric's rank variance that the key alone explains, whatever the shape."""
    p: float
    """Probability of such a dependence by chance."""
    significant: bool
    """Significant by Benjamini and Hochberg's procedure at a false discovery rate of 5 %."""


class Headroom(NamedTuple):
    """Distance of the runs from a requirement's limit."""

    name: str
    limit: float
    sense: str
    unit: str
    median: float
    worst: float
    used: float
    """|worst - median| / |limit - median|: 1 means that the worst run reaches the limit."""
    failures: int
    measured: int


class FailureGroup(NamedTuple):
    """Runs that failed for the same reason, and their range in the varied space."""

    requirement: str
    runs: tuple[int, ...]
    key: str
    """Key that separates them best from the others; "" if no separation is significant."""
    inside: tuple[float, float]
    """Range of that key over the failures."""
    whole: tuple[float, float]
    """Range of that key over all runs."""
    p: float
    """p-value of the separation (Mann-Whitney, times the number of keys)."""


def compute_interval(succeeded: int, runs: int, confidence: float = CONFIDENCE) -> Array:
    """Wilson score interval (2,) of a success rate (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    found = scipy.stats.binomtest(succeeded, runs).proportion_ci(confidence, method="wilson")
    return np.array([found.low, found.high])


def compute_headroom(
    rows: Sequence[Row], requirements: Mapping[str, Requirement]
) -> list[Headroom]:
    """Compare each requirement's limit with the median and the worst value, tightest first."""
    out = []
    for name, r in requirements.items():
        values = np.array([row.metrics.get(name, math.nan) for row in rows])
        values = values[np.isfinite(values)]
        failures = sum(name in row.failed for row in rows)
        if len(values) == 0:
            out.append(
                Headroom(name, r.limit, r.sense, r.unit, math.nan, math.nan, 0.0, failures, 0)
            )
            continue
        median = float(np.median(values))
        if r.sense == "==":
            worst = float(values[np.argmax(np.abs(values - r.limit))])
        else:
            worst = float(values.max() if r.sense in ("<", "<=") else values.min())
        room = abs(r.limit - median)
        used = abs(worst - median) / room if room > 0 else (0.0 if worst == median else math.inf)
        out.append(
            Headroom(
                name, r.limit, r.sense, r.unit, median, worst, used, failures, len(values)
            )
        )  # fmt: skip
    return sorted(out, key=lambda h: (-h.failures, -h.used))


def compute_sensitivities(
    rows: Sequence[Row], keys: Sequence[str], metrics: Sequence[str]
) -> list[Sensitivity]:
    """Compute rank statistics of every metric against every varied key.

    `rho` is Spearman's. `share` is epsilon squared of Kruskal and Wallis' test over bins of the key
    with equally many rows (its distinct values if they are few): a key that acts in both
    directions, like a wind direction, has rho near 0 but a large share. `p` is twice the smaller
    p-value of the two tests. Rows in which the metric was not measured are excluded.
    """
    found: list[Sensitivity] = []
    for metric in metrics:
        y_all = np.array([row.metrics.get(metric, math.nan) for row in rows])
        for key in keys:
            have = np.array(
                [math.isfinite(y) and key in r.varied for y, r in zip(y_all, rows, strict=True)]
            )
            y = y_all[have]
            x = [r.varied[key] for r, ok in zip(rows, have, strict=True) if ok]
            if len(y) < FEWEST or np.ptp(y) == 0.0 or len(set(x)) < 2:
                continue
            numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in x)
            rho, p_rho = math.nan, 1.0
            if numeric:
                test = scipy.stats.spearmanr(np.array(x, float), y)
                rho, p_rho = float(test.statistic), float(test.pvalue)
            share, p_share = _compute_share(_bin(x, numeric), y)
            p = min(2.0 * min(p_rho, p_share), 1.0)
            found.append(Sensitivity(metric, key, rho, share, p, False))
    if not found:
        return []
    adjusted = scipy.stats.false_discovery_control([s.p for s in found], method="bh")
    return [
        s._replace(significant=bool(a <= 1.0 - CONFIDENCE))
        for s, a in zip(found, adjusted, strict=True)
    ]


def _bin(x: Sequence[Value], numeric: bool) -> NDArray[np.int64]:
    """Return the group (n,) of each value: the value itself if few, else bins of equal size."""
    values, group = np.unique(np.array(x if numeric else [str(v) for v in x]), return_inverse=True)
    if numeric and len(values) > 6:
        count = int(np.clip(len(x) // 10, 2, 10))
        order = np.argsort(np.argsort(np.array(x, float), kind="stable"), kind="stable")
        return np.asarray(order * count // len(x), np.int64)
    return np.asarray(group, np.int64)


def _compute_share(group: NDArray[np.int64], y: Array) -> tuple[float, float]:
    """Epsilon squared (H - k + 1) / (n - k), not below 0, and the p-value of the test."""
    members = [y[group == g] for g in np.unique(group)]
    k, n = len(members), len(y)
    if k < 2 or n <= k:
        return 0.0, 1.0
    h, p = scipy.stats.kruskal(*members)
    return float(np.clip((h - k + 1) / (n - k), 0.0, 1.0)), float(p)


def group_failures(rows: Sequence[Row], keys: Sequence[str]) -> list[FailureGroup]:
    """Group the runs that did not succeed by requirement, the largest group first."""
    names: dict[str, list[Row]] = {}
    for row in rows:
        if not row.succeeded:
            names.setdefault(row.requirement, []).append(row)
    out = []
    for name, members in names.items():
        runs = {row.run for row in members}
        best = FailureGroup(name, tuple(sorted(runs)), "", (0.0, 0.0), (0.0, 0.0), 1.0)
        numeric = [k for k in keys if all(_is_number(r.varied.get(k)) for r in rows)]
        others = [row for row in rows if row.run not in runs]
        for key in numeric:
            a = np.array([row.varied[key] for row in members], float)
            b = np.array([row.varied[key] for row in others], float)
            if len(a) < 2 or len(b) < 2:
                continue
            p = float(scipy.stats.mannwhitneyu(a, b).pvalue) * len(numeric)
            if p < min(best.p, 1.0 - CONFIDENCE):
                both = np.concatenate([a, b])
                best = best._replace(
                    key=key, p=p, inside=(float(a.min()), float(a.max())),
                    whole=(float(both.min()), float(both.max())),
                )  # fmt: skip
        out.append(best)
    return sorted(out, key=lambda g: -len(g.runs))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
