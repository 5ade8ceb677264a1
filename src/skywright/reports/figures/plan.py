"""Figure of the plan: clearance and rotor margin over time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.reports.figures.style import (
    BLUE,
    LIMIT,
    WIDTH,
    Span,
    draw_line,
    fit_y,
    new_figure,
    shade_phases,
    stack_panels,
)
from skywright.run.result import RunResult


def draw_plan(result: RunResult) -> Figure | None:
    """Draw planned clearance and rotor margin over the concatenated segments of the plan."""
    t, clearance, margin, spans = _join(result.plan.segments, result.plan.traces)
    if len(t) < 2:
        return None
    figure = new_figure(WIDTH, 3.9)
    strip, axes = stack_panels(figure, 2)
    shade_phases(strip, axes, spans)
    draw_line(axes[0], t, clearance, color=BLUE, label="clearance")
    axes[0].set(
        title="Planned clearance of the robot (except the tip)",
        ylabel="clearance (m)",
    )
    draw_line(axes[1], t, 100.0 * margin, color=BLUE, label="margin")
    axes[1].set(
        title="Planned rotor margin: distance of a rotor's thrust to its nearer limit",
        ylabel="margin (%)",
        xlabel="time along the plan (s)",
    )
    for ax, y, unit in ((axes[0], clearance, "{:.3f} m"), (axes[1], 100.0 * margin, "{:.0f} %")):
        ax.axhline(0.0, color=LIMIT, lw=1.1, ls=(0, (5, 3)))
        known = np.where(np.isfinite(y), y, np.inf)
        i = int(np.argmin(known))
        fit_y(ax, float(np.nanmax(y)), 0.0, low=min(0.0, float(known[i])))
        least = f"least {unit.format(y[i])}"
        ax.plot(t[i], y[i], "v", color=LIMIT, ms=6, zorder=6, label=least)
        right = i < 0.8 * len(t)
        ax.annotate(
            least, (t[i], y[i]), (8 if right else -8, 6),
            textcoords="offset points", fontsize=7.5, color=LIMIT, ha="left" if right else "right",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.6}, zorder=6,
        )  # fmt: skip
    return figure


def _join(
    segments: Mapping[str, NDArray[Any]], traces: Mapping[str, NDArray[Any]]
) -> tuple[Array, Array, Array, list[Span]]:
    """Concatenate the segments; times count from the start of the first."""
    times, clearances, margins, spans = [], [], [], list[Span]()
    start = 0.0
    for name, trace in traces.items():
        if name not in segments or len(trace) == 0 or len(trace) != len(segments[name]):
            continue
        t = start + segments[name]["t"]
        spans.append(Span(name.replace("_", " "), start, float(t[-1]), len(spans) + 1))
        times.append(t)
        clearances.append(trace["clearance"])
        margins.append(trace["rotor_margin"])
        start = float(t[-1])
    if not times:
        empty = np.zeros(0)
        return empty, empty, empty, []
    clearance = np.concatenate(clearances)
    return (
        np.concatenate(times),
        np.where(np.isfinite(clearance) & (clearance < 1e3), clearance, np.nan),
        np.concatenate(margins),
        spans,
    )
