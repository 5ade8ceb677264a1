"""Figures of a report on a bar's insertion: the peg's depth, lateral error and force."""

import numpy as np
from matplotlib.figure import Figure

from skywright.missions.bar_insertion.metrics import compute_peg_way
from skywright.missions.bar_insertion.plan import InsertionPlan
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.models.things.peg import Peg
from skywright.models.things.socket import Socket
from skywright.reports.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    draw_limit,
    draw_line,
    draw_panels,
)
from skywright.run.kind import Chart, Figures
from skywright.run.result import RunResult

SHOWN = ("align", "lower", "insert", "draw out", "set free", "release")


def draw_insertion(result: RunResult[BarInsertion, InsertionPlan]) -> Figure | None:
    """Draw depth, error across the hole, force and angles, from above the socket to the release."""
    s, d = result.samples, result.description
    spans = [p for p in result.phases if p.name in SHOWN]
    if not spans:
        return None
    peg = d.world.find_thing(d.mission.task.bar, Peg)
    socket = d.world.find_thing(d.mission.task.socket, Socket)
    s = s[(s["t"] >= spans[0].start_s) & (s["t"] <= spans[-1].end_s)]
    if not len(s):
        return None
    t, way = s["t"], compute_peg_way(s, d)
    figure, axes = draw_panels(
        7.4, result.phases, t,
        ("Peg's end below the socket's face", "depth (mm)"),
        ("Peg's end beside the hole's axis, in the hole's frame", "error (mm)"),
        ("True force of the peg on the socket, without inertia", "force (N)"),
        ("Angles between peg and hole", "angle (deg)"),
    )  # fmt: skip
    draw_line(axes[0], t, -1e3 * way.tip_S[:, 2], color=BLACK)
    draw_limit(axes[0], 1e3 * peg.length_m, "flange on the socket")
    axes[0].set_ylim(-40.0, 1.25e3 * peg.length_m)
    free = 0.5e3 * (socket.hole_m - peg.side_m)
    reach = free + 1e3 * socket.chamfer_m
    axes[1].axhspan(
        -reach, reach, color=ORANGE, alpha=0.12, lw=0, label=f"chamfer, ±{reach:.3g} mm"
    )
    axes[1].axhspan(-free, free, color=GREEN, alpha=0.25, lw=0, label=f"clearance, ±{free:.3g} mm")
    for a, color in ((0, BLUE), (1, PURPLE)):
        draw_line(axes[1], t, 1e3 * way.tip_S[:, a], color=color, label="xy"[a])
    axes[1].set_ylim(-3.0 * reach, 3.0 * reach)
    axes[1].legend(loc="upper right", ncols=4)
    down, across = -way.f_W[:, 2], np.linalg.norm(way.f_W[:, :2], axis=1)
    draw_line(axes[2], t, down, color=BLACK, label="down")
    draw_line(axes[2], t, across, color=ORANGE, label="across")
    draw_limit(axes[2], peg.mass_kg * d.world.gravity_mps2, "the bar's weight")
    axes[2].legend(loc="upper left", ncols=2)
    draw_line(axes[3], t, np.degrees(way.tilt), color=BLUE, label="tilt of the axes")
    draw_line(axes[3], t, np.degrees(way.turn), color=GREEN, label="about the hole's axis")
    axes[3].legend(loc="upper right", ncols=2)
    return figure


PHASES = {
    "approach rack": "The arms lower the hooks; the platform flies behind the rack.",
    "survey": "Motion capture measures the true pose of the socket.",
    "reach under": "Platform and hooks move below the crossbar.",
    "grasp": "The hooks rise until both detect the crossbar.",
    "lift": "The platform rises until the arms carry the weight of the bar.",
    "carry": "The robot carries the bar to a position above the socket.",
    "align": "The platform positions the peg above the hole; the arms align the bar with it.",
    "lower": "The peg is lowered until it enters the hole or rests beside it.",
    "insert": "The hands reduce their support so that the weight of the bar inserts the peg.",
    "draw out": "The peg was not inserted; the bar is raised for another try.",
    "set free": "The weight is transferred from the hands to the socket.",
    "release": "The hooks are withdrawn from the crossbar.",
    "carry back": "No try succeeded; the robot returns the bar to the rack.",
    "lay down": "The bar is placed into the rack.",
    "look again": "The grasp failed; the pose of the bar is measured again.",
    "lift arms": "The arms fold above the landing gear.",
}


def describe(result: RunResult[BarInsertion, InsertionPlan]) -> str:
    """Return a sentence that states whether the peg was inserted."""
    d = result.description
    did = f"{d.robot.name} in world {d.world.name} "
    tries, task = int(result.metrics.get("insert.tries", 0.0)), d.mission.task
    if result.metrics.get("insert.done") != 1.0:
        return did + f"did not insert the peg ({tries} tries)"
    often = "in the first try" if tries == 1 else f"in {tries} tries"
    hole = d.world.find_thing(task.socket, Socket).hole_m
    play = 1e3 * (hole - d.world.find_thing(task.bar, Peg).side_m)
    return did + f"inserted the peg into a hole {play:.3g} mm wider, {often}"


FIGURES = Figures(
    describe,
    charts={
        "bar_insertion": Chart(
            "The peg and the hole",
            "Depth of the peg, lateral distance of its end from the hole (green: "
            "clearance on each side; orange: range of the chamfer), contact force, and "
            "angles between peg and hole. All quantities refer to the true socket.",
            draw_insertion,
        ),
    },
    phases=PHASES,
)
