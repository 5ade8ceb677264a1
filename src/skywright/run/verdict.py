"""The answer of a campaign: go or no-go, with its confidence, and the limiting factor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from textwrap import shorten
from typing import NamedTuple

import numpy as np

from skywright.description.mission.spec import Requirement
from skywright.run.kind import Measures
from skywright.run.names import COMMON
from skywright.run.rows import (
    CONFIDENCE,
    FailureGroup,
    Headroom,
    Row,
    Sensitivity,
    compute_headroom,
    compute_interval,
    compute_sensitivities,
    group_failures,
)

LIMIT_USE = "limit use"
"""Derived metric of a row: share of the way from the median to a limit; worst requirement."""

GO, NO_GO, NOT_YET = "GO", "NO-GO", "NO-GO YET"


class Verdict(NamedTuple):
    """The answer of a campaign, from its rows."""

    answer: str
    """GO: the interval is above the target; NO-GO: below; NO-GO YET: it contains the target."""
    headline: str
    """One sentence with numbers and confidence."""
    limited_by: str
    """One sentence that states the limiting factor."""
    runs: int
    succeeded: int
    rate: float
    interval: tuple[float, float]
    target: float
    more_runs: int
    """Further runs after which the answer is GO at the present rate; 0 if it never is."""
    flown: int
    """Runs that took off; the others were refused before take-off."""
    flown_interval: tuple[float, float]
    """Interval of the success rate among those."""
    outcomes: dict[str, int]
    failures: list[FailureGroup]
    headroom: list[Headroom]
    sensitivities: list[Sensitivity]


def build_verdict(
    rows: Sequence[Row],
    keys: Sequence[str],
    requirements: Mapping[str, Requirement],
    target: float,
    measures: Measures = COMMON,
) -> Verdict:
    """Evaluate the rows of a campaign; `target` is the success rate that an inspection requires.

    `measures` define the metrics. `rows` must not be empty.
    """
    n, k = len(rows), sum(row.succeeded for row in rows)
    low, high = (float(x) for x in compute_interval(k, n))
    answer = GO if low >= target else NO_GO if high < target else NOT_YET
    more = _count_more_runs(k, n, target) if answer == NOT_YET else 0
    headroom = compute_headroom(rows, requirements)
    with_use = add_limit_use(rows, headroom)
    names = list(dict.fromkeys(m for row in rows for m in row.metrics))
    wanted = [LIMIT_USE, *(m for m in requirements if m in names)]
    wanted += sorted(m for m in names if m not in requirements and m != LIMIT_USE)
    sensitivities = compute_sensitivities(with_use, keys, wanted)
    failures = group_failures(rows, keys)
    outcomes: dict[str, int] = {}
    for row in rows:
        outcomes[row.outcome] = outcomes.get(row.outcome, 0) + 1
    flown = n - outcomes.get("infeasible", 0) - outcomes.get("refused", 0)
    flown_low, flown_high = (float(x) for x in compute_interval(k, flown)) if flown else (0.0, 1.0)
    headline = (
        f"{k} of {n} simulated runs met every requirement ({k / n:.1%}); with "
        f"{CONFIDENCE:.0%} confidence the true rate lies between {low:.1%} and {high:.1%}, "
        + {
            GO: f"above the required {target:.0%}.",
            NO_GO: f"below the required {target:.0%}.",
            NOT_YET: f"which is inconclusive for the required {target:.0%}"
            + (f": about {more} more runs at this rate would decide." if more else "."),
        }[answer]
    )
    reasons = {row.run: row.reason for row in rows}
    limited = _describe_limit(failures, headroom, sensitivities, n - k, reasons, measures)
    return Verdict(
        answer, headline, limited, n, k, k / n, (low, high), target, more, flown,
        (flown_low, flown_high), outcomes, failures, headroom, sensitivities,
    )  # fmt: skip


def add_limit_use(rows: Sequence[Row], headroom: Sequence[Headroom]) -> list[Row]:
    """Add to each row its distance from the median to its tightest limit (1: at the limit).

    Requirements whose median lies on the limit, and rows that were not completed, are excluded.
    """
    out = []
    for row in rows:
        uses = []
        for h in headroom:
            value = row.metrics.get(h.name, math.nan)
            room = h.limit - h.median
            if math.isfinite(value) and math.isfinite(room) and room != 0.0 and h.sense != "==":
                uses.append((value - h.median) / room)
        completed = row.outcome in ("succeeded", "failed")
        use = max(uses) if uses and completed else math.nan
        out.append(row._replace(metrics={**row.metrics, LIMIT_USE: use}))
    return out


def _count_more_runs(succeeded: int, runs: int, target: float) -> int:
    """Return the runs needed until the interval's lower end reaches the target at this rate."""
    rate = succeeded / runs
    if rate <= target:
        return 0
    total = runs
    while total < 100_000:
        total = max(total + 1, int(total * 1.02))
        if compute_interval(int(np.floor(rate * total)), total)[0] >= target:
            return total - runs
    return 0


def _in_words(name: str, measures: Measures) -> str:
    """Return a metric's name and its meaning."""
    return f"{name} ({measures[name][1]})" if name in measures else name


def _describe_limit(
    failures: Sequence[FailureGroup],
    headroom: Sequence[Headroom],
    sensitivities: Sequence[Sensitivity],
    failed: int,
    reasons: Mapping[int, str],
    measures: Measures,
) -> str:
    if failures:
        worst = failures[0]
        runs = f"{len(worst.runs)} of {failed} failed runs"
        text = f"Limited by {_in_words(worst.requirement, measures)} in {runs}"
        if worst.key:
            a, b = worst.inside
            c, d = worst.whole
            text += f", at {worst.key} from {a:.3g} to {b:.3g} (varied from {c:.3g} to {d:.3g})"
        first = min(worst.runs)
        if reasons[first]:  # no plan, aborted, diverged: the word alone gives no reason
            text += f"; run {first}: {shorten(reasons[first], 200, placeholder=' ...')}"
        return text + "."
    open_ended = [h for h in headroom if math.isfinite(h.used) and h.measured and h.used > 0]
    if not open_ended:
        return "No requirement came near its limit."
    h = open_ended[0]
    unit = f" {h.unit}" if h.unit else ""
    name = _in_words(h.name, measures)
    text = (
        f"Nearest to its limit: {name}. The worst run used {h.used:.0%} of the room between the "
        f"median, {h.median:.3g}{unit}, and the limit, {h.limit:.3g}{unit}"
    )
    drivers = [s for s in sensitivities if s.metric == h.name and s.significant]
    if drivers:
        s = max(drivers, key=lambda s: max(s.share, s.rho**2 if math.isfinite(s.rho) else 0.0))
        text += f", driven most by {s.key} ({s.share:.0%} of its rank variance)"
    return text + "."
