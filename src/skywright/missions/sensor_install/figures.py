"""Figures of a report on the installation of a sensor: force, hand, platform and swing."""

import numpy as np
from matplotlib.figure import Figure

from skywright.missions.sensor_install.plan import InstallPlan
from skywright.missions.sensor_install.task import SensorInstall
from skywright.models.rigid_body import joint_names
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    draw_limit,
    draw_line,
    draw_panels,
    fit_y,
)
from skywright.run.kind import Chart, Figures
from skywright.run.metrics import in_phases
from skywright.run.result import RunResult

FORCE_PHASES = ("approach", "touch", "press", "leave singularity", "force", "retract")


def draw_force(result: RunResult[SensorInstall, InstallPlan]) -> Figure | None:
    """Draw the true, estimated and desired force and the deflections of the pressing arm."""
    s = result.samples
    used = in_phases(s, result.phases, *FORCE_PHASES)
    if not np.any(used):
        return None
    way, task = result.plan.get_way(), result.description.mission.task
    s = s[(s["t"] >= s["t"][used][0]) & (s["t"] <= s["t"][used][-1])]
    t = s["t"]
    hangs = result.description.robot.pendulum is not None
    figure, axes = draw_panels(
        6.6, result.phases, t,
        ("Force of the left hand on the pipe", "force (N)"),
        ("Springs of the left arm: shaft minus output link", "deflection (deg)"),
        ("Distances from the reference", "distance (mm)"),
        ("Passive link" if hangs else "Elbow of the left arm", "angle (deg)"),
    )  # fmt: skip
    true = s["left_f_W"] @ way.normal
    draw_line(axes[0], t, s["left_est_f_W"] @ way.normal, color=ORANGE, lw=0.8, label="estimated")
    draw_line(axes[0], t, true, color=BLUE, label="true")
    draw_line(axes[0], t, s["left_ref_f_W"] @ way.normal, color=GREEN, ls=":", label="desired")
    axes[0].legend(loc="upper left", ncols=3)
    fit_y(axes[0], float(np.max(true)), float(np.min(true)), 1.2 * task.force_n)
    names = joint_names(result.description.robot)
    for j, color in ((int(hangs), BLUE), (3 + hangs, PURPLE)):
        label = names[j].replace("left_", "").replace("_", " ")
        draw_line(axes[1], t, np.degrees(s["deflection"][:, j]), color=color, label=label)
    draw_limit(axes[1], -10.0, "end of the linear range, 10 deg", below=True)
    draw_limit(axes[1], 10.0, "end of the linear range, 10 deg")
    axes[1].legend(loc="upper left", ncols=2)
    platform = 1e3 * np.linalg.norm(s["p_WB"] - s["ref_p_WB"], axis=1)
    draw_line(axes[2], t, platform, color=BLACK, label="platform")
    axes[2].legend(loc="upper left")
    draw_line(axes[3], t, np.degrees(s["q"][:, 0 if hangs else 3]), color=BLUE)
    return figure


PHASES = {
    "arms to operation pose": "The arms move forward to their working posture.",
    "navigate": "The robot flies along the planned path to a position in front of the marker.",
    "hover check": "The robot hovers in front of the pipe; the motion of the hands is measured.",
    "navigate on": "The robot approaches the pipe.",
    "approach": "The robot approaches the installation place, located by its marker.",
    "push the link": "The hands push to measure the swing of the link.",
    "swing check": "The robot waits until the pendulum is at rest.",
    "touch": "The hand moves until it detects contact.",
    "press": "The hand presses the sensor onto the pipe.",
    "force": "The hand holds the force for the installation time.",
    "leave singularity": "The platform moves so that the arm is not stretched.",
    "retract": "The hand withdraws; the sensor stays.",
}
"""Phase -> description of what the robot does in it."""


def describe(result: RunResult[SensorInstall, InstallPlan]) -> str:
    """Return a sentence on the force with which the robot pressed."""
    d = result.description
    force = result.metrics.get("force.mean_n")
    did = f"{d.robot.name} in world {d.world.name} "
    if force is None:
        return did + "completed no press"
    return did + f"pressed with a mean force of {force:.2f} N"


FIGURES = Figures(
    describe,
    charts={
        "install_force": Chart(
            "Press of the sensor",
            "Force of the hand on the pipe, deflection of the springs of the pressing "
            "arm, displacement of the platform, and angle of the passive link.",
            draw_force,
        ),
    },
    phases=PHASES,
)
