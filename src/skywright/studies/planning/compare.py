"""The default planner against OMPL's and the paper's on the frozen scenarios, as benchmark rows.

All times are processor time of the planning thread: a busy machine slows wall clocks, not these.
"""

from __future__ import annotations

import importlib.util
import math
import statistics
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.planning.motion.angular import build_angular_map
from skywright.planning.motion.bound import choose_slices, compute_lower_bound
from skywright.planning.motion.decoupled import plan_decoupled
from skywright.planning.motion.planner import Path, plan_path, sample_reserve
from skywright.planning.motion.rrt_star import RrtStar, plan_rrt_star
from skywright.planning.motion.space import build_scratch
from skywright.planning.motion.transport import (
    BENCHMARK,
    TransportProblem,
    build_scenario,
    build_transport,
)
from skywright.robots.loader import load_robot
from skywright.studies.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.worlds.loader import load_world

Array = NDArray[np.float64]

SCENARIOS: dict[str, tuple[int | None, float]] = {
    "paper": (None, 0.0),
    **{f"draw{seed}": (seed, difficulty) for seed, difficulty in BENCHMARK},
}
EARLY_S, LATE_S = 0.2, 5.0
RESOLUTION = 1e-3  # m of cost (6), between the samples that look for violated margins


class Effort(NamedTuple):
    """How much is measured."""

    scenarios: Sequence[str]
    seeds: int
    late_s: float
    star_s: float  # of OMPL's RRT* and Informed RRT*
    success_seeds: int


def measure_planners(session: Session) -> list[Row]:
    """Measure the scenarios of the session's effort."""
    effort = session.pick(
        Effort(["paper"], 1, 0.3, 0.3, 2),
        Effort(["paper", "draw4", "draw7"], 1, 2.0, 5.0, 5),
        Effort([*SCENARIOS], 5, LATE_S, 30.0, 20),
    )
    rows = []
    for name in effort.scenarios:
        rows += measure_scenario(name, effort)
    return [*rows, *measure_decoupled(session.pick(["paper"], [*SCENARIOS], [*SCENARIOS]), 0.4)]


def build_problem(name: str) -> TransportProblem:
    """Build one of `SCENARIOS`."""
    world = build_scenario(load_world("pipe-structures")[0], *SCENARIOS[name])
    return build_transport(load_robot("ars-lrm")[0], world)


def cost_at(path_history: Array | Sequence[tuple[float, float]], when: float) -> float:
    """Cost of the best path that was known at a time (s); inf before the first."""
    return min((float(c) for t, c in path_history if t <= when), default=math.inf)


def _plan(problem: TransportProblem, seed: int, time_s: float) -> Path:
    return plan_path(
        problem.space, problem.start, problem.goal, np.random.default_rng(seed), time_s,
        clock=time.thread_time,
    )  # fmt: skip


def measure_scenario(name: str, effort: Effort) -> list[Row]:
    """Measure one scenario: our planner, the references, and the lower bound."""
    problem = build_problem(name)
    space = problem.space
    _plan(problem, 0, 0.05)  # loads compiled code
    ours = [_plan(problem, seed, effort.late_s) for seed in range(effort.seeds)]
    early = statistics.median(cost_at(p.history, EARLY_S) for p in ours)
    late = statistics.median(p.cost for p in ours)
    quick = [_plan(problem, 100 + seed, 1.0) for seed in range(effort.success_seeds)]
    found = [math.isfinite(p.cost) for p in quick]
    first = [p.first_s for p in (*ours, *quick) if math.isfinite(p.first_s)]
    rows = [
        build_row(f"{name}_success_1s", float(np.mean(found)), limit=0.95, sense=">=",
                  note=f"of {len(found)} seeds, a path within 1 s"),
    ]  # fmt: skip
    if not first or not math.isfinite(late):
        return [*rows, build_unmeasured_row(f"{name}_cost", "no path found", failed=True)]
    reserve = min(sample_reserve(space, build_scratch(space), p.rows, RESOLUTION)[0] for p in ours)
    best = min(ours, key=lambda p: p.cost)
    bound = compute_lower_bound(space, problem.start, problem.goal, choose_slices(best.rows))
    gap = 100.0 * (late / bound - 1.0)
    rows += [
        build_row(f"{name}_first_ms", [1e3 * t for t in first], "ms", limit=5.0),
        build_row(f"{name}_cost", late, "m", note=f"after {effort.late_s:g} s"),
        build_row(f"{name}_reserve_mm", 1e3 * reserve, "mm", limit=0.0, sense=">=",
                  note="smallest clearance beyond the margins, at 1 mm resolution"),
        build_row(f"{name}_gap_to_lower_bound_percent", gap, "%",
                  limit=2.0 if name == "paper" else None, note=f"bound {bound:.4f}"),
    ]  # fmt: skip
    return rows + _measure_references(name, problem, effort, early, late)


