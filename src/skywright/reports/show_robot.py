"""Figure of a robot: rotors with spin and thrust direction, arm, masses, key numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from skywright.core.arrays import Array
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.arm import Link
from skywright.description.robot.limbs import list_joints, list_limbs
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import build_body_model, compute_body, compute_kinematics, posture
from skywright.models.rotors import build_rotors
from skywright.reports.outlines import outline_arm, outline_robot
from skywright.reports.show_style import SIDE, STYLES, TOP, draw_dimension, draw_parts, label_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


CCW, CW = "#2f6fc4", "#e07b00"
THRUST_LENGTH = 0.16  # m, length of the thrust arrows


def draw_robot(robot: Robot) -> Figure:
    """Draw a robot from above and from the side, arm at work and folded, with its key numbers."""
    figure = Figure(figsize=(15.5, 5.8), layout="constrained")
    FigureCanvasAgg(figure)
    title = f"{robot.name}: {robot.description}" if robot.description else robot.name
    figure.suptitle(title, fontsize=13)
    top, side, text = figure.subplots(1, 3, width_ratios=[1.0, 1.0, 0.5])
    _draw_top(top, robot)
    _draw_side(side, robot)
    _write_numbers(text, robot)
    return figure


def _draw_bodies(ax: Axes, robot: Robot, view: tuple[int, int]) -> None:
    working, folded = posture(robot, "working"), posture(robot, "folded")
    body = [part for part in outline_robot(robot, working) if part.part != "disc"]
    draw_parts(ax, outline_arm(robot, folded), view, alpha=0.35)
    draw_parts(ax, body, view)
    discs = [part for part in outline_robot(robot, working) if part.part == "disc"]
    for disc, spin in zip(discs, robot.rotors.spin, strict=True):
        draw_parts(ax, [disc], view, color=CCW if spin == "ccw" else CW)
    _, com, _ = compute_body(build_body_model(robot), pad_joints(working))
    ax.plot(
        com[view[0]], com[view[1]], "P", color="black", ms=9, mec="white", zorder=6,
        ls="none", label="centre of mass, arm at work" if robot.arm else "centre of mass",
    )  # fmt: skip


def _draw_top(ax: Axes, robot: Robot) -> None:
    _draw_bodies(ax, robot, TOP)
    rotors, r = build_rotors(robot.rotors), robot.rotors
    for i, (hub, axis) in enumerate(zip(rotors.position, rotors.axis, strict=True)):
        colour = CCW if r.spin[i] == "ccw" else CW
        _draw_spin(ax, hub, axis, 0.62 * r.propeller_radius_m, r.spin[i] == "ccw", colour)
        name = f"{i}"
        if r.alpha_deg[i] or r.beta_deg[i]:
            name += f"\n{r.alpha_deg[i]:+g}°, {r.beta_deg[i]:+g}°"
        box = {"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.75}
        ax.text(hub[0], hub[1], name, ha="center", va="center", fontsize=8, bbox=box, zorder=7)
    tilted = any(r.alpha_deg) or any(r.beta_deg)
    ax.plot([], [], color=CCW, lw=3, label="propeller, counter-clockwise from above")
    ax.plot([], [], color=CW, lw=3, label="propeller, clockwise from above")
    label_axes(ax, TOP, "from above (front to the right)", "B")
    reach = max(r.radii) + r.propeller_radius_m
    span = robot.platform.diameter_m
    draw_dimension(ax, (-span / 2, -reach - 0.12), (span / 2, -reach - 0.12), f"{span:g} m")
    note = "rotor number" + (", tilt alpha, beta" if tilted else "")
    ax.text(0.01, 0.99, note, transform=ax.transAxes, fontsize=8, va="top", color="#555555")
    ax.legend(fontsize=7.5, loc="upper right", framealpha=0.9)
    ax.margins(0.04, 0.14)


def _draw_spin(ax: Axes, hub: Array, axis: Array, radius: float, ccw: bool, colour: str) -> None:
    """Draw three quarters of a circle in the propeller's disc with an arrow head."""
    u = np.cross(axis, [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    turn = np.linspace(0.3, 0.3 + 1.5 * math.pi, 40) * (1.0 if ccw else -1.0)
    p = hub + radius * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
    ax.plot(p[:, 0], p[:, 1], color=colour, lw=1.4)
    ax.annotate(
        "", p[-1, :2], p[-3, :2], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4}
    )


def _draw_side(ax: Axes, robot: Robot) -> None:
    _draw_bodies(ax, robot, SIDE)
    rotors = build_rotors(robot.rotors)
    for hub, axis, spin in zip(rotors.position, rotors.axis, robot.rotors.spin, strict=True):
        end = hub + THRUST_LENGTH * axis
        ax.annotate(
            "", (end[0], end[2]), (hub[0], hub[2]),
            arrowprops={"arrowstyle": "-|>", "color": CCW if spin == "ccw" else CW, "lw": 1.4},
        )  # fmt: skip
    _draw_joints(ax, robot)
    ground = -robot.platform.gear_height_m
    ax.axhline(ground, color="#bbaa88", lw=1.5, label="ground when landed")
    ax.plot([], [], color="#666666", marker=r"$\uparrow$", ms=9, ls="none", label="thrust")
    if robot.arm is not None:
        ax.plot([], [], **STYLES["arm"], label="arm at work")
        ax.plot([], [], **{**STYLES["arm"], "alpha": 0.35}, label="arm folded")
    if robot.probe is not None:
        ax.plot([], [], **STYLES["probe"], label="probe")
    label_axes(ax, SIDE, "from the right (front to the right)", "B")
    ax.legend(fontsize=7.5, loc="lower right", framealpha=0.9)


def _draw_joints(ax: Axes, robot: Robot) -> None:
    """Draw circles with names at the moving joints, arm at work."""
    if robot.arm is None:
        return
    model = build_body_model(robot)
    k = compute_kinematics(model, posture(robot, "working"))
    for i, limb in enumerate(list_limbs(robot)):
        if limb.link.joint != "fixed":
            p = k["p"][i]
            ax.plot(p[0], p[2], "o", color="white", mec="black", ms=7, zorder=6)
            ax.annotate(limb.name, (p[0], p[2]), (-6, 9), textcoords="offset points", fontsize=8,
                        ha="right")  # fmt: skip


def _write_numbers(ax: Axes, robot: Robot) -> None:
    """Write masses, rotors, joints and probe as text."""
    ax.set_axis_off()
    p, r = robot.platform, robot.rotors
    mass, _, _ = compute_body(build_body_model(robot), pad_joints(posture(robot, "working")))
    up = build_rotors(r).axis[:, 2]  # rotors that point down run at minimum thrust
    lift = float(np.sum(np.where(up > 0.0, r.thrust_max_n, r.thrust_min_n) * up))
    groups: list[tuple[str, list[tuple[str, str]]]] = []
    masses = [("platform", f"{p.mass_kg:.3g} kg")]
    if robot.arm is not None:
        masses += [(limb.name, f"{limb.link.mass_kg:.3g} kg") for limb in list_limbs(robot)]
    if robot.probe is not None:
        masses.append(("probe", f"{robot.probe.mass_kg:.3g} kg"))
    if robot.docking is not None:
        masses.append(("docking gear", f"{robot.docking.mass_kg:.3g} kg"))
    groups.append(("mass", [*masses, ("in all", f"{mass:.3g} kg")]))
    groups.append(("rotors", [
        (f"{len(r.azimuth_deg)} propellers", f"{2 * r.propeller_radius_m:.3g} m"),
        ("thrust of each", f"{r.thrust_min_n:.2g} to {r.thrust_max_n:.3g} N"),
        ("most lift / weight", f"{lift / (9.81 * mass):.2f}"),
        ("battery", f"{robot.battery.energy_wh:g} Wh"),
    ]))  # fmt: skip
    if robot.arm is not None:
        rows = [(limb.name, _describe_joint(limb.link)) for limb in list_joints(robot)]
        groups.append(("joints: range, at work, folded", rows))
    if robot.probe is not None:
        probe = robot.probe
        groups.append(("probe", [
            ("kind", "eddy current" if robot.force_sensor is None else "force sensor"),
            ("length", f"{1e3 * probe.length_m:g} mm"),
            ("spring", f"{probe.spring_n_per_m:g} N/m, {1e3 * probe.spring_travel_m:g} mm"),
            ("nominal push", f"{probe.force_n:g} N"),
        ]))  # fmt: skip
    y, step = 1.0, 1.0 / max(24, sum(len(rows) + 2 for _, rows in groups))
    for heading, rows in groups:
        ax.text(0.0, y, heading, fontsize=9.5, fontweight="bold", va="top", transform=ax.transAxes)
        for name, value in rows:
            y -= step
            ax.text(0.0, y, name, fontsize=9, va="top", transform=ax.transAxes)
            ax.text(1.0, y, value, fontsize=9, va="top", ha="right", transform=ax.transAxes)
        y -= 1.8 * step


def _describe_joint(link: Link) -> str:
    """Format range, working and folded value."""
    low, high = link.reach
    values = [low, high, link.rest("working"), link.rest("folded")]
    unit, values = (
        (" m", values) if link.joint == "slide" else ("°", [math.degrees(x) for x in values])
    )
    a, b, c, d = (f"{x:.4g}" for x in values)
    return f"{a}..{b}{unit}, {c}{unit}, {d}{unit}"


def pad_joints(q: Array) -> Array:
    """Return joint values (n,) padded with zeros to the fixed size of the records."""
    out = np.zeros(MAX_JOINTS)
    out[: len(q)] = q
    return out
