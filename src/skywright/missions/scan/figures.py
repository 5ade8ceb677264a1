"""Figures of an inspection: weld map, instrument display, contact quality."""

import math

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.loader import Description
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import Pipe, Weld
from skywright.description.world.surface import build_cylinder
from skywright.description.world.surface import surface_point as compute_surface_point
from skywright.inspection.contact_quality import GAP_LIMIT, TILT_LIMIT, compute_contact_map
from skywright.inspection.weld import detect_contact
from skywright.inspection.weld_line import WeldLine
from skywright.missions.scan.carried_weld import carry_weld
from skywright.missions.scan.metrics import (
    LIFT_OFF_THRESHOLD,
    find_coverage,
    find_survey,
    get_surface,
)
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.task import Scan
from skywright.missions.skills.datum import describe_datum, list_datum_marks
from skywright.models.eddy_current import Instrument
from skywright.models.rigid_body import build_body_model, compute_tip, posture
from skywright.planning.patterns import build_pattern
from skywright.reports.figures.paths import select_scan, unroll_points
from skywright.reports.figures.series import LIMITS_DRAWN, draw_contact_series
from skywright.reports.figures.style import LIMIT, WIDTH, new_figure, new_map
from skywright.reports.weld_map import draw_impedance_plane, draw_weld_map, draw_weld_signal
from skywright.run.flight import Flown
from skywright.run.kind import Chart, Figures, Sketch
from skywright.run.metrics import in_phases
from skywright.run.result import RunResult
from skywright.run.setup import Setup

CELL = 0.008  # m, of the contact map


def draw_map(result: RunResult[Scan, ScanWay]) -> Figure | None:
    """Draw the weld signal on the unrolled pipe with the true and the estimated line."""
    if result.details is None:
        return None
    seen = np.isfinite(result.details.s + result.details.c)
    if not seen.any():
        return None
    figure, ax = new_map(
        result.details.s[seen], result.details.c[seen], 0.2, below=0.85, right=0.65
    )
    draw_weld_map(ax, result.details, _find_true_welds(result))
    ax.grid(False)
    return figure


def _find_true_welds(result: RunResult[Scan, ScanWay]) -> list[Weld]:
    """Return the true welds as they lie on the map of the inspection."""
    setup = Setup(result.description)
    surface = get_surface(Flown(setup, result.plan, result.samples, result.phases))
    line, world = result.details.line, setup.true.world
    near = np.array([line.s, line.c] if line else [0.0, 0.0])
    if surface is None:
        return []
    return [carry_weld(world, weld, surface, near) for weld in world.list_welds()]


def draw_coverage(result: RunResult[Scan, ScanWay]) -> Figure | None:
    """Draw the requested pattern, its inspected and missed parts, and the area."""
    flown = Flown(Setup(result.description), result.plan, result.samples, result.phases)
    found = find_coverage(flown)
    if found is None:
        return None
    s, c = 1e3 * found.cells.T
    figure, ax = new_map(1e-3 * s, 1e-3 * c, 0.2, below=0.85, right=0.65)
    inside = found.covered
    size = 0.55 * 1e3 * found.cell  # no gap between cells
    for keep, colour, label in (
        (~inside, "#eceef1", "sector, not under the coil"),
        (inside, "#9cc5a1", f"under the coil ({np.mean(inside):.0%} of the sector's area)"),
    ):
        centres = np.column_stack([s[keep], c[keep]])
        squares = centres[:, None] + size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        ax.add_collection(PolyCollection([*squares], facecolor=colour, lw=0, rasterized=True))
        ax.plot([], [], "s", color=colour, label=label)
    path = 1e3 * found.path
    for keep, colour, label in (
        (found.seen, "#1b7837", "pattern, inspected"), (~found.seen, LIMIT, "pattern, missed")
    ):  # fmt: skip
        line = np.where(keep[:, None], path, np.nan)
        if np.any(keep):
            ax.plot(*line.T, color=colour, lw=1.6, label=label)
    ax.set_aspect("equal")
    ax.set(xlabel="s, along the pipe's axis (mm)", ylabel="c, around the pipe (mm)")
    ax.grid(False)
    ax.legend(
        loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=4.1, ncols=2, fontsize=8,
        frameon=False,
    )  # fmt: skip
    return figure


