"""Control-aware planning of a push-and-slide scan (Tognon et al. 2018, section IV).

A tree of configurations in task space grows through the via-points of the pattern. Each edge is the
closed-loop motion of the second-order inverse kinematics on the nominal model. It is kept only if
rotors, joints, motors, task and clearance stay within their limits along the whole edge. The first
attempt for each edge is the straight segment with the best-rated posture; then other postures and
detours over the surface are sampled from the seeded generator.
"""

import math
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.world.surface import Cylinder, level_axes
from skywright.models.geometry import ClearanceQuery
from skywright.models.kinematic_tree import PlanningScene
from skywright.planning.configurations import Candidates, resting
from skywright.planning.flight import build_rest, build_transit_law, plan_flight
from skywright.planning.inverse_dynamics import Loads
from skywright.planning.inverse_kinematics import State, build_state, wrap
from skywright.planning.local_planner import (
    Edge,
    join_edges,
    plan_free_edge,
    plan_surface_edge,
)
from skywright.planning.patterns import TimeLaw, build_time_law
from skywright.planning.problem import ON_SURFACE, Limits, build_problem
from skywright.planning.survey import SurveyTask, plan_survey
from skywright.planning.via_points import ScanTask, Search, Slide

SETTLE = 2.0
"""s of rest in contact before sliding: the attitude error of touch-down decays (section VII)."""
PAUSE = 0.5
"""s of rest at each corner."""
RETREATS = (0.2, 0.35, 0.55)
"""m beyond the stand-off at which the arm is unfolded and folded: the first that is feasible."""

RISES = (0.0, 0.3, 0.6)
"""m straight up before the arm is folded on the return: near the ground the arm would touch it."""

LEAN = math.radians(3.0)
"""Largest inclination of a pipe by which the probe may deviate from its normal: a surveyed pipe."""
TURNED = math.radians(5.0)
"""Largest turn of the heading from across the pipe that a small inclination may cause."""


class Statistics(NamedTuple):
    """Statistics of the search."""

    configurations: int
    edges: int
    failed_edges: int
    attempts: int


class ScanPlan(NamedTuple):
    """A plan, or the reason why there is none."""

    feasible: bool
    blocked_by: str | None
    segments: dict[str, NDArray[Any]]  # REFERENCE rows, each segment's time from 0
    traces: dict[str, NDArray[Any]]  # TRACE rows beside them
    corners_sphi: Array  # (n, 2)
    path_sphi: Array  # (m, 2) desired tip on the surface, one per row of "scan"
    plan_s: float
    duration_s: float
    min_clearance_m: float
    min_rotor_margin: float
    statistics: Statistics


