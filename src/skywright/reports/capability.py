"""Figure of a robot's capability: its static limits on one page."""

import math
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.projections.polar import PolarAxes

from skywright.core.arrays import Array
from skywright.models.capability import MOTOR_TIMEOUT_S, Capability

BLUE, ORANGE, GREEN, RED, GREY = "#1f5fa8", "#d9731a", "#2c8a4b", "#b3261e", "#8a8f98"
SIDES = (("forward (+x)", BLUE), ("left (+y)", GREEN), ("back (-x)", ORANGE), ("right (-y)", RED))


def write_capability_figure(capability: Capability, path: Path | str) -> Path:
    """Write the figure as PNG or SVG (by the suffix) and return its path."""
    c = capability
    out = Path(path)
    figure = plt.figure(figsize=(14.0, 9.6), dpi=110)
    grid = figure.add_gridspec(
        2, 3, left=0.05, right=0.975, top=0.80, bottom=0.07, hspace=0.52, wspace=0.26
    )
    _draw_force(figure.add_subplot(grid[0, 0], projection="polar"), c)
    _draw_wind(figure.add_subplot(grid[0, 1], projection="polar"), c)
    _draw_layout(figure.add_subplot(grid[0, 2]), c)
    _draw_tilt(figure.add_subplot(grid[1, 0]), c)
    _draw_loads(figure.add_subplot(grid[1, 1]), c)
    _draw_polytope(figure.add_subplot(grid[1, 2]), c)
    arm = {"none": "", "given": ", arm as given"}.get(c.posture, f", arm {c.posture}")
    figure.suptitle(
        f"Limits of {c.robot} at rest: {c.body.mass:.2f} kg{arm}, rotors up to "
        f"{100 * c.thrust_fraction:.0f} % of their limit",
        x=0.05,
        y=0.975,
        ha="left",
        fontsize=15,
        fontweight="bold",
    )
    figure.text(0.05, 0.932, _headline(c), fontsize=11, color="#333333", va="center")
    figure.savefig(out)
    plt.close(figure)
    return out


def _headline(c: Capability) -> str:
    if c.layout.full:
        tilt = (
            f"hovers in place with a tilt of up to {math.degrees(c.hover_tilt[0]):.1f} deg "
            f"in roll and {math.degrees(c.hover_tilt[1]):.1f} deg in pitch"
        )
    else:
        tilt = f"moves sideways by tilting, at most {math.degrees(c.tilt_max):.0f} deg"
    return (
        f"Hover {c.hover_power:.0f} W, {c.endurance / 60:.1f} min   |   "
        f"payload {c.payload:.2f} kg   |   {tilt}\n{_say_losses(c)}"
    )


def _say_losses(c: Capability) -> str:
    return f"{_say_rotors(c)}; falls after {MOTOR_TIMEOUT_S:g} s without a control link"


def _say_rotors(c: Capability) -> str:
    n = len(c.hover_thrust)
    if not c.dispensable:
        return "cannot land after the loss of any rotor"
    how = (
        f"leaning {math.degrees(max(c.lean_without)):.0f} deg"
        if c.layout.full
        else "without yaw control"
    )
    if len(c.dispensable) == n:
        return f"lands after the loss of any one of its {n} rotors, {how}"
    which = ", ".join(map(str, c.dispensable))
    return f"lands after the loss of rotor {which}, {how}, but not of another"


def _polar(axes: Axes, title: str) -> PolarAxes:
    assert isinstance(axes, PolarAxes)
    axes.set_theta_zero_location("N")  # the robot from above: forward is up, left is left
    axes.set_thetagrids(
        range(0, 360, 45), ["forward\n+x", "", "left\n+y", "", "back\n-x", "", "right\n-y", ""]
    )
    axes.set_title(title, fontsize=11, fontweight="bold", pad=14)
    axes.tick_params(labelsize=8)
    axes.tick_params(axis="x", pad=6)
    axes.set_rlabel_position(-157.5)
    axes.grid(color="#dddddd")
    return axes


def _closed(values: Array) -> Array:
    return np.append(values, values[:1])


def _mark_least(axes: PolarAxes, angles: Array, values: Array, unit: str) -> None:
    """Write the smallest value below the circle."""
    if np.all(np.isnan(values)):
        return
    i = int(np.nanargmin(values))
    axes.plot([angles[i]], [values[i]], "o", color=RED, markersize=5, zorder=5)
    direction = math.degrees(angles[i])
    axes.text(
        0.5,
        -0.235,
        f"smallest {values[i]:.1f} {unit} toward {direction:.0f} deg",
        transform=axes.transAxes,
        ha="center",
        fontsize=9,
        color=RED,
    )


