"""Figure of a docked robot's press force: over slope, wind, direction and contact point."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.projections.polar import PolarAxes

from skywright.models.docked_map import DockedMap

BLUE, ORANGE, GREEN, RED, GREY = "#1f5fa8", "#d9731a", "#2c8a4b", "#b3261e", "#8a8f98"
SHADES = (BLUE, GREEN, ORANGE, RED, "#6f4ea0")


def write_docked_figure(found: DockedMap, path: Path | str) -> Path:
    """Write the figure as PNG or SVG (by the suffix) and return its path."""
    figure = Figure(figsize=(14.0, 9.4), dpi=110)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, 2, left=0.06, right=0.97, top=0.84, bottom=0.07, hspace=0.34, wspace=0.2
    )
    _draw_slope(figure.add_subplot(grid[0, 0]), found)
    _draw_directions(figure.add_subplot(grid[0, 1], projection="polar"), found)
    _draw_contact(figure.add_subplot(grid[1, 0]), found)
    _draw_balance(figure.add_subplot(grid[1, 1]), found)
    figure.suptitle(
        f"Press force of {found.robot} while docked: {found.mass:.2f} kg, rotors up to "
            f"{100 * found.thrust_fraction:.0f} % of their limit",
        x=0.06, y=0.975, ha="left", fontsize=15, fontweight="bold",
    )  # fmt: skip
    figure.text(0.06, 0.925, describe_press(found), fontsize=11, color="#333333", va="center")
    out = Path(path)
    figure.savefig(out)
    return out


def describe_press(found: DockedMap) -> str:
    """Return the requested condition and its force as one line."""
    tip, c = found.stance.tip, found.condition
    where = f"tip at ({tip[0]:.2f}, {tip[1]:.2f}) m"
    slope = f"slope {math.degrees(c.slope):g} deg{_toward(c.slope, c.slope_toward)}"
    wind = f"wind {c.wind:g} m/s{_toward(c.wind, c.wind_toward)}"
    if math.isnan(found.asked.force):
        answer = "the robot cannot stay docked"
    else:
        answer = f"at most {found.asked.force:.1f} N, limited by {found.asked.limit}"
    return f"{slope}, {wind}, {where}: {answer}"


def _toward(size: float, direction: float | None) -> str:
    if size == 0.0:
        return ""
    return (
        " in the worst direction" if direction is None else f" at {math.degrees(direction):g} deg"
    )


def _finish(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=11, fontweight="bold")
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.set_ylim(bottom=0.0)
    axes.grid(color="#eeeeee")
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=8, frameon=False)


def _draw_slope(axes: Axes, found: DockedMap) -> None:
    slopes = np.degrees(found.slopes)
    for wind, row, colour in zip(found.winds, found.force, SHADES, strict=False):
        axes.plot(slopes, row, "o-", color=colour, lw=2, label=f"wind {wind:g} m/s")
        lost = np.isnan(row)
        if np.any(lost):
            axes.plot(slopes[lost], np.zeros(lost.sum()), "x", color=colour, ms=9, mew=2,
                      clip_on=False, label=f"wind {wind:g} m/s: cannot stay docked")  # fmt: skip
    _finish(
        axes, "Largest press, worst directions of slope and wind", "slope of the surface (deg)",
        "force along the surface's normal (N)",
    )  # fmt: skip


def _draw_directions(plain: Axes, found: DockedMap) -> None:
    assert isinstance(plain, PolarAxes)
    plain.set_theta_zero_location("N")  # forward is up, left is left
    angles = np.append(found.directions, found.directions[:1])
    for slope, row, colour in zip(found.slopes, found.force_toward, SHADES, strict=False):
        label = f"{math.degrees(slope):g} deg"
        plain.plot(angles, np.append(row, row[:1]), "o-", ms=3, color=colour, lw=2, label=label)
    plain.set_title(
        "Largest press (N), calm, against the direction in which the slope rises",
        fontsize=11,
        fontweight="bold",
    )
    plain.set_thetagrids(
        range(0, 360, 45), ["ahead\n+x", "", "left\n+y", "", "back\n-x", "", "right\n-y", ""]
    )
    plain.set_rmin(0.0)
    plain.tick_params(labelsize=8)
    plain.legend(
        fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(-0.35, -0.02), title="slope"
    )


def _draw_contact(axes: Axes, found: DockedMap) -> None:
    for slope, row, colour in zip(found.slopes, found.force_at, SHADES, strict=False):
        label = f"slope {math.degrees(slope):g} deg"
        axes.plot(found.contacts, row, "o-", color=colour, lw=2, label=label)
    axes.axvline(found.stance.tip[0], color=GREY, ls=":", lw=1.5, label="contact point above")
    _finish(
        axes, "Largest press against the contact point, calm, worst direction",
        "contact point ahead of the centre (m), within the arm's reach", "force (N)",
    )  # fmt: skip


def _draw_balance(axes: Axes, found: DockedMap) -> None:
    """Draw feet and tip from above with their forces in the requested condition."""
    axes.set_title("Loads in the requested condition, from above", fontsize=11, fontweight="bold")
    tip, asked = found.stance.tip, found.asked
    scale = 0.022  # m per square root of newton
    for i, foot in enumerate(found.feet):
        load = asked.foot_load[i]
        if math.isfinite(load):
            axes.add_patch(
                Circle((-foot[1], foot[0]), scale * math.sqrt(load), color=BLUE, alpha=0.5)
            )
            text = f"foot {i + 1}\n{load:.1f} N"
        else:
            text = f"foot {i + 1}"
        axes.plot([-foot[1]], [foot[0]], ".", color=BLUE)
        axes.annotate(text, (-foot[1], foot[0]), (0, 14), textcoords="offset points",
                      ha="center", fontsize=9, color=BLUE)  # fmt: skip
    if math.isfinite(asked.force):
        size = scale * math.sqrt(asked.force)
        axes.add_patch(Circle((-tip[1], tip[0]), size, color=RED, alpha=0.5))
    axes.plot([-tip[1]], [tip[0]], "^", color=RED)
    label = f"tip\n{asked.force:.1f} N" if math.isfinite(asked.force) else "tip"
    axes.annotate(label, (-tip[1], tip[0]), (0, 26), textcoords="offset points", ha="center",
                  fontsize=9, color=RED)  # fmt: skip
    com = found.stance.p_BC
    axes.plot([-com[1]], [com[0]], "P", color="black", ms=8, label="centre of mass")
    reach = 1.7 * float(max(np.abs(found.feet[:, :2]).max(), np.abs(tip[:2]).max()))
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set_xlabel("right (m); areas are forces on the surface", fontsize=9)
    axes.set_ylabel("ahead (m)", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    if np.all(np.isfinite(asked.thrust)):
        text = "rotors: " + ", ".join(f"{t:.1f}" for t in asked.thrust) + " N"
        axes.text(0.5, 0.01, text, transform=axes.transAxes, ha="center", fontsize=8)