def plan_scan(
    model: NDArray[Any],
    loads: Loads,
    query: ClearanceQuery,
    scene: PlanningScene,
    cylinder: Cylinder,
    task: ScanTask,
    limits: Limits,
    push_force: float,
    start: Array,
    home: Array,
    q_folded: Array,
    q_working: Array,
    rng: np.random.Generator,
    joints: tuple[str, ...] = (),
    time_limit: float = 20.0,
    survey: SurveyTask | None = None,
    begin: State | None = None,
) -> ScanPlan:
    """Plan approach, unfolding, touch, scan, departure and return.

    With a `survey` the path to its points is inserted. From `begin`, at rest in front of the
    surface with the arm unfolded, "face" replaces approach and unfolding.

    model: (1,) `BodyModel`. start, home (4,): hover poses x, y, z, yaw before and after. push_force
    N along the inward normal while the tip is inside. Does not raise for an impossible task:
    `blocked_by` of the plan then states the constraint.
    """
    began = time.perf_counter()
    axes = choose_axes(cylinder, task.pattern.corners)
    search = Search(
        build_problem(model, loads, query, cylinder, limits, push_force, axes), query, scene, task,
        joints, np.asarray(q_working, dtype=float), rng, began + time_limit,
    )  # fmt: skip
    segments: dict[str, list[Edge]] = {}
    path = np.zeros((0, 2))
    blocked = task.pattern.blocked_by
    if blocked is None and task.depth >= cylinder.radius:
        blocked = (
            f"the desired tip lies {1e3 * task.depth:.0f} mm inside a pipe whose radius is "
            f"{1e3 * cylinder.radius:.0f} mm"
        )
    if blocked is None:
        segments, path, blocked = _plan(search, start, home, q_folded, begin)
    if blocked is None and survey is not None:
        close, first = segments["close_in"][-1], task.pattern.corners[0]
        away = task.stand_off + RETREATS[0]
        more, blocked = plan_survey(search, close.state, first, survey, away)
        flown = list(segments.items())
        at = list(segments).index("close_in") + 1
        segments = dict([*flown[:at], *more.items(), *flown[at:]])  # in the order of flight
    joined = {name: join_edges(edges) for name, edges in segments.items()}
    rows = {name: r for name, (r, _) in joined.items()}
    for r in rows.values():
        fill_force(r, cylinder, task.depth, push_force)
    traces = {name: t for name, (_, t) in joined.items()}
    statistics = Statistics(search.configurations, search.edges, search.failed, search.attempts)
    return ScanPlan(
        feasible=blocked is None,
        blocked_by=blocked,
        segments=rows if blocked is None else {},
        traces=traces,
        corners_sphi=task.pattern.corners,
        path_sphi=path,
        plan_s=time.perf_counter() - began,
        duration_s=float(sum(r["t"][-1] for r in rows.values())) if blocked is None else math.nan,
        min_clearance_m=min(
            (float(t["clearance"].min()) for t in traces.values()), default=math.nan
        ),
        min_rotor_margin=min(
            (float(t["rotor_margin"].min()) for t in traces.values()), default=math.nan
        ),
        statistics=statistics,
    )


