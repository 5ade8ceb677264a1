"""The tree of configurations that grows through a pattern's via-points.

The first attempt for each segment is the straight one with the best-rated posture. Then come other
postures, and finally a rapidly exploring random tree over the surface (task space).
"""

import itertools
import math
import time
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.surface import surface_point
from skywright.models.geometry import ClearanceQuery
from skywright.models.kinematic_tree import PlanningScene
from skywright.planning.configurations import (
    Candidates,
    compute_headings,
    find_configurations,
    halton,
    resting,
    sample_postures,
)
from skywright.planning.inverse_kinematics import State, wrap
from skywright.planning.local_planner import Edge, plan_surface_edge
from skywright.planning.patterns import Pattern, build_time_law
from skywright.planning.problem import (
    ACCELERATION,
    MOTOR,
    SPEED,
    Failure,
    Problem,
    describe_failure,
)

SAMPLES = 48
"""Number of arm postures that are tried at each heading."""
DETOURS, STEP, ROOM = 60, 0.06, 0.12
"""Number of tree extensions for a blocked segment, their length and the space around it (m)."""


class ScanTask(NamedTuple):
    """Pattern and parameters of a scan."""

    pattern: Pattern
    speed: float = 0.01  # m/s of the tip while sliding
    depth: float = 0.03  # m of the desired tip inside the surface
    dead_zone: float = 0.045  # m
    stand_off: float = 0.05  # m
    touch_speed: float = 0.015  # m/s
    close_speed: float = 0.1  # m/s
    ramp: float = 1.0  # s, least time to reach the speed on the surface


class Slide(NamedTuple):
    """An accepted edge of the tree on the surface, with its ends (s, phi)."""

    edge: Edge
    start: Array
    end: Array


