"""Figures of a report on a collision: force on the pad, load on the platform, recoil."""

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from skywright.missions.impact.metrics import NEAR, compute_tilt, compute_turn, find_contact
from skywright.missions.impact.plan import RECOIL_S, ImpactPlan
from skywright.missions.impact.task import Impact
from skywright.recordings.columns import has_columns
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    WIDTH,
    draw_line,
    draw_requirement,
    fit_y,
    new_figure,
)
from skywright.run.kind import Chart, Figures
from skywright.run.result import RunResult

BEFORE_S = 0.1


def draw_impact(result: RunResult[Impact, ImpactPlan]) -> Figure | None:
    """Draw loads and recoil around the contact; peaks at 1 kHz."""
    s = result.samples
    near = NEAR.select(s, result.phases)
    first = find_contact(s, near)
    if first is None:
        return None
    t0 = float(s["t"][first])
    before = s[max(first - 1, 0)]
    s = s[(s["t"] >= t0 - BEFORE_S) & (s["t"] <= t0 + RECOIL_S)]
    t = s["t"] - t0
    figure = new_figure(WIDTH, 6.2)
    axes = figure.subplots(4, 1, sharex=True)
    figure.subplots_adjust(left=0.075, right=0.985, top=0.955, bottom=0.08, hspace=0.5)
    axes[0].set(title="Force on the pad, largest in each 10 ms", ylabel="force (N)")
    draw_line(axes[0], t, s["pad_f_peak"], color=BLUE)
    axes[1].set(
        title="Force of arms or passive link on the platform, minus that in free flight",
        ylabel="force (N)",
    )
    draw_line(axes[1], t, s["load_f_peak"], color=BLUE)
    axes[2].set(title="Torque about the platform's centre", ylabel="torque (N m)")
    draw_line(axes[2], t, s["load_t_peak"], color=BLUE, label="largest in each 10 ms")
    draw_line(axes[2], t, s["load_t_B"][:, 1], color=ORANGE, lw=0.8, label="about pitch")
    limit = draw_requirement(
        axes[2],
        result,
        "impact.torque_share",
        "limit {:g} N m",
        spans=[(0.0, float(t[-1]))],
        scale=result.metrics.get("impact.peak_torque_nm", math.nan)
        / (result.metrics.get("impact.torque_share") or math.nan),
    )
    if limit is not None:
        fit_y(axes[2], 0.0, float(np.max(s["load_t_peak"])), float(np.min(s["load_t_B"])), limit)
    axes[2].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2)
    axes[3].set(title="Recoil", ylabel="angle (deg)")
    _draw_recoil(axes[3], t, s, before, result)
    axes[3].set_xlabel("time since the contact (s)")
    axes[3].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=4)
    return figure


def _draw_recoil(
    ax: Any, t: Any, s: Any, before: Any, result: RunResult[Impact, ImpactPlan]
) -> None:
    draw_line(ax, t, np.degrees(compute_tilt(s, before)), color=BLACK, label="platform's tilt")
    turn = np.degrees(compute_turn(s, before))
    draw_line(ax, t, turn, color=GREY, ls="--", label="platform's heading")
    if result.description.robot.pendulum is not None:
        turned = np.degrees(s["q"][:, 0] - before["q"][0])
        draw_line(ax, t, turned, color=GREEN, label="passive link")
    if has_columns(s, "deflection") and np.any(s["deflection"]):
        wound = np.abs(s["deflection"] - before["deflection"])
        draw_line(ax, t, np.degrees(np.max(wound, axis=1)), color=ORANGE, label="largest spring")


def describe(result: RunResult[Impact, ImpactPlan]) -> str:
    """Return a sentence on the parts that collided, speed and loads."""
    d = result.description
    did = f"{d.robot.name} in world {d.world.name} "
    torque = result.metrics.get("impact.peak_torque_nm")
    if torque is None:
        return did + "never touched the pad"
    task = d.mission.task
    part = "hand" if task.part == "arm" else "passive link"
    joints = "" if task.part == "link" else f", {task.joints} joints"
    speed = result.metrics["impact.speed_mps"]
    return did + (
        f"hit the pad with its {part} at {speed:.2f} m/s{joints}; the load on the platform "
        f"was up to {result.metrics['impact.peak_force_n']:.0f} N and {torque:.1f} N m"
    )


FIGURES = Figures(
    describe,
    phases={
        "impact pose": "The arms move to the posture of the impact.",
        "start point": "The robot flies to the start of its run-up.",
        "run-up": "The robot accelerates towards the bar to the commanded speed.",
        "impact": "Hand or passive link hit the pad; the reference continues for the reaction "
        "time, then stops.",
        "retreat": "The robot backs off the bar.",
    },
    charts={
        "impact": Chart(
            "The collision",
            "Force on the pad, force and torque of arms or passive link on the platform, "
            "and motion of platform, link and springs. The first peak on the pad comes "
            "from the hand or link alone; the mass behind it follows through springs and "
            "joints.",
            draw_impact,
        ),
    },
)