def choose_axes(cylinder: Cylinder, corners: Array) -> Array:
    """Return the frame (3, 3) whose normals the probe's axis follows: the pipe's, or level.

    The heading of a level platform follows the level part of the probe's axis. Near the top of a
    slightly inclined pipe, this part is mostly due to the inclination: the heading, and an array
    with it, would turn by half a turn. There the axis follows the pipe as if it were level, which
    tilts the probe by at most the inclination.
    """
    R = cylinder.R_WP
    level = math.hypot(R[0, 1], R[1, 1])
    inclined = math.atan2(abs(R[2, 1]), level)
    if not 1e-9 < inclined <= LEAN or not len(corners):
        return R
    across = np.array([R[1, 1], -R[0, 1], 0.0]) / level
    phi = np.linspace(corners[:, 1].min(), corners[:, 1].max(), 200)
    n = np.outer(np.sin(phi), R[:, 2]) - np.outer(np.cos(phi), R[:, 0])
    aside = np.abs(n[:, :2] @ [-across[1], across[0]])
    if np.max(np.arctan2(aside, np.abs(n @ across))) <= TURNED:
        return R
    flat = np.column_stack([across, [-across[1], across[0], 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(flat @ level_axes(R).T @ R)  # phi is relative to the pipe's roll


def _plan(
    search: Search, start: Array, home: Array, q_folded: Array, begin: State | None
) -> tuple[dict[str, list[Edge]], Array, str | None]:
    """Try starting configurations until everything connects; else return the first obstacle."""
    corners = search.task.pattern.corners
    found = search.first(corners[0])
    if found.failure is not None:
        return {}, np.zeros((0, 2)), search.explain(found.failure)
    blocked: str | None = None
    progress = -1
    for i in _diverse(found, 6):
        search.attempts += 1
        state = resting(found, i)
        scan, failure = search.grow(state)
        message = None
        segments: dict[str, list[Edge]] = {}
        if failure is None:
            segments, message = _connect(search, state, scan, start, home, q_folded, begin)
        else:
            message = search.explain(failure)
        if message is None:
            return segments, _path(search, scan), None
        if len(scan) > progress:
            progress, blocked = len(scan), message
        if search.late():
            break
    return {}, np.zeros((0, 2)), blocked


def _diverse(found: Candidates, count: int) -> list[int]:
    """Return the best candidates' indices that differ by more than 0.2 rad from better ones."""
    chosen: list[int] = []
    for i in range(len(found.score)):
        yaw = math.atan2(found.R[i, 1, 0], found.R[i, 0, 0])
        for j in chosen:
            other = math.atan2(found.R[j, 1, 0], found.R[j, 0, 0])
            away = float(np.abs(found.q[i] - found.q[j]).max())
            if max(away, abs(wrap(yaw - other))) < 0.2:
                break
        else:
            chosen.append(i)
            if len(chosen) == count:
                break
    return chosen


def _path(search: Search, scan: list[Slide]) -> Array:
    """Return the desired (s, phi) of each row of the joined scan."""
    cyl = search.prob.cylinder
    rows, _ = join_edges(_with_pauses(search, scan))
    local = (rows["p_WT"] - cyl.p_WP) @ cyl.R_WP
    return np.column_stack([local[:, 1], np.arctan2(local[:, 2], -local[:, 0])])


def _with_pauses(search: Search, scan: list[Slide]) -> list[Edge]:
    """Return the edges of a scan with a rest before the first and after each."""
    out: list[Edge] = []
    for i, (edge, _, _) in enumerate(scan):
        if i == 0:
            out.append(build_rest(edge, 0, SETTLE))
        out.append(edge)
        out.append(build_rest(edge, -1, PAUSE))
    return out


def _moved(state: State, offset: Array) -> State:
    """Return the same configuration with the platform moved."""
    return build_state(state.p + offset, state.R, state.q)


def _connect(
    search: Search, first: State, scan: list[Slide], start: Array, home: Array,
    q_folded: Array, begin: State | None,
) -> tuple[dict[str, list[Edge]], str | None]:  # fmt: skip
    """Add the motions before and after the scan; return the segments or what blocks them."""
    last = scan[-1].edge.state
    a, b = scan[0].start, scan[-1].end
    task, message = search.task, ""
    for distance in RETREATS:
        edges, message = _arrive(
            search, first, a, task.stand_off + distance, start, q_folded, begin
        )
        if edges:
            break
    else:
        return {}, message
    for distance in RETREATS:
        depart, message = _depart(search, last, b, task.stand_off + distance, home, q_folded)
        if depart:
            break
    else:
        return {}, message
    edges["scan"] = _with_pauses(search, scan)
    edges.update(depart)
    return edges, None


def _fold_law(search: Search, q_a: Array, q_b: Array) -> TimeLaw:
    lim = search.prob.limits
    size = float(np.abs(q_a - q_b).max(initial=0.0))
    return build_time_law(size, lim.joint_rate, lim.joint_acceleration)


def _arrive(
    search: Search, first: State, corner: Array, distance: float, start: Array, q_folded: Array,
    begin: State | None,
) -> tuple[dict[str, list[Edge]], str]:  # fmt: skip
    """Plan approach, unfold, close_in and touch from `distance` (m) in front of the surface.

    From `begin`: face, close_in and touch.
    """
    prob, task, lim = search.prob, search.task, search.prob.limits
    s, phi = float(corner[0]), float(corner[1])
    _, n = search.tip(s, phi)
    front = _moved(first, n * (task.depth + distance))
    yaw = math.atan2(front.R[1, 0], front.R[0, 0])
    gate = build_state(front.p, rot_z(yaw), q_folded)
    leading = begin or gate
    law = _fold_law(search, leading.q, front.q)
    if begin is not None:
        transit = build_transit_law(begin, np.array([*front.p, yaw]), lim)
        law = max(law, transit, key=lambda x: x.duration)
    unfold = plan_free_edge(prob, leading, front.p, front.R, front.q, law, lim.margin_transit)
    if unfold.failure is not None:
        return {}, search.explain(unfold.failure)
    law = build_time_law(
        distance - task.stand_off, min(task.close_speed, 0.8 * lim.speed), lim.acceleration / 2, 0.5
    )
    at = [np.array([s, phi, g]) for g in (distance, task.stand_off, -task.depth)]
    close = plan_surface_edge(
        prob, unfold.state, at[0], at[1], law, yaw, front.q, False, 0.0
    )  # fmt: skip
    if close.failure is not None:
        return {}, search.explain(close.failure)
    law = build_time_law(task.stand_off + task.depth, task.touch_speed, lim.acceleration / 4, 0.5)
    touch = plan_surface_edge(
        prob, close.state, at[1], at[2], law, yaw, front.q, True, task.dead_zone
    )
    if touch.failure is not None:
        return {}, search.explain(touch.failure)
    if begin is not None:
        return {"face": [unfold], "close_in": [close], "touch": [touch]}, ""
    gate_pose = np.array([*front.p, yaw])
    approach, failure = plan_flight(prob, search.scene, start, gate_pose, q_folded, search.rng)
    if failure is not None:
        return {}, search.explain(failure)
    return {"approach": approach, "unfold": [unfold], "close_in": [close], "touch": [touch]}, ""


def _depart(
    search: Search, last: State, corner: Array, distance: float, home: Array, q_folded: Array
) -> tuple[dict[str, list[Edge]], str]:
    """Plan leave, fold and return."""
    prob, task, lim = search.prob, search.task, search.prob.limits
    s, phi = float(corner[0]), float(corner[1])
    yaw = math.atan2(last.R[1, 0], last.R[0, 0])
    at = [np.array([s, phi, g]) for g in (-task.depth, task.stand_off, distance)]
    law = build_time_law(
        task.stand_off + task.depth,
        min(2 * task.touch_speed, 0.8 * lim.speed),
        lim.acceleration / 4,
        0.5,
    )
    lift = plan_surface_edge(prob, last, at[0], at[1], law, yaw, last.q, True, task.dead_zone)
    if lift.failure is not None:
        return {}, search.explain(lift.failure)
    law = build_time_law(
        distance - task.stand_off, min(task.close_speed, 0.8 * lim.speed), lim.acceleration / 2, 0.5
    )
    back = plan_surface_edge(prob, lift.state, at[1], at[2], law, yaw, last.q, True, 0.0)
    if back.failure is not None:
        # on the lower side the normal points towards the ground: depart horizontally
        _, n = search.tip(s, phi)
        away = np.array([n[0], n[1], 0.0]) * (distance - task.stand_off) / math.hypot(n[0], n[1])
        low, first = lift.state, back.failure
        back = plan_free_edge(prob, low, low.p + away, low.R, low.q, law, lim.margin, ON_SURFACE)
        if back.failure is not None:
            return {}, search.explain(first)
    leave, blocked = [lift, back], ""
    for rise in RISES:
        high = back.state
        if rise > 0.0:
            p = back.state.p + [0.0, 0.0, rise]
            law = build_transit_law(back.state, np.array([*p, yaw]), lim)
            up = plan_free_edge(prob, back.state, p, high.R, high.q, law, lim.margin_transit)
            if up.failure is not None:
                break
            leave, high = [lift, back, up], up.state
        folded = build_state(high.p, rot_z(yaw), q_folded)
        fold = plan_free_edge(
            prob, high, folded.p, folded.R, folded.q, _fold_law(search, folded.q, high.q),
            lim.margin_transit,
        )  # fmt: skip
        if fold.failure is not None:
            blocked = blocked or search.explain(fold.failure)
            continue
        way, failure = plan_flight(
            prob, search.scene, np.array([*folded.p, yaw]), home, q_folded, search.rng
        )
        if failure is not None:
            return {}, search.explain(failure)
        return {"leave": leave, "fold": [fold], "return": way}, ""
    return {}, blocked


def fill_force(rows: NDArray[Any], cylinder: Cylinder, depth: float, force: float) -> None:
    """Write the tip's force reference (N) into rows of REFERENCE.

    Zero outside of the surface, `force` at `depth` (m) and more inside of it, linear between: the
    force of a law that presses by its position stiffness.
    """
    p = (rows["p_WT"] - cylinder.p_WP) @ cylinder.R_WP
    inside = cylinder.radius - np.hypot(p[:, 0], p[:, 2])
    touching = rows["dead_zone"] > 0.0
    rows["force"] = np.where(touching, force * np.clip(inside / depth, 0.0, 1.0), 0.0)


def compute_depth(mass: float, bandwidth: float, force: float) -> float:
    """Return the depth (m) at which position stiffness mass * bandwidth^2 gives `force` (N)."""
    return force / (mass * bandwidth**2)
