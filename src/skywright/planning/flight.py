"""Elements of every flight: time laws between poses, rests, straight free flights."""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.models.kinematic_tree import PlanningScene
from skywright.planning.inverse_kinematics import State, build_state, wrap
from skywright.planning.local_planner import ROW, Edge, plan_free_edge
from skywright.planning.motion.transit import Configuration, Transit, plan_transit
from skywright.planning.patterns import TimeLaw, build_time_law
from skywright.planning.problem import IN_FLIGHT, Failure, Limits, Problem


def build_transit_law(state: State, pose: Array, lim: Limits) -> TimeLaw:
    """Return the fastest law over a length of 1 within the limits of translation and rotation."""
    length = float(np.linalg.norm(pose[:3] - state.p))
    turn = abs(wrap(pose[3] - math.atan2(state.R[1, 0], state.R[0, 0])))
    ways = [(length, lim.speed, lim.acceleration), (turn, lim.yaw_rate, lim.yaw_acceleration)]
    ways = [way for way in ways if way[0] > 1e-9]
    if not ways:
        return build_time_law(0.0, lim.speed, lim.acceleration)
    return build_time_law(1.0, min(v / x for x, v, _ in ways), min(a / x for x, _, a in ways))


def build_rest(edge: Edge, at: int, duration: float) -> Edge:
    """Return a rest at the first (0) or last (-1) row of an edge, which begins one step later."""
    count = round(duration / ROW) + 1
    rows, trace = np.repeat(edge.rows[at], count), np.repeat(edge.trace[at], count)
    rows["t"] = ROW * np.arange(count)
    for name in ("v_WB", "a_WB", "w_WB_B", "wd_WB_B", "qd", "v_WT"):
        rows[name] = 0.0
    return Edge(rows, trace, None, edge.state)


def plan_flight(
    prob: Problem, scene: PlanningScene, a: Array, b: Array, q: Array, rng: np.random.Generator
) -> tuple[list[Edge], Failure | str | None]:
    """Fly from pose a to pose b (4,), arm at `q` at both ends, resting at each waypoint.

    The clearance is as large as the scene allows, because a robot drifts in flight. Returns the
    edges and what blocks them.
    """
    lim = prob.limits
    start, goal = Configuration(a[:3], float(a[3]), q), Configuration(b[:3], float(b[3]), q)
    way = plan_transit(
        scene, start, goal, rng, lim.margin_transit, key=IN_FLIGHT, margin_self=lim.margin_shapes,
        wanted=lim.margin_wanted, low_z=lim.ground,
    )  # fmt: skip
    if way.blocked_by is not None:
        return [], way.blocked_by
    return plan_legs(prob, way, 0.98 * lim.margin_transit)


def plan_legs(prob: Problem, way: Transit, margin: float) -> tuple[list[Edge], Failure | None]:
    """Fly the waypoints of a transit, platform and arms in synchrony, with a rest at each.

    Every leg is checked like all other motions (rotors, motors, tilt, `margin` m). Returns the
    edges and what blocks them.
    """
    edges: list[Edge] = []
    lim = prob.limits
    state = build_state(way.p_WB[0], rot_z(float(way.yaw[0])), way.q[0])
    for p, yaw, q in zip(way.p_WB[1:], way.yaw[1:], way.q[1:], strict=True):
        law = build_transit_law(state, np.array([*p, yaw]), lim)
        turn = float(np.abs(q - state.q[: len(q)]).max(initial=0.0))
        fold = build_time_law(turn, lim.joint_rate, lim.joint_acceleration)
        if fold.duration > law.duration:
            law = fold
        edge = plan_free_edge(prob, state, p, rot_z(float(yaw)), q, law, margin)
        if edge.failure is not None:
            return [], edge.failure
        edges.append(edge)
        state = build_state(p, rot_z(float(yaw)), q)
    return edges, None
