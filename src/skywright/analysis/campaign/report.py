"""The page of a campaign: one HTML file that opens offline and begins with go or no-go."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from skywright.analysis.campaign import figures
from skywright.reports.figures.style import house_style
from skywright.reports.page import build_picture, render_page
from skywright.run.rows import CONFIDENCE, Row, Value
from skywright.run.verdict import LIMIT_USE, Verdict

MANY_FAILURES = 200
"""Maximum number of failed runs listed in the page; results.csv holds all."""


class Facts(NamedTuple):
    """Settings of the campaign that the page shows."""

    mission: str
    description: str
    robot: str
    world: str
    seed: int
    planned_runs: int
    vary: dict[str, str]
    fixed: tuple[str, ...]
    flown_now: int
    """Runs of the last call, which took `wall_s`; the others are from earlier calls."""
    wall_s: float
    versions: Mapping[str, str]


def write_campaign_page(path: Path, rows: Sequence[Row], verdict: Verdict, facts: Facts) -> None:
    """Write campaign.html, a self-contained page."""
    keys = list(facts.vary)
    influential = figures.list_influential(keys, verdict)
    undrawn = len(figures.split_metrics(verdict)[1])
    with house_style():
        pictures = [
            build_picture(
                "Where it fails" if verdict.failures else "Distance of each run from its limits",
                figures.draw_conditions(rows, keys, verdict),
                "Each dot is one run at its value of the varied condition. The height "
                    "shows the use of its tightest limit, from the median of the runs that meet "
                    "the limit (bottom) to the limit (dashed); beyond the limit the scale is "
                    "compressed. Failures have a separate mark. Failures without a value (a "
                    "missed count, an incomplete run) are drawn at the top, other runs without "
                    "a value at the bottom."
                + (f" The {figures.MAX_PANELS} most influential of {len(keys)} conditions are "
                    "drawn."
                   if len(keys) > figures.MAX_PANELS else ""),
            ),
            build_picture(
                "The two most influential conditions" if len(influential) > 1
                    else "The most influential condition and another one",
                figures.draw_map(rows, keys, verdict) if influential else None,
                (f"Only {influential[0]} has a significant effect on limits. "
                    if len(influential) == 1 else "")
                + "Brighter dots are closer to a limit. A cluster of failures shows a risky "
                    "region of conditions.",
            ),
            build_picture(
                "Distance to each limit", figures.draw_headroom(rows, verdict),
                "All runs on one line per requirement, between the median of the runs that "
                    "meet its limit and the limit. Red: runs that failed the requirement. Beyond "
                    "the limit the scale is compressed.",
            ),
            build_picture(
                "Influence of the conditions on the "
                "metrics", figures.draw_sensitivities(keys, verdict),
                "Percentage of a metric's rank variance that a condition alone explains. "
                    "An arrow shows whether the metric rises or falls with the condition; no "
                    "arrow: both. Empty cells are not significant (false discovery rate "
                    f"{1 - CONFIDENCE:.0%}). “{LIMIT_USE}” is the use of the tightest limit, "
                    "drawn as height in the first picture. Lines without a number are metrics "
                    "with a limit."
                + (f" {undrawn} other metrics, without a limit and without a significant effect, "
                    "are not drawn." if undrawn else ""),
            ),
        ]  # fmt: skip
    page = render_page(
        "campaign.html.j2",
        verdict=verdict,
        facts=facts,
        pictures=[p for p in pictures if p],
        failures=[row for row in rows if not row.succeeded][:MANY_FAILURES],
        more_failures=max(verdict.runs - verdict.succeeded - MANY_FAILURES, 0),
        repeated=[row for row in rows if row.attempts > 1],
        example=rows[0].command,
        number=format_value,
        confidence=f"{CONFIDENCE:.0%}",
        tables=sum(text.startswith("csv(") for text in facts.vary.values()),
        ranges=_list_ranges(rows, facts.vary),
        silent=_list_silent(verdict, keys),
        uninfluential=len(keys) > 1 and not influential,
    )
    path.write_text(page, encoding="utf-8")


def format_value(value: Value | None) -> str:
    """Format a float with four significant digits; a missing value is a dash."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def _list_ranges(rows: Sequence[Row], vary: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (key, distribution, drawn range or values) of each varied key."""
    out = []
    for key, text in vary.items():
        drawn = [row.varied[key] for row in rows if key in row.varied]
        numbers = [float(v) for v in drawn if isinstance(v, int | float)]
        if len(numbers) == len(drawn) and numbers:
            seen = f"{min(numbers):.4g} to {max(numbers):.4g}"
        else:
            seen = ", ".join(sorted({str(v) for v in drawn}))
        out.append((key, text, seen))
    return out


def _list_silent(verdict: Verdict, keys: Sequence[str]) -> list[str]:
    """Return the varied keys without a significant effect on any metric."""
    if not verdict.sensitivities:
        return []
    acting = {s.key for s in verdict.sensitivities if s.significant}
    return [key for key in keys if key not in acting]
