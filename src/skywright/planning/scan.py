"""Control-aware planning of a push-and-slide scan (Tognon et al. 2018, section IV).

A tree of configurations in task space grows through the via-points of the pattern. Each edge is
the closed-loop motion of the second-order inverse kinematics on the nominal model, and it is kept
only when rotors, joints, motors, task and clearance stay within their limits all along. The first
try at each edge is the straight segment with the best-rated posture; then other postures and
detours over the surface are sampled from the seeded generator.
"""

from __future__ import annotations

import itertools
import math
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.models.geometry import ClearanceQuery
from skywright.models.rigid_body import compute_tip
from skywright.planning.configurations import (
    Candidates,
    compute_headings,
    find_configurations,
    halton,
    resting,
    sample_postures,
)
from skywright.planning.inverse_dynamics import Loads
from skywright.planning.inverse_kinematics import State, build_state, wrap
from skywright.planning.local_planner import (
    Edge,
    join_edges,
    plan_free_edge,
    plan_surface_edge,
)
from skywright.planning.patterns import Pattern, TimeLaw, build_time_law
from skywright.planning.problem import (
    Failure,
    Limits,
    Problem,
    build_problem,
    describe_failure,
)
from skywright.planning.transit import plan_transit
from skywright.worlds.surface import Cylinder, surface_point

Array = NDArray[np.float64]

SAMPLES = 48
"""Arm postures tried at each heading."""
SETTLE = 2.0
"""s of rest in contact before sliding: the attitude error of touch-down vanishes (section VII)."""
PAUSE = 0.5
"""s of rest at each corner."""


class ScanTask(NamedTuple):
    """What to scan and how."""

    pattern: Pattern
    speed: float = 0.01  # m/s of the tip while sliding
    depth: float = 0.03  # m of the desired tip inside the surface
    dead_zone: float = 0.045  # m
    stand_off: float = 0.05  # m
    touch_speed: float = 0.015  # m/s
    close_speed: float = 0.1  # m/s
    ramp: float = 1.0  # s, least time to reach the speed on the surface


class Statistics(NamedTuple):
    """Of the search."""

    configurations: int
    edges: int
    failed_edges: int
    attempts: int
    transit_nodes: int


class ScanPlan(NamedTuple):
    """A plan, or why there is none."""

    feasible: bool
    blocked_by: str | None
    segments: dict[str, NDArray[Any]]  # REFERENCE rows, each segment's time from 0
    traces: dict[str, NDArray[Any]]  # TRACE rows beside them
    corners_sphi: Array  # (n, 2)
    path_sphi: Array  # (m, 2) desired tip on the surface while scanning, one a row of "scan"
    plan_s: float
    duration_s: float
    min_clearance_m: float
    min_rotor_margin: float
    statistics: Statistics


