"""Draw the frames and the pipe's coordinates for the documentation.

    python docs/draw_conventions.py     (or: make pictures)

writes docs/images/frames.svg and docs/images/pipe-coordinates.svg.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Circle, Polygon, Rectangle

IMAGES = Path(__file__).parent / "images"
RADIUS_M, LENGTH_M = 0.2, 0.5  # the default pipe
ARC_DEG, PASS_M = 40.0, 0.2  # the default raster
WELD_DEG, WELD_OFFSET_M = 25.0, 0.03  # steeper than the default (10 deg), to show the sign
STEEL, WELD, PATH, AXIS = "#d9dde2", "#c0392b", "#1f6fb2", "#333333"


def _arrow(ax, start, end, text="", offset=(0.0, 0.0), colour=AXIS, **kwargs) -> None:
    ax.annotate(
        "", xy=end, xytext=start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4}
    )
    if text:
        ax.text(end[0] + offset[0], end[1] + offset[1], text, color=colour, **kwargs)


def _out_of_page(ax, centre, radius, colour) -> None:
    """A vector towards the reader."""
    ax.add_patch(Circle(centre, radius, fill=False, ec=colour, lw=1.2))
    ax.add_patch(Circle(centre, radius / 4, color=colour))


def _into_page(ax, centre, radius, colour) -> None:
    """A vector away from the reader."""
    ax.add_patch(Circle(centre, radius, fc="white", ec=colour, lw=1.2))
    d = radius * np.sqrt(0.5)
    for sign in (-1, 1):
        ax.plot(
            [centre[0] - d, centre[0] + d],
            [centre[1] - sign * d, centre[1] + sign * d],
            color=colour,
            lw=1.2,
        )


def draw_end_view(ax) -> None:
    """The pipe seen along its axis: phi."""
    ax.set_title("Pipe seen along its axis (y$_P$ points away from you)")
    ax.add_patch(Circle((0, 0), RADIUS_M, fc=STEEL, ec=AXIS, lw=1.5))
    _arrow(ax, (0, 0), (0.31, 0), "x$_P$", (0.005, -0.008))
    _arrow(ax, (0, 0), (0, 0.30), "z$_P$ (up)", (0.01, -0.01))
    _into_page(ax, (0, 0), 0.014, AXIS)
    ax.text(0, -0.05, "y$_P$: the axis, s", color=AXIS, ha="center")

    ax.plot([0, -RADIUS_M - 0.06], [0, 0], color=AXIS, lw=1, ls="--")
    ax.text(-RADIUS_M - 0.075, 0, "φ = 0\nfaces −x$_P$", ha="right", va="center", color=AXIS)
    phi = np.radians(35)
    point = RADIUS_M * np.array([-np.cos(phi), np.sin(phi)])
    ax.plot([0, point[0]], [0, point[1]], color=PATH, lw=1.2)
    ax.add_patch(Arc((0, 0), 0.2, 0.2, theta1=180 - 35, theta2=180, color=PATH, lw=1.6))
    _arrow(ax, (-0.0875, 0.049), (-0.0805, 0.0595), colour=PATH)
    ax.text(-0.145, 0.032, "φ", color=PATH, fontsize=13)
    _arrow(ax, point, point * 1.45, "outward normal (z$_S$)", (-0.13, 0.015), colour=PATH)
    half = np.radians(ARC_DEG / 2)
    sector = np.linspace(-half, half, 40)
    ax.plot(
        -1.03 * RADIUS_M * np.cos(sector),
        1.03 * RADIUS_M * np.sin(sector),
        color=WELD,
        lw=4,
        alpha=0.5,
        solid_capstyle="butt",
    )
    ax.text(
        -0.06,
        -0.265,
        "thick line: the sector that the default raster scans\n"
        f'(side = "side", arc_deg = {ARC_DEG:.0f})',
        ha="center",
        va="top",
        color=WELD,
    )
    ax.text(0.11, 0.20, "φ = 90° at the top", color=AXIS)
    ax.set_xlim(-0.45, 0.4)
    ax.set_ylim(-0.35, 0.36)
    ax.set_aspect("equal")
    ax.axis("off")


def draw_unrolled(ax) -> None:
    """The unrolled surface: s, c = R phi, the weld's angle, the raster."""
    ax.set_title("Unrolled surface: s along the axis, c = R φ around the pipe")
    half_c = 0.16
    ax.add_patch(Rectangle((-LENGTH_M / 2, -half_c), LENGTH_M, 2 * half_c, fc=STEEL, ec="none"))

    edge = RADIUS_M * np.radians(ARC_DEG / 2)
    levels = np.linspace(-edge, edge, 4)
    path = []
    for i, c in enumerate(levels):
        ends = (-PASS_M / 2, PASS_M / 2) if i % 2 == 0 else (PASS_M / 2, -PASS_M / 2)
        path += [(ends[0], c), (ends[1], c)]
    xs, ys = np.array(path).T
    ax.plot(xs, ys, color=PATH, lw=1.6, marker="o", ms=4, label="raster: 4 axial passes, 8 corners")

    c = np.linspace(-half_c, half_c, 50)
    s = WELD_OFFSET_M + RADIUS_M * np.tan(np.radians(WELD_DEG)) * np.sin(c / RADIUS_M)
    ax.plot(s, c, color=WELD, lw=3, label="weld: s = offset + R tan(angle) sin φ")
    crossings = np.interp(levels, c, s)
    ax.plot(
        crossings,
        levels,
        ls="none",
        marker="o",
        mfc="none",
        mec=WELD,
        mew=1.6,
        ms=9,
        label="crossings",
    )

    ax.axhline(0, color=AXIS, lw=0.8, ls="--")
    ax.plot([WELD_OFFSET_M] * 2, [0, half_c], color=AXIS, lw=1, ls=":")
    ax.add_patch(
        Arc((WELD_OFFSET_M, 0), 0.2, 0.2, theta1=90 - WELD_DEG, theta2=90, color=AXIS, lw=1.6)
    )
    ax.text(WELD_OFFSET_M + 0.022, 0.112, "angle", ha="center")
    ax.annotate(
        "",
        xy=(WELD_OFFSET_M, -0.012),
        xytext=(0, -0.012),
        arrowprops={"arrowstyle": "|-|, widthA=0.25, widthB=0.25", "color": AXIS},
    )
    ax.annotate(
        "offset",
        xy=(WELD_OFFSET_M / 2, -0.012),
        xytext=(-0.235, -0.047),
        arrowprops={"arrowstyle": "-", "color": AXIS, "lw": 0.7},
        va="center",
    )
    ax.text(-0.245, 0.004, "φ = 0")
    ax.set_xlabel("s  (m, along the axis)")
    ax.set_ylabel("c = R φ  (m, towards the top)")
    ax.set_xlim(-LENGTH_M / 2, LENGTH_M / 2)
    ax.set_ylim(-half_c, half_c)
    ax.set_aspect("equal")
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.16),
        ncol=3,
        frameon=False,
        fontsize=9,
        columnspacing=1.2,
        handlelength=1.6,
    )