def draw_instrument(result: RunResult[Scan, ScanWay]) -> Figure | None:
    """Draw the impedance plane, its part near contact, and both components over time."""
    weld = result.details
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
    left.set(
        title="Instrument display (impedance plane)",
        xlabel="real part (instrument units)",
        ylabel="imaginary part (instrument units)",
    )
    right = figure.add_axes((0.58, 0.46, 0.40, 0.49))
    draw_impedance_plane(right, ec, shown, zoom=True)
    right.set_title("Detail near contact; dashed: lift-off threshold")
    below = figure.add_axes((0.075, 0.075, 0.905, 0.25))
    draw_weld_signal(below, weld)
    below.set_title(
        "Lift-off (blue) and weld signal (ochre) during the scan, each divided by its "
        "threshold; red: crossings",
        fontsize=9,
    )
    return figure


def draw_contact_quality(result: RunResult[Scan, ScanWay]) -> Figure | None:
    """Draw the worst gap, tilt and lift-off of each 8 mm cell of the unrolled pipe."""
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
        ax.set(title=title, xlabel="s, along the axis (mm)")
        if i == 0:
            ax.set_ylabel("c, around the pipe (mm)")
        scale = figure.add_axes((0.07 + 0.325 * i, 0.105, 0.265, 0.03))
        bar = figure.colorbar(image, cax=scale, orientation="horizontal", extend="max")
        bar.set_ticks([0.0, limit / 2, limit])
        bar.ax.set_xticklabels(["0", f"{limit / 2:g}", label.format(limit)])
        bar.ax.tick_params(labelsize=7.5)
    return figure


PHASES = {
    "approach": "The robot flies along the planned path to the pipe with the arm folded.",
    "unfold": "The arm moves to its measuring pose.",
    "missed_move": "The probe moves to the parts that the first scan missed.",
    "close_in": "The probe stops a few centimetres off the surface.",
    "survey_move": "The robot flies to the next touch point of the survey.",
    "look": "The probe's camera looks at the datum mark.",
    "survey_touch": "The robot advances until it detects contact; the tip rests for a second.",
    "survey_back": "The robot backs off the surface.",
    "survey_leave": (
        "The robot leaves the pipe; the pipe is fitted to the touches, and the scan is "
        "planned again."
    ),
    "face": "The robot flies to a position in front of the surveyed pipe.",
    "trim": "The integrators settle before contact.",
    "touch": "The probe touches the surface and compresses its spring.",
    "settle": "The probe rests in contact; the contact is verified.",
    "scan": (
        "The probe slides along the planned lines under force. The requirements refer to this "
        "phase."
    ),
    "back_off": "Contact was lost; the robot retreats for another try.",
    "leave": "The probe leaves the surface.",
    "fold": "The arm returns to its flight pose.",
}
"""Phase -> description of what the robot does in it."""


def describe(result: RunResult[Scan, ScanWay]) -> str:
    """Return a sentence on the scan and its result."""
    d = result.description
    contact = result.metrics.get("contact.duration_s", 0.0)
    did = f"{d.robot.name} in world {d.world.name} scanned for {contact:.0f} s"
    weld = result.details
    lines = weld.lines if weld is not None else ()
    if not lines:
        n = len(weld.crossings) if weld is not None else 0
        if not n:
            return did + " and found no weld"
        return did + f" and found {n} crossing{'s' * (n > 1)} of a weld, but no line"
    told = " and ".join(
        f"{len(result.details.list_crossings(k))} crossings, at "
        f"{math.degrees(line.angle):.2f} deg ± {compute_angle_std(result, line):.2f} deg"
        for k, line in enumerate(lines)
    )
    what = "the weld" if len(lines) == 1 else f"{len(lines)} welds"
    return did + f" and found {what} on {told} from the circumference"


