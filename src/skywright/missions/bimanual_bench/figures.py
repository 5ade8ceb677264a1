"""Figures of a report on trials on the bench: one per trial, and the hands over the run."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from skywright.description.world.things import list_movers
from skywright.missions.bimanual_bench.metrics import DRIFT, compute_bar_errors, compute_drift
from skywright.missions.bimanual_bench.plan import BenchPlan
from skywright.missions.bimanual_bench.task import BimanualBench
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    draw_limit,
    draw_line,
    draw_panels,
    draw_requirement,
    fit_y,
)
from skywright.run.kind import Chart, Figures
from skywright.run.result import RunResult

SIDES = (("left", BLUE), ("right", ORANGE))


def _start(
    result: RunResult[BimanualBench, BenchPlan],
    first: str,
    last: str,
    *panels: tuple[str, str],
) -> tuple[Figure, list[Any], Any] | None:
    """Return two panels over the phases from `first` to `last` and their samples, or None."""
    names = [p.name for p in result.phases]
    if first not in names or last not in names[names.index(first) :]:
        return None
    at = names.index(first)
    start, end = result.phases[at].start_s, result.phases[names.index(last, at)].end_s
    s = result.samples[(result.samples["t"] >= start) & (result.samples["t"] <= end)]
    if len(s) < 2:
        return None
    return *draw_panels(4.0, result.phases, s["t"], *panels), s


def _object(result: RunResult[BimanualBench, BenchPlan], name: str) -> int:
    return list_movers(result.description.world.things).index(name)


def draw_squeeze(result: RunResult[BimanualBench, BenchPlan]) -> Figure | None:
    """Draw the force of each hand on the box, and the box's height."""
    begun = _start(
        result, "squeeze", "lower",
        ("Squeeze force of each hand", "force (N)"),
        ("Height above the initial position", "height (mm)"),
    )  # fmt: skip
    if begun is None:
        return None
    figure, axes, s = begun
    wanted = float(result.description.mission.task.squeeze_n)
    for (side, color), sign in zip(SIDES, (-1.0, 1.0), strict=True):
        true = sign * s[f"{side}_f_W"][:, 1]
        draw_line(axes[0], s["t"], true, color=color, label=f"{side}, true")
        felt = sign * s[f"{side}_est_f_W"][:, 1]
        draw_line(axes[0], s["t"], felt, color=color, lw=0.7, ls=":", label=f"{side}, as estimated")
    axes[0].axhline(wanted, color=GREEN, lw=1.1, ls=":", label="asked for")
    axes[0].set_ylim(-0.2, 1.6 * wanted)
    axes[0].legend(loc="lower right", ncols=5)
    box = s[f"object{_object(result, result.description.mission.task.box)}_p_WO"][:, 2]
    hands = 0.5 * (s["left_p_WH"] + s["right_p_WH"])[:, 2]
    draw_line(axes[1], s["t"], 1e3 * (box - box[0]), color=GREEN, label="box")
    draw_line(axes[1], s["t"], 1e3 * (hands - hands[0]), color=BLACK, lw=0.8, label="hands")
    goal = 0.5 * (s["left_ref_p_WH"] + s["right_ref_p_WH"])[:, 2]
    draw_line(axes[1], s["t"], 1e3 * (goal - goal[-1]), color=GREEN, ls=":", label="asked for")
    axes[1].legend(loc="upper right", ncols=3)
    return figure


def draw_unplug(result: RunResult[BimanualBench, BenchPlan]) -> Figure | None:
    """Draw the motion of hands and plug since the grasp, the threshold of (33), and the forward
    force."""
    begun = _start(
        result, "pull", "unplugged",
        ("Displacement since the grasp", "distance (mm)"),
        ("Force of both hands together, backward", "force (N)"),
    )  # fmt: skip
    if begun is None:
        return None
    figure, axes, s = begun
    task = result.description.mission.task
    ways = []
    for side, color in SIDES:
        way = 1e3 * np.linalg.norm(s[f"{side}_est_p_WH"] - s[f"{side}_est_p_WH"][0], axis=1)
        ways.append(way)
        draw_line(axes[0], s["t"], way, color=color, label=f"{side} hand, as estimated")
    plug = s[f"object{_object(result, task.plug)}_p_WO"]
    moved = 1e3 * np.linalg.norm(plug - plug[0], axis=1)
    draw_line(axes[0], s["t"], moved, color=GREEN, label="plug")
    draw_limit(axes[0], 1e3 * task.unplug_threshold_m, "threshold of (33)")
    fit_y(axes[0], float(max(*ways[0], *ways[1], *moved)), low=0.0)
    axes[0].legend(loc="upper left", ncols=3)
    pull = -(s["left_f_W"] + s["right_f_W"])[:, 0]
    draw_line(axes[1], s["t"], pull, color=BLUE)
    held = result.description.world.things[task.plug].frees_at_n
    if held is not None:
        draw_limit(axes[1], held, "the socket holds")
    return figure


def draw_bar(result: RunResult[BimanualBench, BenchPlan]) -> Figure | None:
    """Draw the errors of the bar's centre and direction."""
    begun = _start(
        result, "lift bar", "lower bar",
        ("Distance of the bar's centre from its pose, (29)", "distance (mm)"),
        ("Angle of the bar to its pose, (30)", "angle (deg)"),
    )  # fmt: skip
    found = compute_bar_errors(result.samples, result.phases, result.description)
    if begun is None or found is None:
        return None
    figure, axes, s = begun
    near = np.isin(result.samples["t"], s["t"])
    for ax, values, name in (
        (axes[0], 1e3 * found.position[near], "bench.bar_position_mm"),
        (axes[1], np.degrees(found.direction[near]), "bench.bar_direction_deg"),
    ):
        draw_line(ax, s["t"], values, color=BLUE)
        limit = draw_requirement(ax, result, name, "limit {:g}")
        fit_y(ax, float(np.max(values)), limit or 0.0, low=0.0)
    return figure