def _draw_force(plain: Axes, c: Capability) -> None:
    axes = _polar(plain, "Lateral force at level attitude (N)")
    if not np.any(c.lateral_force > 0.0):
        axes.set_yticks([])
        axes.text(0.5, 0.42, "none: parallel rotors\n", transform=axes.transAxes, ha="center")
        return
    axes.plot(_closed(c.directions), _closed(c.lateral_force), color=BLUE, lw=2)
    axes.fill(_closed(c.directions), _closed(c.lateral_force), color=BLUE, alpha=0.15)
    axes.set_ylim(0, 1.08 * np.nanmax(c.lateral_force))
    _mark_least(axes, c.directions, c.lateral_force, "N")


def _draw_wind(plain: Axes, c: Capability) -> None:
    axes = _polar(plain, "Steady wind held (m/s), blowing toward")
    degrees = math.degrees(c.tilt_max)
    if not np.any(c.wind_limit_tilted > 0.0):
        axes.set_yticks([])
        axes.text(0.5, 0.45, "none: no reserve in hover", transform=axes.transAxes, ha="center")
        return
    if c.layout.full:
        axes.plot(
            _closed(c.directions),
            _closed(c.wind_limit_tilted),
            "--",
            color=GREY,
            lw=1.3,
            label=f"leaning up to {degrees:.0f} deg",
        )
    axes.plot(
        _closed(c.directions),
        _closed(c.wind_limit),
        color=GREEN,
        lw=2,
        label="level" if c.layout.full else f"tilting up to {degrees:.0f} deg",
    )
    axes.fill(_closed(c.directions), _closed(c.wind_limit), color=GREEN, alpha=0.15)
    axes.set_ylim(0, 1.08 * np.nanmax(c.wind_limit_tilted))
    axes.legend(loc="lower left", bbox_to_anchor=(-0.3, -0.1), fontsize=8, frameon=False)
    _mark_least(axes, c.directions, c.wind_limit, "m/s")


def _draw_layout(axes: Axes, c: Capability) -> None:
    """Draw the rotors from above: x forward is up, y left is left."""
    r = c.layout.rotors
    axes.set_title("Rotors seen from above", fontsize=11, fontweight="bold")
    radius = r.propeller_radius
    scale = 0.9 * radius / max(0.05, float(np.abs(r.axis[:, :2]).max()))
    for i, (position, axis) in enumerate(zip(r.position, r.axis, strict=True)):
        x, y = -position[1], position[0]
        colour = BLUE if r.spin[i] > 0 else ORANGE
        axes.add_patch(Circle((x, y), radius, fill=False, color=colour, lw=1.8))
        axes.plot([0, x], [0, y], color="#cccccc", lw=3, zorder=0)
        lean = np.hypot(axis[0], axis[1])
        away = np.array([axis[1], -axis[0]]) / lean if lean > 1e-6 else np.array([0.0, -1.0])
        axes.text(
            x + 0.5 * radius * away[0], y + 0.5 * radius * away[1], f"{i + 1}",
            ha="center", va="center", fontsize=10, color=colour,
        )  # fmt: skip
        if lean > 1e-6:
            axes.annotate(
                "",
                (x - scale * axis[1], y + scale * axis[0]),
                (x, y),
                arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6},
            )
        else:
            axes.plot([x], [y], "o", color=colour, markersize=4)
    com, tip = c.body.p_BC, c.p_BT
    if np.hypot(tip[0], tip[1]) > 1e-6:
        axes.plot([0, -tip[1]], [0, tip[0]], color="black", lw=2, label="arm to its tip")
        axes.plot([-tip[1]], [tip[0]], "^", color="black", markersize=7)
    axes.plot([-com[1]], [com[0]], "P", color=RED, markersize=9, label="centre of mass")
    axes.plot([], [], color=BLUE, label="counter-clockwise")
    axes.plot([], [], color=ORANGE, label="clockwise")
    reach = float(np.abs(r.position[:, :2]).max()) + radius
    top = max(reach, tip[0] + 0.05)
    axes.set(xlim=(-1.08 * reach, 1.08 * reach), ylim=(-1.08 * reach, 1.08 * top), aspect="equal")
    axes.set_xlabel("right (m); arrows: lateral part of each axis", fontsize=9)
    axes.set_ylabel("forward (m)", fontsize=9)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), fontsize=8, frameon=False, ncol=2)
    axes.tick_params(labelsize=8)


