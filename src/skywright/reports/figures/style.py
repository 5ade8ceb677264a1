"""The one style of all report figures, and what they share: phases, limits, thinning, SVG.

Colours are those of Okabe and Ito (2008), which colour-blind readers can tell apart.
"""

import io
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.run.flight import PhaseRecord
from skywright.run.run import RunResult

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, BLACK, GREY = "#56B4E9", "#CC79A7", "#222222", "#8a8f98"
LIMIT = "#b3261e"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, RED, "#7f6000", "#3d5a80", "#6a994e", "#9d4edd",
          "#555555", "#c9ada7")  # fmt: skip

WIDTH = 9.6
"""Inches; the page shows figures at this width."""

MAX_COLUMNS = 500
"""Time bins a line is thinned to; each keeps its smallest and largest value."""

NAME_WIDTH = 16
"""Letters of a slanted phase name on one line."""
MANY = 300
"""Points from which a cloud is drawn as a picture."""

_STYLE: Any = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # fixed: looking for free room costs a third of the drawing time
    "axes.titlepad": 4.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#666666",
    "axes.labelcolor": "#333333",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "text.parse_math": False,  # a name with $ in it is a name
    "svg.fonttype": "none",
    "svg.hashsalt": "skywright",  # the same run gives the same file
    "path.simplify": True,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Everything drawn inside has the report's style."""
    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(width: float = WIDTH, height: float = 4.0) -> Figure:
    """Return an empty figure of a size in inches, without pyplot's global state."""
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    return figure


def new_map(
    s: Array, c: Array, above: float, below: float = 0.5, right: float = 0.15
) -> tuple[Figure, Axes]:
    """Return a figure as high as a map of (s, c) with equal scales needs; margins in inches."""
    width, left = 7.4, 0.75
    across, up = float(np.ptp(s)), float(np.ptp(c))
    room = 0.12 * max(across, up, 1e-3)
    inner = width - left - right
    height = min(max(inner * (up + room) / (across + room), 1.2), 7.0)
    total = height + above + below
    figure = new_figure(width, total)
    box = (left / width, below / total, inner / width, height / total)
    return figure, figure.add_axes(box, anchor="NW")


def render_svg(figure: Figure) -> bytes:
    """Return the figure as SVG with real text; point clouds become pictures inside it."""
    for ax in figure.axes:
        for dots in ax.collections:
            if np.size(dots.get_offsets()) // 2 > MANY:
                dots.set_rasterized(True)
        for line in ax.lines:
            if line.get_marker() not in ("None", "", None) and np.size(line.get_xdata()) > MANY:
                line.set_rasterized(True)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", dpi=150, metadata={"Date": None, "Creator": None})
    # Verdana has the metrics of DejaVu Sans: text fits where the reader has only one of the two
    return buffer.getvalue().replace(b"'DejaVu Sans'", b"'DejaVu Sans', Verdana, sans-serif")


def write_png(draw: Callable[[RunResult], Figure | None], result: RunResult, path: Path) -> Path:
    """Draw one figure of a run and write it as PNG. Raises InputError where there is none."""
    with house_style():
        figure = draw(result)
        if figure is None:
            raise InputError(f"{path.name}: the run ended {result.outcome}, nothing to draw")
        figure.savefig(path, dpi=125, metadata={"Software": None})
    return path