class _Search:
    """State of one planning call."""

    def __init__(
        self, prob: Problem, query: ClearanceQuery, task: ScanTask, joints: tuple[str, ...],
        q_working: Array, rng: np.random.Generator, deadline: float,
    ) -> None:  # fmt: skip
        self.prob, self.query, self.task, self.joints = prob, query, task, joints
        self.q_working, self.rng, self.deadline = q_working, rng, deadline
        nj = int(prob.model[0]["n_joints"])
        grid = sample_postures(prob, halton(SAMPLES, nj)) if nj else np.zeros((1, 0))
        self.postures = np.vstack([q_working[None, :nj], grid]) if nj else grid
        self.configurations = self.edges = self.failed = self.attempts = self.nodes = 0

    def late(self) -> bool:
        return time.perf_counter() > self.deadline

    def tip(self, s: float, phi: float) -> tuple[Array, Array]:
        p, n = np.empty(3), np.empty(3)
        surface_point(self.prob.cylinder, s, phi, p, n)
        return p - self.task.depth * n, n

    def first(self, corner: Array) -> Candidates:
        """Candidates at the first corner: every heading, every posture."""
        tip, n = self.tip(corner[0], corner[1])
        yaws = compute_headings(n, self.prob.cylinder.R_WP)
        self.configurations += len(yaws) * len(self.postures)
        return find_configurations(
            self.prob, tip, n, self.task.depth, yaws, self.postures, self.q_working,
            self.q_working, 0.0, 0.0,
            (corner[0], corner[1]),
        )  # fmt: skip

    def next(self, corner: Array, state: State, wide: bool) -> Candidates:
        """Candidates at a corner, near the configuration `state`; `wide`: other postures too."""
        tip, n = self.tip(corner[0], corner[1])
        nj = int(self.prob.model[0]["n_joints"])
        yaw = math.atan2(state.R[1, 0], state.R[0, 0])
        q = state.q[:nj]
        near = [q]
        if nj:
            steps = (-0.25, -0.1, 0.1, 0.25)
            near += [q + d * e for d in steps for e in np.eye(nj)]
            if wide:
                near += list(q + self.rng.normal(0.0, 0.5, (12, nj)))
        yaws = np.array([yaw, *self._turned(yaw, n)])
        self.configurations += len(yaws) * len(near)
        return find_configurations(
            self.prob, tip, n, self.task.depth, yaws, np.array(near), self.q_working, q,
            yaw, 1.0,
            (corner[0], corner[1]),
        )  # fmt: skip

    @staticmethod
    def _turned(yaw: float, n: Array) -> list[float]:
        """The heading into the surface that is nearest to the present one, if it is defined."""
        if math.hypot(n[0], n[1]) < 0.02:
            return []
        into = math.atan2(-n[1], -n[0])
        if abs(wrap(into - yaw)) > math.pi / 2:
            into += math.pi
        return [into] if abs(wrap(into - yaw)) > 1e-3 else []

    def slide(self, state: State, a: Array, b: Array, end: State) -> Edge:
        """The tip slides from corner a to corner b, ending in configuration `end`."""
        radius = self.prob.cylinder.radius
        length = math.hypot(b[0] - a[0], radius * (b[1] - a[1]))
        law = build_time_law(length, self.task.speed, self.prob.limits.acceleration / 4,
                             self.task.ramp)  # fmt: skip
        yaw = math.atan2(end.R[1, 0], end.R[0, 0])
        d = -self.task.depth
        edge = plan_surface_edge(
            self.prob, state, np.array([a[0], a[1], d]), np.array([b[0], b[1], d]), law, yaw,
            end.q, True, self.task.dead_zone,
        )  # fmt: skip
        self.edges += 1
        self.failed += edge.failure is not None
        return edge

    def grow(self, start: State) -> tuple[list[tuple[Edge, Array, Array]], Failure | None]:
        """Grow through all via-points; return the edges with their ends, and what stopped it."""
        corners = self.task.pattern.corners
        done: list[tuple[Edge, Array, Array]] = []
        state = start
        for a, b in itertools.pairwise(corners):
            step, failure = self.reach(state, a, b)
            if failure is not None:
                return done, failure
            done += step
            state = step[-1][0].state
        return done, None

    def reach(
        self, state: State, a: Array, b: Array
    ) -> tuple[list[tuple[Edge, Array, Array]], Failure | None]:
        """Reach via-point b from a: straight, other postures, then a tree with detours."""
        first: Failure | None = None
        for wide in (False, True):
            found = self.next(b, state, wide)
            if found.failure is not None:
                first = first or found.failure
                continue
            for i in range(min(len(found.score), 3)):
                edge = self.slide(state, a, b, resting(found, i))
                if edge.failure is None:
                    return [(edge, a, b)], None
                first = first or edge.failure
                if self.late():
                    return [], first
        # task-space RRT: sample the surface around the segment, then try to connect to b
        tree: list[tuple[State, Array, list[tuple[Edge, Array, Array]]]] = [(state, a, [])]
        radius = self.prob.cylinder.radius
        room = np.array([0.08, 0.08 / radius])
        lo, hi = np.minimum(a, b) - room, np.maximum(a, b) + room
        half = self.prob.cylinder.half_length
        lo[0], hi[0] = max(lo[0], -half), min(hi[0], half)
        for _ in range(8):
            if self.late():
                break
            sample = self.rng.uniform(lo, hi)
            gaps = [np.hypot(n[1][0] - sample[0], radius * (n[1][1] - sample[1])) for n in tree]
            node, at, way = tree[int(np.argmin(gaps))]
            found = self.next(sample, node, True)
            if found.failure is not None:
                continue
            edge = self.slide(node, at, sample, resting(found, 0))
            if edge.failure is not None:
                continue
            way = [*way, (edge, at, sample)]
            tree.append((edge.state, sample, way))
            onward = self.next(b, edge.state, False)
            if onward.failure is None:
                last = self.slide(edge.state, sample, b, resting(onward, 0))
                if last.failure is None:
                    return [*way, (last, sample, b)], None
        assert first is not None
        return [], first


