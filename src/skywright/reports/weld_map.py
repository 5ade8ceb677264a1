"""The weld map: the unrolled surface with the probe's signal, the crossings and the lines."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.patches import Patch
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.description.world.spec import Weld
from skywright.description.world.surface import build_weld_curve
from skywright.errors import InputError
from skywright.inspection.calibration import to_complex
from skywright.inspection.weld import WeldResult
from skywright.inspection.weld_data import WeldReport

MAX_POINTS = 6000
_ESTIMATE, _TRUTH, _LOST, _CROSSING = "#c1121f", "#111111", "#8a8f98", "#c1121f"


def _thin(index: np.ndarray) -> np.ndarray:
    return index[:: max(1, math.ceil(index.size / MAX_POINTS))]


def _find_inside(s: Array, c: Array, box: tuple[float, float, float, float]) -> NDArray[np.bool_]:
    return (s >= box[0]) & (s <= box[1]) & (c >= box[2]) & (c <= box[3])


def draw_weld_map(
    ax: Axes, result: WeldResult, truth: Sequence[Weld] = (), colorbar: bool = True
) -> None:
    """Draw the map of a scan; `truth` are the true welds in the same unrolled coordinates."""
    cal = result.calibration
    on_surface = result.contact & np.isfinite(result.s + result.c)
    # lost contact is drawn only near the surface: the approach is not a fault
    lost = np.isfinite(result.s + result.c) & ~result.contact & (np.abs(result.gap) < 0.005)
    seen = on_surface | lost
    if seen.any():
        s, c = result.s[seen], result.c[seen]
        margin = max(0.008, 0.06 * max(float(np.ptp(s)), float(np.ptp(c))))
        box = (s.min() - margin, s.max() + margin, c.min() - margin, c.max() + margin)
    else:
        box = (-0.1, 0.1, -0.1, 0.1)
    handles: list[Any] = []
    labels: list[str] = []

    index = _thin(np.flatnonzero(lost))
    if index.size:
        mark = ax.plot(1e3 * result.s[index], 1e3 * result.c[index], "x", color=_LOST, ms=4)[0]
        handles.append(mark)
        labels.append("near the surface, not in contact")
    index = _thin(np.flatnonzero(on_surface))
    top = cal.weld_threshold * 3
    if index.size:
        top = max(top, float(np.quantile(result.weld[index], 0.998)))
        dots = ax.scatter(
            1e3 * result.s[index],
            1e3 * result.c[index],
            c=result.weld[index],
            s=9,
            cmap="viridis",
            vmin=0,
            vmax=top,
            linewidths=0,
        )
        if colorbar and ax.figure is not None:
            bar = ax.figure.colorbar(dots, ax=ax, pad=0.02, fraction=0.05, shrink=0.8)
            bar.set_label("weld signal (instrument units)")
            bar.ax.axhline(cal.weld_threshold, color=_ESTIMATE, lw=1.5)
            bar.ax.text(
                -0.25,
                cal.weld_threshold,
                "threshold",
                color=_ESTIMATE,
                fontsize=7,
                rotation=90,
                ha="right",
                va="center",
                transform=bar.ax.get_yaxis_transform(),
            )
    ways = np.linspace(-1.0, 1.0, 801) * math.hypot(box[1] - box[0], box[3] - box[2])
    for weld in truth:
        true = build_weld_curve(weld, result.surface.radius)
        s, c = true.follow(max(abs(box[0]), abs(box[1])), 4001)
        turn = 2.0 * math.pi * result.surface.radius
        c = c - turn * np.round((c - 0.5 * (box[2] + box[3])) / turn)  # at the turn of the scan
        inside = _find_inside(s, c, box)
        if inside.any():
            s, c = np.where(inside, s, np.nan), np.where(inside, c, np.nan)
            if abs(weld.angle_deg) < 60:
                width = weld.half_width_m * np.hypot(1.0, np.gradient(s, c))
                ax.fill_betweenx(
                    1e3 * c, 1e3 * (s - width), 1e3 * (s + width),
                    color="#d9c9a3", alpha=0.5, lw=0, zorder=0,
                )  # fmt: skip
                handles.append(Patch(color="#d9c9a3", alpha=0.5))
                labels.append(f"true weld, {2e3 * weld.half_width_m:.0f} mm wide")
            dashed = ax.plot(1e3 * s, 1e3 * c, color=_TRUTH, lw=1.4, ls=(0, (6, 4)), zorder=4)
            handles.append(dashed[0])
            labels.append("true weld line")
    for line in result.lines:
        s, c = line.follow(ways)
        inside = _find_inside(s, c, box)
        if inside.any():
            path, along = np.column_stack([s, c])[inside], ways[inside]
            half = 2 * np.hypot(line.std_offset, line.std_angle * along)[:, None]
            normal = np.array([math.cos(line.angle), -math.sin(line.angle)])
            band = np.concatenate([path + half * normal, (path - half * normal)[::-1]])
            ax.fill(*(1e3 * band.T), color=_ESTIMATE, alpha=0.25, lw=0)
            drawn = ax.plot(*(1e3 * path.T), color=_ESTIMATE, lw=1.6)[0]
            handles.append((drawn, Patch(color=_ESTIMATE, alpha=0.25)))
            labels.append(
                f"estimated line {math.degrees(line.angle):.2f} ± "
                f"{math.degrees(line.std_angle):.2f}°, ± {1e3 * line.std_offset:.2f} mm "
                "on this surface (band: 2 std)"
            )
    for on_line, label in ((True, "crossings"), (False, "crossing left out")):
        some = [x for x in result.crossings if (x.line >= 0 or not result.lines) == on_line]
        if some:
            face = "white" if on_line else "none"
            mark = ax.plot(
                [1e3 * x.s for x in some],
                [1e3 * x.c for x in some],
                "o" if on_line else "s",
                mfc=face,
                mec=_CROSSING,
                ms=7,
                mew=1.6,
                ls="none",
                zorder=6,
            )[0]
            handles.append(mark)
            labels.append(f"{label} ({len(some)})")
    ax.set(
        xlim=(1e3 * box[0], 1e3 * box[1]),
        ylim=(1e3 * box[2], 1e3 * box[3]),
        aspect="equal",
        xlabel="s, along the pipe's axis (mm)",
        ylabel="c, around the pipe (mm)",
    )
    if not result.lines:
        ax.set_title("No weld line found", color=_ESTIMATE, fontsize=10)
    if handles:
        ax.legend(
            handles,
            labels,
            loc="upper center",
            bbox_to_anchor=(0.5, 0.0),
            borderaxespad=4.1,  # in font sizes: below the axis label for any height of the map
            ncols=2,
            fontsize=8,
            frameon=False,
            handler_map={tuple: HandlerTuple(ndivide=1)},
        )


def draw_impedance_plane(ax: Axes, ec: np.ndarray, result: WeldResult, zoom: bool = False) -> None:
    """Draw the instrument's display: signal and calibrated axes; `zoom`: near contact."""
    cal = result.calibration
    w = to_complex(ec)
    finite = np.isfinite(w)
    air = _thin(np.flatnonzero(finite & ~result.contact))
    touch = _thin(np.flatnonzero(finite & result.contact & ~result.on_weld))
    weld = _thin(np.flatnonzero(finite & result.on_weld))
    for index, color, label in (
        (air, _LOST, "off the surface"),
        (touch, "#31688e", "in contact"),
        (weld, "#e9b000", "on the weld"),
    ):
        ax.plot(w[index].real, w[index].imag, ".", ms=2.5, color=color, label=label)
    reach = np.linspace(0, cal.excursion, 80)
    bend = reach * (cal.curve[0] + reach * (cal.curve[1] + reach * cal.curve[2]))
    curve = cal.contact + cal.lift_off_axis * (reach + 1j * bend)
    ax.plot(curve.real, curve.imag, color="#444444", lw=1, label="lift-off curve (calibration)")
    if zoom:
        if cal.weld_axis is not None:
            tip = cal.contact + cal.weld_axis * (1.2 * cal.lift_off_threshold)
            ax.annotate(
                "",
                xy=(tip.real, tip.imag),
                xytext=(cal.contact.real, cal.contact.imag),
                arrowprops={"arrowstyle": "->", "color": _ESTIMATE, "lw": 1.4},
            )
            tip = cal.contact + cal.weld_axis * (1.35 * cal.lift_off_threshold)
            ax.text(
                tip.real, tip.imag, "weld", color=_ESTIMATE, fontsize=8, ha="center", va="center"
            )
        # between these lines the lift-off signal means contact
        side = cal.weld_axis or 1j * cal.lift_off_axis
        for sign in (-1, 1):
            edge = cal.lift_off_threshold * (sign * cal.lift_off_axis + side * np.array([-3, 3]))
            edge = edge + cal.contact
            ax.plot(edge.real, edge.imag, color=_ESTIMATE, lw=1, ls="--")
        reach_shown = 1.6 * cal.lift_off_threshold
        ax.set(
            xlim=(cal.contact.real - reach_shown, cal.contact.real + reach_shown),
            ylim=(cal.contact.imag - reach_shown, cal.contact.imag + reach_shown),
            aspect="equal",
        )
        ax.set_title("near contact (dashed: lift-off threshold)", fontsize=9)
        ax.set(xlabel="real part (instrument units)", ylabel="imaginary part")
        return
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_ylabel("imaginary part")
    ax.set_title("Instrument display (impedance plane)", fontsize=10)
    ax.legend(fontsize=7, frameon=False, markerscale=3, loc="best")