def draw_frames(ax) -> None:
    """Side view of robot and pipe with the frames W, B, A, T, S."""
    ax.set_title("Frames, seen from the robot's right side (y points away from you)")
    ax.plot([-0.9, 2.6], [0, 0], color=AXIS, lw=1.5)
    ax.fill_between([-0.9, 2.6], [-0.06, -0.06], [0, 0], color="#e8e4dc")
    pipe = np.array([1.95, 1.45])
    for x in (1.93, 1.97):
        ax.plot([x, x], [0, pipe[1] - RADIUS_M], color="#9aa3ad", lw=1.5)
    ax.add_patch(Circle((pipe[0], pipe[1]), RADIUS_M, fc=STEEL, ec=AXIS, lw=1.5))
    ax.text(pipe[0] + 0.02, pipe[1] - 0.12, "pipe", ha="center")
    ax.text(pipe[0] + 0.06, 0.6, "support")

    size = 0.26
    body = np.array([0.75, 1.32])
    ax.add_patch(
        Polygon(
            body + [[-0.18, -0.04], [0.18, -0.04], [0.12, 0.04], [-0.12, 0.04]],
            fc="#566573",
            ec="none",
        )
    )
    for x in (-0.43, 0.43):  # rotors, tilted
        ax.plot([body[0], body[0] + x], [body[1] + 0.02] * 2, color="#566573", lw=3)
        tilt = 0.035 * np.sign(x)
        ax.plot(
            [body[0] + x - 0.16, body[0] + x + 0.16],
            [body[1] + 0.06 - tilt, body[1] + 0.06 + tilt],
            color="#7f8c8d",
            lw=4,
            alpha=0.6,
        )
    for x in (-0.2, 0.2):
        ax.plot(
            [body[0] + x / 2, body[0] + x], [body[1] - 0.03, body[1] - 0.3], color="#566573", lw=2
        )
    arm = np.array([body + [0.0, -0.09], body + [0.27, -0.2], body + [0.5, 0.0]])
    tip = pipe - [RADIUS_M, 0.0]
    holder = tip - [0.13, 0.0]
    arm[2] = holder
    arm[1] = body + [0.36, -0.2]
    ax.plot(*arm.T, color="#2c3e50", lw=4, solid_capstyle="round")
    ax.plot([holder[0], tip[0]], [holder[1], tip[1]], color="#e67e22", lw=5, solid_capstyle="butt")
    ax.text(holder[0] - 0.02, holder[1] - 0.15, "probe", color="#e67e22")

    def frame(origin, x, z, name, colour, at) -> None:
        x, z = np.array(x) * size, np.array(z) * size
        _arrow(ax, origin, origin + x, colour=colour)
        _arrow(ax, origin, origin + z, colour=colour)
        for tipped, label in ((x, f"x$_{name}$"), (z, f"z$_{name}$")):
            if np.any(tipped):
                where = origin + 1.24 * tipped
                ax.text(*where, label, color=colour, ha="center", va="center")
        ax.text(
            *(origin + at),
            name,
            color=colour,
            fontsize=14,
            fontweight="bold",
            ha="center",
            va="center",
        )

    frame(np.array([-0.6, 0.14]), (1, 0), (0, 1), "W", AXIS, (-0.1, 0.12))
    frame(body, (1.25, 0), (0, 1.25), "B", PATH, (-0.09, 0.12))
    ax.add_patch(Circle(arm[0], 0.03, color="#7d3c98"))
    ax.text(
        arm[0][0] - 0.02,
        arm[0][1] - 0.16,
        "A",
        color="#7d3c98",
        fontsize=14,
        fontweight="bold",
        ha="center",
    )
    ax.text(
        0.62,
        2.02,
        "tip T: z$_T$ along the probe, out of the robot\n(into the surface)",
        color="#117a65",
        ha="left",
    )
    _arrow(ax, tip, tip + [0.34, 0.0], colour="#117a65")
    ax.text(tip[0] + 0.2, tip[1] + 0.05, "z$_T$", color="#117a65", ha="center")
    ax.plot([1.2, tip[0]], [2.0, tip[1]], color="#117a65", lw=0.7, ls=":")
    _arrow(ax, tip, tip + [-0.34, 0.0], colour=WELD)
    ax.text(tip[0] - 0.3, tip[1] + 0.07, "z$_S$", color=WELD, ha="center")
    ax.text(2.12, 1.78, "surface S:\nz$_S$ = outward normal,\nx$_S$ along the axis", color=WELD)
    ax.plot([2.1, tip[0]], [1.8, tip[1]], color=WELD, lw=0.7, ls=":")
    ax.text(
        -0.85,
        1.85,
        "W  world: z up, ground at z = 0\nB  body: x forward, y left, z up\n"
        "A  arm base\nT  tip    S  surface",
        va="bottom",
        color=AXIS,
    )
    ax.set_xlim(-0.95, 2.95)
    ax.set_ylim(-0.1, 2.45)
    ax.set_aspect("equal")
    ax.axis("off")


def main() -> None:
    # Fixed names inside the file, so that a redraw without a change is no difference in git.
    plt.rcParams.update({"svg.hashsalt": "skywright", "font.size": 10})
    IMAGES.mkdir(exist_ok=True)

    figure, axes = plt.subplots(1, 2, figsize=(12, 5), width_ratios=(1, 1.25))
    draw_end_view(axes[0])
    draw_unrolled(axes[1])
    figure.tight_layout()
    figure.savefig(IMAGES / "pipe-coordinates.svg", metadata={"Date": None})

    figure, ax = plt.subplots(figsize=(10, 6.4))
    draw_frames(ax)
    figure.tight_layout()
    figure.savefig(IMAGES / "frames.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
