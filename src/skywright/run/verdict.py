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
"""Derived metric of a row: use of a limit on its `LimitScale`; worst requirement."""

MOST_MORE = 100_000
"""Largest number of runs that the headline computes."""

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
    """Further runs after which the answer is GO or NO-GO at the present rate; 0 if it is decided,
    if the rate equals the target, or if more than MOST_MORE runs are needed."""
    flown: int
    """Runs that took off; the others were refused, or a check on the ground failed."""
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
    flown = sum(row.took_off for row in rows)
    flown_low, flown_high = (float(x) for x in compute_interval(k, flown)) if flown else (0.0, 1.0)
    asked = f"{100.0 * target:.10g}"
    digits = max(1, len(asked.partition(".")[2]))  # those of the target, to compare them
    headline = (
        f"{k} of {n} simulated runs met every requirement ({k / n:.{digits}%}); with "
        f"{CONFIDENCE:.0%} confidence the true rate lies between {low:.{digits}%} and "
        f"{high:.{digits}%}, "
        + {
            GO: f"above the required {asked}%.",
            NO_GO: f"below the required {asked}%.",
            NOT_YET: f"which is inconclusive for the required {asked}%: "
            + _describe_more_runs(k, n, target, more),
        }[answer]
    )
    reasons = {row.run: row.reason for row in rows}
    limited = _describe_limit(failures, headroom, sensitivities, n - k, reasons, measures)
    return Verdict(
        answer, headline, limited, n, k, k / n, (low, high), target, more, flown,
        (flown_low, flown_high), outcomes, failures, headroom, sensitivities,
    )  # fmt: skip


class LimitScale(NamedTuple):
    """Scale of a requirement on which all runs are compared with its limit.

    The use of the limit is 1 at the limit and larger beyond it, for upper and lower limits. It is 0
    at the median of the completed runs that meet the limit. If none meets it, it is 2 at the median
    of the runs that miss it.
    """

    name: str
    limit: float
    sign: float
    """1 if larger values are worse, -1 if smaller ones are."""
    room: float
    """Difference of the metric that changes the use by 1; positive."""
    met: bool
    """Whether a completed run meets the limit."""

    def compute_use(self, row: Row) -> float:
        """Return the use of the limit by a run; NaN if it is not measured or was waived."""
        value = row.metrics.get(self.name, math.nan)
        use = 1.0 + self.sign * (value - self.limit) / self.room
        if not math.isfinite(use) or (use > 1.0 and self.name not in row.failed):
            return math.nan
        return use


def build_scale(rows: Sequence[Row], h: Headroom) -> LimitScale | None:
    """Return the scale of a requirement; None if the limit has no near and far.

    There is none for ==, and none where the median run lies on the limit, as with a count of which
    none is allowed.
    """
    if h.sense == "==":
        return None
    sign = 1.0 if h.sense in ("<", "<=") else -1.0
    met, missed = [], []
    for row in [r for r in rows if r.completed] or rows:
        room = sign * (h.limit - row.metrics.get(h.name, math.nan))
        if not math.isfinite(room):
            continue
        if h.name in row.failed:
            missed.append(-room)
        elif room >= 0.0:  # otherwise the requirement was waived in this run
            met.append(room)
    room = float(np.median(met or missed)) if met or missed else 0.0
    return LimitScale(h.name, h.limit, sign, room, bool(met)) if room > 0.0 else None


def add_limit_use(rows: Sequence[Row], headroom: Sequence[Headroom]) -> list[Row]:
    """Add to each row the largest use of a limit (`LimitScale`).

    It is NaN for rows that were not completed. Requirements without a scale are excluded.
    """
    scales = [scale for h in headroom if (scale := build_scale(rows, h)) is not None]
    out = []
    for row in rows:
        uses = [use for scale in scales if math.isfinite(use := scale.compute_use(row))]
        use = max(uses) if uses and row.completed else math.nan
        out.append(row._replace(metrics={**row.metrics, LIMIT_USE: use}))
    return out


def _count_more_runs(succeeded: int, runs: int, target: float) -> int:
    """Return the further runs until the interval excludes the target at this rate; 0: too many."""
    rate = succeeded / runs
    if rate == target:
        return 0
    total = runs
    while total < MOST_MORE:
        total = max(total + 1, int(total * 1.02))
        if rate > target:
            decided = compute_interval(math.floor(rate * total), total)[0] >= target
        else:
            decided = compute_interval(math.ceil(rate * total), total)[1] < target
        if decided:
            return total - runs
    return 0


def _describe_more_runs(succeeded: int, runs: int, target: float, more: int) -> str:
    """State how many further runs give an answer, and which one."""
    rate = succeeded / runs
    if rate == target:
        return "this rate equals the required one, and at it no number of runs decides."
    answer = GO if rate > target else NO_GO
    count = f"about {more} more run{'s' if more != 1 else ''}" if more else f"over {MOST_MORE} runs"
    return f"{count} at this rate would give {answer}."


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
