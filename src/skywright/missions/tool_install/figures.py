"""Figures of a report on a tool's installation: phases, load, hands at the handle."""

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from skywright.description.world.things import list_movers
from skywright.missions.skills.tool_handling import LOW
from skywright.missions.tool_install.metrics import (
    HOVER,
    INSTALL,
    RETRIEVAL,
    compute_grasp_errors,
    compute_operated,
)
from skywright.missions.tool_install.plan import ToolPlan, find_places
from skywright.missions.tool_install.task import ToolInstall
from skywright.recordings.columns import has_columns
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    draw_line,
    draw_panels,
    draw_requirement,
    fit_y,
)
from skywright.run.kind import Chart, Figures
from skywright.run.result import RunResult
from skywright.run.where import Where


def _find_index(result: RunResult[ToolInstall, ToolPlan]) -> int:
    """Return the index of the tool among the moving things."""
    d = result.description
    return list_movers(d.world.things).index(d.mission.task.tool)


def draw_phases(result: RunResult[ToolInstall, ToolPlan]) -> Figure | None:
    """Draw tool and platform over the whole flight, and the weight on the hands."""
    s = result.samples
    if not len(s):
        return None
    tool = s[f"object{_find_index(result)}_p_WO"]
    t = s["t"]
    figure, axes = draw_panels(
        7.0, result.phases, t,
        ("Platform (lines) and tool (dashed): way", "x, y (m)"),
        ("Heights", "z (m)"),
        ("True upward force of each hook on the handle", "force (N)"),
        ("Springs of the left arm: shaft minus output link", "deflection (deg)"),
    )  # fmt: skip
    for a, color in ((0, BLUE), (1, ORANGE)):
        draw_line(axes[0], t, s["p_WB"][:, a], color=color, label="xy"[a])
        draw_line(axes[0], t, tool[:, a], color=color, ls="--", lw=0.9)
    axes[0].legend(loc="upper left", ncols=2)
    draw_line(axes[1], t, s["p_WB"][:, 2], color=BLACK, label="platform")
    draw_line(axes[1], t, tool[:, 2], color=GREEN, ls="--", label="tool")
    axes[1].legend(loc="upper left", ncols=2)
    for side, color in (("left", BLUE), ("right", PURPLE)):
        draw_line(axes[2], t, s[f"{side}_f_W"][:, 2], color=color, lw=0.8, label=side)
    axes[2].legend(loc="upper left", ncols=2)
    for j, color, label in ((0, BLUE, "shoulder pitch"), (3, PURPLE, "elbow pitch")):
        draw_line(axes[3], t, np.degrees(s["deflection"][:, j]), color=color, lw=0.8, label=label)
    axes[3].legend(loc="upper left", ncols=2)
    return figure


def draw_tracking(result: RunResult[ToolInstall, ToolPlan]) -> Figure | None:
    """Draw the error of both tips at the grasp points, and the platform's motion: figures 23 and
    24."""
    s = result.samples
    hover = HOVER.select(s, result.phases)
    if not np.any(hover):
        return None
    s = s[hover]
    t = s["t"]
    index = _find_index(result)
    error = 1e3 * compute_grasp_errors(s, index, result.plan.get_way(), -LOW)
    figure, axes = draw_panels(
        5.4, result.phases, t,
        ("Tracking error of the left tip", "error (mm)"),
        ("Tracking error of the right tip", "error (mm)"),
        ("Displacement of the platform", "way (mm)"),
    )  # fmt: skip
    for h in (0, 1):
        size = np.linalg.norm(error[:, h], axis=1)
        for a, color in ((0, BLUE), (1, ORANGE), (2, GREEN)):
            draw_line(axes[h], t, error[:, h, a], color=color, lw=0.8, label="xyz"[a])
        draw_line(axes[h], t, size, color=BLACK, lw=1.0, label="distance")
        limit = draw_requirement(axes[h], result, "tip.hover_rms_mm", "limit {:g} mm on the rms")
        axes[h].legend(loc="upper left", ncols=4)
        fit_y(axes[h], limit or 0.0, float(np.max(size)), float(np.min(error[:, h])))
    drift = 1e3 * (s["p_WB"] - s["p_WB"][0])
    for a, color in ((0, BLUE), (1, ORANGE), (2, GREEN)):
        draw_line(axes[2], t, drift[:, a], color=color, lw=0.8, label="xyz"[a])
    axes[2].legend(loc="lower left", ncols=3)
    return figure