def plan_scan(
    model: NDArray[Any],
    loads: Loads,
    query: ClearanceQuery,
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
) -> ScanPlan:
    """Plan approach, unfolding, touch, scan, departure and return.

    model: (1,) BODY_MODEL. start, home (4,): hover poses x, y, z, yaw before and after. push_force
    N along the inward normal while the tip is inside. Never raises for an impossible task: the
    plan then says in `blocked_by` which constraint blocks it.
    """
    began = time.perf_counter()
    search = _Search(
        build_problem(model, loads, query, cylinder, limits, push_force), query, task, joints,
        np.asarray(q_working, dtype=float), rng, began + time_limit,
    )  # fmt: skip
    segments: dict[str, list[Edge]] = {}
    path = np.zeros((0, 2))
    blocked = task.pattern.blocked_by
    if blocked is None and task.depth >= cylinder.radius:
        blocked = (
            f"pipe too thin: the desired tip lies {1e3 * task.depth:.0f} mm inside, the radius is "
            f"{1e3 * cylinder.radius:.0f} mm"
        )
    if blocked is None:
        segments, path, blocked = _plan(search, start, home, q_folded)
    joined = {name: join_edges(edges) for name, edges in segments.items()}
    rows = {name: r for name, (r, _) in joined.items()}
    traces = {name: t for name, (_, t) in joined.items()}
    statistics = Statistics(
        search.configurations, search.edges, search.failed, search.attempts, search.nodes
    )
    return ScanPlan(
        feasible=blocked is None,
        blocked_by=blocked,
        segments=rows if blocked is None else {},
        traces=traces,
        corners_sphi=task.pattern.corners,
        path_sphi=path,
        plan_s=time.perf_counter() - began,
        duration_s=float(sum(r["t"][-1] for r in rows.values())) if blocked is None else math.nan,
        min_clearance_m=min((float(t["clearance"].min()) for t in traces.values()), default=math.nan),
        min_rotor_margin=min(
            (float(t["rotor_margin"].min()) for t in traces.values()), default=math.nan
        ),
        statistics=statistics,
    )


def _plan(
    search: _Search, start: Array, home: Array, q_folded: Array
) -> tuple[dict[str, list[Edge]], Array, str | None]:
    """Try starting configurations until everything connects; tell the first obstacle otherwise."""
    corners = search.task.pattern.corners
    found = search.first(corners[0])
    if found.failure is not None:
        return {}, np.zeros((0, 2)), search_message(search, found.failure)
    blocked: str | None = None
    progress = -1
    for i in _diverse(found, 6):
        search.attempts += 1
        state = resting(found, i)
        scan, failure = search.grow(state)
        message = None
        segments: dict[str, list[Edge]] = {}
        if failure is None:
            segments, message = _connect(search, state, scan, start, home, q_folded)
        else:
            message = search_message(search, failure)
        if message is None:
            return segments, _path(search, scan), None
        if len(scan) > progress:
            progress, blocked = len(scan), message
        if search.late():
            break
    return {}, np.zeros((0, 2)), blocked


def search_message(search: _Search, failure: Failure) -> str:
    """Return the sentence of a failure."""
    return describe_failure(failure, search.query, search.joints)


def _diverse(found: Candidates, count: int) -> list[int]:
    """Indices of the best candidates that differ by more than 0.2 rad from better ones."""
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


