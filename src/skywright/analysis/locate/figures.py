"""Figures of a localisation: paths, coordinates, errors, clocks, drift of the camera."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skywright.analysis.locate.locate import Fusion, LocateReport
from skywright.analysis.locate.trajectory_error import TrajectoryError
from skywright.core.arrays import Mask
from skywright.models.localisation.drift_filter import CAMERA, STATION
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIMIT,
    ORANGE,
    PURPLE,
    WIDTH,
    draw_line,
    fit_y,
    new_figure,
)

MANY_POINTS = 4000
AXES = "xyz"


def draw_paths(report: LocateReport) -> Figure:
    """Draw the result, the sensors and the reference from above and from the side."""
    figure = new_figure(WIDTH, 4.4)
    for i, (a, b) in enumerate(((0, 1), (0, 2))):
        ax = figure.add_subplot(1, 2, i + 1)
        f = report.fusion
        if f is not None:
            camera, station = f.events.kind == CAMERA, f.events.kind == STATION
            z = f.events.z
            aligned = z[camera][:: _every(camera)]
            ax.plot(aligned[:, a], aligned[:, b], color=ORANGE, lw=0.9, label="camera, aligned")
            seen = z[station]
            ax.plot(seen[:, a], seen[:, b], ".", ms=3, color=GREY, label="total station")
        error = report.errors.get("fused") or report.errors.get("trajectory")
        p = report.trajectory.p
        if error is not None:
            ax.plot(error.p_ref[:, a], error.p_ref[:, b], color=BLACK, lw=1.6, alpha=0.5,
                    label="reference")  # fmt: skip
            p = error.p if error.frame is None else error.frame.apply(p)
        p = p[:: max(1, len(p) // MANY_POINTS)]
        name = "fused" if f is not None else report.trajectory.name[:30]
        ax.plot(p[:, a], p[:, b], color=BLUE, lw=1.2, label=name)
        ax.plot(*p[0, [a, b]], "o", color=GREEN, ms=6, label="start")
        ax.set(
            xlabel=f"{AXES[a]} (m)",
            ylabel=f"{AXES[b]} (m)",
            title="from above" if b == 1 else "from the side",
        )
        ax.set_aspect("equal", adjustable="datalim")
        if i == 0:
            ax.legend(loc="best", fontsize=7.5)
    figure.tight_layout(pad=0.8, w_pad=1.6)
    return figure


def _every(mask: Mask) -> int:
    return max(1, int(np.count_nonzero(mask)) // MANY_POINTS)


def draw_coordinates(f: Fusion) -> Figure:
    """Draw each coordinate over time, with the outages of the station."""
    figure, axes = _stack(3)
    start = float(f.events.t[0])
    t = f.events.t - start
    camera, station = f.events.kind == CAMERA, f.events.kind == STATION
    for i, ax in enumerate(axes):
        _shade_outages(ax, f, start)
        draw_line(ax, t[camera], f.events.z[camera, i], color=ORANGE, label="camera, aligned")
        ax.plot(t[station], f.events.z[station, i], ".", ms=2.5, color=GREY,
                label="total station")  # fmt: skip
        draw_line(ax, t, f.fused.p[:, i], color=BLUE, label="fused")
        ax.set_ylabel(f"{AXES[i]} (m)")
        # keep outliers from compressing the axis
        fit_y(ax, *np.quantile(f.fused.p[:, i], [0.0, 1.0]),
              *np.quantile(f.events.z[camera, i], [0.0, 1.0]))  # fmt: skip
    axes[0].legend(loc="upper left", ncols=3, fontsize=7.5)
    return figure


def _stack(count: int, height: float = 1.55) -> tuple[Figure, list[Axes]]:
    figure = new_figure(WIDTH, 0.6 + height * count)
    first = figure.add_subplot(count, 1, 1)
    axes = [first, *(figure.add_subplot(count, 1, i + 2, sharex=first) for i in range(count - 1))]
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time since the start of the recording (s)")
    figure.subplots_adjust(
        left=0.075, right=0.985, top=1 - 0.3 / figure.get_figheight(),
        bottom=0.5 / figure.get_figheight(), hspace=0.16,
    )  # fmt: skip
    return figure, axes


def _shade_outages(ax: Axes, f: Fusion, start: float) -> None:
    for o in f.outages:
        ax.axvspan(o.start - start, o.end - start, color="#f3d9d6", lw=0, zorder=0)


def draw_errors(report: LocateReport) -> Figure:
    """Draw the distance from the reference over time."""
    figure = new_figure(WIDTH, 3.0)
    ax = figure.add_axes((0.075, 0.16, 0.91, 0.72))
    start = min(float(e.t[0]) for e in report.errors.values())
    if report.fusion is not None:
        start = float(report.fusion.events.t[0])
        _shade_outages(ax, report.fusion, start)
    for name, e, color in _list_errors(report):
        draw_line(ax, e.t - start, 1e3 * np.maximum(e.error, 1e-5), color=color,
                  label=f"{name}: rms {_length(e.absolute.rms)}")  # fmt: skip
    if report.std is not None:
        t = report.trajectory.t - start
        draw_line(ax, t, 2e3 * report.std, color=BLUE, lw=0.8, ls=":",
                  label="fused: two standard deviations, as stated by the filter")  # fmt: skip
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** 0.35)
    ax.legend(loc="upper left", fontsize=7.5)
    ax.set(
        xlabel="time since the start of the recording (s)",
        ylabel="distance (mm)",
        title="Distance from the reference over time",
    )
    ax.yaxis.set_major_formatter(lambda v, _: f"{v:g}")
    return figure


def draw_distribution(report: LocateReport) -> Figure:
    """Draw the cumulative distribution of the distance from the reference."""
    figure = new_figure(0.62 * WIDTH, 2.9)
    ax = figure.add_axes((0.12, 0.17, 0.85, 0.71))
    for name, e, color in _list_errors(report):
        size = np.sort(1e3 * e.error)[:: max(1, len(e.error) // 500)]
        ax.plot(size, np.linspace(0, 100, len(size)), color=color, label=name)
    ax.set_xscale("log")
    ax.set(
        xlabel="distance from the reference (mm)", ylabel="samples below (%)",
        title="Distribution of the distance",
    )  # fmt: skip
    ax.legend(loc="upper left", fontsize=7.5)
    ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
    return figure


def _list_errors(report: LocateReport) -> list[tuple[str, TrajectoryError, str]]:
    """Return name, error and colour, the first last: it is drawn on top."""
    colors = (BLUE, PURPLE, ORANGE)
    pairs = zip(report.errors.items(), colors[: len(report.errors)], strict=True)
    return [(name, e, color) for (name, e), color in pairs][::-1]


def _length(metres: float) -> str:
    return f"{1e3 * metres:.1f} mm" if metres < 0.1 else f"{metres:.3g} m"


def draw_clocks(f: Fusion) -> Figure | None:
    """Draw the correlation of the speeds over the clock offset."""
    if f.time is None or not len(f.time.lags):
        return None
    figure = new_figure(0.62 * WIDTH, 2.7)
    ax = figure.add_axes((0.12, 0.18, 0.85, 0.7))
    draw_line(ax, f.time.lags, f.time.correlation, color=BLUE)
    found = f.calibration.time_offset
    ax.axvline(found, color=LIMIT, lw=1.1, ls=(0, (5, 3)))
    ax.annotate(
        f"{found:+.4f} ± {f.calibration.offset_std:.4f} s", (found, 1.0), (4, -2),
        xycoords=("data", "axes fraction"), textcoords="offset points", va="top", fontsize=8,
        color=LIMIT,
    )  # fmt: skip
    ax.set(
        xlabel="camera's clock minus station's (s)",
        ylabel="correlation of the speeds",
        title="Correlation of the speeds against the clock offset",
    )
    return figure


def draw_camera(f: Fusion) -> Figure:
    """Draw the estimated errors of the camera: drift, rotation, scale."""
    figure, axes = _stack(3, 1.4)
    start = float(f.events.t[0])
    t = f.events.t - start
    for ax in axes:
        _shade_outages(ax, f, start)
    for i, color in enumerate((BLUE, ORANGE, GREEN)):
        draw_line(axes[0], t, 1e3 * f.fused.drift[:, i], color=color, label=AXES[i])
    axes[0].set_ylabel("drift (mm)")
    axes[0].legend(loc="upper left", ncols=3, fontsize=7.5)
    for i, (name, color) in enumerate((("tilt x", GREY), ("tilt y", ORANGE), ("heading", BLUE))):
        draw_line(axes[1], t, np.degrees(f.fused.turn[:, i]), color=color, label=name)
    axes[1].set_ylabel("turn (deg)")
    axes[1].legend(loc="upper left", ncols=3, fontsize=7.5)
    draw_line(axes[2], t, 100.0 * (f.fused.scale - 1.0), color=BLUE)
    axes[2].set_ylabel("scale change (%)")
    jumps = t[(f.events.kind == CAMERA) & ~f.fused.accepted]
    for at in jumps[:40]:
        axes[0].axvline(at, color=LIMIT, lw=0.8, alpha=0.6)
    return figure