def draw_operator(where: Where, result: RunResult[ToolInstall, ToolPlan]) -> Figure | None:
    """Draw the operator's stick, and the resulting motion of hands and tool."""
    s = result.samples[where.select(result.samples, result.phases)]
    if not len(s) or not has_columns(s, "operator_stick") or not np.any(s["operator_stick"]):
        return None
    t, world = s["t"], result.description.true_world
    _, seat = find_places(world, result.description.mission.task)
    way = compute_operated(s, _find_index(result), seat)
    figure, axes = draw_panels(
        7.0, result.phases, t,
        ("The operator's stick: 1 is full deflection; grey: button pressed", "stick"),
        ("Midpoint of the hands (lines) and its goal set by the stick (dotted), relative "
            "to the start",
         "way (mm)"),
        ("Displacement of the tool from its seat on the pipe", "distance (mm)"),
        ("Weight on both hooks; zero when the tool is seated, or not hooked yet", "force (N)"),
    )  # fmt: skip
    for a, (color, label) in enumerate(((BLUE, "ahead"), (ORANGE, "left"), (GREEN, "up"))):
        draw_line(axes[0], t, s["operator_stick"][:, a], color=color, lw=0.8, label=label)
        draw_line(axes[1], t, 1e3 * way["hands"][:, a], color=color, label=label)
        draw_line(axes[1], t, 1e3 * way["goal"][:, a], color=color, ls=":", lw=1.2)
        draw_line(axes[2], t, 1e3 * way["tool"][:, a], color=color, label=label)
    pressed = np.flatnonzero(s["operator_button"] > 0.0)
    if len(pressed):
        axes[0].axvspan(t[pressed[0]], t[-1], color=GREY, alpha=0.3, lw=0.0)
    load = s["left_f_W"][:, 2] + s["right_f_W"][:, 2]
    draw_line(axes[3], t, load, color=PURPLE, lw=0.8)
    for ax in axes[:3]:
        ax.axhline(0.0, color=GREY, lw=0.6)
        ax.legend(loc="lower left" if ax is axes[1] else "upper right", ncols=3)
    return figure


PHASES = {
    "approach bench": (
        "The arms move down; the robot flies along the planned path to the tool, which motion "
        "capture tracks."
    ),
    "hover check": "Both hooks track points below the handle while the platform hovers.",
    "grasp": "Platform and hooks rise until both hands detect the handle.",
    "lift": "The platform rises until the arms carry the weight of the tool.",
    "look again": "The grasp failed; the pose of the tool is measured again.",
    "carry": (
        "The robot flies slowly along the planned path above all obstacles; the tool can "
        "swing in the hooks."
    ),
    "approach pipe": (
        "The robot descends over the pipe; the platform compensates the offset of the "
        "suspended tool."
    ),
    "install": "The tool is lowered until the pipe carries its weight.",
    "release": "The hooks move down and out of the handle.",
    "wait": "The tool inspects the pipe; the robot waits.",
    "retrieve": "The hooks move below the handle of the tool on the pipe.",
    "take up again": "The input ended before the work was done; the hands move up.",
    "hook": "The operator leads the hooks below the handle and raises them until they carry the "
    "tool.",
    "lift off": "The operator lifts the tool off the pipe.",
    "carry back": "The robot returns along the same path with the tool.",
    "back to the bench": "The robot descends over the initial position of the tool.",
    "lower": "The tool is lowered until the bench carries its weight.",
    "lift arms": "The arms move above the landing gear.",
}
"""Phase -> description of what the robot does in it."""


def describe(result: RunResult[ToolInstall, ToolPlan]) -> str:
    """Return a sentence on the final position of the tool."""
    d = result.description
    seat, back = result.metrics.get("tool.seat_error_mm"), result.metrics.get("tool.returned")
    did = f"{d.robot.name} in world {d.world.name} "
    if seat is None:
        return did + "did not reach the installation of the tool"
    where = "brought it back" if back == 1.0 else "did not retrieve it"
    return did + f"installed the tool on the pipe with an error of {seat:.1f} mm, and {where}"


FIGURES = Figures(
    describe,
    charts={
        "tool_phases": Chart(
            "Path of the tool by phase",
            "Positions of platform and tool, load of each hook, and deflection of the "
            "springs of the left arm.",
            draw_phases,
        ),
        "tool_tracking": Chart(
            "The hands at the grasp points",
            "Tracking error of both tips at the tool while the platform hovered, and "
            "drift of the platform.",
            draw_tracking,
        ),
        "tool_operator": Chart(
            "The operator at the stick",
            "Input of the operator in the frame of the seat, and the resulting motion. "
            "The stick moves the goal of both hands, (24); the hands follow with their "
            "springs; the three distances of the tool from its seat converge to zero.",
            partial(draw_operator, INSTALL),
        ),
        "tool_retrieval": Chart(
            "The operator takes the tool again",
            "Input of the operator while the hooks are led below the handle, take up the weight "
            "of the tool and lift it off the pipe.",
            partial(draw_operator, RETRIEVAL),
        ),
    },
    phases=PHASES,
)
