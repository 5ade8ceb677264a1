"""Paths of platform and arms together: straight if collision-free, otherwise from the planner."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Table
from skywright.core.rotations import rot_z
from skywright.core.types import MAX_JOINTS
from skywright.missions.skills.moves import TURN_ACCELERATION, TURN_SPEED, set_rest
from skywright.models.compliant_arms import find_swing
from skywright.models.geometry import ClearanceQuery, compute_clearance
from skywright.models.kinematic_tree import PlanningScene
from skywright.planning.motion.transit import Configuration, plan_transit
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms_interface import compute_joints_s
from skywright.vehicle.interface import Limits
from skywright.vehicle.moves import compute_move_s
from skywright.vehicle.rest_to_rest import build_straight, duration

STEP = 0.05  # m, between clearance checks of a straight line
SAME = 1e-6  # rad, below which an angle need not move


class Way(NamedTuple):
    """Waypoints of platform and arms, start and goal included, connected by straight lines."""

    p_WB: Array  # (m, 3) m
    yaw: Array  # (m,) rad
    q: Array  # (m, n_joints) rad


class Surroundings(NamedTuple):
    """Inputs for planning a path."""

    query: ClearanceQuery
    scene: PlanningScene
    model: NDArray[Any]  # (1,) of `BodyModel`
    passive: str | None  # joint without a motor
    low_z: float  # m, lowest height of the platform's origin
    margin: float  # m, clearance from all obstacles
    key: str  # key that sets the margin
    margin_self: float  # m, clearance between parts of the robot


def build_surroundings(setup: Setup[Any], margin: float, key: str) -> Surroundings:
    """Build the inputs from the nominal scene; `key` is the key that sets the `margin` (m)."""
    passive = "pendulum" if setup.robot.pendulum is not None else None
    return Surroundings(
        setup.clearance,
        setup.planning_scene,
        setup.model,
        passive,
        setup.limits.ground,
        margin,
        key,
        setup.limits.margin_shapes,
    )


def plan_way(
    around: Surroundings, start: Configuration, goal: Configuration, rng: np.random.Generator
) -> tuple[Way, float, str | None]:
    """Return a path from start to goal, its clearance (m), and what blocks it.

    The path is a straight flight with the goal's heading and posture if that is collision-free; it
    is also returned if no path was found. `rng` is used only if the straight flight is not free.
    """
    a, b = start.p_WB, goal.p_WB
    straight = Way(np.array([a, b]), np.full(2, goal.yaw), np.array([goal.q, goal.q]))
    room, _ = check_line(around.query, a, b, rot_z(goal.yaw), goal.q)
    if room >= around.margin:
        return straight, room, None
    found = plan_transit(
        around.scene, start, goal, rng, around.margin, wanted=2 * around.margin,
        key=around.key, margin_self=around.margin_self, passive=around.passive,
        low_z=around.low_z,
    )  # fmt: skip
    if found.blocked_by is not None:
        return straight, room, found.blocked_by
    q = np.array([find_swing(around.model, row) for row in found.q])
    return Way(found.p_WB, found.yaw, q), found.clearance, None


def check_line(query: ClearanceQuery, a: Array, b: Array, R: Array, q: Array) -> tuple[float, str]:
    """Return the least distance (m) along a straight flight, and the pair of geometries."""
    least, what = math.inf, ""
    for u in np.linspace(0.0, 1.0, max(math.ceil(float(np.linalg.norm(b - a)) / STEP), 1) + 1):
        found = compute_clearance(query, a + u * (b - a), R, q)
        if found.distance < least:
            least = found.distance
            what = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
    return least, what


def reverse_way(way: Way) -> Way:
    """Return the path in reverse."""
    return Way(*(x[::-1] for x in way))


def differs(s: Supervisor, q: Array) -> bool:
    """Return whether the arms' reference differs from q (n_joints,) rad."""
    return float(np.max(np.abs(q - s.vehicle.reference["q"][: len(q)]))) > SAME


def fly_way(s: Supervisor, way: Way, share: float) -> None:
    """Fly a path with a fraction of the limits, at rest at each waypoint, with the arms in
    synchrony."""
    for p, yaw, q in zip(way.p_WB[1:], way.yaw[1:], way.q[1:], strict=True):
        if share == 1.0 and not differs(s, q):
            s.uav.go_to(p, yaw)
        else:
            s.body.track(slide_platform(s, p, share, yaw, q))
        s.until_arrived()


def compute_slide_s(
    limits: Limits, share: float, distance: float, turn: float = 0.0, bend: float = 0.0
) -> float:
    """Return the duration (s) of `slide_platform` by a distance (m), a turn and a bend (rad)."""
    return max(
        duration(distance, share * limits.speed, share * limits.acceleration),
        duration(abs(turn), share * TURN_SPEED, share * TURN_ACCELERATION),
        compute_joints_s(np.array([bend])),
        1.0,
    )


def compute_way_s(way: Way, limits: Limits, share: float, yaw: float, q: Array) -> float:
    """Return the duration (s) of `fly_way` from the heading `yaw` (rad) with the arms at q."""
    total = 0.0
    points = zip(way.p_WB, way.p_WB[1:], way.yaw[1:], way.q[1:], strict=False)
    for here, there, heading, pose in points:
        distance, turn = (
            float(np.linalg.norm(there - here)),
            math.remainder(heading - yaw, math.tau),
        )
        bend = float(np.max(np.abs(pose - q)))
        if share == 1.0 and bend <= SAME:
            total += compute_move_s(distance, turn, limits)
        else:
            total += compute_slide_s(limits, share, distance, turn, bend)
        yaw, q = heading, pose
    return total


def slide_platform(
    s: Supervisor, p: Array, share: float, yaw: float | None = None, q: Array | None = None
) -> Table:
    """Move the platform to p (3,) m with a fraction of its limits; the hands keep their task.

    With `yaw` (rad) it turns, with `q` (n_joints,) rad the joints move, in synchrony.
    """
    start = set_rest(s.vehicle.reference)
    delta = p - start["p_WB"]
    turn, joints = 0.0, np.zeros(MAX_JOINTS)
    if yaw is not None:
        turn = math.remainder(yaw - math.atan2(start["R_WB"][1, 0], start["R_WB"][0, 0]), math.tau)
    if q is not None:
        joints[: len(q)] = q - start["q"][: len(q)]
    limits, distance = s.vehicle.limits, float(np.linalg.norm(delta))
    bend = float(np.max(np.abs(joints)))
    total = compute_slide_s(limits, share, distance, turn, bend)
    move = build_straight(start, start, delta, total)
    if abs(turn) > SAME:
        move.table["R_WB"] = np.array([rot_z(s * turn) for s in move.s]) @ start["R_WB"]
        move.table["w_WB_B"][:, 2] = move.ds * turn
        move.table["wd_WB_B"][:, 2] = move.dds * turn
    if bend > SAME:
        move.table["q"] += move.s[:, None] * joints
        move.table["qd"] = move.ds[:, None] * joints
    return move.table
