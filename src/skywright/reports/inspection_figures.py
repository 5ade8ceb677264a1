"""Figures of an inspection report: positions of readings, indications, A-scans."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from skywright.core.arrays import Array
from skywright.inspection.files.nde import UltrasonicScan
from skywright.inspection.history.entries import StoredIndication, StoredReading
from skywright.reports.figures.style import BLACK, LIMIT, RED, new_figure

FEW = 40
"""Maximum number of readings whose values are written."""


def draw_places(
    readings: Sequence[StoredReading],
    indications: Sequence[StoredIndication],
    axes: tuple[int, int],
) -> Figure | None:
    """Draw positions in the frame of the asset along two of its axes; None if there are none.

    Accepted readings are coloured by their value, refused ones are crosses, indications triangles.
    """
    if not readings and not indications:
        return None
    names = "xyz"
    figure = new_figure(7.6, 5.0)
    ax = figure.add_subplot()
    taken = [r for r in readings if r.reading.accepted and r.reading.value is not None]
    if taken:
        places = _list_places([r.reading for r in taken], axes)
        values = [r.reading.value or 0.0 for r in taken]
        dots = ax.scatter(
            places[:, 0], places[:, 1], c=values, cmap="viridis", s=46, edgecolor=BLACK, lw=0.4,
            label="reading accepted",
        )  # fmt: skip
        unit = taken[0].reading.unit
        figure.colorbar(dots, label=f"{taken[0].reading.quantity} ({unit})")
        if len(taken) <= FEW:
            for (x, y), value in zip(places, values, strict=True):
                ax.annotate(f"{value:.2f}", (x, y), (4, 4), textcoords="offset points", size=7)
    refused = [r.reading for r in readings if not r.reading.accepted]
    if refused:
        ax.plot(*_list_places(refused, axes).T, "x", color=RED, ms=8, label="reading refused: gap")
    if indications:
        places = _list_places([i.indication for i in indications], axes)
        ax.plot(*places.T, "^", color=LIMIT, ms=8, label="indication")
        for (x, y), i in zip(places, indications, strict=True):
            ax.annotate(str(i.id), (x, y), (6, -10), textcoords="offset points", size=8)
    ax.set(xlabel=f"{names[axes[0]]} (m)", ylabel=f"{names[axes[1]]} (m)")
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.12)
    ax.legend(loc="best")
    figure.tight_layout()
    return figure


def choose_axes(points: Array) -> tuple[int, int]:
    """Return the two axes along which positions (n, 3) have the largest extent, in their order."""
    spread = np.ptp(points, axis=0) if len(points) else np.zeros(3)
    a, b = sorted(np.argsort(-spread, kind="stable")[:2].tolist())
    return int(a), int(b)


def _list_places(entries: Sequence[object], axes: tuple[int, int]) -> Array:
    names = [("x_m", "y_m", "z_m")[k] for k in axes]
    return np.array([[getattr(e, name) for name in names] for e in entries])


def draw_ascans(scans: Sequence[tuple[str, UltrasonicScan, tuple[int, int]]]) -> Figure | None:
    """Draw one A-scan per row over the depth from its velocity; None without any."""
    if not scans:
        return None
    figure = new_figure(7.6, 1.0 + 1.25 * len(scans))
    rows = figure.subplots(len(scans), 1, squeeze=False)[:, 0]
    for ax, (name, scan, (i, j)) in zip(rows, scans, strict=True):
        t = scan.start_s + np.arange(scan.ascan.shape[2]) / scan.sample_rate_hz
        ax.plot(0.5e3 * scan.velocity_mps * t, 100.0 * scan.ascan[i, j], color=BLACK, lw=0.7)
        if scan.time is not None and np.isfinite(scan.time[i, j]):
            ax.axvline(0.5e3 * scan.velocity_mps * scan.time[i, j], color=LIMIT, lw=1.0)
        ax.set(ylabel="% FSH", ylim=(-105, 105), title=name)
    rows[-1].set_xlabel("depth (mm), from the velocity of the set-up")
    figure.tight_layout()
    return figure
