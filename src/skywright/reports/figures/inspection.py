"""What the inspection found: weld map, instrument display, contact quality."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from skywright.evaluation.metrics import LIFT_OFF_THRESHOLD
from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT, compute_contact_map
from skywright.inspection.eddy_current import Instrument
from skywright.reports.figures.paths import select_scan, unroll_points
from skywright.reports.figures.style import LIMIT, WIDTH, new_figure
from skywright.reports.weld_map import draw_impedance_plane, draw_weld_map, draw_weld_signal

if TYPE_CHECKING:
    from skywright.evaluation.run import RunResult


def draw_map(result: RunResult) -> Figure | None:
    """Weld signal on the unrolled pipe with the true and the estimated line."""
    if result.weld is None:
        return None
    figure = new_figure(WIDTH, 5.0)
    ax = figure.add_axes((0.08, 0.22, 0.88, 0.72))
    draw_weld_map(ax, result.weld, result.description.world.weld)
    return figure


def draw_instrument(result: RunResult) -> Figure | None:
    """Impedance plane, its part near contact, and both components over time."""
    if result.weld is None:
        return None
    s = select_scan(result)
    ec = s["ec"]
    if len(ec) != len(result.weld.t):
        return None
    figure = new_figure(WIDTH, 6.6)
    draw_impedance_plane(figure.add_axes((0.075, 0.46, 0.43, 0.49)), ec, result.weld)
    draw_impedance_plane(figure.add_axes((0.58, 0.46, 0.40, 0.49)), ec, result.weld, zoom=True)
    draw_weld_signal(figure.add_axes((0.075, 0.075, 0.905, 0.25)), result.weld)
    return figure


def draw_contact_quality(result: RunResult) -> Figure | None:
    """Worst gap, tilt and lift-off of each 5 mm cell of the unrolled pipe."""
    s = select_scan(result)
    if len(s) < 2 or result.description.world.pipe is None:
        return None
    along, around = unroll_points(result, s["p_WT"])
    phase = Instrument().phase
    lift = s["ec"] @ np.array([math.cos(phase), math.sin(phase)])
    grid = compute_contact_map(along, around, 1e3 * s["gap_max"], s["tilt"], lift)
    figure = new_figure(WIDTH, 3.5)
    panels = (
        (grid.gap, "Worst air gap (mm)", 1e3 * GAP_LIMIT, "limit {:g} mm"),
        (np.degrees(grid.tilt), "Worst probe tilt (deg)", math.degrees(TILT_LIMIT), "limit {:g}"),
        (grid.lift_off, "Worst lift-off signal (units)", LIFT_OFF_THRESHOLD, "limit {:g}"),
    )
    s_plan, c_plan = unroll_points(result, s["ref_p_WT"])
    colours = colormaps["cividis"].with_extremes(over=LIMIT)
    for i, (cells, title, limit, label) in enumerate(panels):
        ax = figure.add_axes((0.07 + 0.325 * i, 0.27, 0.265, 0.6))
        image = ax.pcolormesh(
            1e3 * grid.s_edges, 1e3 * grid.c_edges, np.clip(cells, 0.0, None).T, cmap=colours,
            vmin=0.0, vmax=limit, rasterized=True,
        )  # fmt: skip
        ax.plot(1e3 * s_plan, 1e3 * c_plan, color="#999999", lw=0.5, ls=":")
        ax.grid(False)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_title(title)
        ax.set_xlabel("s, along the axis (mm)")
        if i == 0:
            ax.set_ylabel("c, around the pipe (mm)")
        scale = figure.add_axes((0.07 + 0.325 * i, 0.105, 0.265, 0.03))
        bar = figure.colorbar(image, cax=scale, orientation="horizontal", extend="max")
        bar.set_ticks([0.0, limit / 2, limit])
        bar.ax.set_xticklabels(["0", f"{limit / 2:g}", label.format(limit)])
        bar.ax.tick_params(labelsize=7.5)
    return figure
