"""Figure of the cost of the best path over planning time, for several planners and the lower
bound."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from skywright.core.arrays import Array
from skywright.reports.figures.style import SERIES, WIDTH, draw_limit, new_figure

ROOM = 0.22
"""Plotted range above the lower bound, as a share of it."""


class Progress(NamedTuple):
    """One planner on one scenario."""

    name: str
    t: Array  # (k,) s
    cost: Array  # (seeds, k), inf before a seed's first path


class Scenario(NamedTuple):
    """A panel: planners and the lower bound of the cost."""

    name: str
    planners: Sequence[Progress]
    bound: float


def draw_convergence(scenarios: Sequence[Scenario]) -> Figure:
    """Draw one panel per scenario; a line is the median of the seeds, its band their range."""
    columns = min(len(scenarios), 2)
    rows = -(-len(scenarios) // columns)
    figure = new_figure(WIDTH, 0.6 + 3.1 * rows)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True)
    figure.subplots_adjust(
        left=0.08, right=0.98, top=1 - 0.3 / (0.6 + 3.1 * rows), bottom=0.5 / (0.6 + 3.1 * rows),
        wspace=0.2, hspace=0.25,
    )  # fmt: skip
    colours: dict[str, str] = {}
    for ax, scenario in zip(axes.flat, scenarios, strict=False):
        ax.set_title(scenario.name)
        ax.set_xscale("log")
        for p in scenario.planners:
            colour = colours.setdefault(p.name, SERIES[len(colours)])
            ax.step(p.t, np.median(p.cost, axis=0), where="post", color=colour, label=p.name)
            best, worst = np.min(p.cost, axis=0), np.max(p.cost, axis=0)
            known = np.isfinite(worst)
            ax.fill_between(
                p.t[known], best[known], worst[known], step="post", color=colour, alpha=0.18, lw=0
            )
        ax.set_ylim(scenario.bound * (1 - 0.1 * ROOM), scenario.bound * (1 + ROOM))
        draw_limit(ax, scenario.bound, "lower bound", below=True)
        ax.set_ylabel("cost (6) of the best path (m)")
        ax.legend(loc="upper right")
    for ax in axes[-1]:
        ax.set_xlabel("processor time (s)")
    for ax in axes.flat[len(scenarios) :]:
        ax.set_visible(False)
    return figure
