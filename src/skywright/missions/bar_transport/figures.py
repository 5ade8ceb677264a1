"""Figures of a report on a carried bar: snapshots and time histories, as in Caballero 2018."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from skywright.core.arrays import Array, Samples
from skywright.core.rotations import rot_from_quat
from skywright.description.world.scenario import get_structures
from skywright.missions.bar_transport.metrics import (
    CARRYING,
    compute_clearances,
    compute_swing,
    compute_tip_errors,
)
from skywright.missions.bar_transport.task import BarTransport
from skywright.models.rigid_body import compute_hands_apart
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
    draw_requirement,
    new_figure,
)
from skywright.reports.outlines import outline_robot
from skywright.run.kind import Chart, Figures
from skywright.run.result import RunResult
from skywright.run.setup import Setup

SNAPSHOTS = 6
LEAST_SPAN_DEG = 5.0  # least range of an axis of angles
PLANNED = {"color": BLACK, "lw": 1.0, "ls": (0, (4, 2))}


def draw_snapshots(result: RunResult[BarTransport, None]) -> Figure | None:
    """Draw the flight from the side and from above: figures 7 and 9 of the paper."""
    s = _carry(result)
    if len(s) < SNAPSHOTS:
        return None
    world = result.description.world
    area = get_structures(world).area
    x0, x1, z1, y1 = -1.5, 10.5, 3.6, 3.0
    if area is not None:
        x0, x1, z1, y1 = area.x_min_m, area.x_max_m, area.z_max_m, area.y_max_m
    # both views have one scale, one above the other
    high = max([z1, *(max(t.z_m, t.to_z_m) for t in get_structures(world).tubes.values())])
    spans = [(x0 - 0.3, x1 + 0.3), (-0.15, high + 0.3), (-y1 - 0.3, y1 + 0.3)]
    wide, tall, deep = (b - a for a, b in spans)
    inch = 0.93 * WIDTH / wide
    height = inch * (tall + deep) + 1.5
    figure = new_figure(WIDTH, height)
    side = figure.add_axes((0.06, (0.6 + inch * deep + 0.6) / height, 0.93, inch * tall / height))
    above = figure.add_axes((0.06, 0.6 / height, 0.93, inch * deep / height))
    side.set_title("Side view: start 0, goal f; grey: platform and bar during the transport")
    above.set_title("From above")
    bar = _bar_ends(s, result)
    for ax, a in ((side, 2), (above, 1)):
        _draw_structures(ax, world, a)
        ax.plot(s["p_WB"][:, 0], s["p_WB"][:, a], color=GREY, lw=0.8, ls=":")
        ax.plot(bar[:, 0].mean(axis=1), bar[:, a].mean(axis=1), color=GREY, lw=0.8, ls=":")
        if area is not None:
            low = 0.0 if a == 2 else area.y_min_m
            size = (x1 - x0, (z1 if a == 2 else y1) - low)
            ax.add_patch(Rectangle((x0, low), *size, fill=False, color=LIMIT, ls="--", lw=0.9))
        ax.set(
            xlim=spans[0],
            ylim=spans[1 if a == 2 else 2],
            aspect="equal",
            ylabel="zy"[a == 1] + " (m)",
        )
    above.set_xlabel("x (m)")
    for n, i in enumerate(_choose(s)):
        row = s[i]
        R = rot_from_quat(row["q_WB"])
        joints = result.description.robot
        for part in outline_robot(joints, row["q"][: _count(result)]):
            points = part.points @ R.T + row["p_WB"]
            if part.part in ("arm", "spoke", "gear"):
                width = 1.6 if part.part == "arm" else 0.7
                color = ORANGE if part.part == "arm" else BLUE
                side.plot(points[:, 0], points[:, 2], color=color, lw=width)
            if part.part in ("disc", "arm"):
                color = ORANGE if part.part == "arm" else BLUE
                above.plot(points[:, 0], points[:, 1], color=color, lw=0.6)
        side.plot(*bar[i][[0, 2]].mean(axis=1), "o", color=GREEN, ms=4)
        above.plot(bar[i][0], bar[i][1], color=GREEN, lw=2.2)
        label = "f" if n == SNAPSHOTS - 1 else str(n) if n == 0 else f"i{n}"
        side.annotate(
            label, (row["p_WB"][0], row["p_WB"][2]), (0, 6), textcoords="offset points",
            ha="center", fontsize=8,
        )  # fmt: skip
    return figure


def draw_histories(result: RunResult[BarTransport, None]) -> Figure | None:
    """Draw coordinates against the plan, figures 8 and 10 of the paper, and the errors."""
    s = _carry(result)
    if len(s) < 2:
        return None
    t = s["t"] - s["t"][0]
    figure = new_figure(WIDTH, 8.2)
    axes = figure.subplots(4, 2, sharex=True)
    figure.subplots_adjust(left=0.07, right=0.985, top=0.965, bottom=0.06, hspace=0.38, wspace=0.2)
    pitch = np.array([np.degrees(-np.arcsin(rot_from_quat(q)[2, 0])) for q in s["q_WB"]])
    q, wanted = np.degrees(s["q"]), np.degrees(s["ref_q"])
    panels = [
        ("x of the platform (q1)", "m", s["p_WB"][:, 0], s["ref_p_WB"][:, 0]),
        ("z of the platform (q3)", "m", s["p_WB"][:, 2], s["ref_p_WB"][:, 2]),
        ("pitch of the platform (q5)", "deg", pitch, np.zeros(len(s))),
        ("passive joint (q0)", "deg", q[:, 0], wanted[:, 0]),
        ("shoulders (q7)", "deg", q[:, 1], wanted[:, 1]),
        ("elbows (q8)", "deg", q[:, 2], wanted[:, 2]),
    ]
    for ax, (title, unit, y, plan) in zip(axes.flat, panels, strict=False):
        ax.set(title=title, ylabel=unit)
        draw_line(ax, t, y, color=BLUE, label="flown")
        draw_line(ax, t, plan, **PLANNED, label="planned")
    for ax, j in ((axes[2, 0], 3), (axes[2, 1], 4)):
        draw_line(ax, t, q[:, j], color=PURPLE, ls=":", label="flown, right arm")
    axes[2, 0].legend(loc="best")
    for ax in axes[1:3].flat:  # tenths of a degree must not fill the axis
        low, high = ax.get_ylim()
        if high - low < LEAST_SPAN_DEG:
            middle = 0.5 * (low + high)
            ax.set_ylim(middle - 0.5 * LEAST_SPAN_DEG, middle + 0.5 * LEAST_SPAN_DEG)
    axes[0, 0].legend(loc="upper left")
    axes[3, 0].set(title="Distance of the bar's centre from the plan, and swing", ylabel="cm, deg")
    tip = 100.0 * np.linalg.norm(compute_tip_errors(s), axis=1)
    draw_line(axes[3, 0], t, tip, color=GREEN, label="distance (cm)")
    draw_line(axes[3, 0], t, np.degrees(compute_swing(s)), color=ORANGE, label="swing (deg)")
    low, high = axes[3, 0].get_ylim()
    axes[3, 0].set_ylim(low, high + 0.25 * (high - low))
    axes[3, 0].legend(loc="upper left", ncols=2)
    axes[3, 1].set(title="Clearance of robot and bar", ylabel="m")
    d = result.description
    draw_line(axes[3, 1], t, compute_clearances(s, Setup(d)), color=BLUE)
    begun = float(s["t"][0] - t[0])
    draw_requirement(
        axes[3, 1], result, "transport.clearance_share", "limit {:g} m", origin=begun,
        scale=getattr(d.mission.task, "margin_m", math.nan),  # a plan file alone has none
    )  # fmt: skip
    axes[3, 1].set_ylim(bottom=0.0)
    for ax in axes[3]:
        ax.set_xlabel("time since the start of the transport (s)")
    return figure


def _carry(result: RunResult[BarTransport, None]) -> Samples:
    s = result.samples
    found: Samples = s[CARRYING.select(s, result.phases)][::2]
    return found


def _count(result: RunResult[BarTransport, None]) -> int:
    arm = result.description.robot.arm
    assert arm is not None
    return 1 + 2 * len(arm.links)


def _choose(s: Samples) -> list[int]:
    """Return instants at equal distances on the planned path."""
    steps = np.linalg.norm(np.diff(s["ref_p_WB"], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, way[-1], SNAPSHOTS)
    return [int(np.argmin(np.abs(way - w))) for w in wanted[:-1]] + [len(s) - 1]


def _bar_ends(s: Samples, result: RunResult[BarTransport, None]) -> Array:
    """Return both ends of the bar (n, 3, 2) m; without one, the hands."""
    arm = result.description.robot.arm
    left, right = s["left_p_WH"], s["right_p_WH"]
    grow = 0.0
    if arm is not None and arm.bar is not None:
        grow = 0.5 * (arm.bar.length_m / compute_hands_apart(result.description.robot) - 1.0)
    return np.asarray(
        np.stack([left + grow * (left - right), right - grow * (left - right)], axis=2)
    )  # fmt: skip


def _draw_structures(ax: Axes, world: Any, a: int) -> None:
    """Draw pipes as seen along the axis that is not drawn; one parallel to it is a disc."""
    for tube in get_structures(world).tubes.values():
        p = np.array([tube.x_m, tube.y_m, tube.z_m])
        q = np.array([tube.to_x_m, tube.to_y_m, tube.to_z_m])
        r = 0.5 * tube.diameter_m
        way = (q - p)[[0, a]]
        length = float(np.linalg.norm(way))
        if length < 1e-6:
            ax.add_patch(Circle((p[0], p[a]), r, color="#c9a227", lw=0))
            continue
        corner = p[[0, a]] + r * np.array([way[1], -way[0]]) / length
        angle = float(np.degrees(np.arctan2(way[1], way[0])))
        ax.add_patch(
            Rectangle(tuple(corner), length, 2 * r, angle=angle, color="#e3c65b", lw=0, alpha=0.7)
        )


PHASES = {
    "start pose": "The robot flies to the start of the plan with the bar in both hands.",
    "transport": "Platform, arms and bar follow the plan; the passive link swings freely.",
    "settle": "The robot hovers at the goal.",
}
"""Phase -> description of what the robot does in it."""


def describe(result: RunResult[BarTransport, None]) -> str:
    """Return a sentence that states what was carried where."""
    d = result.description
    task = d.mission.task
    what = f"a bar of {task.bar_length_m:g} m and {task.bar_mass_kg:g} kg"
    if task.bar_length_m == 0.0:
        what = "nothing"
    seed = d.world.scenario_seed
    where = f"world {d.world.name}" + ("" if seed is None else f", scenario {seed}")
    return f"{d.robot.name} carried {what} to x = {task.goal_x_m:g} m in {where}"


FIGURES = Figures(
    describe,
    charts={
        "transport_snapshots": Chart(
            "The flight",
            "Blue: platform; orange: link and arms; green: bar; yellow: pipes; dashed "
            "red: limits of the area. The views are projections: objects at different "
            "depths can appear to overlap.",
            draw_snapshots,
        ),
        "transport_histories": Chart(
            "Flown and planned",
            "The planner keeps the platform level, so the planned pitch is zero.",
            draw_histories,
        ),
    },
    phases=PHASES,
)
