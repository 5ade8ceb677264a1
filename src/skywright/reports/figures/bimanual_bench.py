"""What a report shows of trials on the bench: forces of the hands, things, and what was felt."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from skywright.reports.figures.style import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    WIDTH,
    clip_phases,
    draw_line,
    new_figure,
    shade_phases,
    stack_panels,
)

if TYPE_CHECKING:
    from skywright.evaluation.run import RunResult


def draw_trials(result: RunResult) -> Figure | None:
    """Hands' forces, hands against their references, and the things' motion."""
    s = result.samples
    if len(s) < 2:
        return None
    t = s["t"]
    figure = new_figure(WIDTH, 6.6)
    strip, axes = stack_panels(figure, 4)
    shade_phases(strip, axes, clip_phases(result.phases, float(t[0]), float(t[-1])))
    axes[0].set_title("Force of each hand on what it touches")
    axes[0].set_ylabel("force (N)")
    for side, color in (("left", BLUE), ("right", ORANGE)):
        force = np.linalg.norm(s[f"{side}_f_W"], axis=1)
        draw_line(axes[0], t, force, color=color, label=f"{side}, true")
        felt = np.linalg.norm(s[f"{side}_est_f_W"], axis=1)
        draw_line(axes[0], t, felt, color=color, lw=0.6, ls=":", label=f"{side}, estimated")
    axes[0].set_ylim(0.0, 12.0)
    axes[0].legend(loc="upper left", ncols=4)
    axes[1].set_title("Distance of each hand from its reference")
    axes[1].set_ylabel("distance (mm)")
    for side, color in (("left", BLUE), ("right", ORANGE)):
        error = 1e3 * np.linalg.norm(s[f"{side}_p_WH"] - s[f"{side}_ref_p_WH"], axis=1)
        draw_line(axes[1], t, np.minimum(error, 200.0), color=color, label=side)
    axes[1].legend(loc="upper left", ncols=2)
    axes[2].set_title("How far each thing was moved")
    axes[2].set_ylabel("distance (mm)")
    for i, (name, color) in enumerate(
        zip(result.description.world.objects, (GREEN, PURPLE, ORANGE, BLUE), strict=False)
    ):
        way = s[f"object{i}_p_WO"] - s[f"object{i}_p_WO"][0]
        draw_line(axes[2], t, 1e3 * np.linalg.norm(way, axis=1), color=color, label=name)
    axes[2].legend(loc="upper left", ncols=4)
    axes[3].set_title("Springs of the left arm")
    axes[3].set_ylabel("deflection (deg)")
    for j, (name, color) in enumerate(
        zip(("pitch", "roll", "yaw", "elbow"), (BLUE, GREEN, ORANGE, PURPLE), strict=True)
    ):
        draw_line(axes[3], t, np.degrees(s["deflection"][:, j]), color=color, label=name)
    axes[3].legend(loc="upper left", ncols=4)
    return figure


FIGURES: dict[str, Callable[[RunResult], Figure | None]] = {"bench_trials": draw_trials}
CAPTIONS = {
    "bench_trials": (
        "The trials",
        "Bands are phases. A thing that is carried moves with the hands; what was only pressed "
        "stays at zero.",
    ),
}


def describe(result: RunResult) -> str:
    """Say which trials were made."""
    d = result.description
    trials = ", ".join(getattr(d.mission, "task").trials)  # noqa: B009
    return f"{d.robot.name} in world {d.world.name} tried: {trials}"
