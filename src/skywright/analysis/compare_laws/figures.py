"""The figure of a comparison of laws: medians of each metric over the cases."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from skywright.analysis.compare_laws.compare import LawComparison
from skywright.reports.figures.style import LIMIT, SERIES, WIDTH, new_figure

COLUMNS = 2


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
    rows = math.ceil(len(shown) / COLUMNS)
    high = 0.8 + 2.2 * rows
    figure = new_figure(WIDTH, high)
    figure.subplots_adjust(
        left=0.07, right=0.99, top=1.0 - 0.75 / high, bottom=0.35 / high, hspace=0.45, wspace=0.18
    )
    limits = c.requirements
    width = 0.8 / len(c.laws)
    for i, metric in enumerate(shown):
        ax = figure.add_subplot(rows, COLUMNS, i + 1)
        unit, _ = c.measures.get(metric, ("", ""))
        for k, law in enumerate(c.laws):
            for j, case in enumerate(c.cases):
                values = [r.metrics.get(metric, math.nan) for r in c.find(law, case.name).rows]
                values = [v for v in values if math.isfinite(v)]
                if not values:
                    continue
                x = j + (k - 0.5 * (len(c.laws) - 1)) * width
                ax.plot(
                    np.full(len(values), x), values, "o", ms=3, alpha=0.6, color=SERIES[k], mew=0
                )
                ax.hlines(
                    float(np.median(values)), x - 0.4 * width, x + 0.4 * width, color=SERIES[k],
                    lw=2, label=law if j == 0 else "",
                )  # fmt: skip
        if metric in limits and math.isfinite(limits[metric].limit):
            ax.axhline(limits[metric].limit, color=LIMIT, ls="--", lw=1)
        ax.set_title(metric + (f" ({unit})" if unit else ""))
        ax.set_xticks(range(len(c.cases)), [case.name for case in c.cases])
    labels = {
        text: line for ax in figure.axes
        for line, text in zip(*ax.get_legend_handles_labels(), strict=True)
    }  # fmt: skip
    figure.legend(list(labels.values()), list(labels), loc="upper right", ncols=len(labels))
    return figure
