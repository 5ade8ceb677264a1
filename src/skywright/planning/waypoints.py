"""Waypoint flights from rest to rest: straight if collision-free, otherwise around obstacles."""

import math
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.world.surface import Cylinder
from skywright.models.geometry import ClearanceQuery
from skywright.models.kinematic_tree import PlanningScene
from skywright.planning.flight import build_rest, build_transit_law, plan_legs
from skywright.planning.inverse_dynamics import Loads
from skywright.planning.inverse_kinematics import build_state
from skywright.planning.local_planner import Edge, join_edges, plan_free_edge
from skywright.planning.motion.transit import Configuration, plan_transit
from skywright.planning.problem import CLEARANCE, IN_FLIGHT, Limits, build_problem, describe_failure

INSIDE = 0.98
"""Fraction of the margin of a detour: the legs are checked at discrete instants."""


class WaypointPlan(NamedTuple):
    """Segments "waypoint 1", "waypoint 2", ... (each ends with its rest), or why there are none."""

    feasible: bool
    blocked_by: str | None
    segments: dict[str, NDArray[Any]]  # REFERENCE rows, each segment's time from 0
    plan_s: float
    duration_s: float
    min_clearance_m: float
    min_rotor_margin: float


def plan_waypoints(
    model: NDArray[Any],
    loads: Loads,
    query: ClearanceQuery,
    cylinder: Cylinder,
    limits: Limits,
    start: Array,
    poses: Array,
    rests: Array,
    q_folded: Array,
    scene: PlanningScene,
    rng: np.random.Generator,
    joints: tuple[str, ...] = (),
    passive: str | None = None,
) -> WaypointPlan:
    """Plan flights from `start` (4,) through `poses` (n, 4), resting `rests` (n,) s at each.

    Poses are (x, y, z, yaw). The arm is at `q_folded` at each. The margin in transit applies; a
    detour keeps a larger one if possible. `passive` names a joint without a motor.
    """
    began = time.perf_counter()
    prob = build_problem(model, loads, query, cylinder, limits, 0.0)
    state = build_state(start[:3], rot_z(start[3]), q_folded)
    segments: dict[str, NDArray[Any]] = {}
    clearance, margin, duration = math.inf, math.inf, 0.0
    blocked: str | None = None
    for i, (pose, rest) in enumerate(zip(poses, rests, strict=True)):
        law = build_transit_law(state, pose, limits)
        edge = plan_free_edge(
            prob, state, pose[:3], rot_z(pose[3]), state.q, law, limits.margin_transit
        )
        edges: list[Edge] = [edge]
        failure = edge.failure
        if failure is not None and failure.code == CLEARANCE:
            yaw = math.atan2(state.R[1, 0], state.R[0, 0])
            way = plan_transit(
                scene, Configuration(state.p, yaw, q_folded),
                Configuration(pose[:3], float(pose[3]), q_folded), rng,
                limits.margin_transit / INSIDE, key=IN_FLIGHT,
                margin_self=limits.margin_shapes, wanted=limits.margin_wanted, passive=passive,
                low_z=limits.ground,
            )  # fmt: skip
            if way.blocked_by is not None:
                blocked = f"way-point {i + 1}: {way.blocked_by}"
                break
            edges, failure = plan_legs(prob, way, limits.margin_transit)
        if failure is not None:
            why = describe_failure(failure, query, joints, model)
            blocked = f"way-point {i + 1}: {why}"
            break
        if rest > 0.0:
            edges.append(build_rest(edges[-1], -1, rest))
        rows, trace = join_edges(edges)
        segments[f"waypoint {i + 1}"] = rows
        clearance = min(clearance, float(trace["clearance"].min()))
        margin = min(margin, float(trace["rotor_margin"].min()))
        duration += float(rows["t"][-1])
        state = build_state(pose[:3], rot_z(pose[3]), q_folded)
    return WaypointPlan(
        blocked is None, blocked, segments if blocked is None else {}, time.perf_counter() - began,
        duration if blocked is None else math.nan,
        clearance if math.isfinite(clearance) else math.nan,
        margin if math.isfinite(margin) else math.nan,
    )  # fmt: skip
