"""Figures of a comparison: robots at the pipe, reach, torque maps, collisions, accuracy."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from skywright.analysis.compare.comparison import Comparison, Side
from skywright.description.world.spec import Pipe
from skywright.models.reach import PLATFORM_MARGIN
from skywright.reports.figures.style import (
    BLUE,
    GREY,
    LIMIT,
    ORANGE,
    SKY,
    WIDTH,
    draw_limit,
    new_figure,
)
from skywright.reports.outlines import move, outline_robot

COLOURS = (BLUE, ORANGE)


def draw_pair(c: Comparison, pipe: Pipe) -> Figure:
    """Draw both robots from the side with the hand at the underside of the pipe."""
    figure = new_figure(WIDTH, 4.4)
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    figure.subplots_adjust(left=0.07, right=0.99, top=0.92, bottom=0.11, wspace=0.06)
    for ax, side, colour in zip(axes, c.sides, COLOURS, strict=True):
        ax.set(title=side.name, aspect="equal")
        ax.add_patch(Circle((0.0, 0.0), 0.5 * pipe.diameter_m, color=GREY, zorder=3))
        ax.set_xlabel("ahead of the pipe's axis (m)")
        if side.way is None:
            ax.text(0.5, 0.5, "the robot cannot fly this task", transform=ax.transAxes, ha="center")
            continue
        place = side.way.p_contact - [pipe.x_m, pipe.y_m, pipe.z_m]
        yaw = math.radians(pipe.yaw_deg)
        back = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        for part in move(outline_robot(side.robot, side.way.q), place, yaw):
            x, z = part.points @ back, part.points[:, 2]
            if part.part == "disc":
                ax.plot(x, z, color=SKY, lw=2.5, zorder=4)
            else:
                ax.plot(x, z, color=colour if part.part == "arm" else "#333333", lw=1.8, zorder=5)
        least = float(np.min(side.way.propellers))
        text = f"propellers to pipe, least: {least:.2f} m" if least > 0.0 else (
            f"no path: rotors or booms and pipe\nwould overlap by {-least:.2f} m")  # fmt: skip
        ax.text(
            0.98, 0.98, text, transform=ax.transAxes, ha="right", va="top",
            color=LIMIT if least <= 0 else "#333333",
        )  # fmt: skip
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high + 0.15 * (high - low))  # room for the text
    axes[0].set_ylabel("above the pipe's axis (m)")
    return figure


def draw_clearance(c: Comparison) -> Figure | None:
    """Draw the distance of propellers and landing gear to the pipe along the path of
    sensor-install."""
    if all(s.way is None for s in c.sides):
        return None
    figure = new_figure(WIDTH, 3.2)
    ax = figure.add_axes((0.07, 0.15, 0.92, 0.75))
    ax.set_title("Distance to the pipe during the approach")
    for side, colour in zip(c.sides, COLOURS, strict=True):
        if side.way is None:
            continue
        w = side.way
        left = w.distance[-1] - w.distance
        ax.plot(left, w.propellers, color=colour, label=f"{side.name}: propellers, hub")
        ax.plot(left, w.gear, color=colour, ls="--", label=f"{side.name}: landing gear")
    ax.invert_xaxis()
    ax.set(xlabel="remaining distance to the contact (m)", ylabel="distance (m); below 0: overlap")
    draw_limit(ax, PLATFORM_MARGIN, f"margin {PLATFORM_MARGIN:g} m")
    ax.legend(loc="upper right", ncols=2)
    return figure


def draw_reach(c: Comparison) -> Figure:
    """Draw the reachable positions of the hand around the pipe."""
    figure = new_figure(WIDTH, 4.9)
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    figure.subplots_adjust(left=0.07, right=0.99, top=0.93, bottom=0.1, wspace=0.06)
    for ax, side in zip(axes, c.sides, strict=True):
        m = side.reach
        ax.set(aspect="equal", xlabel="ahead of the pipe's axis (m)")
        if m is None:
            continue
        ax.set_title(side.name)
        ax.text(
            0.02, 0.97, f"touches {100 * m.surface_share:.0f} % of the circumference,\n"
            f"{100 * m.below_share:.0f} % of the lower half", transform=ax.transAxes, va="top",
        )  # fmt: skip
        shown = np.where(m.inside, math.nan, m.reached)
        half = 0.5 * (m.x[1] - m.x[0])
        extent = (m.x[0] - half, m.x[-1] + half, m.z[0] - half, m.z[-1] + half)
        ax.imshow(
            shown, origin="lower", extent=extent, cmap=ListedColormap(["#f3d9d5", "#cfe8dc"]),
            vmin=0.0, vmax=1.0, interpolation="nearest",
        )  # fmt: skip
        ax.add_patch(Circle((0.0, 0.0), m.radius, color=GREY, zorder=3))
        dots = 1.06 * m.radius * np.column_stack([-np.cos(m.angle), np.sin(m.angle)])
        for mask, colour in ((m.touched, "#00694d"), (~m.touched, LIMIT)):
            ax.plot(dots[mask, 0], dots[mask, 1], ".", color=colour, ms=4, zorder=4)
        ax.grid(False)
    axes[0].set_ylabel("above the pipe's axis (m)")
    return figure


def draw_reaction(c: Comparison) -> Figure:
    """Draw the torque on the platform per newton at the hand, over the direction of the force."""
    figure = new_figure(WIDTH, 5.4)
    grid = figure.add_gridspec(
        2, 3, width_ratios=[1, 1, 0.04], left=0.07, right=0.93, top=0.94, bottom=0.09,
        hspace=0.34, wspace=0.08,
    )  # fmt: skip
    maps = [s.reaction for s in c.sides]
    top = max(float(np.nanmax(np.linalg.norm(m.torque, axis=2))) for m in maps if m is not None)
    image = None
    for i, (side, m) in enumerate(zip(c.sides, maps, strict=True)):
        if m is None:
            continue
        az, el = np.degrees(m.azimuth), np.degrees(m.elevation)
        for row, (what, values) in enumerate((
            ("whole torque", np.linalg.norm(m.torque, axis=2)),
            ("about pitch only", np.abs(m.torque[..., 1])),
        )):  # fmt: skip
            ax = figure.add_subplot(grid[row, i])
            ax.set_title(f"{side.name}: {what}, up to {np.nanmax(values):.2f}")
            image = ax.pcolormesh(
                az, el, values, vmin=0.0, vmax=top, cmap="viridis", shading="gouraud",
                rasterized=True,
            )  # fmt: skip
            _name_directions(ax)
            if i:
                ax.tick_params(labelleft=False)
            else:
                ax.set_ylabel("force on the hand points")
    if image is not None:
        figure.colorbar(image, cax=figure.add_subplot(grid[:, 2]), label="torque a newton (N m/N)")
    return figure


def draw_recoil(c: Comparison) -> Figure | None:
    """Draw the angle of the passive link under the force, over the force's direction."""
    sides = [s for s in c.sides if s.robot.pendulum is not None and s.reaction is not None]
    if not sides:
        return None
    figure = new_figure(0.5 * WIDTH * len(sides), 2.9)
    for i, side in enumerate(sides):
        m = side.reaction
        assert m is not None
        ax = figure.add_subplot(1, len(sides), i + 1)
        ax.set_title(f"{side.name}, {m.force:g} N")
        image = ax.pcolormesh(
            np.degrees(m.azimuth), np.degrees(m.elevation), np.degrees(np.abs(m.swing)),
            vmin=0.0, cmap="viridis", shading="gouraud", rasterized=True,
        )  # fmt: skip
        _name_directions(ax)
        ax.set_ylabel("force on the hand points")
        figure.colorbar(image, ax=ax, label="link turns (deg)")
    figure.tight_layout(pad=0.8)
    return figure


