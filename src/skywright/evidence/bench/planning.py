"""Planning time over seeds, and the time of one distance query of the whole robot."""

import numpy as np

from skywright.core.arrays import Array
from skywright.evidence.bench.flights import load_scan
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import interleave, read_clock
from skywright.evidence.planning.compare import measure_planners
from skywright.models.geometry import ClearanceQuery, build_clearance, compute_clearance
from skywright.models.scene import build_scene
from skywright.run.planning import plan_mission

LIMIT = 1.0  # s, with loaded code, for a plan of about 110 s of motion

CASES: dict[str, tuple[str, ...]] = {
    "default": (),
    "behind_the_pipe": ("world.pipe.yaw_deg=180",),
    "thick_inclined": ("world.pipe.diameter_m=0.6", "world.pipe.inclination_deg=30"),
    "thin_inclined_far_side": (
        "world.pipe.diameter_m=0.3", "world.pipe.inclination_deg=-30", "world.pipe.yaw_deg=150",
    ),
    "top": ('mission.task.side="top"',),
    "underside": ('mission.task.side="underside"',),
}  # fmt: skip
REFUSED = {"underside"}
"""Cases without a plan, because the posts block the path: the time until that is known."""


def measure(session: Session) -> list[Row]:
    """Plan each case with several seeds, time queries, compare motion planners."""
    seeds = session.pick(2, 3, 20)
    plan_mission(load_scan(*CASES["behind_the_pipe"]))  # compiles
    rows = [measure_case(name, seeds) for name in session.pick(["default"], [*CASES], [*CASES])]
    query = measure_query(session.pick(2, 10, 30))
    return [*rows, query, *measure_planners(session)]


def measure_case(name: str, seeds: int) -> Row:
    """Plan one case with every seed."""
    times, motion = [], []
    for seed in range(seeds):
        plan = plan_mission(load_scan(*CASES[name], f"mission.seed={seed}"))
        times.append(plan.plan_s)
        if plan.feasible:
            motion.append(plan.duration_s)
    note = f"a plan for {len(motion)} of {seeds} seeds, slowest {max(times):.2g} s"
    if motion:
        note += f", {np.median(motion):.0f} s of motion"
    if name in REFUSED:
        note += " (refused: the posts are in the way)"
    return build_row(f"{name}_s", times, "s", limit=LIMIT, note=note)


def measure_query(rounds: int, count: int = 500) -> Row:
    """Time distance queries at random poses near the pipe, called from Python."""
    d = load_scan()
    query = build_clearance(build_scene(d.robot, d.world))
    offsets = np.random.default_rng(0).uniform(-0.2, 0.2, (count, 3))
    poses = np.array([1.2, 0.0, 1.4]) + offsets
    times = interleave({"query": lambda: _time_queries(query, poses)}, rounds)["query"]
    return build_row(
        "clearance_query_us", [1e6 * t / count for t in times], "us",
        note="platform, propellers and arm against pipe, posts and ground, one pose",
    )  # fmt: skip


def _time_queries(query: ClearanceQuery, poses: Array) -> float:
    q, eye = np.array([-0.7, 0.7]), np.eye(3)
    began = read_clock()
    for p in poses:
        compute_clearance(query, p, eye, q)
    return read_clock() - began
