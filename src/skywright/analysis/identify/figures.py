"""Figures of an identification: measured against predicted, and the confidence intervals."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from skywright.analysis.identify.fit import Estimate, Prediction
from skywright.analysis.identify.parameters import Parameter
from skywright.core.arrays import Array, Mask
from skywright.reports.figures.style import BLACK, BLUE, GREY, ORANGE, RED, WIDTH, new_figure

NAMES = ("x", "y", "z")
WINDOW = 12.0  # s, length of the plotted series


def draw_series(p: Prediction, part: slice, what: str, unit: str) -> Figure:
    """Draw three components around a held-out part: forces or angular accelerations."""
    t, held_out = p.t, p.held_out
    measured, predicted, nominal = p.measured[:, part], p.predicted[:, part], p.nominal[:, part]
    r_squared, at = p.r_squared(p.predicted)[part], _choose(t, held_out)
    figure = new_figure(WIDTH, 5.4)
    axes = figure.subplots(3, 1, sharex=True)
    for i, ax in enumerate(axes):
        ax.plot(
            t[at], nominal[at, i], color=GREY, lw=0.9, ls=":", label="predicted by the robot file"
        )
        ax.plot(t[at], measured[at, i], color=BLACK, lw=1.4, label="measured")
        ax.plot(t[at], predicted[at, i], color=ORANGE, lw=1.1, label="predicted, identified")
        low, high = np.min(measured[at, i]), np.max(measured[at, i])
        room = 0.25 * max(high - low, 1e-9)
        ax.set(
            ylim=(low - room, high + room),
            ylabel=f"{NAMES[i]} ({unit})",
            title=f"{what} {NAMES[i]}, R² {r_squared[i]:.4f} on held-out parts",
        )
        _shade(ax, t[at], held_out[at])
    axes[0].legend(loc="upper right", ncols=3)
    axes[-1].set_xlabel("time in the log (s)")
    figure.tight_layout()
    return figure


def _choose(t: Array, held_out: Mask) -> slice:
    """Return a window around the first held-out part."""
    first = int(np.argmax(held_out))
    begin = int(np.searchsorted(t, t[first] - 0.5 * WINDOW))
    end = int(np.searchsorted(t, t[begin] + WINDOW))
    return slice(begin, max(end, begin + 2))


def _shade(ax: object, t: Array, held_out: Mask) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held_out, [False]]).astype(int)))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        ax.axvspan(t[a], t[min(b, len(t) - 1)], color=BLUE, alpha=0.08, lw=0)  # type: ignore[attr-defined]


def draw_scatter(p: Prediction) -> Figure:
    """Draw predicted over measured angular acceleration of the held-out samples."""
    measured, predicted = p.measured[p.held_out, 3:], p.predicted[p.held_out, 3:]
    r_squared = p.r_squared(p.predicted)[3:]
    figure = new_figure(WIDTH, 3.4)
    for i, ax in enumerate(figure.subplots(1, 3)):
        ax.plot(measured[:, i], predicted[:, i], ".", color=BLUE, ms=3, alpha=0.6)
        span = [float(np.min(measured[:, i])), float(np.max(measured[:, i]))]
        ax.plot(span, span, color=RED, lw=1.0)
        ax.set(
            title=f"about {NAMES[i]}: R² {r_squared[i]:.4f}",
            xlabel="measured (rad/s²)",
            ylabel="predicted (rad/s²)",
        )
    figure.tight_layout()
    return figure


def draw_intervals(estimates: Sequence[Estimate]) -> Figure:
    """Draw estimates with intervals as deviations from the robot file, in per cent."""
    figure = new_figure(WIDTH, 0.6 + 0.24 * len(estimates))
    ax = figure.subplots()
    at = np.arange(len(estimates))[::-1]
    scales = np.array([_scale(e.parameter) for e in estimates])
    shift = 100.0 * np.array([e.value - e.parameter.nominal for e in estimates]) / scales
    half = 100.0 * np.array([e.half_width for e in estimates]) / scales
    ax.errorbar(shift, at, xerr=half, fmt="o", color=BLUE, ms=4, capsize=3)
    ax.axvline(0.0, color=GREY, lw=1.0)
    ax.set_yticks(at, [e.parameter.name for e in estimates])
    ax.set(
        ylim=(-0.7, len(estimates) - 0.3),
        xlabel="deviation from the robot file (%; centre of mass: of 10 mm, products of "
        "inertia: of the mean inertia)",
    )
    figure.tight_layout()
    return figure


def _scale(p: Parameter) -> float:
    """Return the reference of a deviation: the file's value, or the scale if that is too small."""
    offset = "com_" in p.name or p.name.endswith(("_xy_kgm2", "_xz_kgm2", "_yz_kgm2"))
    return p.scale if offset or abs(p.nominal) <= 0.2 * p.scale else abs(p.nominal)