class Search:
    """One planning call: problem, sampled postures, random numbers and counters."""

    def __init__(
        self, prob: Problem, query: ClearanceQuery, scene: PlanningScene, task: ScanTask,
        joints: tuple[str, ...], q_working: Array, rng: np.random.Generator, deadline: float,
    ) -> None:  # fmt: skip
        self.prob, self.query, self.scene, self.task = prob, query, scene, task
        self.joints = joints
        self.q_working, self.rng, self.deadline = q_working, rng, deadline
        nj = int(prob.model[0]["n_joints"])
        grid = sample_postures(prob, halton(SAMPLES, nj)) if nj else np.zeros((1, 0))
        self.postures = np.vstack([q_working[None, :nj], grid]) if nj else grid
        self.configurations = self.edges = self.failed = self.attempts = 0

    def late(self) -> bool:
        return time.perf_counter() > self.deadline

    def tip(self, s: float, phi: float) -> tuple[Array, Array]:
        """Return the desired tip and the outward normal."""
        p, n = np.empty(3), np.empty(3)
        surface_point(self.prob.cylinder, s, phi, p, n)
        return p - self.task.depth * n, n

    def axis(self, phi: float) -> Array:
        """Return the direction opposite to which the probe points."""
        R = self.prob.R_WA
        return np.asarray(R[:, 2] * math.sin(phi) - R[:, 0] * math.cos(phi))

    def first(self, corner: Array) -> Candidates:
        """Return candidates at the first corner: every heading, every posture."""
        tip, n = self.tip(corner[0], corner[1])[0], self.axis(corner[1])
        yaws = compute_headings(n, self.prob.cylinder.R_WP)
        self.configurations += len(yaws) * len(self.postures)
        return find_configurations(
            self.prob, tip, n, self.task.depth, yaws, self.postures, self.q_working,
            self.q_working, 0.0, 0.0,
            (corner[0], corner[1]),
        )  # fmt: skip

    def next(self, corner: Array, state: State, wide: bool) -> Candidates:
        """Return candidates at a corner, near the configuration `state`; `wide`: other postures
        too."""
        tip, n = self.tip(corner[0], corner[1])[0], self.axis(corner[1])
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
        """Return the heading into the surface nearest to the present one, if it is defined."""
        if math.hypot(n[0], n[1]) < 0.02:
            return []
        into = math.atan2(-n[1], -n[0])
        if abs(wrap(into - yaw)) > math.pi / 2:
            into += math.pi
        return [into] if abs(wrap(into - yaw)) > 1e-3 else []

    def slide(self, state: State, a: Array, b: Array, end: State) -> Edge:
        """Slide the tip from corner a to corner b, ending in configuration `end`.

        The speed is reduced if platform or motors would be too fast at the requested speed of the
        tip.
        """
        lim, task = self.prob.limits, self.task
        length = math.hypot(b[0] - a[0], self.prob.cylinder.radius * (b[1] - a[1]))
        yaw = math.atan2(end.R[1, 0], end.R[0, 0])
        ends = [np.array([x[0], x[1], -task.depth]) for x in (a, b)]
        for share in (1.0, 0.5, 0.2):
            law = build_time_law(
                length, share * task.speed, 0.25 * share * lim.acceleration, task.ramp
            )
            edge = plan_surface_edge(
                self.prob, state, ends[0], ends[1], law, yaw, end.q, True, task.dead_zone
            )
            self.edges += 1
            self.failed += edge.failure is not None
            if edge.failure is None or edge.failure.code not in (SPEED, ACCELERATION, MOTOR):
                break
        return edge

    def grow(self, start: State) -> tuple[list[Slide], Failure | None]:
        """Grow through all via-points; return the edges with their ends, and the failure."""
        corners = self.task.pattern.corners
        done: list[Slide] = []
        state = start
        for a, b in itertools.pairwise(corners):
            step, failure = self.reach(state, a, b)
            if failure is not None:
                return done, failure
            done += step
            state = step[-1].edge.state
        return done, None

    def reach(self, state: State, a: Array, b: Array) -> tuple[list[Slide], Failure | None]:
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
                    return [Slide(edge, a, b)], None
                first = first or edge.failure
                if self.late():
                    return [], first
        anywhere = self.first(b)
        if anywhere.failure is not None:  # no configuration holds the tip there
            return [], anywhere.failure
        assert first is not None
        way = self.detour(state, a, b)
        return (way, None) if way else ([], first)

    def detour(self, state: State, a: Array, b: Array) -> list[Slide]:
        """Run a task-space RRT over the surface from a towards b; returns [] without a path."""
        tree: list[tuple[State, Array, list[Slide]]] = [(state, a, [])]
        scale = np.array([1.0, self.prob.cylinder.radius])
        half = np.array([self.prob.cylinder.half_length, math.inf])  # phi is periodic
        lo = np.maximum(np.minimum(a, b) - ROOM / scale, -half)
        hi = np.minimum(np.maximum(a, b) + ROOM / scale, half)
        for _ in range(DETOURS):
            if self.late():
                break
            sample = self.rng.uniform(lo, hi)
            far = [float(np.linalg.norm(scale * (node[1] - sample))) for node in tree]
            near = int(np.argmin(far))
            node, at, way = tree[near]
            point = at + min(1.0, STEP / far[near]) * (sample - at)
            found = self.next(point, node, True)
            if found.failure is not None:
                continue
            edge = self.slide(node, at, point, resting(found, 0))
            if edge.failure is not None:
                continue
            way = [*way, Slide(edge, at, point)]
            tree.append((edge.state, point, way))
            onward = self.next(b, edge.state, False)
            if onward.failure is None:
                last = self.slide(edge.state, point, b, resting(onward, 0))
                if last.failure is None:
                    return [*way, Slide(last, point, b)]
        return []

    def explain(self, failure: Failure | str) -> str:
        """Return the sentence of a failure; a string is returned unchanged."""
        if isinstance(failure, str):
            return failure
        return describe_failure(failure, self.query, self.joints, self.prob.model)
