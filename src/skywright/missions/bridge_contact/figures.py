"""Figures of a report on contact inspection: the flight, the forces, positions of the feet."""

import numpy as np
from matplotlib.figure import Figure

from skywright.description.world.spec import World
from skywright.description.world.things import find_first
from skywright.missions.bridge_contact.metrics import FREE, HOLD, compute_press
from skywright.missions.bridge_contact.plan import ContactPlan
from skywright.missions.bridge_contact.task import BridgeContact
from skywright.missions.skills.datum import describe_datum, list_datum_marks
from skywright.models.things.bench import Bench
from skywright.recordings.columns import has_columns
from skywright.reports.figures.localisation import CAPTION, draw_localisation
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    WIDTH,
    draw_line,
    draw_panels,
    new_figure,
)
from skywright.run.kind import Chart, Figures
from skywright.run.result import RunResult


def _is_clamped(world: World) -> bool:
    return find_first(world.things, Bench) is not None


def draw_approach(result: RunResult[BridgeContact, ContactPlan]) -> Figure | None:
    """Draw the position against its reference (Fig. 23), one panel per axis, and the tilt."""
    s = result.samples
    if (
        not has_columns(s, "ref_force")
        or not np.any(s["ref_force"] > 0.0)
        or _is_clamped(result.description.world)
    ):
        return None
    figure, axes = draw_panels(
        6.4, result.phases, s["t"],
        *((f"Position {name} of the platform", f"{name} (m)") for name in "xyz"),
        ("Tilt from level", "tilt (deg)"),
    )  # fmt: skip
    for i in range(3):
        draw_line(axes[i], s["t"], s["p_WB"][:, i], color=BLUE, label="flown")
        draw_line(axes[i], s["t"], s["ref_p_WB"][:, i], color=BLACK, ls="--", label="reference")
        if np.ptp(s["p_WB"][:, i]) < 0.2:
            axes[i].set_ylim(*(np.mean(s["ref_p_WB"][:, i]) + np.array([-0.1, 0.1])))
    axes[0].legend(loc="lower right", ncols=2)
    q = s["q_WB"]
    up = 1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2)
    draw_line(axes[3], s["t"], np.degrees(np.arccos(np.clip(up, -1.0, 1.0))), color=GREEN)
    return figure


def draw_force(result: RunResult[BridgeContact, ContactPlan]) -> Figure | None:
    """Draw the tip's force against the profile, the load of the feet, and the robot's motion."""
    s = result.samples
    on = s["pressing"] > 0.5
    if not np.any(on):
        return None
    docks = bool(np.any(s["docked"] > 0.5)) and not _is_clamped(result.description.world)
    t0, t1 = float(s["t"][on][0]) - 2.0, float(s["t"][on][-1]) + 2.0
    part = s[(s["t"] >= t0) & (s["t"] <= t1)]
    load = ("Total load of the docking feet on the deck", "force (N)")
    figure, axes = draw_panels(
        5.8 if docks else 4.4, result.phases, part["t"],
        ("Force of the tip on the structure", "force (N)"), *([load] if docks else []),
        ("Displacement of the platform since the first hold", "distance (mm)"),
    )  # fmt: skip
    asked = np.where(part["pressing"] > 0.5, part["ref_force"], np.nan)
    draw_line(axes[0], part["t"], compute_press(part), color=BLUE, label="true")
    draw_line(axes[0], part["t"], part["force_meas"], color=ORANGE, lw=0.7, label="measured")
    draw_line(axes[0], part["t"], asked, color=BLACK, ls="--", label="asked for")
    axes[0].legend(loc="upper right", ncols=3)
    if docks:
        feet = np.linalg.norm(part["f_docking_W"], axis=1)
        draw_line(axes[1], part["t"], feet, color=GREEN)
    for where, color, label in ((HOLD, BLUE, "docked"), (FREE, ORANGE, "in flight")):
        held = where.select(part, result.phases)
        if np.any(held):
            p = part["p_WB"]
            away = 1e3 * np.linalg.norm(p - p[held][0], axis=1)
            draw_line(axes[-1], part["t"], np.where(held, away, np.nan), color=color, label=label)
    if axes[-1].get_legend_handles_labels()[0]:
        axes[-1].legend(loc="upper left")
    return figure


def draw_measurements(result: RunResult[BridgeContact, ContactPlan]) -> Figure | None:
    """Draw the error of each held force: mean and spread, docked and in flight side by side."""
    rows = []
    held = {*HOLD.find(result.phases), *FREE.find(result.phases)}
    for i, phase in enumerate(result.phases):
        if i in held:
            s = result.samples[result.samples["phase"] == i]
            if len(s):
                error = compute_press(s) - s["ref_force"]
                rows.append((phase.name.startswith("free"), float(s["ref_force"][0]), error))
    if not rows:
        return None
    figure = new_figure(WIDTH, 3.0)
    ax = figure.subplots()
    figure.subplots_adjust(left=0.075, right=0.985, top=0.88, bottom=0.17)
    ax.set_title("Force error during holds: mean and range")
    for free, color, label in ((False, BLUE, "resting on its base"), (True, ORANGE, "in flight")):
        mine = [(force, error) for is_free, force, error in rows if is_free is free]
        if mine:
            x = np.array([force for force, _ in mine]) + (0.06 if free else -0.06)
            mean = np.array([float(np.mean(e)) for _, e in mine])
            low = mean - [float(np.min(e)) for _, e in mine]
            high = np.array([float(np.max(e)) for _, e in mine]) - mean
            ax.errorbar(x, mean, yerr=[low, high], fmt="o", color=color, capsize=4, label=label)
    limit = result.description.mission.requirements.get("force.rms_error_n")
    if limit is not None:
        for sign in (1.0, -1.0):
            ax.axhline(sign * limit.limit, color=GREY, ls=":", lw=1.0)
        ax.annotate(
            f"required rms {limit.limit:g} N", (0.005, limit.limit), xytext=(2, 2),
            xycoords=("axes fraction", "data"), textcoords="offset points", color=GREY,
        )  # fmt: skip
    ax.set(xlabel="requested force (N)", ylabel="error (N)")
    ax.legend(loc="upper left", bbox_to_anchor=(0.2, 1.0), ncols=2)
    return figure


