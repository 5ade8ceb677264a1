"""The figure of a comparison of laws: medians of each metric over the cases."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from skywright.analysis.compare_laws.compare import Flown, LawComparison
from skywright.reports.figures.style import LIMIT, SERIES, WIDTH, new_figure

COLUMNS = 2
MARKERS = "osD^vPX*"
"""The laws take the colours in turn; each round of colours has another marker."""


def draw_medians(c: LawComparison) -> Figure | None:
    """Draw one panel per metric: the runs of each law in each case as dots, their median as a
    bar."""
    same = c.list_constant()
    shown = [
        m for m in c.metrics
        if m not in same and any(math.isfinite(f.compute_median(m)) for f in c.flown)
    ]  # fmt: skip
    if not shown:
        return None
    drawn = {f.law for f in c.flown if any(math.isfinite(f.compute_median(m)) for m in shown)}
    flown = [law for law in c.laws if law in drawn]
    columns = max(int((WIDTH - 0.2) / (0.5 + 0.07 * max(map(len, flown)))), 1)
    key = 0.18 * (math.ceil(len(flown) / columns) - 1)  # lines of the legend after the first
    rows = math.ceil(len(shown) / COLUMNS)
    high = 0.8 + key + 2.2 * rows
    figure = new_figure(WIDTH, high)
    figure.subplots_adjust(
        left=0.07, right=0.99, top=1.0 - (0.75 + key) / high, bottom=0.35 / high, hspace=0.45,
        wspace=0.18,
    )  # fmt: skip
    limits = c.requirements
    width = 0.8 / len(c.laws)
    for i, metric in enumerate(shown):
        ax = figure.add_subplot(rows, COLUMNS, i + 1)
        unit, _ = c.measures.get(metric, ("", ""))
        for k, law in enumerate(c.laws):
            for j, case in enumerate(c.cases):
                x = j + (k - 0.5 * (len(c.laws) - 1)) * width
                _draw_runs(ax, c.find(law, case.name), metric, x, 0.4 * width, _choose_style(k))
        if metric in limits and math.isfinite(limits[metric].limit):
            ax.axhline(limits[metric].limit, color=LIMIT, ls="--", lw=1)
        ax.set_title(metric + (f" ({unit})" if unit else ""))
        ax.set_xticks(range(len(c.cases)), [case.name for case in c.cases])
    handles = []
    for law in flown:
        colour, marker = _choose_style(c.laws.index(law))
        handles.append(Line2D([], [], color=colour, marker=marker, ms=6, mew=0, lw=2, label=law))
    figure.legend(handles=handles, loc="upper right", ncols=min(columns, len(flown)))
    return figure


def _draw_runs(
    ax: Axes, f: Flown, metric: str, x: float, half: float, style: tuple[str, str]
) -> None:
    """Draw the runs of a law in a case at x, hollow if incomplete, and the bar of their median."""
    colour, marker = style
    for ended in (True, False):
        values = [r.metrics.get(metric, math.nan) for r in f.rows if r.completed == ended]
        values = [v for v in values if math.isfinite(v)]
        if values:
            ax.plot(
                np.full(len(values), x), values, marker, ls="", ms=3, alpha=0.6, mec=colour,
                mfc=colour if ended else "none", mew=0.0 if ended else 0.8,
            )  # fmt: skip
    if math.isfinite(median := f.compute_median(metric)):
        ax.hlines(median, x - half, x + half, color=colour, lw=2)


def _choose_style(k: int) -> tuple[str, str]:
    """Return colour and marker of law number `k`."""
    return SERIES[k % len(SERIES)], MARKERS[k // len(SERIES) % len(MARKERS)]
