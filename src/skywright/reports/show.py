"""The picture of `skywright show`: a robot, a world or a mission, from above and from the side."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from skywright.missions.loader import Description
from skywright.missions.lookup import Subject
from skywright.missions.spec import Scan
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.scene import support_posts
from skywright.reports.outlines import (
    Outline,
    move,
    outline_arm,
    outline_box,
    outline_pipe,
    outline_robot,
    surface_curve,
)
from skywright.robots.spec import Robot
from skywright.worlds.spec import Pipe, Weld, World

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TOP, SIDE = (0, 1), (0, 2)
"""Which coordinates a view shows: x and y seen from above, x and z seen from the side."""

STYLES: dict[str, dict[str, Any]] = {
    "disc": {"color": "#4477aa", "lw": 1.2, "alpha": 0.9},
    "spoke": {"color": "#777777", "lw": 2.0},
    "hub": {"color": "#555555", "lw": 1.0},
    "gear": {"color": "#999999", "lw": 1.0},
    "arm": {"color": "#cc3311", "lw": 4.0, "solid_capstyle": "round"},
    "probe": {"color": "#ee7733", "lw": 3.0, "solid_capstyle": "round"},
    "pipe": {"color": "#8a8a8a", "lw": 0.6},
    "post": {"color": "#8a8a8a", "lw": 5.0, "alpha": 0.6},
    "box": {"color": "#aa8866", "lw": 1.0},
    "weld": {"color": "#222222", "lw": 2.0},
    "sector": {"color": "#009988", "lw": 1.6},
    "path": {"color": "#009988", "lw": 1.4, "ls": "--"},
}


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


def _draw(ax: Axes, parts: list[Outline], view: tuple[int, int], **override: Any) -> None:
    for part in parts:
        style = {**STYLES[part.part], **override}
        x, y = part.points[:, view[0]], part.points[:, view[1]]
        ax.plot(x, y, **style)
        if part.filled:
            ax.fill(x, y, color=style["color"], alpha=0.12, lw=0)


def _label(ax: Axes, view: tuple[int, int], title: str, frame: str) -> None:
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(title, fontsize=10)
    ax.set_xlabel(f"x in {frame} (m)")
    ax.set_ylabel(f"{'xyz'[view[1]]} in {frame} (m)")
    ax.grid(True, lw=0.3, alpha=0.6)


def draw_robot(robot: Robot) -> Figure:
    """Draw a robot from above and from the side, arm at work and folded."""
    figure, axes = _figure(2, _title(robot.name, robot.description), 11.5)
    working, folded = posture(robot, "working"), posture(robot, "folded")
    model = build_body_model(robot)
    for ax, view in zip(axes, (TOP, SIDE), strict=True):
        _draw(ax, outline_arm(robot, folded), view, alpha=0.35)
        _draw(ax, outline_robot(robot, working), view)
        _, com, _ = compute_body(model, _pad(working))
        ax.plot(com[view[0]], com[view[1]], "kP", ms=8, zorder=5)
        ax.annotate(
            "centre of mass", (com[view[0]], com[view[1]]), (6, 8), fontsize=8,
            textcoords="offset points",
        )  # fmt: skip
        _label(ax, view, "", "B")
    r = robot.rotors
    top, side = axes
    for i, azimuth in enumerate(np.radians(r.azimuth_deg)):
        spot = r.radius_m * np.array([math.cos(azimuth), math.sin(azimuth)])
        name = f"{i}\n{r.spin[i]}"
        if r.alpha_deg[i] or r.beta_deg[i]:
            name += f"\n{r.alpha_deg[i]:+g}/{r.beta_deg[i]:+g} deg"
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.7}
        top.text(spot[0], spot[1], name, ha="center", va="center", fontsize=7, bbox=box)
    top.set_title("from above (front to the right): rotor, spin, tilt alpha/beta", fontsize=10)
    ground = -robot.platform.gear_height_m
    side.axhline(ground, color="#bbaa88", lw=1.5, label="ground when landed")
    side.set_title("from the right side (front to the right)", fontsize=10)
    if robot.arm is not None:
        side.plot([], [], **STYLES["arm"], label="arm at work")
        side.plot([], [], **{**STYLES["arm"], "alpha": 0.35}, label="arm folded")
    if robot.probe is not None:
        side.plot([], [], **STYLES["probe"], label="probe")
    side.legend(fontsize=8, loc="lower right")
    return figure


def _pad(q: NDArray[np.float64]) -> NDArray[np.float64]:
    from skywright.core.types import MAX_JOINTS

    out = np.zeros(MAX_JOINTS)
    out[: len(q)] = q
    return out


def _world_parts(world: World) -> list[Outline]:
    parts: list[Outline] = []
    if world.pipe is not None:
        if world.pipe.supports:
            for top in support_posts(world):
                parts.append(Outline(np.array([top * [1, 1, 0], top]), "post"))
        parts += outline_pipe(world.pipe)
        if world.weld is not None and world.weld.present:
            s, phi = _weld_curve(world.pipe, world.weld)
            parts.append(Outline(surface_curve(world.pipe, s, phi), "weld"))
    for box in world.obstacles.values():
        parts += outline_box(box)
    return parts


def _weld_curve(pipe: Pipe, weld: Weld) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (s, phi) of the weld's line, where it runs on the pipe."""
    radius, half = pipe.diameter_m / 2, pipe.length_m / 2
    slope = math.radians(weld.angle_deg)
    reach = math.pi * radius + half
    t = np.linspace(-2 * reach, 2 * reach, 2001)
    if weld.angle_deg == 90.0:
        s, c = t, np.full_like(t, weld.offset_m)
    else:
        s, c = weld.offset_m + t * math.sin(slope), t * math.cos(slope)
    inside = (np.abs(s) <= half) & (np.abs(c) <= math.pi * radius)
    s[~inside] = np.nan
    return s, c / radius


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
        _draw(ax, parts + extra, view)
        _label(ax, view, title, "W")
    axes[1].axhline(0.0, color="#bbaa88", lw=1.5)
    _draw_wind(axes[0], world)