def describe(result: RunResult[BridgeContact, ContactPlan]) -> str:
    """Return a sentence on the forces that were held, and their accuracy."""
    d, m = result.description, result.metrics
    did = f"{d.robot.name} in world {d.world.name} "
    held = len(HOLD.find(result.phases)) + len(FREE.find(result.phases))
    if not held:
        return did + "made no measurement"
    parts = []
    if "force.rms_error_n" in m:
        how = "clamped to the bench" if _is_clamped(d.world) else "docked"
        moved = f", {m['dock.wander_mm']:.1f} mm of wander" if "dock.wander_mm" in m else ""
        parts.append(f"{how} to {m['force.rms_error_n']:.2f} N rms{moved}")
    if "free.rms_error_n" in m:
        parts.append(
            f"in flight to {m['free.rms_error_n']:.2f} N rms, {m['free.wander_mm']:.0f} mm"
        )
    return did + f"held {held} forces: {'; '.join(parts)}"


def describe_survey(result: RunResult[BridgeContact, ContactPlan]) -> list[str]:
    """Return sentences on the surface that was fitted to the touches."""
    m, what = result.metrics, "survey.normal_error_deg"
    if what not in m:
        return []
    return [
        f"The surface fitted to the survey's {m['survey.touches']:.0f} touches deviates "
        f"from the true surface by {m['survey.surface_error_mm']:.1f} mm and {m[what]:.2f} "
        f"deg, that of the map by {m['survey.map_error_mm']:.1f} mm and "
        f"{m['survey.map_normal_error_deg']:.2f} deg; the fit states standard deviations "
        f"of {m['survey.surface_std_mm']:.1f} mm and {m['survey.normal_std_deg']:.2f} deg.",
        *describe_datum(m, "The place of a spot"),
    ]


FIGURES = Figures(
    describe,
    marks=list_datum_marks,
    notes=describe_survey,
    phases={
        "survey_approach": "The robot flies to the structure, whose pose is uncertain.",
        "survey_move": "The robot flies to the next touch point.",
        "look": "The probe's camera looks at the datum mark.",
        "survey_touch": "The robot advances until it detects contact. Docking feet are pressed "
        "until all touch; a tip keeps pressing.",
        "survey_back": "The robot backs off the surface.",
        "free press": "An operator's stick raises and lowers the force of the tip.",
        "survey_leave": "The surface is fitted to the touches, and the mission is planned again.",
        "approach": "The robot flies along the planned path to the structure.",
        "align": "The robot turns parallel to the surface.",
        "dock": "The robot approaches until the docking feet touch.",
        "seat": "The rotors load the docking feet.",
        "reach": "The arm moves the tip close to the surface.",
        "touch": "The tip advances until it measures contact.",
        "press to *": "The force of the tip changes to the next value.",
        "hold *": "The tip holds the force; the phase is one measurement.",
        "release": "The force of the tip decreases to zero.",
        "retract": "The arm withdraws the tip.",
        "undock": "The feet are unloaded, and the robot leaves the surface.",
        "free approach": "The robot flies to the place of the press in flight.",
        "free near": "The robot moves the tip close to the surface, in flight.",
        "free touch": "The tip advances in flight until it measures contact.",
        "free press to *": "The force of the tip changes to the next value, in flight.",
        "free hold *": "The tip holds the force in flight; the phase is one measurement.",
        "free release": "The force of the tip decreases to zero, in flight.",
        "free leave": "The robot leaves the surface.",
        "slide": "The tip slides along the surface under force.",
        "slide back": "The tip slides back to where the slide began.",
        "rest": "The arm moves to its rest posture.",
        "inspection position": "The arm moves the tip close to the plate.",
        "back to rest": "The arm returns to its rest posture.",
    },
    charts={
        "contact-force": Chart(
            "The forces",
            "Measured and requested force of the tip. The phases that hold a force are "
            "measurements. A docked robot rests against the deck with a small load "
            "on its feet, and only the arm moves. In flight every motion of the platform "
            "changes the force.",
            draw_force,
        ),
        "contact-errors": Chart(
            "Force error of each measurement",
            "Points are means; bars show the range from the smallest to the largest error "
            "of a measurement.",
            draw_measurements,
        ),
        "contact-localisation": Chart(*CAPTION, draw_localisation),
        "contact-flight": Chart(
            "The flight",
            "Position and attitude follow separate references: the platform moves without "
            "tilting and tilts without moving.",
            draw_approach,
        ),
    },
)
