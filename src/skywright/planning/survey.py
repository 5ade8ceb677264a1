"""Places at which a surface is touched before the work, and the path between them."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.models.geometry import leave_out
from skywright.planning.inverse_kinematics import State
from skywright.planning.local_planner import Edge, plan_surface_edge
from skywright.planning.patterns import Pattern, build_time_law
from skywright.planning.via_points import Search

ROUND = 3
"""Number of touches around the pipe on each of the two rings at the ends of the pattern."""
SAME = 1e-4  # m, rad: closer points are merged


class SurveyTask(NamedTuple):
    """Places of the touches, and the largest depth of the desired tip on the map."""

    points: Array  # (n, 2) s m, phi rad
    beyond: float  # m inside the map's surface
    press: float  # m inside the true surface, at most


def choose_points(corners: Array) -> Array:
    """Return (n, 2) places (s, phi) that span the pattern with these corners, in flying order."""
    (s_lo, phi_lo), (s_hi, phi_hi) = corners.min(axis=0), corners.max(axis=0)
    phis = np.linspace(phi_hi, phi_lo, ROUND)
    if phi_hi - phi_lo < SAME:  # a line along the pipe: more rings instead of more angles
        return np.array([[s, phi_lo] for s in np.linspace(s_lo, s_hi, ROUND)])
    first, second = (s_lo, s_hi) if corners[0, 0] - s_lo <= s_hi - corners[0, 0] else (s_hi, s_lo)
    return np.array([[first, p] for p in phis] + [[second, p] for p in phis[::-1]])


def plan_survey(
    search: Search, state: State, corner: Array, task: SurveyTask, away: float
) -> tuple[dict[str, list[Edge]], str | None]:
    """Move from `state`, off the surface over `corner`, from point to point; then `away` (m) off.

    Each touch is planned as well: a point at which the robot cannot press is rejected. The pipe
    stops the tip wherever it is, so the clearance from it is checked down to the press depth, and
    that from everything else down to `beyond`. Returns "survey 1", ... (the first may be missing if
    the robot is there already) and "survey leave", or what blocks them.
    """
    scan, lim = search.task, search.prob.limits
    free = search.prob._replace(clearance=leave_out(search.query, "pipe"))
    aloft = scan._replace(
        pattern=Pattern(task.points, None), depth=-scan.stand_off, dead_zone=0.0,
        speed=scan.close_speed,
    )  # fmt: skip
    over = Search(
        search.prob, search.query, search.scene, aloft, search.joints, search.q_working,
        search.rng, search.deadline,
    )  # fmt: skip
    edges: dict[str, list[Edge]] = {}
    at = np.asarray(corner, float)
    for i, point in enumerate(task.points):
        if np.max(np.abs(point - at)) > SAME:
            moves, failure = over.reach(state, at, point)
            if failure is not None:
                return {}, f"survey: {search.explain(failure)}"
            edges[f"survey {i + 1}"] = [m.edge for m in moves]
            state, at = moves[-1].edge.state, point
        yaw, touched = math.atan2(state.R[1, 0], state.R[0, 0]), state
        ends = (scan.stand_off, -task.press, -task.beyond)
        for prob, gap, end in zip((search.prob, free), ends, ends[1:], strict=False):
            law = build_time_law(gap - end, scan.touch_speed, lim.acceleration / 4, 0.5)
            touch = plan_surface_edge(
                prob, touched, _at(point, gap), _at(point, end), law, yaw, state.q, True,
                scan.dead_zone,
            )  # fmt: skip
            if touch.failure is not None:
                return {}, f"survey: {search.explain(touch.failure)}"
            touched = touch.state
    law = build_time_law(away - scan.stand_off, scan.close_speed, lim.acceleration / 2, 0.5)
    leave = plan_surface_edge(
        search.prob, state, _at(at, scan.stand_off), _at(at, away), law,
        math.atan2(state.R[1, 0], state.R[0, 0]), state.q, True, 0.0,
    )  # fmt: skip
    if leave.failure is not None:
        return {}, f"survey: {search.explain(leave.failure)}"
    return {**edges, "survey leave": [leave]}, None


def _at(point: Array, gap: float) -> Array:
    return np.array([point[0], point[1], gap])