def _path(search: _Search, scan: list[tuple[Edge, Array, Array]]) -> Array:
    """Desired (s, phi) of each row of the joined scan."""
    cyl = search.prob.cylinder
    rows, _ = join_edges(_with_pauses(search, scan))
    local = (rows["p_WT"] - cyl.p_WP) @ cyl.R_WP
    return np.column_stack([local[:, 1], np.arctan2(local[:, 2], -local[:, 0])])


def _with_pauses(search: _Search, scan: list[tuple[Edge, Array, Array]]) -> list[Edge]:
    """The edges of a scan with a rest before the first and after each."""
    out: list[Edge] = []
    for i, (edge, _, _) in enumerate(scan):
        if i == 0:
            out.append(build_rest(edge, 0, SETTLE))
        out.append(edge)
        out.append(build_rest(edge, -1, PAUSE))
    return out


def build_rest(edge: Edge, at: int, duration: float) -> Edge:
    """Stay at the first (0) or last (-1) row of an edge; rows start one step after it."""
    count = round(duration / 0.02) + 1
    rows, trace = np.repeat(edge.rows[at], count), np.repeat(edge.trace[at], count)
    rows["t"] = 0.02 * np.arange(count)
    for name in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT"):
        rows[name] = 0.0
    return Edge(rows, trace, None, edge.state)


def _moved(state: State, offset: Array) -> State:
    """The same configuration with the platform moved."""
    return build_state(state.p + offset, state.R, state.q)


def _connect(
    search: _Search, first: State, scan: list[tuple[Edge, Array, Array]], start: Array, home: Array,
    q_folded: Array,
) -> tuple[dict[str, list[Edge]], str | None]:  # fmt: skip
    """Add the motions before and after the scan; return the segments or what blocks them."""
    last = scan[-1][0].state
    a, b = scan[0][1], scan[-1][2]
    message = "approach"
    for distance in (0.25, 0.4, 0.6):
        edges, message = _arrive(search, first, a, distance, start, q_folded)
        if edges:
            break
    else:
        return {}, message
    for distance in (0.25, 0.4, 0.6):
        depart, message = _depart(search, last, b, distance, home, q_folded)
        if depart:
            break
    else:
        return {}, message
    edges["scan"] = _with_pauses(search, scan)
    edges.update(depart)
    return edges, None


def _fold_law(search: _Search, q_a: Array, q_b: Array) -> TimeLaw:
    lim = search.prob.limits
    size = float(np.abs(q_a - q_b).max(initial=0.0))
    return build_time_law(size, lim.joint_rate, lim.joint_acceleration)


def _arrive(
    search: _Search, first: State, corner: Array, distance: float, start: Array, q_folded: Array
) -> tuple[dict[str, list[Edge]], str]:
    """approach, unfold, close_in and touch for a start `distance` (m) in front of the surface."""
    prob, task, lim = search.prob, search.task, search.prob.limits
    s, phi = float(corner[0]), float(corner[1])
    _, n = search.tip(s, phi)
    front = _moved(first, n * (task.depth + distance))
    yaw = math.atan2(front.R[1, 0], front.R[0, 0])
    gate = build_state(front.p, rot_z(yaw), q_folded)
    unfold = plan_free_edge(
        prob, gate, front.p, front.R, front.q, _fold_law(search, gate.q, front.q),
        lim.margin_transit,
    )  # fmt: skip
    if unfold.failure is not None:
        return {}, search_message(search, unfold.failure)
    law = build_time_law(distance - task.stand_off, task.close_speed, lim.acceleration / 2, 0.5)
    at = [np.array([s, phi, g]) for g in (distance, task.stand_off, -task.depth)]
    close = plan_surface_edge(
        prob, unfold.state, at[0], at[1], law, yaw, front.q, False, 0.0
    )  # fmt: skip
    if close.failure is not None:
        return {}, search_message(search, close.failure)
    law = build_time_law(task.stand_off + task.depth, task.touch_speed, lim.acceleration / 4, 0.5)
    touch = plan_surface_edge(
        prob, close.state, at[1], at[2], law, yaw, front.q, True, task.dead_zone
    )
    if touch.failure is not None:
        return {}, search_message(search, touch.failure)
    approach, message = _fly(search, start, np.array([*front.p, yaw]), q_folded)
    if not approach:
        return {}, message
    return {"approach": approach, "unfold": [unfold], "close_in": [close], "touch": [touch]}, ""


