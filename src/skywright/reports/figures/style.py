"""The common style of all report figures, with functions for phases, limits, thinning and SVG.

Colours are those of Okabe and Ito (2008), which colour-blind readers can distinguish.
"""

import io
import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.run.flight import PhaseRecord
from skywright.run.kind import load_kind
from skywright.run.result import RunResult
from skywright.run.where import WHOLE, find_where

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, BLACK, GREY = "#56B4E9", "#CC79A7", "#222222", "#8a8f98"
LIMIT = "#b3261e"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, RED, "#7f6000", "#3d5a80", "#6a994e", "#9d4edd",
          "#555555", "#c9ada7")  # fmt: skip

RUN_CLOCK = "time since the start of the run (s)"
"""Label of the time axis of a run; templates/plots.js links it to the replay."""
WIDTH = 9.6
"""Inches; the page shows figures at this width."""

MAX_COLUMNS = 500
"""Number of time bins of a thinned line; each keeps its smallest and largest value."""

LETTER, KEY_WIDTH = 0.0078, 150
"""Width of a letter of a phase's name, as a share of the panels' width; letters per line of the
key."""
MANY = 300
"""Number of points from which a point cloud is rasterized."""

SPANS: WeakKeyDictionary[Figure, Sequence["Span"]] = WeakKeyDictionary()
"""The phases of each figure."""
WHOLE_LINES: WeakKeyDictionary[Line2D, tuple[Array, Array]] = WeakKeyDictionary()
"""Times and values of lines that are drawn thinned."""

_STYLE: Any = {
    "font.family": "DejaVu Sans",  # part of matplotlib
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # fixed: the search for free space takes a third of the drawing time
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
    "text.parse_math": False,  # $ in a name has no meaning
    "svg.fonttype": "none",
    "svg.hashsalt": "skywright",  # equal runs give equal files
    "path.simplify": True,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Apply the report's style inside this context."""
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
    """Return a figure whose height fits a map of (s, c) with equal scales; margins in inches."""
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
    """Return the figure as SVG with real text; point clouds are rasterized."""
    for ax in figure.axes:
        for dots in ax.collections:
            if np.size(dots.get_offsets()) // 2 > MANY:
                dots.set_rasterized(True)
        for line in ax.lines:
            if line.get_marker() not in ("None", "", None) and np.size(line.get_xdata()) > MANY:
                line.set_rasterized(True)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", dpi=150, metadata={"Date": None, "Creator": None})
    # Verdana has the metrics of DejaVu Sans: text fits if only one of the two is installed
    return buffer.getvalue().replace(b"'DejaVu Sans'", b"'DejaVu Sans', Verdana, sans-serif")


def write_png(draw: Callable[[RunResult], Figure | None], result: RunResult, path: Path) -> Path:
    """Draw one figure of a run and write it as PNG. Raises InputError if there is nothing to
    draw."""
    with house_style():
        figure = draw(result)
        if figure is None:
            raise InputError(f"{path.name}: the run ended {result.outcome}, nothing to draw")
        figure.savefig(path, dpi=125, metadata={"Software": None})
    return path


def thin(t: Array, y: Array, columns: int = MAX_COLUMNS) -> tuple[Array, Array]:
    """Reduce a line (n,), (n,) to the extremes of `columns` bins, so that no peak is lost.

    NaN still interrupts the line.
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
    """Interval of a phase."""

    name: str
    start: float
    end: float
    number: int  # in the order of the run, from 1


def clip_phases(phases: Sequence[PhaseRecord], start: float, end: float) -> list[Span]:
    """Return the phases inside a time window, with readable names."""
    return [
        Span(p.name.replace("_", " "), max(p.start_s, start), min(p.end_s, end), i)
        for i, p in enumerate(phases, 1)
        if min(p.end_s, end) > max(p.start_s, start)
    ]


def shade_phases(strip: Axes, axes: Sequence[Axes], spans: Sequence[Span]) -> None:
    """Shade every other phase on all axes; the strip on top shows the names of long phases.

    If a name does not fit, all phases are numbered, and a key below the panels lists their names.
    """
    strip.set_axis_off()
    if not spans:
        return
    figure = strip.figure
    assert isinstance(figure, Figure)
    SPANS[figure] = spans
    start, end = spans[0].start, spans[-1].end
    length = end - start
    bands = [(s.start, s.end - s.start) for s in spans]
    for ax in axes:
        ax.set_xlim(start, end)
        ax.broken_barh(
            bands[::2], (0, 1), transform=ax.get_xaxis_transform(), color="#eef1f5", lw=0, zorder=0
        )
    strip.set(xlim=(start, end), ylim=(0, 1))
    strip.broken_barh(bands[::2], (0, 1), color="#aab6c4", lw=0)
    strip.broken_barh(bands[1::2], (0, 1), color="#d9e0e8", lw=0)
    style: Any = {"fontsize": 7.5, "color": "#444444", "ha": "center", "va": "bottom"}
    wide = [s.end - s.start > LETTER * length * (len(s.name) + 1) for s in spans]
    middles = [0.5 * (s.start + s.end) for s in spans]
    for span, middle, fits in zip(spans, middles, wide, strict=True):
        if fits:
            strip.text(middle, 1.35 if all(wide) else 3.5, span.name, **style)
    if all(wide):
        return
    least = min(2.2 * LETTER, 1.0 / len(spans)) * length  # avoids overlap of numbers
    for span, middle, x in zip(spans, middles, _spread(middles, least, end), strict=True):
        strip.plot([middle, x], [1.0, 1.9], color=GREY, lw=0.5, clip_on=False)
        strip.text(x, 1.9, f"{span.number}", **{**style, "fontsize": 7.0})
    _write_key(figure, spans)


def _spread(at: Sequence[float], least: float, end: float) -> list[float]:
    """Shift positions to a distance of at least `least`, none beyond `end`."""
    steps = least * np.arange(len(at))
    apart = np.maximum.accumulate(np.asarray(at) - steps) + steps
    return list(np.minimum(apart, end - steps[::-1]))


def _write_key(figure: Figure, spans: Sequence[Span]) -> None:
    """Write the phases' numbers and names below the panels, and enlarge the figure accordingly."""
    numbers: dict[str, list[str]] = {}
    for span in spans:
        numbers.setdefault(span.name, []).append(str(span.number))
    entries = [f"{', '.join(n)} {name}".replace(" ", "\u00a0") for name, n in numbers.items()]
    text = textwrap.wrap("Phases: " + " · ".join(entries), KEY_WIDTH, break_long_words=False)
    width, height = figure.get_size_inches()
    more = 0.16 * len(text) + 0.06
    for ax in figure.axes:
        x, y, w, h = ax.get_position().bounds
        ax.set_position((x, (y * height + more) / (height + more), w, h * height / (height + more)))
    figure.set_size_inches(width, height + more)
    figure.text(
        0.02, 0.06 / (height + more), "\n".join(text), fontsize=7.5, color="#444444", va="bottom"
    )


def draw_line(ax: Axes, t: Array, y: Array, **style: Any) -> None:
    """Draw a thinned time series; figures/interactive.py uses the whole one."""
    WHOLE_LINES[ax.plot(*thin(t, y), **style)[0]] = (t, y)


def draw_limit(
    ax: Axes,
    value: float,
    label: str,
    *,
    below: bool = False,
    spans: Sequence[tuple[float, float]] | None = None,
) -> None:
    """Draw a limit with its name at the right end of the line.

    `spans` are the times (s) in which it applies; None: all times.
    """
    style: Any = {"color": LIMIT, "lw": 1.1, "ls": (0, (5, 3)), "zorder": 4, "label": f"_{label}"}
    if spans is None:
        ax.axhline(value, **style)
    else:
        ax.plot([t for a, b in spans for t in (a, b, b)],
                [y for _ in spans for y in (value, value, math.nan)], **style)  # fmt: skip
    ax.annotate(
        label, (1.0, value), (-3, -2 if below else 2), xycoords=ax.get_yaxis_transform(),
        textcoords="offset points", ha="right", va="top" if below else "bottom", fontsize=7.5,
        color=LIMIT, zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.6},
    )  # fmt: skip