def draw_world(world: World) -> Figure:
    """Draw a world from above, from the side, and the pipe's surface unrolled."""
    columns = 2 if world.pipe is None else 3
    figure, axes = _figure(columns, _title(world.name, world.description), 5.2 * columns)
    _draw_scene(axes[:2], world, [])
    if world.pipe is None and not world.obstacles:
        axes[0].text(0.5, 0.5, "nothing but flat ground", transform=axes[0].transAxes, ha="center")
        for ax in axes:
            ax.plot([-3, 3], [-1, 3], alpha=0)  # some room to look at
    if world.pipe is not None:
        _draw_unrolled(axes[2], world.pipe, world.weld, None)
    return figure


def draw_mission(description: Description) -> Figure:
    """Draw a mission: the robot at its start, the world, way-points or the sector to scan."""
    mission, world, robot = description.mission, description.world, description.robot
    columns = 2 if world.pipe is None or mission.scan is None else 3
    figure, axes = _figure(columns, _title(mission.name, mission.description), 5.2 * columns)
    start = np.array([mission.start_x_m, mission.start_y_m, robot.platform.gear_height_m])
    parts = outline_robot(robot, posture(robot, "folded"))
    extra = move(parts, start, math.radians(mission.start_yaw_deg))
    hover = start * [1, 1, 0] + [0, 0, mission.hover_height_m]
    points = [start, hover]
    if mission.kind == "waypoints":
        points += [np.array([w.x_m, w.y_m, w.z_m]) for w in mission.waypoints]
        extra.append(Outline(np.array(points), "path"))
    if mission.scan is not None and world.pipe is not None:
        edge_s, edge_phi = sector_edge(mission.scan)
        extra.append(Outline(surface_curve(world.pipe, edge_s, edge_phi), "sector"))
        _draw_unrolled(axes[2], world.pipe, world.weld, mission.scan)
    _draw_scene(axes[:2], world, extra)
    for ax, view in zip(axes, (TOP, SIDE), strict=False):
        for i, w in enumerate(mission.waypoints):
            p = (w.x_m, w.y_m, w.z_m)
            ax.plot(p[view[0]], p[view[1]], "o", color="#009988", ms=5)
            ax.annotate(
                f"{i}", (p[view[0]], p[view[1]]), (5, 5), fontsize=9, textcoords="offset points"
            )
    what = "way-points (green)" if mission.waypoints else "sector to scan (green)"
    axes[0].set_title(f"from above: robot at its start, {what}", fontsize=10)
    return figure


def sector_edge(scan: Scan) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edge of the scanned sector as (s, phi), closed."""
    centres = {"side": 0.0, "top": 90.0, "underside": -90.0, "angle": scan.centre_angle_deg}
    middle, half = math.radians(centres[scan.side]), math.radians(scan.arc_deg) / 2
    low, high = scan.centre_s_m - scan.pass_length_m / 2, scan.centre_s_m + scan.pass_length_m / 2
    sweep = np.linspace(middle - half, middle + half, 31)
    s = np.concatenate([np.full(31, low), np.full(31, high), [low]])
    return s, np.concatenate([sweep, sweep[::-1], sweep[:1]])


def _draw_unrolled(ax: Axes, pipe: Pipe, weld: Weld | None, scan: Scan | None) -> None:
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
    if weld is not None and weld.present:
        s, phi = _weld_curve(pipe, weld)
        ax.plot(s, phi * radius, **STYLES["weld"], label=f"weld, {weld.angle_deg:g} deg")
    if scan is not None:
        s, phi = sector_edge(scan)
        ax.plot(s, phi * radius, **STYLES["sector"], label="sector to scan")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title("pipe's surface, unrolled (angle at yaw 0)", fontsize=10)
    ax.set_xlabel("s along the axis (m)")
    ax.set_ylabel("c around the circumference (m)")
    ax.grid(True, lw=0.3, alpha=0.6)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=8, loc="lower left")
