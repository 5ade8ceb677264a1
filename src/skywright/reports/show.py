"""Figure of `skywright show`: a robot, a world or a mission, from above and from the side."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from skywright.core.rotations import quat_to_rot
from skywright.description.loader import Description
from skywright.description.lookup import Subject
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import Pipe, Weld, World
from skywright.description.world.surface import build_cylinder, find_weld_on_pipe, roll_points
from skywright.models.rigid_body import posture
from skywright.models.scene import home_pose, support_posts
from skywright.reports.outlines import (
    Outline,
    move,
    outline_pipe,
    outline_robot,
    outline_structure,
    outline_things,
    place,
    surface_curve,
)
from skywright.reports.show_robot import draw_robot
from skywright.reports.show_style import (
    SIDE,
    STYLES,
    TOP,
    draw_dimension,
    draw_parts,
    label_axes,
)
from skywright.run.kind import Sketch, load_kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def write_show_figure(subject: Subject, path: Path) -> None:
    """Draw a subject and write it to `path` (.png or .svg)."""
    if subject.robot is not None:
        figure = draw_robot(subject.robot)
    elif subject.world is not None:
        figure = draw_world(subject.world)
    else:
        assert subject.description is not None
        figure = draw_mission(subject.description)
    figure.savefig(path, dpi=150)


def _title(name: str, description: str) -> str:
    return f"{name}: {description}" if description else name


def _figure(columns: int, title: str, width: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, 5.2), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    return figure, list(np.atleast_1d(figure.subplots(1, columns)))


def _world_parts(world: World) -> list[Outline]:
    parts: list[Outline] = []
    if world.pipe is not None:
        if world.pipe.supports:
            for top in support_posts(world):
                parts.append(Outline(np.array([top * [1, 1, 0], top]), "post"))
        parts += outline_pipe(world.pipe)
        for weld in world.list_welds():
            s, c = find_weld_on_pipe(world.pipe, weld)
            parts.append(Outline(roll_points(build_cylinder(world.pipe), s, c)[0], "weld"))
    for tube in get_structures(world).tubes.values():
        ends = [[tube.x_m, tube.y_m, tube.z_m], [tube.to_x_m, tube.to_y_m, tube.to_z_m]]
        parts.append(Outline(np.array(ends), "post"))
    if world.structure is not None:
        parts += outline_structure(world.structure)
    return parts + outline_things(world.things)


def _draw_wind(ax: Axes, world: World) -> None:
    if world.wind.kind == "none" or world.wind.mean_mps == 0:
        return
    angle = math.radians(world.wind.toward_deg)
    x, y = 0.1 * math.cos(angle), 0.08 * math.sin(angle)
    ax.annotate(
        "", (0.5 + x, 0.9 + y), (0.5 - x, 0.9 - y), xycoords="axes fraction",
        textcoords="axes fraction", arrowprops={"arrowstyle": "-|>", "color": "#33bbee", "lw": 2},
    )  # fmt: skip
    ax.text(
        0.5, 0.79, f"wind {world.wind.mean_mps:g} m/s", color="#1188bb",
        transform=ax.transAxes, fontsize=8, ha="center",
    )  # fmt: skip


def _draw_scene(axes: list[Axes], world: World, extra: list[Outline]) -> None:
    parts = _world_parts(world)
    for ax, view, title in zip(axes, (TOP, SIDE), ("from above", "from the side"), strict=True):
        draw_parts(ax, parts + extra, view)
        label_axes(ax, view, title, "W")
    axes[1].axhline(0.0, color="#bbaa88", lw=1.5)
    _draw_wind(axes[0], world)
    if world.pipe is not None:
        _draw_pipe_size(axes[0], axes[1], world.pipe)


def _draw_pipe_size(top: Axes, side: Axes, pipe: Pipe) -> None:
    """Draw height, length and diameter; the latter two if the pipe is along y."""
    cyl = build_cylinder(pipe)
    reach = max(cyl.radius, abs(cyl.half_length * cyl.R_WP[0, 1]))
    x = pipe.x_m + reach + 0.08
    side.plot([pipe.x_m, x], [pipe.z_m, pipe.z_m], color="#888888", lw=0.6, ls=":")
    draw_dimension(side, (x, 0.0), (x, pipe.z_m), f"{pipe.z_m:g} m")
    if math.isclose(abs(cyl.R_WP[1, 1]), 1.0, abs_tol=1e-6):  # along y
        edge = pipe.y_m + cyl.half_length + 0.07
        low, high = pipe.x_m - cyl.radius, pipe.x_m + cyl.radius
        draw_dimension(top, (low, edge), (high, edge), f"{pipe.diameter_m:g} m")
        ends = (pipe.y_m - cyl.half_length, pipe.y_m + cyl.half_length)
        draw_dimension(top, (high + 0.07, ends[0]), (high + 0.07, ends[1]), f"{pipe.length_m:g} m")


def draw_world(world: World) -> Figure:
    """Draw a world from above and from the side, and the pipe's surface unrolled."""
    columns = 2 if world.pipe is None else 3
    figure, axes = _figure(columns, _title(world.name, world.description), 5.2 * columns)
    _draw_scene(axes[:2], world, [])
    if world.pipe is None and world.structure is None and not world.things:
        axes[0].text(0.5, 0.5, "flat ground only", transform=axes[0].transAxes, ha="center")
        for ax in axes:
            ax.plot([-3, 3], [-1, 3], alpha=0)  # sets a minimum range
    if world.pipe is not None:
        _draw_unrolled(axes[2], world.pipe, world.list_welds(), None)
    return figure