def draw_requirement(
    ax: Axes,
    result: RunResult,
    name: str,
    label: str,
    *,
    spans: Sequence[tuple[float, float]] | None = None,
    origin: float = 0.0,
    scale: float = 1.0,
) -> float | None:
    """Draw the limit of a metric over the phases in which it is measured, and name them.

    `label` contains {:g} for the limit. `spans` replace the phases; `origin` (s) is the start time
    of the axes; the limit of a share is multiplied by `scale`. Returns the limit, or None if the
    metric has no requirement.
    """
    limit = next((scale * r.limit for r in result.requirements if r.name == name), None)
    if limit is None or math.isnan(limit):
        return None
    where = find_where(name, load_kind(result.description.mission.kind).where)
    phases = [result.phases[i] for i in where.find(result.phases, result.plan.segments)]
    if where.text and where.phases != WHOLE.phases:
        label = f"{label}: {where.text}"
    spans = [(p.start_s - origin, p.end_s - origin) for p in phases] if spans is None else spans
    draw_limit(ax, limit, label.replace("{:g}", f"{limit:.4g}"), spans=spans)
    return limit


def fit_y(ax: Axes, *values: float, low: float | None = None) -> None:
    """Set the y range to all finite `values` with a margin; `low` fixes the lower end."""
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
    """Return a figure of panels over times `t` (n,) s, each a (title, label), with phases
    shaded."""
    figure = new_figure(WIDTH, height)
    strip, axes = stack_panels(figure, len(panels))
    shade_phases(strip, axes, clip_phases(phases, float(t[0]), float(t[-1])))
    for ax, (title, label) in zip(axes, panels, strict=True):
        ax.set(title=title, ylabel=label)
    return figure, axes


def stack_panels(figure: Figure, count: int, *, bottom: float = 0.5) -> tuple[Axes, list[Axes]]:
    """Return a strip for the phases, and stacked axes of equal height that share the time."""
    width, height = figure.get_size_inches()
    left, right, gap, names, band = 0.72, 0.15, 0.36, 0.52, 0.1
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
    axes[-1].set_xlabel(RUN_CLOCK)
    return strip, axes