def thin(t: Array, y: Array, columns: int = MAX_COLUMNS) -> tuple[Array, Array]:
    """Reduce a line (n,), (n,) to the extremes of `columns` bins, so that no peak is lost.

    NaN interrupts the line, as before.
    """
    n = len(t)
    if n <= 4 * columns:
        return t, y
    size = -(-n // columns)
    full = size * (n // size)
    blocks = y[:full].reshape(-1, size)
    bad = np.isnan(blocks)
    low = np.argmin(np.where(bad, np.inf, blocks), axis=1)
    high = np.argmax(np.where(bad, -np.inf, blocks), axis=1)
    rows = np.arange(len(blocks)) * size
    gaps = rows[bad.any(axis=1)] + np.argmax(bad[bad.any(axis=1)], axis=1)
    tail = np.arange(full, n)
    keep = np.unique(np.concatenate([rows + low, rows + high, gaps, tail]))
    return t[keep], y[keep]


class Span(NamedTuple):
    """A stretch of time that a phase fills."""

    name: str
    start: float
    end: float


def clip_phases(phases: Sequence[PhaseRecord], start: float, end: float) -> list[Span]:
    """Phases inside a time window, with readable names."""
    spans = []
    for p in phases:
        a, b = max(p.start_s, start), min(p.end_s, end)
        if b > a:
            spans.append(Span(p.name.replace("_", " "), a, b))
    return spans


def shade_phases(strip: Axes, axes: Sequence[Axes], spans: Sequence[Span]) -> None:
    """Shade every other phase on all axes; the strip on top carries the names."""
    strip.set_axis_off()
    if not spans:
        return
    start, end = spans[0].start, spans[-1].end
    bands = [(s.start, s.end - s.start) for s in spans]
    for ax in axes:
        ax.set_xlim(start, end)
        ax.broken_barh(
            bands[::2], (0, 1), transform=ax.get_xaxis_transform(), color="#eef1f5", lw=0, zorder=0
        )
    strip.set(xlim=(start, end), ylim=(0, 1))
    strip.broken_barh(bands[::2], (0, 1), color="#aab6c4", lw=0)
    strip.broken_barh(bands[1::2], (0, 1), color="#d9e0e8", lw=0)
    least = 0.022 * (end - start)  # so that slanted names do not touch
    at = [0.5 * (s.start + s.end) for s in spans]
    for i in range(1, len(at)):
        at[i] = max(at[i], at[i - 1] + least)
    limit = end
    for i in range(len(at) - 1, -1, -1):
        at[i] = min(at[i], limit)
        limit = at[i] - least
    for span, x in zip(spans, at, strict=True):
        wide = (span.end - span.start) > 0.014 * (end - start) * len(span.name)
        x = 0.5 * (span.start + span.end) if wide else x
        # a long slanted name on two lines, or its end would be cut off
        name = (
            span.name
            if wide
            else "\n".join(textwrap.wrap(span.name, NAME_WIDTH, break_long_words=False))
        )
        strip.text(
            x, 1.35, name, fontsize=7.5, color="#444444", rotation=0 if wide else 40,
            ha="center" if wide else "left", va="bottom", rotation_mode="anchor",
        )  # fmt: skip


def draw_line(ax: Axes, t: Array, y: Array, **style: Any) -> None:
    """Draw a thinned time series."""
    ax.plot(*thin(t, y), **style)


def draw_limit(ax: Axes, value: float, label: str, *, below: bool = False) -> None:
    """Draw a limit with its name at the right end of the line."""
    ax.axhline(value, color=LIMIT, lw=1.1, ls=(0, (5, 3)), zorder=4)
    ax.annotate(
        label, (1.0, value), (-3, -2 if below else 2), xycoords=ax.get_yaxis_transform(),
        textcoords="offset points", ha="right", va="top" if below else "bottom", fontsize=7.5,
        color=LIMIT, zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.6},
    )  # fmt: skip


def fit_y(ax: Axes, *values: float, low: float | None = None) -> None:
    """Show all finite `values` with some room; `low` fixes the lower end."""
    known = np.array([v for v in values if np.isfinite(v)])
    if known.size == 0:
        return
    bottom = float(known.min()) if low is None else low
    top = float(known.max())
    room = 0.18 * max(top - bottom, 1e-9)
    ax.set_ylim(bottom if low is not None else bottom - 0.5 * room, top + room)


def draw_panels(
    height: float, phases: Sequence[PhaseRecord], t: Array, *panels: tuple[str, str]
) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels over times `t` (n,) s, each a (title, label), phases shaded."""
    figure = new_figure(WIDTH, height)
    strip, axes = stack_panels(figure, len(panels))
    shade_phases(strip, axes, clip_phases(phases, float(t[0]), float(t[-1])))
    for ax, (title, label) in zip(axes, panels, strict=True):
        ax.set(title=title, ylabel=label)
    return figure, axes


def stack_panels(figure: Figure, count: int, *, bottom: float = 0.5) -> tuple[Axes, list[Axes]]:
    """Axes of equal height, one above the other, sharing the time, and a strip for the phases."""
    width, height = figure.get_size_inches()
    left, right, gap, names, band = 0.72, 0.15, 0.36, 0.62, 0.1
    top = names + band + 0.36
    across = (left / width, (width - left - right) / width)
    strip = figure.add_axes((across[0], (height - names - band) / height, across[1], band / height))
    each = (height - top - bottom - gap * (count - 1)) / count
    axes: list[Axes] = []
    for i in range(count):
        y = height - top - each * (i + 1) - gap * i
        box = (across[0], y / height, across[1], each / height)
        ax = figure.add_axes(box, sharex=axes[0] if axes else None)
        ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
        if i < count - 1:
            ax.tick_params(labelbottom=False)
        axes.append(ax)
    axes[-1].set_xlabel("time since the start of the run (s)")
    return strip, axes