def compute_angle_std(result: RunResult[Scan, ScanWay], line: WeldLine) -> float:
    """Return the standard deviation (deg) of a weld's angle from the true pipe's circumference.

    It contains that of the line on the believed surface, and that of the surface's axis about its
    normal at the line: a survey of a sector determines the axis less accurately. Without a survey
    the map's error, uniform within its bound, remains.
    """
    phi = line.c / result.details.surface.radius
    of_map = result.description.plant.map_error_deg / math.sqrt(3.0)
    told = result.metrics
    up = told.get("survey.turn_up_std_deg", of_map)
    aside = told.get("survey.turn_aside_std_deg", of_map)
    return math.hypot(math.degrees(line.std_angle), up * math.cos(phi), aside * math.sin(phi))


def scan_path(scan: Scan, pipe: Pipe) -> tuple[Array, Array]:
    """Return the scan's path as (s, phi), n points; empty if the pattern exceeds the pipe."""
    corners = build_pattern(
        scan.pattern, 0.5 * pipe.diameter_m, 0.5 * pipe.length_m, scan.get_centre(),
        math.radians(scan.arc_deg), scan.passes, scan.pass_length_m, scan.centre_s_m,
    ).corners  # fmt: skip
    if len(corners) < 2:
        return np.zeros(0), np.zeros(0)
    u = np.linspace(0.0, len(corners) - 1.0, 40 * (len(corners) - 1) + 1)
    index = np.arange(len(corners))
    return np.interp(u, index, corners[:, 0]), np.interp(u, index, corners[:, 1])


def place_at_work(robot: Robot, pipe: Pipe, scan: Scan) -> tuple[Array, float] | None:
    """Return position and heading of a level platform with the probe normal to the scan's middle.

    None if a level platform in working posture cannot point the probe there (top, underside).
    """
    if robot.probe is None:
        return None
    middle = scan.get_centre()
    cyl = build_cylinder(pipe)
    tip, normal = np.zeros(3), np.zeros(3)
    compute_surface_point(cyl, scan.centre_s_m, middle, tip, normal)
    p_BT, R_BT = compute_tip(build_body_model(robot), posture(robot, "working"))
    heading = math.atan2(-normal[1], -normal[0]) - math.atan2(R_BT[1, 2], R_BT[0, 2])
    R = rot_z(heading)
    if float(R @ R_BT[:, 2] @ normal) > -0.95:
        return None
    return tip - R @ p_BT, heading


def sketch(d: Description[Scan], way: ScanWay | None) -> Sketch:
    """Return the pattern, or the planned path, and the platform at work."""
    scan, pipe = d.mission.task, d.world.pipe
    if pipe is None:
        return Sketch()
    on_pipe = np.column_stack(scan_path(scan, pipe)) if way is None else way.path_sphi
    label = f"{scan.pattern}, {scan.passes} passes" if scan.pattern != "line" else "line"
    at_work = place_at_work(d.robot, pipe, scan)
    return Sketch("way and scan", on_pipe=on_pipe, label=label, at_work=at_work)


def list_notes(result: RunResult[Scan, ScanWay]) -> list[str]:
    """Return notes that the pictures do not show: why there is no map, or no weld on it."""
    weld, metrics = result.details, result.metrics
    survey = _describe_survey(result)
    if weld is None:
        scanned = any(p.name == "scan" for p in result.phases)
        why = "the scan could not be evaluated" if scanned else "the run did not reach the scan"
        more = f" ({result.reason})" if result.reason else ""
        return [*survey, f"No map: {why}{more}."]
    notes = survey + [f"Note: {note}" for note in weld.notes]
    if metrics.get("weld.unresolved"):
        notes.append(
            f"Not resolved: {metrics['weld.unresolved']:.0f} weld(s), too close to another one "
            "(least distance: both half-widths and the coil's 3.5 mm) or too faint."
        )
    if weld.line is not None:
        return notes
    where = "The pattern crosses none."
    if metrics.get("weld.expected"):
        where = (
            f"Expected crossings: {metrics['weld.expected']:.0f}. See the map, the contact "
            "quality and the instrument's signal."
        )
    elif not result.description.world.list_welds():
        where = "The pipe has none."
    what = "No line of a weld was found" if weld.crossings else "No weld was found"
    return [f"{what}. {where}", *notes]


