"""The comparison as small jobs for several processes; a folder may keep finished ones.

A job is one planner on one scenario with all its seeds. All times are processor times of the
planning thread, which a busy machine does not change.
"""

import hashlib
import json
import math
import multiprocessing
import re
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.threads import on_one_thread
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.planning.motion import planner
from skywright.planning.motion.angular import build_angular_map
from skywright.planning.motion.bound import choose_slices, compute_lower_bound
from skywright.planning.motion.decoupled import plan_decoupled
from skywright.planning.motion.planner import Path as PlannedPath
from skywright.planning.motion.planner import plan_path, sample_reserve
from skywright.planning.motion.rrt_star import RrtStar, plan_rrt_star
from skywright.planning.motion.space import build_scratch
from skywright.planning.motion.transport import (
    BENCHMARK,
    TransportProblem,
    build_scenario,
    build_transport,
)

SCENARIOS: dict[str, tuple[int | None, float]] = {
    "paper": (None, 0.0),
    **{f"draw{seed}": (seed, difficulty) for seed, difficulty in BENCHMARK},
}
HIGH = "paper_high"
"""The paper's scenario without its ceiling, which decoupled planning of platform and arms can
solve."""
HIGH_M = 6.0  # m, height of its area
EARLY_S = 0.2
CURVE_S = tuple(1e-3 * 10.0 ** (k / 10) for k in range(46))  # 1 ms to 32 s
"""Times at which the cost of the best path is recorded, for the plot of cost against time."""
RESOLUTION = 1e-3  # m of cost (6), between samples for the check of the margins
OURS, SUCCESS, PAPER, DECOUPLED = "ours", "success", "paper_rrt_star", "decoupled"
OMPL = ("RRTstar", "InformedRRTstar", "RRTConnect")


class Effort(NamedTuple):
    """Amount of work of a comparison."""

    scenarios: tuple[str, ...]
    decoupled: tuple[str, ...]
    seeds: int
    late_s: float
    star_s: float  # OMPL's RRT* and Informed RRT*, and the paper's planner on its own scenario
    success_seeds: int
    decoupled_s: float


class Job(NamedTuple):
    """One planner on one scenario."""

    scenario: str
    what: str


def list_jobs(effort: Effort, with_ompl: bool) -> list[Job]:
    """Return all jobs of an effort by scenario, the longest first within each."""
    kinds = [*(OMPL if with_ompl else ()), OURS, PAPER, SUCCESS]
    jobs = [Job(name, what) for name in effort.scenarios for what in kinds]
    return [*jobs, *(Job(name, DECOUPLED) for name in effort.decoupled)]


def build_problem(name: str) -> TransportProblem:
    """Build one of `SCENARIOS`, or `HIGH`."""
    world = load_world("pipe-structures")[0]
    if name == HIGH:
        assert world.area is not None
        area = world.area.model_copy(update={"z_max_m": HIGH_M})
        world = world.model_copy(update={"area": area})
    else:
        world = build_scenario(world, *SCENARIOS[name])
    return build_transport(load_robot("ars-lrm")[0], world)


def cost_at(history: Array | Sequence[tuple[float, float]], when: float) -> float:
    """Return the cost of the best path known at a time (s); inf before the first."""
    return min((float(c) for t, c in history if t <= when), default=math.inf)


def _curve(history: Array | Sequence[tuple[float, float]], end_s: float) -> list[float]:
    return [cost_at(history, t) for t in CURVE_S if t <= end_s]


def _plan(problem: TransportProblem, seed: int, time_s: float) -> PlannedPath:
    return plan_path(
        problem.space, problem.start, problem.goal, np.random.default_rng(seed), time_s,
        clock=time.thread_time,
    )  # fmt: skip


