"""Figures of a report on the three flight modes (Fig. 20 of Sanchez-Cuevas 2020)."""

import numpy as np
from matplotlib.figure import Figure

from skywright.missions.flight_modes.plan import ModesPlan
from skywright.missions.flight_modes.task import ModesTask
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    ORANGE,
    RUN_CLOCK,
    WIDTH,
    draw_line,
    new_figure,
)
from skywright.run.kind import Chart, Figures
from skywright.run.result import RunResult

MODES = {
    "standard stabilisation": "#e7f3e7",
    "command position": "#fbf6dc",
    "command angle": "#fbe6e2",
    "hold angle": "#fbe6e2",
}
"""Phase -> background, in the paper's colours: green, yellow, red."""


def draw_modes(result: RunResult[ModesTask, ModesPlan]) -> Figure | None:
    """Draw roll, pitch and level position against their references."""
    s = result.samples
    if not len(s):
        return None
    figure = new_figure(WIDTH, 5.6)
    axes = figure.subplots(4, 1, sharex=True)
    figure.subplots_adjust(left=0.075, right=0.985, top=0.955, bottom=0.085, hspace=0.45)
    for ax, k, name in ((axes[0], 0, "Roll"), (axes[1], 1, "Pitch")):
        ax.set(title=name, ylabel="angle (deg)")
        draw_line(ax, s["t"], _compute_angle(s["q_WB"], k), color=BLUE, label="flown")
        draw_line(
            ax, s["t"], _compute_angle(s["ref_q_WB"], k), color=BLACK, ls="--", label="reference"
        )
    for ax, i, name in ((axes[2], 0, "x"), (axes[3], 1, "y")):
        ax.set(title=f"Position {name}", ylabel=f"{name} (m)")
        draw_line(ax, s["t"], s["p_WB"][:, i], color=ORANGE)
        draw_line(ax, s["t"], s["ref_p_WB"][:, i], color=BLACK, ls="--")
    axes[0].legend(loc="upper left", ncols=2)
    axes[3].set_xlabel(RUN_CLOCK)
    for ax in axes:
        for phase in result.phases:
            if phase.name in MODES:
                ax.axvspan(phase.start_s, phase.end_s, color=MODES[phase.name], zorder=0, lw=0)
    return figure


def _compute_angle(q: np.ndarray, axis: int) -> np.ndarray:
    """Return roll (axis 0) or pitch (1) in deg of quaternions (n, 4) wxyz."""
    w, x, y, z = q.T
    if axis == 0:
        return np.asarray(np.degrees(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))))
    return np.asarray(np.degrees(np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))))


def describe(result: RunResult[ModesTask, ModesPlan]) -> str:
    """Return a sentence on the accuracy of the modes."""
    d, m = result.description, result.metrics
    did = f"{d.robot.name} in world {d.world.name} "
    if "modes.tilt_deg" not in m or "modes.translate_tilt_deg" not in m:
        return did + "did not fly all modes"
    return did + (
        f"tilted by {m['modes.tilt_deg']:.1f} deg with a position error of "
        f"{m['modes.position_error_mm']:.0f} mm, and translated with at most "
        f"{m['modes.translate_tilt_deg']:.1f} deg of tilt"
    )


FIGURES = Figures(
    describe,
    phases={
        "standard stabilisation": "The robot tilts with attitude and height controlled only; the "
        "tilt accelerates it.",
        "take over": "The position loop takes over where the robot is.",
        "command position": "The robot translates and stays level.",
        "command angle": "The robot tilts and holds its position.",
        "hold angle": "The robot holds the tilt; the phase is one measurement.",
    },
    charts={
        "modes": Chart(
            "The three modes",
            "Green, standard stabilisation: attitude and height are controlled as on a "
            "robot with level rotors, so a tilt accelerates the robot. Yellow, command "
            "position: the robot translates and stays level. Red, command angle: the "
            "robot tilts and holds its position.",
            draw_modes,
        ),
    },
)