def _describe_survey(result: RunResult[Scan, ScanWay]) -> list[str]:
    """Return sentences on the pipe that was fitted to the touches, with its covariance."""
    setup = Setup(result.description)
    found = find_survey(Flown(setup, result.plan, result.samples, result.phases))
    if found is None:
        return []
    m, cov = result.metrics, found.found.fit.covariance

    def tell(name: str, unit: str) -> str:
        value, std = m[f"survey.{name}_{unit}"], m[f"survey.{name}_std_{unit}"]
        return f"{value:+.2f} ± {std:.2f} {unit}"

    ahead, radius = 2, 4  # indices of the fit's parameters
    related = cov[ahead, radius] / math.sqrt(cov[ahead, ahead] * cov[radius, radius])
    return [
        f"Before the scan the probe touched the pipe at {len(found.touched)} points. "
        "Relative to the map, the +y end of the fitted pipe is rotated by "
        f"{tell('turn_up', 'deg')} (up) and {tell('turn_aside', 'deg')} (aside), its axis "
        f"is displaced by {tell('ahead', 'mm')} (ahead) and {tell('up', 'mm')} (up), and "
        f"its radius differs by {tell('radius', 'mm')} (one standard deviation each; "
        f"displacement ahead and radius have a correlation of {related:.2f}). Touches do "
        "not determine the position of the pipe along its axis or its rotation about it; "
        f"these are taken from {'the map' if found.mark is None else 'the datum mark'}.",
        *describe_datum(m, "The pattern"),
    ]


def draw_contact(result: RunResult[Scan, ScanWay]) -> Figure | None:
    """Draw the contact of the probe over time, and the plan."""
    way = result.plan.get_way()
    return draw_contact_series(result, way.push_force_n, way.depth_m)


FIGURES = Figures(
    describe,
    marks=list_datum_marks,
    charts={
        "weld_map": Chart(
            "Weld map",
            "The scanned part of the pipe, unrolled. Each dot is a reading of the probe; "
            "bright dots have a strong weld signal. Red: detected weld line. Dashed "
            "black: true weld.",
            draw_map,
        ),
        "contact_quality": Chart(
            "Contact quality",
            "The worst value in each cell of 8 mm that the probe passed. Dark is good, "
            "red exceeds the limit; cells without colour were not visited. The lift-off "
            "signal is the instrument's own measure of the gap.",
            draw_contact_quality,
        ),
        "instrument": Chart(
            "Signal of the instrument",
            "An eddy-current instrument shows a point in the impedance plane. Lift-off "
            "moves the point along the lift-off curve, a weld moves it across the curve. "
            "Right: detail near contact. Below: both components during the scan; a weld "
            "is detected where the ochre line exceeds the threshold.",
            draw_instrument,
        ),
        "coverage": Chart(
            "Coverage of the requested pattern",
            "The pattern counts as inspected where the probe was within 6 mm of it with a "
            "gap below 1 mm and a tilt below 10 deg. The area counts as inspected under "
            "the coil. Passes detect welds that cross them; full area coverage requires a "
            "pass distance of at most the coil's width.",
            draw_coverage,
        ),
        "contact_series": Chart(
            "Signals during contact",
            "Grey and white bands are phases, named on top. Dotted green lines are expected "
            f"values. {LIMITS_DRAWN}",
            draw_contact,
        ),
    },
    phases=PHASES,
    judged=("settle", "scan"),
    title="Inspection",
    notes=list_notes,
    sketch=sketch,
)