def draw_weld_signal(ax: Axes, result: WeldResult) -> None:
    """Draw lift-off and weld components over time with their thresholds."""
    cal = result.calibration
    finite = np.flatnonzero(np.isfinite(result.t + result.lift_off))
    index = finite[:: max(1, math.ceil(finite.size / 20000))]
    t = result.t[index] - result.t[finite[0]] if finite.size else result.t[index]
    start = float(result.t[finite[0]]) if finite.size else 0.0
    shown = np.where(result.contact[index], result.weld[index] / cal.weld_threshold, np.nan)
    ax.plot(t, shown, color="#b98900", lw=0.9)
    # above the weld signal, whose noise is wider: both are near 0 between crossings
    ax.plot(t, result.lift_off[index] / cal.lift_off_threshold, color="#1a5fd0", lw=1.6)
    ax.axhline(1.0, color=_ESTIMATE, lw=1, ls="--")
    for x in result.crossings:
        ax.axvline(x.t - start, color=_ESTIMATE, lw=0.8, alpha=0.6)
    high = 3.0
    if result.contact.any():
        high = max(high, 1.15 * float(np.nanmax(result.weld[result.contact])) / cal.weld_threshold)
    ax.set(
        ylim=(-1.5, min(high, 12.0)),
        xlabel="time (s)" if start == 0 else f"time since {start:g} s (s)",
        ylabel="signal / threshold",
    )
    ax.set_title(
        f"Lift-off (blue, contact below {cal.lift_off_threshold:.3g}) and weld signal (ochre, weld "
        f"above {cal.weld_threshold:.3g}), each divided by its threshold; red lines: crossings",
        fontsize=9,
    )
    ax.margins(x=0)
    ax.grid(alpha=0.25)


