"""Paths of a run: the flight from above and from the side, the tip on the unrolled surface."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skywright.core.arrays import Array, Samples
from skywright.description.world import surface
from skywright.description.world.scenario import get_structures
from skywright.models.rigid_body import posture
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIMIT,
    ORANGE,
    RED,
    WIDTH,
    new_figure,
    new_map,
)
from skywright.reports.outlines import (
    Outline,
    move,
    outline_pipe,
    outline_robot,
    outline_structure,
    outline_things,
    outline_tube,
)
from skywright.run.kind import load_kind
from skywright.run.result import RunResult

_PARTS: dict[str, tuple[str, float]] = {
    "pipe": ("#9a9a9a", 0.5), "box": ("#aa8866", 1.0), "disc": ("#5b7fa6", 0.8),
    "spoke": ("#777777", 1.2), "hub": ("#555555", 0.8), "gear": ("#aaaaaa", 0.8),
    "arm": ("#444444", 2.6), "probe": (RED, 2.0),
}  # fmt: skip


WORK = ("force", "inspect", "carry", "transport")
"""Main phases of missions without a scan."""


def unroll_points(result: RunResult, p_W: Array) -> tuple[Array, Array]:
    """Return unrolled coordinates (s, c), each (n,) m, of points (n, 3) in W near the pipe."""
    pipe = result.description.true_world.pipe
    assert pipe is not None
    cyl = surface.build_cylinder(pipe)
    s, c, _ = surface.unroll_points(cyl, p_W)
    return s, cyl.radius * join_angles(c / cyl.radius)


def join_angles(phi: Array) -> Array:
    """Return angles (n,) rad without the jump at ±pi if they are on both sides of it."""
    middle = math.atan2(float(np.mean(np.sin(phi))), float(np.mean(np.cos(phi))))
    if abs(middle) > 0.75 * math.pi:
        middle %= 2.0 * math.pi  # use one turn for both sides
    return np.asarray(middle + np.mod(phi - middle + math.pi, 2.0 * math.pi) - math.pi)


def select_scan(result: RunResult) -> Samples:
    """Return the samples in phases named scan."""
    scanning = [i for i, p in enumerate(result.phases) if p.name == "scan"]
    return result.samples[np.isin(result.samples["phase"], scanning)]


def draw_tip_path(result: RunResult) -> Figure | None:
    """Draw desired and actual path of the tip on the unrolled pipe, and samples without contact."""
    s = select_scan(result)
    if len(s) < 2 or result.description.world.pipe is None:
        return None
    s_des, c_des = unroll_points(result, s["ref_p_WT"])
    s_true, c_true = unroll_points(result, s["p_WT"])
    figure, ax = new_map(np.concatenate([s_des, s_true]), np.concatenate([c_des, c_true]), 0.75)
    ax.plot(1e3 * s_des, 1e3 * c_des, color=GREEN, lw=4, alpha=0.45, label="desired tip")
    ax.plot(1e3 * s_true, 1e3 * c_true, color=BLUE, lw=1.1, label="actual tip")
    ax.plot(1e3 * s_true[0], 1e3 * c_true[0], "o", color=BLACK, ms=6, label="start")
    ax.plot(1e3 * s_true[-1], 1e3 * c_true[-1], "s", color=BLACK, ms=6, label="end")
    lost = s["f_normal"] <= 0.0
    if lost.any():
        ax.plot(
            1e3 * s_true[lost], 1e3 * c_true[lost], ".", color=LIMIT, ms=5, label="no contact force"
        )
    ax.set(aspect="equal", xlabel="s, along the pipe's axis (mm)", ylabel="c, around the pipe (mm)")
    ax.set_title("Path of the probe's tip on the unrolled pipe", pad=22)
    ax.legend(loc="lower left", bbox_to_anchor=(-0.01, 0.995), ncols=5, borderaxespad=0.2)
    return figure


def draw_flight_path(result: RunResult) -> Figure | None:
    """Draw platform and tip from above and from the side, with robot and world to scale."""
    s = result.samples
    if len(s) < 2:
        return None
    figure = new_figure(WIDTH, 4.9)
    views = (
        (0, 1, "Seen from above", "x (m)", "y (m)", (0.07, 0.12, 0.42, 0.74)),
        (0, 2, "Seen from the side (along y)", "x (m)", "z, height (m)", (0.565, 0.12, 0.42, 0.74)),
    )
    parts, robots = _outline_world(result), _outline_robots(result)
    d = result.description
    points = load_kind(d.mission.kind).figures().sketch(d, result.plan.way).points
    for a, b, title, x_label, y_label, box in views:
        ax = figure.add_axes(box)
        _draw_parts(ax, parts, a, b)
        for shape, strength in robots:
            _draw_parts(ax, shape, a, b, strength)
        step = max(1, len(s) // 1500)
        ax.plot(
            s["ref_p_WB"][::step, a], s["ref_p_WB"][::step, b], color=GREEN, lw=3.5, alpha=0.45,
            label="planned platform",
        )  # fmt: skip
        ax.plot(
            s["p_WB"][::step, a], s["p_WB"][::step, b], color=BLUE, lw=1.1, label="flown platform"
        )
        if result.description.robot.probe is not None:
            tip = s["p_WT"][::step]
            ax.plot(tip[:, a], tip[:, b], color=ORANGE, lw=0.8, label="tip")
        for i, p in enumerate(points):
            ax.plot(p[a], p[b], "o", mfc="white", mec=BLACK, ms=11, zorder=6)
            ax.text(p[a], p[b], f"{i + 1}", ha="center", va="center", fontsize=7.5, zorder=7)
        _draw_wind(ax, result, a, b)
        if b == 2:
            ax.axhline(0.0, color="#8d7750", lw=1.5, zorder=1)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(title=title, xlabel=x_label, ylabel=y_label)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=len(labels))
    return figure


def _outline_world(result: RunResult) -> list[Outline]:
    world = result.description.true_world
    parts = outline_pipe(world.pipe) if world.pipe is not None else []
    if world.structure is not None:
        parts += outline_structure(world.structure)
    parts += outline_things(world.things)
    for tube in get_structures(world).tubes.values():
        parts += outline_tube(tube)
    return parts


def _outline_robots(result: RunResult) -> list[tuple[list[Outline], float]]:
    """Return the robot at its start, and in the middle of its work (or at its first way-point)."""
    robot, s = result.description.robot, result.samples
    n = len(posture(robot, "folded"))
    out = [(_place(result, s[0], s["q"][0][:n]), 0.35)]
    work = select_scan(result)
    if not len(work):
        spans = [p for p in result.phases if p.name in WORK or p.name.startswith("hold")]
        work = s[(s["t"] >= spans[0].start_s) & (s["t"] < spans[0].end_s)] if spans else s[:0]
    if len(work):
        row = work[len(work) // 2]
        out.append((_place(result, row, row["q"][:n]), 1.0))
    return out


def _place(result: RunResult, row: Any, q: Array) -> list[Outline]:
    w, x, y, z = row["q_WB"]
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return move(outline_robot(result.description.robot, q), row["p_WB"], yaw)


def _draw_parts(ax: Axes, parts: list[Outline], a: int, b: int, strength: float = 1.0) -> None:
    for part in parts:
        color, width = _PARTS.get(part.part, (GREY, 0.8))
        x, y = part.points[:, a], part.points[:, b]
        ax.plot(x, y, color=color, lw=width, alpha=strength, zorder=2)
        if part.filled and part.part == "disc":
            ax.fill(x, y, color=color, alpha=0.12 * strength, lw=0, zorder=2)


def _draw_wind(ax: Axes, result: RunResult, a: int, b: int) -> None:
    wind = result.description.world.wind
    if wind.kind == "none" or wind.mean_mps <= 0.0:
        return
    toward = math.radians(wind.toward_deg)
    v = np.array([math.cos(toward), math.sin(toward), wind.vertical_mps / wind.mean_mps])
    size = float(np.hypot(v[a], v[b]))
    if size < 0.1:
        return
    x, y = 0.12, 0.9
    ax.annotate(
        "", (x + 0.09 * v[a] / size, y + 0.09 * v[b] / size), (x, y), xycoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "color": GREY, "lw": 2},
    )  # fmt: skip
    ax.text(x, y - 0.08, f"wind {wind.mean_mps:.3g} m/s", transform=ax.transAxes, fontsize=7.5,
            color="#555555", ha="center", va="top")  # fmt: skip