def _measure_references(
    name: str, problem: TransportProblem, effort: Effort, early: float, late: float
) -> list[Row]:
    space, start, goal = problem.space, problem.start, problem.goal
    papers = [
        plan_rrt_star(
            space, build_angular_map(space), start, goal, np.random.default_rng(seed),
            effort.late_s, RrtStar(certified=True), clock=time.thread_time,
        ).cost
        for seed in range(effort.seeds)
    ]  # fmt: skip
    rows = [
        _compare(
            f"{name}_over_paper_rrt_star", late, papers, 1.0,
            f"both after {effort.late_s:g} s, both with certified edges",
        )
    ]  # fmt: skip
    if importlib.util.find_spec("ompl") is None:
        why = "the package ompl is not installed (extra dev)"
        return [*rows, build_unmeasured_row(f"{name}_over_ompl", why)]
    from skywright.studies.planning.ompl_planners import run_connect, run_planner

    for planner in ("RRTstar", "InformedRRTstar"):
        costs = [
            cost_at(run_planner(planner, space, start, goal, effort.star_s).history, math.inf)
            for _ in range(effort.seeds)
        ]
        note = f"ours after {EARLY_S:g} s, theirs after {effort.star_s:g} s"
        rows.append(_compare(f"{name}_over_ompl_{planner.lower()}", early, costs, 1.0, note))
    costs = [
        cost_at(run_connect(space, start, goal, effort.late_s).history, math.inf)
        for _ in range(effort.seeds)
    ]
    limit = 0.99 if name == "paper" else 1.0
    note = f"both after {effort.late_s:g} s; theirs restarted and simplified until then"
    rows.append(_compare(f"{name}_over_ompl_rrtconnect", late, costs, limit, note))
    return rows


def _compare(row: str, ours: float, theirs: list[float], limit: float, note: str) -> Row:
    """Row of our cost over the median of theirs; a reference without a path is told."""
    their = statistics.median(theirs)
    if not math.isfinite(their):
        return build_unmeasured_row(row, f"the reference found no path; ours {ours:.3f}; {note}")
    return build_row(row, ours / their, limit=limit, note=f"{ours:.3f} over {their:.3f}; {note}")


def measure_decoupled(names: Sequence[str], time_s: float) -> list[Row]:
    """Joint against decoupled planning (platform first, arms after) with the same time."""
    rows = []
    for name in names:
        problem = build_problem(name)
        joint = _plan(problem, 1, time_s)
        apart = plan_decoupled(
            problem.space, problem.start, problem.goal, np.random.default_rng(1), time_s,
            clock=time.thread_time,
        )  # fmt: skip
        note = f"joint {joint.cost:.3f}, decoupled "
        note += f"{apart.cost:.3f}" if math.isfinite(apart.cost) else f"fails: {apart.reason}"
        if math.isfinite(apart.cost) and math.isfinite(joint.cost):
            rows.append(
                build_row(f"{name}_joint_over_decoupled", joint.cost / apart.cost, note=note)
            )
        else:
            rows.append(build_unmeasured_row(f"{name}_joint_over_decoupled", note))
    return rows