def _depart(
    search: _Search, last: State, corner: Array, distance: float, home: Array, q_folded: Array
) -> tuple[dict[str, list[Edge]], str]:
    """leave, fold and return."""
    prob, task, lim = search.prob, search.task, search.prob.limits
    s, phi = float(corner[0]), float(corner[1])
    yaw = math.atan2(last.R[1, 0], last.R[0, 0])
    at = [np.array([s, phi, g]) for g in (-task.depth, task.stand_off, distance)]
    law = build_time_law(task.stand_off + task.depth, 2 * task.touch_speed, lim.acceleration / 4, 0.5)
    lift = plan_surface_edge(prob, last, at[0], at[1], law, yaw, last.q, True, task.dead_zone)
    if lift.failure is not None:
        return {}, search_message(search, lift.failure)
    law = build_time_law(distance - task.stand_off, task.close_speed, lim.acceleration / 2, 0.5)
    back = plan_surface_edge(prob, lift.state, at[1], at[2], law, yaw, last.q, True, 0.0)
    if back.failure is not None:
        return {}, search_message(search, back.failure)
    folded = build_state(back.state.p, rot_z(yaw), q_folded)
    fold = plan_free_edge(
        prob, back.state, folded.p, folded.R, folded.q, _fold_law(search, folded.q, back.state.q),
        lim.margin_transit,
    )  # fmt: skip
    if fold.failure is not None:
        return {}, search_message(search, fold.failure)
    way, message = _fly(search, np.array([*folded.p, yaw]), home, q_folded)
    if not way:
        return {}, message
    return {"leave": [lift, back], "fold": [fold], "return": way}, ""


def _fly(search: _Search, a: Array, b: Array, q: Array) -> tuple[list[Edge], str]:
    """Free flight with the arm at `q`, resting at each way-point."""
    prob, lim = search.prob, search.prob.limits
    # as much room as there is: the robot drifts while it flies
    for margin in (lim.margin_wanted, 0.5 * lim.margin_wanted, lim.margin_transit):
        transit = plan_transit(prob, a, b, q, max(margin, lim.margin_transit), search.rng)
        search.nodes += transit.nodes
        if transit.failure is None or search.late():
            break
    if transit.failure is not None:
        return [], search_message(search, transit.failure)
    edges: list[Edge] = []
    state = build_state(transit.poses[0, :3], rot_z(transit.poses[0, 3]), q)
    for pose in transit.poses[1:]:
        law = build_transit_law(state, pose, lim)
        edge = plan_free_edge(
            prob, state, pose[:3], rot_z(pose[3]), state.q, law, 0.98 * lim.margin_transit
        )
        if edge.failure is not None:
            return [], search_message(search, edge.failure)
        edges.append(edge)
        state = build_state(pose[:3], rot_z(pose[3]), q)
    return edges, ""


def build_transit_law(state: State, pose: Array, lim: Limits) -> TimeLaw:
    """Return the law of the slower of translation and turning, as a law over its own length."""
    length = float(np.linalg.norm(pose[:3] - state.p))
    turn = abs(wrap(pose[3] - math.atan2(state.R[1, 0], state.R[0, 0])))
    move = build_time_law(length, lim.speed, lim.acceleration)
    spin = build_time_law(turn, lim.yaw_rate, lim.yaw_acceleration)
    return move if move.duration >= spin.duration else spin


def compute_depth(mass: float, bandwidth: float, force: float) -> float:
    """Return the depth (m) at which position stiffness mass * bandwidth^2 gives `force` (N)."""
    return force / (mass * bandwidth**2)


def compute_nominal_tip(model: NDArray[Any], state: State) -> Array:
    """Return the tip's position (3,) in W at a configuration."""
    nj = int(model[0]["n_joints"])
    p_BT, _ = compute_tip(model, state.q[:nj])
    return state.p + state.R @ p_BT
