"""Common functions of the figures of `skywright show`: line styles, views, dimensions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.reports.outlines import Outline

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TOP, SIDE = (0, 1), (0, 2)
"""Coordinates of a view: x and y from above, x and z from the side."""

STYLES: dict[str, dict[str, Any]] = {
    "disc": {"color": "#4477aa", "lw": 1.2, "alpha": 0.9},
    "spoke": {"color": "#777777", "lw": 2.0},
    "hub": {"color": "#555555", "lw": 1.0},
    "gear": {"color": "#999999", "lw": 1.0},
    "arm": {"color": "#cc3311", "lw": 4.0, "solid_capstyle": "round"},
    "probe": {"color": "#ee7733", "lw": 3.0, "solid_capstyle": "round"},
    "pipe": {"color": "#8a8a8a", "lw": 0.6},
    "post": {"color": "#8a8a8a", "lw": 5.0, "alpha": 0.6, "zorder": 0.5},
    "box": {"color": "#aa8866", "lw": 1.0},
    "weld": {"color": "#222222", "lw": 1.4},
    "sector": {"color": "#009988", "lw": 1.6},
    "scan": {"color": "#009988", "lw": 1.2},
    "path": {"color": "#009988", "lw": 1.4, "ls": "--"},
}


def draw_parts(ax: Axes, parts: list[Outline], view: tuple[int, int], **override: Any) -> None:
    """Draw outlines in a view; `override` replaces entries of their style."""
    for part in parts:
        style = {**STYLES[part.part], **override}
        x, y = part.points[:, view[0]], part.points[:, view[1]]
        ax.plot(x, y, **style)
        if part.filled:
            ax.fill(x, y, color=style["color"], alpha=0.12, lw=0)


def label_axes(ax: Axes, view: tuple[int, int], title: str, frame: str) -> None:
    """Set equal scales, the title, and axis labels with frame and unit."""
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(title, fontsize=10)
    ax.set(xlabel=f"x in {frame} (m)", ylabel=f"{'xyz'[view[1]]} in {frame} (m)")
    ax.grid(True, lw=0.3, alpha=0.6)


def draw_dimension(ax: Axes, a: tuple[float, float], b: tuple[float, float], text: str) -> None:
    """Draw a double arrow from `a` to `b` with the dimension at its centre."""
    ax.plot([a[0], b[0]], [a[1], b[1]], alpha=0.0)  # extends the range of the axes
    ax.annotate(
        "",
        b,
        a,
        arrowprops={"arrowstyle": "<->", "color": "#333333", "lw": 0.9, "shrinkA": 0, "shrinkB": 0},
    )
    vertical = abs(b[1] - a[1]) > abs(b[0] - a[0])
    box = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.85}
    ax.text(
        0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), text, ha="center", va="center", fontsize=8,
        rotation=90 if vertical else 0, bbox=box,
    )  # fmt: skip
