"""Figures of a campaign: failures over the varied keys, use of the limits, sensitivities."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from skywright.core.arrays import Array
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    LIMIT,
    ORANGE,
    PURPLE,
    RED,
    WIDTH,
    new_figure,
)
from skywright.run.rows import Row
from skywright.run.verdict import LIMIT_USE, Verdict, add_limit_use, build_scale

BOTTOM, TOP = -0.3, 1.6
"""Smallest and largest drawn use of a limit. Above 1 the scale is compressed: TOP is infinite."""

MARKERS = "XPsD^v*"
FAILURES = (RED, BLACK, PURPLE, ORANGE, GREEN)
MAX_PANELS = 12

TICK_ROOM = 0.62
"""Inches per labelled tick of a number, wide enough for seven characters, e.g. −0.0025."""
LETTER_ROOM = 0.075
"""Inches per letter of a tick's label."""
LINE = 0.14
"""Inches per line of ticks' labels."""


def draw_conditions(rows: Sequence[Row], keys: Sequence[str], verdict: Verdict) -> Figure | None:
    """Draw one panel per varied key: each run's use of its tightest limit, with failures marked.

    If more than MAX_PANELS keys vary, the most influential ones are drawn, in the given order.
    """
    if not keys:
        return None
    shown = set(rank_keys(keys, verdict)[:MAX_PANELS])
    keys = [key for key in keys if key in shown]
    columns = min(len(keys), 3)
    lines = math.ceil(len(keys) / columns)
    placed = {key: _place(rows, key) for key in keys}
    extra = max(_count_lines(names, 0.8 * WIDTH / columns) for _, names in placed.values()) - 1
    height = 0.75 + (2.1 + LINE * extra) * lines
    figure = new_figure(WIDTH, height)
    use = _compute_use(rows, verdict)
    styles = _choose_styles(verdict)
    grid = figure.add_gridspec(
        lines, columns, left=0.07, right=0.99, bottom=(0.52 + LINE * extra) / height,
        top=1 - 0.62 / height, wspace=0.16, hspace=0.42 + 0.8 * LINE * extra,
    )  # fmt: skip
    for i, key in enumerate(keys):
        ax = figure.add_subplot(grid[i // columns, i % columns])
        x, names = placed[key]
        good = np.array([row.succeeded for row in rows])
        ax.scatter(x[good], use[good], s=9, color=BLUE, alpha=0.45, lw=0)
        for name, (colour, marker) in styles.items():
            hit = np.array([not r.succeeded and r.requirement == name for r in rows])
            ax.scatter(x[hit], use[hit], s=34, color=colour, marker=marker, lw=0, zorder=4)
        ax.axhline(1.0, color=LIMIT, lw=1.1, ls=(0, (5, 3)), zorder=1)
        ax.set_ylim(BOTTOM - 0.1, TOP + 0.12)
        ax.set_yticks([0.0, 0.5, 1.0], ["median", "half-way", "limit"])
        if i % columns:
            ax.tick_params(labelleft=False)
        ax.set_xlabel(key)
        _place_ticks(ax.xaxis, names)
    handles = [_dot(BLUE, "o", "met every requirement")]
    handles += [_dot(c, m, f"failed: {name}") for name, (c, m) in styles.items()]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.06, 1.0), ncols=4)
    return figure


def draw_map(rows: Sequence[Row], keys: Sequence[str], verdict: Verdict) -> Figure | None:
    """Draw all runs over the two most influential keys, coloured by the use of their tightest
    limit."""
    if len(keys) < 2:
        return None
    chosen = rank_keys(keys, verdict)[:2]
    figure = new_figure(6.6, 4.6)
    ax = figure.add_axes((0.12, 0.16, 0.7, 0.72))
    use = _compute_use(rows, verdict)
    (x, x_names), (y, y_names) = (_place(rows, key) for key in chosen)
    good = np.array([row.succeeded for row in rows])
    dots = ax.scatter(
        x[good], y[good], c=np.clip(use[good], 0.0, 1.0), cmap="viridis", vmin=0.0, vmax=1.0,
        s=26, lw=0,
    )  # fmt: skip
    styles = _choose_styles(verdict)
    for name, (colour, marker) in styles.items():
        hit = np.array([not r.succeeded and r.requirement == name for r in rows])
        ax.scatter(
            x[hit], y[hit], s=60, color=colour, marker=marker, edgecolor="white", lw=0.6, zorder=4
        )
        if len(verdict.failures) and np.count_nonzero(~good) <= 12:
            for i in map(int, np.flatnonzero(hit)):
                ax.annotate(
                    f"run {rows[i].run}", (x[i], y[i]), (5, 4), textcoords="offset points",
                    fontsize=7.5,
                )  # fmt: skip
    ax.set(xlabel=chosen[0], ylabel=chosen[1])
    for names, axis in ((x_names, ax.xaxis), (y_names, ax.yaxis)):
        _place_ticks(axis, names)
    bar = figure.colorbar(dots, cax=figure.add_axes((0.85, 0.16, 0.025, 0.72)))
    bar.set_ticks([0.0, 1.0], labels=["median", "limit"])
    handles = [_dot(c, m, f"failed: {name}") for name, (c, m) in styles.items()]
    if handles:
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.1, 1.0), ncols=3)
    return figure