def _draw_tilt(axes: Axes, c: Capability) -> None:
    axes.set_title("Lateral force against tilt toward it", fontsize=11, fontweight="bold")
    # opposite sides often coincide: dashes over a solid line keep both visible
    for i, ((name, colour), row) in enumerate(zip(SIDES, c.lateral_force_tilted, strict=True)):
        dashes = ("-", "-", "--", (0, (1, 2)))[i]
        width = (3.2, 2.4, 2.0, 2.0)[i]
        axes.plot(np.degrees(c.tilts), row, color=colour, ls=dashes, lw=width, label=name)
    axes.axvline(math.degrees(c.tilt_max), color=GREY, ls=":", lw=1.5)
    axes.text(
        math.degrees(c.tilt_max), 0.02, " tilt limit of control", rotation=90, fontsize=8,
        color=GREY, ha="right", va="bottom", transform=axes.get_xaxis_transform(),
    )  # fmt: skip
    axes.set_xlabel("tilt (deg), height held", fontsize=9)
    axes.set_ylabel("largest horizontal force (N)", fontsize=9)
    axes.set_ylim(bottom=0)
    axes.grid(color="#eeeeee")
    axes.legend(fontsize=8, frameon=False)
    axes.tick_params(labelsize=8)


def _draw_loads(axes: Axes, c: Capability) -> None:
    axes.set_title("Rotor thrust in hover, between its limits", fontsize=11, fontweight="bold")
    n = len(c.hover_thrust)
    at = np.arange(1, n + 1)
    full, preload = c.layout.rotors.thrust_max, c.layout.preload
    low, high = c.layout.t_min + preload, c.layout.t_max + preload
    axes.bar(at, full - high, bottom=high, color="#eeeeee", width=0.62)
    colours = [BLUE if s > 0 else ORANGE for s in c.layout.rotors.spin]
    axes.bar(at, c.hover_thrust, color=colours, width=0.62)
    for i, thrust in zip(at, c.hover_thrust, strict=True):
        axes.text(float(i), thrust + 0.012 * full[0], f"{thrust:.1f}", ha="center", fontsize=9)
    axes.axhline(high[0], color=RED, lw=1.5, ls="--")
    axes.axhline(low[0], color=RED, lw=1.5, ls="--")
    axes.text(
        0.45, high[0], f"upper limit {high[0]:.2f} N ", fontsize=8, color=RED,
        ha="left", va="bottom",
    )  # fmt: skip
    axes.text(
        n + 0.55, low[0], f"lower limit {low[0]:.2f} N ", fontsize=8,
        color=RED, ha="right", va="bottom",
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5},
    )  # fmt: skip
    axes.set_xticks(at)
    axes.set(xlim=(0.4, n + 0.6), ylim=(0, 1.05 * full[0]))
    axes.set_xlabel("rotor (blue: counter-clockwise)", fontsize=9)
    axes.set_ylabel("thrust (N); grey: control reserve", fontsize=9)
    axes.tick_params(labelsize=8)


def _draw_polytope(axes: Axes, c: Capability) -> None:
    """Draw the force polytope from the side: forward and vertical force, without torque."""
    axes.set_title("Feasible rotor forces (outline)", fontsize=11, fontweight="bold")
    points = c.force_polytope[:, [0, 2]]
    hull = _hull(points)
    axes.fill(hull[:, 0], hull[:, 1], color=BLUE, alpha=0.15)
    axes.plot(*_closed_rows(hull).T, color=BLUE, lw=1.8, label="forward and up")
    side = _hull(c.force_polytope[:, [1, 2]])
    axes.plot(*_closed_rows(side).T, color=GREEN, lw=1.3, ls="--", label="left and up")
    weight = c.body.mass * c.body.gravity
    axes.axhline(weight, color=RED, lw=1.3, ls=":")
    axes.plot([0], [weight], "o", color=RED, markersize=6, label=f"hover: weight {weight:.1f} N")
    widest = max(5.0, float(np.abs(c.force_polytope[:, :2]).max())) * 1.15
    up = c.force_polytope[:, 2]
    axes.set(xlim=(-widest, widest), ylim=(min(0.0, 1.1 * float(up.min())), 1.1 * float(up.max())))
    axes.set_xlabel("horizontal force (N), no torque about the centre of mass", fontsize=9)
    axes.set_ylabel("vertical force (N)", fontsize=9)
    axes.grid(color="#eeeeee")
    axes.legend(fontsize=8, frameon=True, loc="lower right", framealpha=0.9)
    axes.tick_params(labelsize=8)


def _closed_rows(points: Array) -> Array:
    return np.vstack([points, points[:1]])


def _hull(points: Array) -> Array:
    """Return the convex hull (k, 2), counter-clockwise; the ends of a segment if it is flat."""
    order = points[np.lexsort((points[:, 1], points[:, 0]))]

    def half(rows: Array) -> list[Array]:
        chain: list[Array] = []
        for p in rows:
            while len(chain) > 1:
                a, b = chain[-1] - chain[-2], p - chain[-2]
                if a[0] * b[1] - a[1] * b[0] > 1e-9:
                    break
                chain.pop()
            chain.append(p)
        return chain

    lower, upper = half(order), half(order[::-1])
    return np.array(lower[:-1] + upper[:-1])
