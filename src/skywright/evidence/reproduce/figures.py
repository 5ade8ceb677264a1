"""Figures of claims from plain data: curves with limits, bars, stability maps, block diagrams."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from skywright.core.arrays import Array
from skywright.reports.figures.style import (
    BLACK,
    LIMIT,
    SERIES,
    WIDTH,
    draw_limit,
    new_figure,
    thin,
)


class Curve(NamedTuple):
    """A line or points of a panel."""

    label: str
    x: Array
    y: Array
    style: str = "line"  # line, dashed, points or line+points
    color: str = ""  # default: the next of the series


class Band(NamedTuple):
    """A coloured interval of the x axis."""

    start: float
    end: float
    color: str


class Panel(NamedTuple):
    """One set of axes with curves and limits."""

    title: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    limits: Sequence[tuple[float, str]] = ()  # value on the y axis, name
    equal: bool = False  # same scale on both axes
    log_x: bool = False
    log_y: bool = False
    low: float | None = None  # lower end of the y axis
    bands: Sequence[Band] = ()


class Bars(NamedTuple):
    """Groups of bars: values (groups, series)."""

    title: str
    y_label: str
    groups: Sequence[str]
    series: Sequence[str]
    values: Array
    limits: Sequence[tuple[float, str]] = ()
    log_y: bool = False


class Map(NamedTuple):
    """Ratios in the cells of a grid, (rows, columns); colours tell those above the limit."""

    title: str
    x_label: str
    y_label: str
    columns: Sequence[str]
    rows: Sequence[str]
    values: Array
    limit: float
    value_label: str
    line_at: float | None = None  # column position of a vertical line, in cells
    line_label: str = ""


class Block(NamedTuple):
    """A box of a block diagram, at its centre."""

    x: float
    y: float
    text: str


class Blocks(NamedTuple):
    """A block diagram; boxes are BLOCK wide and high, arrows go from block to block."""

    title: str
    blocks: Sequence[Block]
    arrows: Sequence[tuple[int, int, str]]  # from, to, label


Part = Panel | Bars | Map | Blocks

BLOCK = (1.7, 0.74)
"""Width and height of a block."""


class ClaimFigure(NamedTuple):
    """Figure of a claim; panels are arranged in rows of `across`."""

    panels: Sequence[Part]
    caption: str
    across: int = 2


def draw_claim(data: ClaimFigure) -> Figure:
    """Draw the figure of a claim."""
    across = min(data.across, len(data.panels))
    down = -(-len(data.panels) // across)
    figure = new_figure(WIDTH if across > 1 else 0.72 * WIDTH, 2.9 * down)
    for i, panel in enumerate(data.panels):
        ax = figure.add_subplot(down, across, i + 1)
        if isinstance(panel, Panel):
            _draw_panel(ax, panel)
        elif isinstance(panel, Bars):
            _draw_bars(ax, panel)
        elif isinstance(panel, Map):
            _draw_map(ax, panel)
        else:
            _draw_blocks(ax, panel)
    figure.tight_layout(pad=0.8, w_pad=1.6)
    return figure


def _draw_panel(ax: Axes, panel: Panel) -> None:
    for i, curve in enumerate(panel.curves):
        color = curve.color or SERIES[i % len(SERIES)]
        if curve.style == "points":
            ax.plot(curve.x, curve.y, ".", ms=3, color=color, label=curve.label)
            continue
        x, y = thin(np.asarray(curve.x, float), np.asarray(curve.y, float))
        dash = "--" if curve.style == "dashed" else "-"
        marker = "o" if curve.style == "line+points" else None
        ax.plot(x, y, dash, marker=marker, ms=3.5, color=color, label=curve.label)
    if panel.log_x:
        ax.set_xscale("log")
        _plain(ax.xaxis)
    if panel.log_y:
        ax.set_yscale("log")
        _plain(ax.yaxis)
    for band in panel.bands:
        ax.axvspan(band.start, band.end, color=band.color, lw=0, zorder=0)
    for value, name in panel.limits:
        draw_limit(ax, value, name)
    if panel.low is not None:
        ax.set_ylim(bottom=panel.low)
    if panel.equal:
        ax.set_aspect("equal", adjustable="datalim")
    low, high = ax.get_ylim()
    if not panel.log_y and not panel.equal:
        ax.set_ylim(low, high + 0.22 * (high - low))  # room for the legend
    if any(c.label for c in panel.curves):
        ax.legend(loc="upper left", ncols=2 if len(panel.curves) > 3 else 1, fontsize=7.5)
    _name(ax, panel.title, panel.x_label, panel.y_label)


def _draw_bars(ax: Axes, bars: Bars) -> None:
    n = len(bars.series)
    width = 0.8 / n
    x = np.arange(len(bars.groups))
    for j, name in enumerate(bars.series):
        at = x + (j - 0.5 * (n - 1)) * width
        drawn = ax.bar(at, bars.values[:, j], 0.92 * width, color=SERIES[j], label=name)
        many = n * len(bars.groups) > 12  # fewer digits, or the numbers overlap
        ax.bar_label(drawn, fmt="%.2g" if many else "%.3g", fontsize=6 if many else 7.5, padding=1)
    ax.set_xticks(x, bars.groups)
    ax.grid(False, axis="x")
    if bars.log_y:
        ax.set_yscale("log")
        _plain(ax.yaxis)
    for value, name in bars.limits:
        draw_limit(ax, value, name)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * 3 if bars.log_y else high + 0.25 * (high - low))
    if n > 1:
        ax.legend(loc="upper left", ncols=n, fontsize=7.5)
    _name(ax, bars.title, "", bars.y_label)


def _draw_map(ax: Axes, data: Map) -> None:
    values = np.asarray(data.values, float)
    known = np.clip(np.log10(np.maximum(values, 1e-9) / data.limit), -1.5, 1.5)
    ax.imshow(known, cmap="RdBu_r", vmin=-1.5, vmax=1.5, aspect="auto", origin="lower", alpha=0.75)
    for r in range(values.shape[0]):
        for c in range(values.shape[1]):
            v = values[r, c]
            text = "lost" if np.isinf(v) else f"{v:.0%}"
            ax.text(
                c, r, text, ha="center", va="center", fontsize=7.5,
                color="white" if abs(known[r, c]) > 1.0 else BLACK,
                fontweight="bold" if v > data.limit else "normal",
            )  # fmt: skip
    ax.set_xticks(range(len(data.columns)), data.columns)
    ax.set_yticks(range(len(data.rows)), data.rows)
    ax.grid(False)
    if data.line_at is not None:
        ax.axvline(data.line_at, color=LIMIT, lw=1.2, ls=(0, (5, 3)))
        ax.annotate(
            data.line_label, (data.line_at, 1.0), (3, -3), xycoords=("data", "axes fraction"),
            textcoords="offset points", va="top", fontsize=7, color=LIMIT,
        )  # fmt: skip
    _name(ax, data.title, data.x_label, data.y_label)
    ax.set_title(f"{data.title}: {data.value_label}", fontsize=8.5)


def _draw_blocks(ax: Axes, data: Blocks) -> None:
    width, height = BLOCK
    for block in data.blocks:
        corner = (block.x - 0.5 * width, block.y - 0.5 * height)
        ax.add_patch(Rectangle(corner, width, height, facecolor="#eef3f8", edgecolor=BLACK, lw=0.9))
        ax.text(block.x, block.y, block.text, ha="center", va="center", fontsize=7)
    for start, end, what in data.arrows:
        a, b = data.blocks[start], data.blocks[end]
        if abs(b.x - a.x) > width:  # the blocks are side by side
            side = 0.5 * width * np.sign(b.x - a.x)
            tail, head = (a.x + side, a.y), (b.x - side, b.y)
        else:
            side = 0.5 * height * np.sign(b.y - a.y)
            tail, head = (a.x, a.y + side), (b.x, b.y - side)
        ax.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": BLACK, "lw": 0.9})
        middle = (0.5 * (tail[0] + head[0]), 0.5 * (tail[1] + head[1]))
        ax.text(
            *middle, what, ha="center", va="center", fontsize=6.5,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
        )  # fmt: skip
    x, y = [b.x for b in data.blocks], [b.y for b in data.blocks]
    ax.set(
        xlim=(min(x) - 0.6 * width, max(x) + 0.6 * width), ylim=(min(y) - height, max(y) + height)
    )
    ax.axis("off")
    ax.set_title(data.title, fontsize=8.5)


def _plain(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers, because the style parses no formulae."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def _name(ax: Axes, title: str, x_label: str, y_label: str) -> None:
    ax.set_title(title, fontsize=8.5)
    ax.set(xlabel=x_label, ylabel=y_label)