def draw_headroom(rows: Sequence[Row], verdict: Verdict) -> Figure | None:
    """Draw one line per requirement: all runs between the median that meets the limit (0) and the
    limit (1); runs that failed the requirement are red."""
    shown = [
        (h, scale) for h in verdict.headroom
        if h.measured and (scale := build_scale(rows, h)) is not None
    ]  # fmt: skip
    if not shown:
        return None
    height = 0.9 + 0.42 * len(shown)
    figure = new_figure(WIDTH, height)
    ax = figure.add_axes((0.24, 0.5 / height, 0.5, (height - 0.75) / height))
    rng = np.random.default_rng(0)  # only spreads the dots vertically
    for line, (h, scale) in enumerate(shown):
        x = np.array([scale.compute_use(row) for row in rows])
        bad = np.array([h.name in row.failed for row in rows])[np.isfinite(x)]
        x = np.maximum(_compress(x[np.isfinite(x)]), -1.0)
        y = line + rng.uniform(-0.26, 0.26, len(x))
        ax.scatter(x[~bad], y[~bad], s=8, color=BLUE, alpha=0.4, lw=0)
        ax.scatter(x[bad], y[bad], s=18, color=LIMIT, marker="X", lw=0)
        unit = f" {h.unit}" if h.unit else ""
        ax.text(
            TOP + 0.08, line, f"median of all {h.median:.3g}, worst {h.worst:.3g}\n"
            f"limit {h.limit:.3g}{unit}{'' if scale.met else ', no run meets it'}",
            va="center", fontsize=8,
        )  # fmt: skip
    ax.axvline(1.0, color=LIMIT, lw=1.1, ls=(0, (5, 3)))
    ax.set(xlim=(-1.05, TOP + 0.04), ylim=(len(shown) - 0.5, -0.5))
    ax.set_yticks(range(len(shown)), [h.name for h, _ in shown])
    ax.set_xticks([0.0, 0.5, 1.0], ["median", "half-way", "limit"])
    ax.grid(axis="y", visible=False)
    return figure


def split_metrics(verdict: Verdict) -> tuple[list[str], list[str]]:
    """Return the metrics that `draw_sensitivities` draws, and the others.

    Requirements come first, drawn even if no key acts on them. Other metrics are drawn only if a
    key has a significant effect, because an empty line of theirs tells nothing.
    """
    metrics = list(dict.fromkeys(s.metric for s in verdict.sensitivities))
    shown = _list_limits(verdict) | {s.metric for s in verdict.sensitivities if s.significant}
    return [m for m in metrics if m in shown], [m for m in metrics if m not in shown]


def draw_sensitivities(keys: Sequence[str], verdict: Verdict) -> Figure | None:
    """Draw the share of each metric's rank variance that each key explains; requirements first."""
    metrics, _ = split_metrics(verdict)
    keys = [k for k in keys if any(s.key == k for s in verdict.sensitivities)]
    if not metrics or not keys:
        return None
    height = 1.9 + 0.3 * len(metrics)
    width = min(2.9 + 0.62 * len(keys), WIDTH)
    figure = new_figure(width, height)
    ax = figure.add_axes(
        (2.2 / width, 1.6 / height, (width - 2.3) / width, (height - 1.75) / height)
    )
    table = np.full((len(metrics), len(keys)), np.nan)
    found = {(s.metric, s.key): s for s in verdict.sensitivities}
    for i, metric in enumerate(metrics):
        for j, key in enumerate(keys):
            s = found.get((metric, key))
            if s is None:
                continue
            strength = max(s.share, s.rho**2 if math.isfinite(s.rho) else 0.0)
            table[i, j] = strength if s.significant else 0.0
            if s.significant:
                arrow = ""
                if math.isfinite(s.rho) and s.rho**2 > 0.3 * strength:
                    arrow = "↑" if s.rho > 0 else "↓"
                ax.text(
                    j, i, f"{100 * strength:.0f}{arrow}", ha="center", va="center", fontsize=8,
                    color="white" if strength > 0.5 else "#222222",
                )  # fmt: skip
    ax.imshow(table, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    ax.set_xticks(range(len(keys)), keys, rotation=40, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(metrics)), metrics)
    ax.grid(visible=False)
    return figure


