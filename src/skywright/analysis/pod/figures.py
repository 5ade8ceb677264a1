"""Figures of a probability of detection: curve with bound, data, and groups."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from skywright.analysis.pod.groups import Compared
from skywright.analysis.pod.links import from_axis
from skywright.analysis.pod.pod import Pod
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREY,
    LIMIT,
    ORANGE,
    SERIES,
    house_style,
    new_figure,
)

BINS = 8


def write_pod_figure(pod: Pod, compared: Compared | None, path: Path) -> None:
    """Write the figure of a curve and of the curves of its groups."""
    with house_style():
        draw_pod(pod, compared).savefig(path, dpi=125)


def draw_pod(pod: Pod, compared: Compared | None = None) -> Figure:
    """Draw the POD over size with its lower bound, and the data."""
    signals = pod.curve.model == "a-hat"
    figure = new_figure(7.6, 6.4 if signals else 4.4)
    axes = figure.subplots(2 if signals else 1, 1, sharex=True, squeeze=False)[:, 0]
    _draw_curve(axes[-1], pod)
    if compared is not None:
        _draw_groups(axes[-1], compared)
    elif not signals:
        _draw_hits(axes[-1], pod)
    if signals:
        _draw_signals(axes[0], pod)
    axes[-1].legend(loc="best")
    if pod.curve.size_axis == "log":
        _mark_decades(axes[-1].xaxis)
    axes[-1].set_xlabel(f"size ({pod.unit})" if pod.unit else "size")
    figure.tight_layout()
    return figure


def _mark_decades(axis: Axis) -> None:
    """Label 1, 2 and 5 of each decade with plain numbers."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _draw_curve(ax: Axes, pod: Pod) -> None:
    c = pod.curve
    name = {"wald": "Wald", "likelihood": "likelihood ratio"}[c.bounds]
    ax.plot(c.sizes, c.pod, color=BLUE, lw=1.8, label="POD, all flaws")
    ax.plot(c.sizes, c.lower, color=BLUE, ls="--", label=f"lower bound, 95 % ({name})")
    if c.size_axis == "log":
        ax.set_xscale("log")
    ax.set(ylim=(-0.06, 1.06), ylabel="probability of detection", xlim=(c.sizes[0], c.sizes[-1]))
    ax.axhline(0.9, color=GREY, lw=0.8, ls=":")
    unit = f" {pod.unit}".rstrip()
    for size, label, color in ((c.a90, "a90", BLACK), (c.a90_95, "a90/95", LIMIT)):
        if size is not None and size <= c.sizes[-1]:
            ax.plot([size, size], [0.0, 0.9], color=color, lw=0.9, ls="-.",
                    label=f"{label} {size:.3g}{unit}")  # fmt: skip
    if c.ceiling is not None:
        ax.axhline(c.ceiling.value, color=ORANGE, lw=1.0, label=f"ceiling {c.ceiling.value:.3f}")
    ax.set_title(f"{pod.counted.found} of {pod.counted.flaws} flaws found")


def _draw_hits(ax: Axes, pod: Pod) -> None:
    table = pod.inspections.select(pod.inspections.size > 0)
    assert table.hit is not None
    ax.plot(table.size, np.where(table.hit > 0, 1.03, -0.03), "|", color=GREY, ms=7,
            label="flaws (found above, missed below)")  # fmt: skip
    order = np.argsort(table.size)
    parts = np.array_split(order, min(BINS, max(len(order) // 8, 2)))
    ax.plot([np.median(table.size[p]) for p in parts], [table.hit[p].mean() for p in parts], "o",
            color=ORANGE, ms=4, label=f"share found, {len(parts)} groups of size")  # fmt: skip


def _draw_signals(ax: Axes, pod: Pod) -> None:
    table, c = pod.inspections, pod.curve
    flawed = table.select(table.size > 0)
    assert flawed.signal is not None
    ax.plot(flawed.size, flawed.signal, "o", color=GREY, ms=3, label="signals")
    b = c.coefficients
    x = np.log(c.sizes) if c.size_axis == "log" else c.sizes
    line = b["b0"] + b["b1"] * x
    decision = b["b0"] + b["b1"] * b["mu"]
    for shift, ls in ((0.0, "-"), (1.645 * b["s"], ":"), (-1.645 * b["s"], ":")):
        y = [from_axis(v + shift, c.signal_axis) or np.nan for v in line]
        ax.plot(c.sizes, y, color=BLUE, ls=ls, lw=1.0, label="line, 90 % band" if ls == "-" else "")
    at = from_axis(decision, c.signal_axis)
    assert at is not None
    ax.axhline(at, color=LIMIT, lw=0.9, label=f"decision {at:.3g}")
    if c.signal_axis == "log":
        ax.set_yscale("log")
        _mark_decades(ax.yaxis)
    ax.set(ylabel="signal", title="signal against size")
    ax.legend(loc="upper left")


def _draw_groups(ax: Axes, compared: Compared) -> None:
    for (name, one), color in zip(compared.groups.items(), SERIES[2:] * 5, strict=False):
        if isinstance(one, Pod):
            label = f"{compared.column} {name} ({one.counted.flaws})"
            ax.plot(one.curve.sizes, one.curve.pod, color=color, lw=1.1, label=label)