def draw_drift(result: RunResult[BimanualBench, BenchPlan]) -> Figure | None:
    """Draw the base's drift, true and as measured by the arms."""
    begun = _start(
        result, "drift", "drift", ("Drift forward", "way (mm)"), ("Drift upward", "way (mm)")
    )
    found = compute_drift(result.samples, result.phases, result.description)
    if begun is None or found is None:
        return None
    figure, axes, _ = begun
    t = result.samples["t"][DRIFT.select(result.samples, result.phases)]
    for ax, axis in zip(axes, (0, 2), strict=True):
        draw_line(ax, t, 1e3 * found.true[:, axis], color=GREEN, lw=2.5, label="of the base")
        draw_line(
            ax, t, 1e3 * found.felt[:, axis], color=BLACK, lw=1.0, label="estimated by the arms"
        )
        fit_y(ax, *(1e3 * f(found.true[:, axis]) for f in (np.min, np.max)))
    axes[0].legend(loc="upper right", ncols=2)
    return figure


def draw_hands(result: RunResult[BimanualBench, BenchPlan]) -> Figure | None:
    """Draw the forces of the hands and the springs of an arm over the whole run."""
    s = result.samples
    if len(s) < 2:
        return None
    t = s["t"]
    figure, axes = draw_panels(
        4.4, result.phases, t,
        ("Force of each hand on what it touches", "force (N)"),
        ("Springs of the left arm", "deflection (deg)"),
    )  # fmt: skip
    for side, color in SIDES:
        force = np.linalg.norm(s[f"{side}_f_W"], axis=1)
        draw_line(axes[0], t, force, color=color, label=side)
    axes[0].set_ylim(0.0, 8.0)
    axes[0].legend(loc="upper left", ncols=2)
    for j, (name, color) in enumerate(
        zip(("pitch", "roll", "yaw", "elbow"), (BLUE, GREEN, ORANGE, PURPLE), strict=True)
    ):
        draw_line(axes[1], t, np.degrees(s["deflection"][:, j]), color=color, label=name)
    fit_y(axes[1], -35.0, 25.0)
    axes[1].legend(loc="upper left", ncols=4)
    return figure


def describe(result: RunResult[BimanualBench, BenchPlan]) -> str:
    """Return a sentence with the results of the trials."""
    d, found = result.description, result.metrics
    parts = {
        "bench.box_lift_m": ("held a box {:.0f} mm high", 1e3),
        "bench.unplug_delay_s": ("detected the release of a plug after {:.2f} s", 1.0),
        "bench.bar_position_mm": ("moved a bar with an error of {:.0f} mm", 1.0),
        "bench.drift_error_mm": ("estimated the drift of its base to {:.1f} mm", 1.0),
    }
    said = [text.format(scale * found[k]) for k, (text, scale) in parts.items() if k in found]
    trials = ", ".join(d.mission.task.trials)
    start = f"{d.robot.name} in world {d.world.name} tried {trials}"
    return start + (": its two hands " + "; ".join(said) if said else "")


FIGURES = Figures(
    describe,
    phases={
        "to *": "The clamp moves the robot to the next object.",
        "approach box": "The hands move to both sides of the box.",
        "squeeze": "Both hands press against the box with the requested force.",
        "lift": "The hands raise the box.",
        "hold box": "The hands hold the box at its height.",
        "lower": "The hands lower the box onto the bench.",
        "release": "The hands release the object and move apart.",
        "approach plug": "The hands move to both sides of the plug.",
        "grasp plug": "Both hands press against the plug.",
        "pull": "The hands pull the plug with increasing force.",
        "unplugged": "The arms detected the release of the plug and stop.",
        "stuck": "The plug did not come free.",
        "approach bar": "The hands move to the ends of the bar.",
        "hold bar": "Both hands hold the bar.",
        "lift bar": "The hands raise the bar.",
        "turn bar": "The hands turn the bar.",
        "bar forward": "The hands move the bar forward.",
        "lower bar": "The hands lower the bar.",
        "approach post": "The hands move to both sides of the post.",
        "grasp post": "Both hands press against the post.",
        "drift": "The clamp moves the base; the arms measure this motion.",
    },
    charts={
        "bench_squeeze": Chart(
            "A box between two hands",
            "The box is held by friction alone. Its weight deflects the springs of "
            "shoulder and elbow: hands and box first sag, then a slow loop raises them to "
            "the requested height.",
            draw_squeeze,
        ),
        "bench_unplug": Chart(
            "Release of a plug",
            "The release is detected from the displacement of the hands: beyond the "
            "threshold the plug must be out. The deflected springs then move the hands "
            "abruptly.",
            draw_unplug,
        ),
        "bench_bar": Chart(
            "Motion of a bar",
            "The bar follows both hands. Each pose is evaluated in its last second.",
            draw_bar,
        ),
        "bench_drift": Chart(
            "Arms as position sensors of the base",
            "The hands hold a fixed post, so the joint angles measure the motion of the base.",
            draw_drift,
        ),
        "bench_hands": Chart(
            "The whole run",
            "Bands are phases.",
            draw_hands,
        ),
    },
)