def _compute_use(rows: Sequence[Row], verdict: Verdict) -> Array:
    """Return the drawn height (n,) of each run.

    A failure without a use of 1 or more is drawn at TOP, a success without a use at BOTTOM.
    """
    use = np.array([row.metrics[LIMIT_USE] for row in add_limit_use(rows, verdict.headroom)])
    good = np.array([row.succeeded for row in rows])
    drawn = np.maximum(np.where(np.isfinite(use), _compress(use), BOTTOM), BOTTOM)
    return np.where(good | (use >= 1.0), drawn, TOP)


def _compress(use: Array) -> Array:
    """Compress uses (n,) beyond the limit into 1 to TOP, with slope 1 at the limit."""
    beyond, width = np.maximum(use - 1.0, 0.0), TOP - 1.0
    return np.minimum(use, 1.0) + width * beyond / (width + beyond)


def _choose_styles(verdict: Verdict) -> dict[str, tuple[str, str]]:
    """Return colour and marker of each cause of failure."""
    return {
        g.requirement: (FAILURES[i % len(FAILURES)], MARKERS[i % len(MARKERS)])
        for i, g in enumerate(verdict.failures)
    }


def rank_keys(keys: Sequence[str], verdict: Verdict) -> list[str]:
    """Sort keys by their influence on the limits; keys that separate failures come first."""
    influential = list_influential(keys, verdict)
    others = {s.key for s in verdict.sensitivities if s.significant}  # on any metric
    rest = [k for k in keys if k not in influential]
    return influential + sorted(rest, key=lambda k: k not in others)


def list_influential(keys: Sequence[str], verdict: Verdict) -> list[str]:
    """Return the keys that separate failures, or significantly act on limits; strongest first.

    Acting on a limit means on the use of the tightest limit, or on a metric with a requirement.
    """
    limits = _list_limits(verdict)
    strength = {k: (0.0, 0.0, 0.0) for k in keys}  # on failures, limit use, required metrics
    for s in verdict.sensitivities:
        if s.significant and s.metric in limits:
            value = max(s.share, s.rho**2 if math.isfinite(s.rho) else 0.0)
            failures, use, metric = strength[s.key]
            if s.metric == LIMIT_USE:
                use = value
            strength[s.key] = (failures, use, max(metric, value))
    for group in verdict.failures:
        if group.key:
            failures, use, metric = strength[group.key]
            strength[group.key] = (failures + 1.0, use, metric)
    acting = [k for k in keys if any(strength[k])]
    return sorted(acting, key=lambda k: strength[k], reverse=True)


def _list_limits(verdict: Verdict) -> set[str]:
    """Return the metrics that are compared with a limit."""
    return {LIMIT_USE, *(h.name for h in verdict.headroom)}


def _place_ticks(axis: Axis, names: Sequence[str]) -> None:
    """Label an axis with the names of its values, or with as many numbers as have room.

    Names that are too long for one line of the x axis alternate between several lines.
    """
    figure = axis.axes.figure
    assert isinstance(figure, Figure)
    width = axis.axes.get_position().width * figure.get_size_inches()[0]
    across = axis is axis.axes.xaxis
    if names:
        lines = _count_lines(names, width) if across else 1
        axis.set_ticks(range(len(names)), ["\n" * (i % lines) + n for i, n in enumerate(names)])
    elif across:
        axis.set_major_locator(MaxNLocator(max(int(width / TICK_ROOM), 1), steps=[1, 2, 5, 10]))


def _count_lines(names: Sequence[str], width: float) -> int:
    """Return the lines over which names at equal distances on `width` inches alternate."""
    longest = max(map(len, names), default=0)
    return max(math.ceil((longest + 2) * LETTER_ROOM * len(names) / width), 1)


def _place(rows: Sequence[Row], key: str) -> tuple[Array, list[str]]:
    """Return the values (n,) of a key; words become 0, 1, ... and are returned as names."""
    values = [row.varied.get(key) for row in rows]
    if all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        return np.array(values, float), []
    names = sorted({str(v) for v in values})
    return np.array([names.index(str(v)) for v in values], float), names


def _dot(colour: str, marker: str, label: str) -> Line2D:
    return Line2D([], [], ls="", marker=marker, color=colour, mec="none", ms=6, label=label)