def draw_mission(description: Description) -> Figure:
    """Draw a mission: world, robot at its start and at work, way-points or the scan's path."""
    mission, world, robot = description.mission, description.world, description.robot
    sketch = load_kind(mission.kind).figures().sketch(description, None)
    unrolled = world.pipe is not None and bool(sketch.label)
    columns = 3 if unrolled else 2
    figure, axes = _figure(columns, _title(mission.name, mission.description), 5.2 * columns)
    yaw = math.radians(mission.start_yaw_deg)
    start, quat, _ = home_pose(robot, world, mission.start_x_m, mission.start_y_m, yaw)
    R_WB = np.empty((3, 3))
    quat_to_rot(quat, R_WB)
    extra = place(outline_robot(robot, posture(robot, "folded")), start, R_WB)
    hover = start * [1, 1, 0] + [0, 0, mission.hover_height_m]
    if len(sketch.points):
        extra.append(Outline(np.vstack([start, hover, sketch.points]), "path"))
    if unrolled and world.pipe is not None:
        if len(sketch.on_pipe) > 1:
            extra.append(Outline(surface_curve(world.pipe, *sketch.on_pipe.T), "scan"))
        if sketch.at_work is not None:
            at, heading = sketch.at_work
            extra.append(Outline(np.array([start, hover, at]), "path"))
            body = move(outline_robot(robot, posture(robot, "working")), at, heading)
            for ax, view in zip(axes, (TOP, SIDE), strict=False):
                draw_parts(ax, body, view, alpha=0.35)
        _draw_unrolled(axes[2], world.pipe, world.list_welds(), sketch)
    _draw_scene(axes[:2], world, extra)
    for ax, view in zip(axes, (TOP, SIDE), strict=False):
        for i, p in enumerate(sketch.points):
            ax.plot(p[view[0]], p[view[1]], "o", color="#009988", ms=5)
            ax.annotate(
                f"{i + 1}", (p[view[0]], p[view[1]]), (5, 5), fontsize=9, textcoords="offset points"
            )
    more = f", {sketch.name} (green)" if sketch.name else ""
    axes[0].set_title(f"from above: robot at its start{more}", fontsize=10)
    return figure


def _draw_unrolled(ax: Axes, pipe: Pipe, welds: list[Weld], sketch: Sketch | None) -> None:
    """Draw the unrolled surface: s along the axis, c around the circumference."""
    radius, half = pipe.diameter_m / 2, pipe.length_m / 2
    around = math.pi * radius
    ax.plot(
        [-half, half, half, -half, -half], [-around, -around, around, around, -around],
        color="#8a8a8a", lw=1.2,
    )  # fmt: skip
    names = {-90.0: "underside", 0.0: "side facing -x", 90.0: "top"}
    for angle, name in names.items():
        c = radius * math.radians(angle)
        ax.axhline(c, color="#cccccc", lw=0.8, ls=":")
        ax.text(half, c, f" {name}", fontsize=8, va="center", color="#666666")
    for weld in welds:
        line = find_weld_on_pipe(pipe, weld)
        ax.plot(*line, **STYLES["weld"], label=f"weld, {weld.angle_deg:g} deg")
    if sketch is not None:
        s, phi = sketch.on_pipe.T
        if len(s) > 1:
            ax.plot(s, phi * radius, **STYLES["scan"], label=sketch.label)
            ax.plot(s[0], phi[0] * radius, "o", color="#009988", ms=5, label="its start")
        else:
            ax.text(0.5, 0.5, "the pattern does not fit", transform=ax.transAxes, ha="center")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title("pipe's surface, unrolled (angle at yaw 0)", fontsize=10)
    ax.set(xlabel="s along the axis (m)", ylabel="c around the circumference (m)")
    ax.grid(True, lw=0.3, alpha=0.6)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8, loc="lower left")
