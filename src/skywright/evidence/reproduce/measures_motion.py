"""Measures of Caballero 2018, section III: joint planning of platform and arms, and its optimality.

Nothing is flown. The scenarios are the fixed ones of the planners' benchmark.
"""

import math
import time

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.scenario import get_structures
from skywright.evidence.planning.jobs import HIGH, RESOLUTION, SCENARIOS, build_problem
from skywright.evidence.reproduce.figures import Bars, ClaimFigure, Curve, Panel
from skywright.evidence.reproduce.measured import Measured, Records
from skywright.planning.motion.angular import build_angular_map
from skywright.planning.motion.bound import choose_slices, compute_lower_bound
from skywright.planning.motion.decoupled import plan_decoupled
from skywright.planning.motion.passages import list_passages
from skywright.planning.motion.planner import check_state, plan_path, sample_reserve
from skywright.planning.motion.rrt_star import RrtStar, plan_rrt_star
from skywright.planning.motion.space import build_scratch

SEEDS = 3
SHORT_S = 0.5  # s of processor time for a plan, joint or decoupled
LONG_S = 10.0  # for the paper's RRT*


def measure_joint_planning(records: Records) -> Measured:
    """Share of scenarios solved by joint planning, and by planning the platform first."""
    names = [*SCENARIOS, HIGH]
    solved = np.zeros((len(names), 2))
    for i, name in enumerate(names):
        p = build_problem(name)
        for seed in range(SEEDS):
            joint = plan_path(
                p.space, p.start, p.goal, np.random.default_rng(seed), SHORT_S, first=True,
                clock=time.thread_time,
            )  # fmt: skip
            apart = plan_decoupled(
                p.space, p.start, p.goal, np.random.default_rng(seed), SHORT_S,
                clock=time.thread_time,
            )  # fmt: skip
            solved[i] += [len(joint.rows) > 0, len(apart.rows) > 0]
    share = solved / SEEDS
    frozen = share[: len(SCENARIOS)]
    values = {
        "joint": float(frozen[:, 0].mean()),
        "decoupled": float(frozen[:, 1].mean()),
        "decoupled_high": float(share[-1, 1]),
        "scenarios": float(len(SCENARIOS)),
    }
    bars = Bars(
        "Plans found", "share of the seeds", [n.replace("_", "\n") for n in names],
        ["platform and arms together", "platform first"], share,
    )  # fmt: skip
    caption = f"{SEEDS} seeds, {SHORT_S:g} s each. {HIGH}: the paper's without its ceiling."
    return Measured(values, ClaimFigure([bars], caption))


def measure_lower_gap(records: Records) -> Measured:
    """The second structure: width of each opening for the bar, and the path of the plan."""
    p = build_problem("paper")
    widths = {w.name: w for w in list_passages(p.world, p.space, 0.0, p.transport.margin)}
    # both openings relative to the bar, including those that the plan does not use
    needs = p.transport.bar_length + 2.0 * p.transport.margin
    path = plan_path(p.space, p.start, p.goal, np.random.default_rng(0), slices=2000)
    reserve, _ = sample_reserve(p.space, build_scratch(p.space), path.rows, RESOLUTION)
    values = {
        "upper": widths["upper gap"].opening / needs,
        "lower": widths["lower gap"].opening / needs,
        "reserve_mm": 1e3 * float(reserve),
        "upper_m": widths["upper gap"].opening,
        "lower_m": widths["lower gap"].opening,
        "needs_m": needs,
        "margin_m": p.transport.margin,
    }
    fine = _sample_rows(path.rows)
    scratch, bar = build_scratch(p.space), np.empty((len(fine), 2, 3))
    for ends, row in zip(bar, fine, strict=True):  # the bar is the last shape
        check_state(p.space, row, scratch)
        last = int(p.space[0]["ns"]) - 1
        ends[:] = scratch[0]["p0"][last], scratch[0]["p1"][last]
    tubes = get_structures(p.world).tubes
    at = tubes[p.world.passages["lower gap"].between[0]].x_m
    passes = bar[int(np.argmin(np.abs(bar[:, :, 0].mean(axis=1) - at)))]
    gap = np.array([np.nan, np.nan])  # separates the lines
    pipes = np.concatenate([
        [[tube.y_m, tube.z_m], [tube.to_y_m, tube.to_z_m], gap]
        for tube in tubes.values() if abs(tube.x_m - at) < 1e-6
    ])  # fmt: skip
    side = Panel(
        "The plan, from the side", "x (m)", "z (m)",
        [
            Curve("platform", path.rows[:, 0], path.rows[:, 1], "line+points"),
            Curve("bar", bar[:, 0, 0], bar[:, 0, 2]),
        ],
        equal=True,
    )  # fmt: skip
    ahead = Panel(
        "The second structure, seen along the way", "y (m)", "z (m)",
        [
            Curve("pipes' axes", pipes[:, 0], pipes[:, 1]),
            Curve("bar as it passes", passes[:, 1], passes[:, 2], "line+points"),
        ],
        equal=True,
    )  # fmt: skip
    caption = "The bar passes below the shelves; above them the posts are too close."
    return Measured(values, ClaimFigure([side, ahead], caption))


def _sample_rows(rows: Array) -> Array:
    """Interpolate configurations along a path, a few centimetres apart."""
    s = np.linspace(0.0, len(rows) - 1.0, 40 * len(rows))
    return np.column_stack([np.interp(s, np.arange(len(rows)), c) for c in rows.T])


def measure_optimality(records: Records) -> Measured:
    """Cost of the paper's RRT* over time, the lower bound, and the cost of the default planner."""
    p = build_problem("paper")
    world = build_angular_map(p.space)
    stars = [
        plan_rrt_star(
            p.space, world, p.start, p.goal, np.random.default_rng(seed), LONG_S,
            RrtStar(certified=True), clock=time.thread_time,
        )
        for seed in range(SEEDS)
    ]  # fmt: skip
    ours = plan_path(
        p.space, p.start, p.goal, np.random.default_rng(0), 2.0, clock=time.thread_time
    )
    bound = compute_lower_bound(p.space, p.start, p.goal, choose_slices(ours.rows))
    found = [s.cost for s in stars if math.isfinite(s.cost)]
    values = {
        "found": len(found) / SEEDS,
        "ours_gap": ours.cost / bound - 1.0,
        "bound_m": bound,
        "ours_m": ours.cost,
        "first_s": float(np.median([s.history[0, 0] for s in stars if len(s.history)] or [0.0])),
    }
    if found:
        values |= {"gap": max(found) / bound - 1.0, "cost_m": float(np.median(found))}
    curves = [
        Curve(f"RRT* of the paper, seed {i}", s.history[:, 0], s.history[:, 1])
        for i, s in enumerate(stars)
        if len(s.history)
    ]
    curves.append(Curve("default planner", ours.history[:, 0], ours.history[:, 1], "dashed"))
    panel = Panel("Cost (6) of the best path", "time (s)", "cost (m)", curves,
                  [(bound, "lower bound")], log_x=True)  # fmt: skip
    return Measured(values, ClaimFigure([panel], f"{LONG_S:g} s of processor time."))