@on_one_thread
def run_job(job: Job, effort: Effort) -> dict[str, Any]:
    """Run one job; return lists over the seeds, with inf if no path was found."""
    problem = build_problem(job.scenario)
    space, start, goal = problem.space, problem.start, problem.goal
    if job.what == OURS:
        _plan(problem, 0, 0.05)  # loads the compiled code
        paths = [_plan(problem, seed, effort.late_s) for seed in range(effort.seeds)]
        scratch, best = build_scratch(space), min(paths, key=lambda p: p.cost)
        found = {
            "early": [cost_at(p.history, EARLY_S) for p in paths],
            "late": [p.cost for p in paths],
            "first_s": [p.first_s for p in paths],
            "curve": [_curve(p.history, effort.late_s) for p in paths],
        }
        if math.isfinite(best.cost):
            found["reserve"] = [
                sample_reserve(space, scratch, p.rows, RESOLUTION)[0] for p in paths if len(p.rows)
            ]
            found["bound"] = [compute_lower_bound(space, start, goal, choose_slices(best.rows))]
        return found
    if job.what == SUCCESS:
        _plan(problem, 0, 0.05)
        paths = [_plan(problem, 100 + seed, 1.0) for seed in range(effort.success_seeds)]
        return {"cost": [p.cost for p in paths], "first_s": [p.first_s for p in paths]}
    if job.what == PAPER:
        world, settings = build_angular_map(space), RrtStar(certified=True)
        end_s = effort.star_s if job.scenario == "paper" else effort.late_s
        stars = [
            plan_rrt_star(
                space, world, start, goal, np.random.default_rng(seed), end_s, settings,
                clock=time.thread_time,
            )
            for seed in range(effort.seeds)
        ]  # fmt: skip
        return {
            "cost": [cost_at(s.history, effort.late_s) for s in stars],
            "curve": [_curve(s.history, end_s) for s in stars],
        }
    if job.what == DECOUPLED:
        _plan(problem, 0, 0.05)
        seeds, clock, seconds = range(effort.seeds), time.thread_time, effort.decoupled_s
        apart = [
            plan_decoupled(space, start, goal, np.random.default_rng(seed), seconds, clock=clock)
            for seed in seeds
        ]
        return {
            "joint": [_plan(problem, seed, seconds).cost for seed in seeds],
            "cost": [a.cost for a in apart],
            "reason": next((a.reason for a in apart if a.reason), ""),
        }
    from skywright.evidence.planning.ompl_planners import run_connect, run_planner

    end_s = effort.late_s if job.what == "RRTConnect" else effort.star_s
    traces = [
        run_connect(space, start, goal, end_s)
        if job.what == "RRTConnect"
        else run_planner(job.what, space, start, goal, CURVE_S[10:], end_s)
        for _ in range(effort.seeds)
    ]
    return {
        "cost": [cost_at(t.history, math.inf) for t in traces],
        "curve": [_curve(t.history, end_s) for t in traces],
    }


def run_jobs(
    jobs: Sequence[Job], effort: Effort, workers: int = 1, keep: Path | None = None
) -> dict[Job, dict[str, Any]]:
    """Run jobs on `workers` processes (1: in this one); return their results.

    With `keep`, finished jobs are written to that folder, and results of the same source and effort
    are reused. An interrupted comparison can therefore be continued.
    """
    found = {} if keep is None else dict(load_kept(jobs, effort, keep))
    left = [job for job in jobs if job not in found]
    for job, result in _run(left, effort, workers):
        found[job] = result
        if keep is not None:
            _write_kept(job, effort, keep, result)
    return found


def _run(jobs: Sequence[Job], effort: Effort, workers: int) -> Iterator[tuple[Job, dict[str, Any]]]:
    if workers <= 1 or len(jobs) <= 1:
        for job in jobs:
            yield job, run_job(job, effort)
        return
    # fill the cache of compiled code once instead of in all processes at a time
    run_job(Job(jobs[0].scenario, OURS), effort._replace(seeds=1, late_s=0.1))
    run_job(Job(jobs[0].scenario, PAPER), effort._replace(seeds=1, late_s=0.1))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(jobs)), mp_context=context) as pool:
        running = {pool.submit(run_job, job, effort): job for job in jobs}
        try:
            for done in as_completed(running):
                yield running[done], done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _list_sources(what: str) -> list[Path]:
    """Return the source files of the planner that a job runs."""
    folder, own = Path(planner.__file__).parent, Path(__file__).parent
    planners = {PAPER: ("rrt_star",), DECOUPLED: ("decoupled",), **dict.fromkeys(OMPL, ())}
    left = [folder / f"{name}.py" for name in planners.get(what, ("planner", "bound"))]
    left += [own / "ompl_planners.py"] if what in OMPL else []
    found: set[Path] = set()
    while left:
        file = left.pop()
        found.add(file)
        names = re.findall(r"from skywright\.planning\.motion\.(\w+) import", file.read_text())
        left += [f for f in (folder / f"{name}.py" for name in names) if f not in found]
    return sorted(found)


def _stamp(job: Job, effort: Effort) -> dict[str, Any]:
    """Return what a kept result depends on: the effort, the planner's source, the problem."""
    numbers = effort._asdict()
    del numbers["scenarios"], numbers["decoupled"]
    source, problem = hashlib.sha256(), build_problem(job.scenario)
    for file in _list_sources(job.what):
        source.update(file.read_bytes())
    for part in (problem.space, np.asarray(problem.start), np.asarray(problem.goal)):
        source.update(part.tobytes())
    return {"source": source.hexdigest()[:16], "effort": numbers}


def load_kept(
    jobs: Iterable[Job], effort: Effort, keep: Path
) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Yield the kept results in a folder that are still valid."""
    for job in jobs:
        path = keep / f"{job.scenario}-{job.what}.json"
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if isinstance(kept, dict) and "found" in kept and kept.get("stamp") == _stamp(job, effort):
            yield job, kept["found"]


def _write_kept(job: Job, effort: Effort, keep: Path, found: dict[str, Any]) -> None:
    keep.mkdir(parents=True, exist_ok=True)
    path = keep / f"{job.scenario}-{job.what}.json"
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps({"stamp": _stamp(job, effort), "found": found}), encoding="utf-8")
    partial.replace(path)
