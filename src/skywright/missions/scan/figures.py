"""What the inspection found: weld map, instrument display, contact quality."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT, compute_contact_map
from skywright.inspection.eddy_current import Instrument
from skywright.inspection.weld import detect_contact
from skywright.reports.figures.paths import select_scan, unroll_points
from skywright.reports.figures.style import LIMIT, WIDTH, new_figure, new_map
from skywright.reports.weld_map import draw_impedance_plane, draw_weld_map, draw_weld_signal
from skywright.run.metrics import LIFT_OFF_THRESHOLD, in_phases

if TYPE_CHECKING:
    from skywright.run.run import RunResult


CELL = 0.008  # m, of the contact map


def draw_map(result: RunResult) -> Figure | None:
    """Weld signal on the unrolled pipe with the true and the estimated line."""
    if result.weld is None:
        return None
    seen = np.isfinite(result.weld.s + result.weld.c)
    if not seen.any():
        return None
    figure, ax = new_map(result.weld.s[seen], result.weld.c[seen], 0.2, below=0.85, right=0.65)
    draw_weld_map(ax, result.weld, result.description.world.weld)
    ax.grid(False)
    return figure


def draw_instrument(result: RunResult) -> Figure | None:
    """Impedance plane, its part near contact, and both components over time."""
    weld = result.weld
    if weld is None:
        return None
    ec = select_scan(result)["ec"]
    if len(ec) != len(weld.t):
        return None
    touch = result.samples[in_phases(result.samples, result.phases, "touch")]["ec"]
    touching = detect_contact(touch, weld.calibration)[2]
    shown = weld._replace(
        contact=np.concatenate([touching, weld.contact]),
        on_weld=np.concatenate([np.zeros(len(touch), bool), weld.on_weld]),
    )
    ec = np.concatenate([touch, ec])
    figure = new_figure(WIDTH, 6.8)
    left = figure.add_axes((0.075, 0.46, 0.43, 0.49))
    draw_impedance_plane(left, ec, shown)
    left.set_title("Instrument display (impedance plane)")
    left.set_xlabel("real part (instrument units)")
    left.set_ylabel("imaginary part (instrument units)")
    right = figure.add_axes((0.58, 0.46, 0.40, 0.49))
    draw_impedance_plane(right, ec, shown, zoom=True)
    right.set_title("The same near contact; dashed: lift-off threshold")
    below = figure.add_axes((0.075, 0.075, 0.905, 0.25))
    draw_weld_signal(below, weld)
    below.set_title(
        "Lift-off (blue) and weld signal (ochre) while scanning, each over its threshold; "
        "red: crossings",
        fontsize=9,
    )
    return figure


def draw_contact_quality(result: RunResult) -> Figure | None:
    """Worst gap, tilt and lift-off of each 8 mm cell of the unrolled pipe."""
    s = select_scan(result)
    if len(s) < 2 or result.description.world.pipe is None:
        return None
    along, around = unroll_points(result, s["p_WT"])
    phase = Instrument().phase
    lift = s["ec"] @ np.array([math.cos(phase), math.sin(phase)])
    grid = compute_contact_map(along, around, 1e3 * s["gap_max"], s["tilt"], lift, CELL)
    figure = new_figure(WIDTH, 3.5)
    panels = (
        (grid.gap, "Worst air gap (mm)", 1e3 * GAP_LIMIT, "limit {:g} mm"),
        (
            np.degrees(grid.tilt),
            "Worst probe tilt (deg)",
            math.degrees(TILT_LIMIT),
            "limit {:g} deg",
        ),
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


FIGURES: dict[str, Callable[[RunResult], Figure | None]] = {
    "weld_map": draw_map,
    "contact_quality": draw_contact_quality,
    "instrument": draw_instrument,
}
PHASES = {
    "approach": "Along the planned way to the pipe, arm folded.",
    "unfold": "The arm takes the pose in which it measures.",
    "close_in": "The probe stops a few centimetres off the surface.",
    "trim": "The controller learns the steady errors before it touches.",
    "touch": "The probe moves onto the surface and its spring is pressed in.",
    "settle": "At rest in contact; is the probe really on?",
    "scan": "The probe slides along the planned lines under force: this is what is judged.",
    "back_off": "Contact was lost: back from the surface, for another try.",
    "leave": "The probe leaves the surface.",
    "fold": "The arm goes back into its pose of flight.",
}
"""Phase -> what is done in it."""

CAPTIONS = {
    "weld_map": (
        "Weld map",
        "The scanned part of the pipe, unrolled flat. Each dot is a reading of the probe, "
        "brighter where it sees more weld. A red line is where the processing says that the "
        "weld runs, a dashed black one where it is in truth.",
    ),
    "contact_quality": (
        "Contact quality",
        "The worst value in each cell of 8 mm that the probe passed. Dark is good, red is "
        "beyond the limit; cells without colour were not visited. The lift-off signal is "
        "what the instrument itself knows of the gap.",
    ),
    "instrument": (
        "What the instrument showed",
        "An eddy-current instrument shows a point in a plane. Lifting the probe moves it "
        "along the lift-off curve, a weld moves it across. Right: the part near contact. "
        "Below: both movements over the scan; a weld is seen where the ochre line passes "
        "the threshold.",
    ),
}


def describe(result: RunResult) -> str:
    """Say what was scanned and found."""
    d = result.description
    contact = result.metrics.get("contact.duration_s", 0.0)
    did = f"{d.robot.name} in world {d.world.name} scanned for {contact:.0f} s"
    line = result.weld.line if result.weld is not None else None
    if line is None:
        return did + " and found no weld"
    return did + (
        f" and found the weld on {len(line.inliers)} crossings, at "
        f"{math.degrees(line.angle):.1f} deg ± {math.degrees(line.std_angle):.1f} deg "
        "from the circumference"
    )