def build_weld_figure(
    result: WeldResult, ec: np.ndarray, title: str, truth: Sequence[Weld] = ()
) -> Figure:
    """Build the whole figure: map, impedance plane and signals."""
    figure = Figure(figsize=(11, 8.2), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 2, height_ratios=[1.1, 1.5, 1], width_ratios=[1.9, 1])
    draw_weld_map(figure.add_subplot(grid[:2, 0]), result, truth)
    draw_impedance_plane(figure.add_subplot(grid[0, 1]), ec, result)
    draw_impedance_plane(figure.add_subplot(grid[1, 1]), ec, result, zoom=True)
    draw_weld_signal(figure.add_subplot(grid[2, :]), result)
    figure.suptitle(title, fontsize=12)
    return figure


def write_weld_map(
    report: WeldReport | WeldResult,
    path: Path,
    *,
    ec: np.ndarray | None = None,
    truth: Sequence[Weld] = (),
    title: str | None = None,
) -> None:
    """Write the figure (PNG, SVG or PDF by the suffix) of a processed file or scan.

    A WeldResult also needs its signal `ec` (n, 2). Raises InputError if the path is unwritable.
    """
    if isinstance(report, WeldReport):
        result, ec = report.result, report.scan.ec
        surface = "fitted" if report.fit.fitted else "given"
        title = title or (
            f"Weld map of {report.name}: unrolled surface, {surface} cylinder of "
            f"{2e3 * result.surface.radius:.1f} mm diameter"
            + (f" (± {2e3 * report.fit.std_radius:.1f} mm)" if report.fit.fitted else "")
        )
    else:
        result = report
        title = title or f"Weld map: unrolled pipe of {2e3 * result.surface.radius:.0f} mm diameter"
        if ec is None:
            raise InputError("weld map: the signal `ec` is needed with a WeldResult")
    figure = build_weld_figure(result, ec, title.replace("$", r"\$"), truth)
    path = Path(path)
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"{path}: unknown picture format; valid: .png, .svg, .pdf")
    try:
        figure.savefig(path, dpi=150)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