def _name_directions(ax: Axes) -> None:
    ax.set_xticks(range(0, 361, 90), ["ahead", "left", "back", "right", ""])
    ax.set_yticks([-90, -45, 0, 45, 90], ["down", "", "level", "", "up"])
    ax.grid(False)


def draw_collisions(c: Comparison) -> Figure | None:
    """Draw peak torque, peak force and tilt of the platform for every collision."""
    bars = [
        (f"{s.name}: {x.what}", x.metrics, colour)
        for s, colour in zip(c.sides, COLOURS, strict=True) for x in s.collisions if x.metrics
    ]  # fmt: skip
    if not bars:
        return None
    figure = new_figure(WIDTH, 0.9 + 0.36 * len(bars))
    axes = figure.subplots(1, 3, sharey=True)
    figure.subplots_adjust(left=0.26, right=0.99, top=0.87, bottom=0.12, wspace=0.08)
    places = -np.arange(len(bars))
    axes[0].set_yticks(places, [name for name, *_ in bars])
    for ax, (key, title) in zip(axes, (
        ("impact.peak_torque_nm", "Torque on the platform (N m)"),
        ("impact.peak_force_n", "Force on the platform (N)"),
        ("impact.recoil_deg", "Tilt afterwards (deg)"),
    ), strict=True):  # fmt: skip
        values = [m.get(key, math.nan) for _, m, _ in bars]
        ax.barh(places, values, color=[colour for *_, colour in bars], height=0.6)
        for y, v in zip(places, values, strict=True):
            if math.isfinite(v):
                ax.annotate(
                    f"{v:.2g}", (v, y), (3, 0), textcoords="offset points", va="center", fontsize=8
                )
        ax.margins(x=0.18)
        ax.grid(axis="y", visible=False)
        ax.set_title(title)
    return figure


def draw_accuracy(c: Comparison) -> Figure | None:
    """Draw the rms distances of tip and platform from their references over the wind speed."""
    if all(s.hover is None for s in c.sides):
        return None
    figure = new_figure(WIDTH, 3.2)
    axes = figure.subplots(1, 2, sharey=True)
    figure.subplots_adjust(left=0.07, right=0.99, top=0.9, bottom=0.16, wspace=0.06)
    for side, colour in zip(c.sides, COLOURS, strict=True):
        if side.hover is None:
            continue
        _draw_spread(axes[0], side, side.hover.tip, colour)
        _draw_spread(axes[1], side, side.hover.platform, colour)
    for ax, what in zip(axes, ("Tip", "Platform"), strict=True):
        ax.set(title=f"{what} from its reference, rms over 15 s", xlabel="mean wind, gusty (m/s)")
        ax.set_ylim(bottom=0.0)
    axes[0].set_ylabel("distance (mm)")
    draw_limit(axes[0], 50.0, "5 cm: requirement of the paper")
    axes[0].legend(loc="upper left")
    return figure


def _draw_spread(ax: Axes, side: Side, table: np.ndarray, colour: str) -> None:
    """Draw the mean over the seeds, and each flight as a dot."""
    assert side.hover is not None
    wind = side.hover.wind
    known = np.isfinite(table).any(axis=1)
    mean = np.array([1e3 * np.nanmean(row) if ok else math.nan
                     for row, ok in zip(table, known, strict=True)])  # fmt: skip
    ax.plot(wind, mean, color=colour, label=side.name)
    for k in range(table.shape[1]):
        ax.plot(wind, 1e3 * table[:, k], ".", color=colour, ms=5)
