"""Free flight in three dimensions between two configurations, platform and arms together.

One planner serves the paths of all missions. Its only input is the simulated scene, so it works for
any robot and world. The platform moves in x, y, z and yaw; the arms move in synchrony from the
posture at the start to the one at the goal (one more coordinate). If this gives no path, every
joint has its own coordinate.
"""

import itertools
import math
import time
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.user_code import njit
from skywright.models.kinematic_tree import PlanningScene
from skywright.models.self_contact import find_self_contact
from skywright.planning.motion.cost import path_cost
from skywright.planning.motion.edges import pair_distance, place_shapes
from skywright.planning.motion.improve import drop_corners
from skywright.planning.motion.kinematics import fill_motion
from skywright.planning.motion.pairs import PAIR_LIMIT, PAIR_SELF, PAIR_WORLD
from skywright.planning.motion.planner import Path, check_state, plan_path, sample_reserve
from skywright.planning.motion.space import (
    JOINT0,
    YAW,
    Coordinate,
    Scratch,
    Space,
    build_scratch,
    build_space,
)
from skywright.planning.problem import BETWEEN_PARTS

ROOM = 2.0
"""m around start, goal and obstacles that a path may use."""
SLICES = 24
"""Number of slices of work before the cheapest path is returned: repeatable without a clock."""
STEP = 0.01  # m of cost (6), between the samples of the reported clearance
STILL = 1e-6  # rad, below which a joint does not move
CORNER = 0.8
UNCHECKED = -1e3  # m, margin of a pair that is not checked
SLACK = 0.01
"""m, by which parts that are close at an end may come closer on the path. Where the distance is
constant, an interval of the edge check covers at most this motion."""
TOUCH_Q = 0.01  # rad, sum over the joints, between the postures checked for contact of parts


class Configuration(NamedTuple):
    """Configuration of the robot: level platform, joints at rest."""

    p_WB: Array  # (3,) m
    yaw: float
    q: Array  # (nj,) rad; the value of a passive joint is not used


class Transit(NamedTuple):
    """Waypoints from start to goal, connected by straight lines, or what blocks the path."""

    p_WB: Array  # (m, 3) m; empty: none
    yaw: Array  # (m,) rad, unwrapped
    q: Array  # (m, nj) rad
    cost: float  # of (6)
    clearance: float  # m, smallest distance to obstacles on the path
    blocked_by: str | None
    plan_s: float


def plan_transit(
    scene: PlanningScene,
    start: Configuration,
    goal: Configuration,
    rng: np.random.Generator,
    margin: float = 0.1,
    *,
    key: str = "",
    margin_self: float = 0.02,
    wanted: float = 0.0,
    passive: str | None = None,
    low_z: float = 0.0,
    slices: int = SLICES,
) -> Transit:
    """Plan from `start` to `goal`, `margin` (m) from world and ground, no lower than `low_z` (m).

    `key` names the input that sets the margin; the robot's parts keep `margin_self` (m) apart.
    Parts that are closer than that at an end come at most `SLACK` closer on the path, or any closer
    if the cores of their shapes are within `SLACK`; they do not touch.

    If possible, the path keeps `wanted` (m) or half of it, except at corners: a corner is removed
    if the rest keeps `CORNER` of it, because a flight slows down at each corner. `passive` names a
    joint without a motor, which is in static equilibrium. The same `rng` gives the same path on
    every machine. Does not raise for an impossible path: `blocked_by` states what blocks it.
    """
    began = time.perf_counter()
    turn = math.remainder(goal.yaw - start.yaw, 2.0 * math.pi)
    goal = goal._replace(yaw=start.yaw + turn)
    driven = [j for j, name in enumerate(scene.joints) if name != passive]
    moving = [j for j in driven if abs(goal.q[j] - start.q[j]) > STILL]
    joints = len(scene.joints)

    def refuse(why: str) -> Transit:
        none = np.zeros((0, 3 + joints))
        return Transit(
            none[:, :3], none[:, 0], none[:, 3:], math.inf, math.nan, why,
            time.perf_counter() - began,
        )  # fmt: skip

    for keep in sorted({max(wanted, margin), max(wanted / 2, margin), margin}, reverse=True):
        space, ends = _build_blend(scene, start, goal, moving, keep, margin_self, passive, low_z)
        for name, end in zip(("start", "goal"), ends, strict=True):
            touch = _find_touch(scene, space, end[None])
            if touch:
                return refuse(f"{name}: {touch} of the robot touch")
        path = plan_path(space, ends[0], ends[1], rng, slices=slices)
        if len(path.rows):
            break
    touch = _find_touch(scene, space, path.rows)
    if path.blocked < 0 and (touch or not len(path.rows)) and driven:
        keep = margin
        space, ends = _build_free(scene, start, goal, driven, margin, margin_self, passive, low_z)
        path = plan_path(space, ends[0], ends[1], rng, slices=slices)
        touch = _find_touch(scene, space, path.rows)
    if path.blocked >= 0:
        return refuse(describe_blocked(space, scene, ends, path.blocked, key))
    if not len(path.rows):
        often = describe_pair(space, scene, int(np.argmax(path.hits)), key, margin_self)
        return refuse(f"no path found; most frequent obstacle: {often}")
    rows, cost = path.rows, path.cost
    short, lower = _shorten(space, path, max(margin, CORNER * keep))
    # if parts touch on the shorter path, the corners lead one part around another
    if len(short) < len(rows) and not _find_touch(scene, space, short):
        rows, cost, touch = short, lower, ""
    if touch:
        return refuse(f"no path found; most frequent obstacle: {touch} of the robot touch")
    u = space[0]["offset"] + rows @ space[0]["map"][:, : rows.shape[1]].T
    return Transit(
        u[:, :3], u[:, YAW], u[:, JOINT0 : JOINT0 + joints], cost,
        measure_clearance(space, rows)[0], None, time.perf_counter() - began,
    )  # fmt: skip


def _shorten(space: Space, path: Path, margin: float) -> tuple[Array, float]:
    """Remove the corners that `margin` (m) does not require; return rows and cost."""
    looser = space.copy()
    kept = space[0]["margin"]
    own = space[0]["pairs"][:, 2] == PAIR_SELF
    looser[0]["margin"] = np.where(own, kept, np.minimum(kept, margin))
    rows = path.rows.copy()
    if len(rows) <= 2:
        return rows, path.cost
    count, cost = _drop(looser, build_scratch(space), rows)
    return rows[:count], float(cost)


def measure_clearance(space: Space, rows: Array, step: float = STEP) -> tuple[float, int]:
    """Return the smallest distance (m) on a path to anything except the robot itself, and its pair.

    Without anything else, the distance is infinite and the pair is -1.
    `rows` (m, n) are the path's coordinates, `step` is the spacing in cost (6) of the samples.
    """
    bare = space.copy()
    bare[0]["margin"] = np.where(space[0]["pairs"][:, 2] == PAIR_SELF, UNCHECKED, 0.0)
    distance, pair = sample_reserve(bare, build_scratch(space), rows, step)
    return (float(distance), int(pair)) if pair >= 0 else (math.inf, -1)


@njit(cache=True, error_model="numpy")
def _drop(space: Space, scratch: Scratch, rows: Array) -> tuple[int, float]:
    count = drop_corners(space[0], rows, rows.shape[0], scratch[0])
    return count, path_cost(space[0], rows, count)


def _build_blend(
    scene: PlanningScene, start: Configuration, goal: Configuration, moving: list[int],
    margin: float, margin_self: float, passive: str | None, low_z: float,
) -> tuple[Space, Array]:  # fmt: skip
    """Build the space with one coordinate that moves the arms from start to goal posture."""
    coordinates = _platform(scene, start, goal, low_z)
    ends = [[*start.p_WB, start.yaw], [*goal.p_WB, goal.yaw]]
    if moving:
        names = tuple(scene.joints[j] for j in moving)
        gains = tuple(float(goal.q[j] - start.q[j]) for j in moving)
        coordinates.append(Coordinate("arms", names, 0.0, 1.0, gains))
        ends[0].append(0.0)
        ends[1].append(1.0)
    fixed = {name: float(start.q[j]) for j, name in enumerate(scene.joints)}
    return _excuse_ends(scene, coordinates, fixed, np.array(ends), margin, margin_self, passive)


def _build_free(
    scene: PlanningScene, start: Configuration, goal: Configuration, driven: list[int],
    margin: float, margin_self: float, passive: str | None, low_z: float,
) -> tuple[Space, Array]:  # fmt: skip
    """Build the space in which every joint with a motor moves independently."""
    coordinates = _platform(scene, start, goal, low_z)
    for j in driven:
        low = min(float(scene.q_min[j]), float(start.q[j]), float(goal.q[j])) - STILL
        high = max(float(scene.q_max[j]), float(start.q[j]), float(goal.q[j])) + STILL
        coordinates.append(Coordinate(scene.joints[j], (scene.joints[j],), low, high))
    ends = np.array([[*c.p_WB, c.yaw, *np.asarray(c.q)[driven]] for c in (start, goal)])
    return _excuse_ends(scene, coordinates, {}, ends, margin, margin_self, passive)


def _platform(
    scene: PlanningScene, start: Configuration, goal: Configuration, low_z: float
) -> list[Coordinate]:
    w = scene.world
    reach = w.radius[:, None] + np.einsum("nij,nj->ni", np.abs(w.rot), w.half)
    points = np.vstack(
        [start.p_WB, goal.p_WB, w.p0 - reach, w.p1 - reach, w.p0 + reach, w.p1 + reach]
    )
    low, high = points.min(axis=0) - ROOM, points.max(axis=0) + ROOM
    low[2] = max(low[2], min(low_z, float(start.p_WB[2]), float(goal.p_WB[2])))
    out = [Coordinate("xyz"[i], ("xyz"[i],), float(low[i]), float(high[i])) for i in range(3)]
    yaws = sorted((start.yaw, goal.yaw))
    return [*out, Coordinate("yaw", ("yaw",), yaws[0] - math.pi, yaws[1] + math.pi)]


def _excuse_ends(
    scene: PlanningScene, coordinates: list[Coordinate], fixed: dict[str, float], ends: Array,
    margin: float, margin_self: float, passive: str | None,
) -> tuple[Space, Array]:  # fmt: skip
    """Build the space; parts of the robot that are close at an end may be closer on the path.

    Shapes are coarse: the platform is one box, and a folded arm may lie inside it. `_find_touch`
    checks the path of such parts.
    """
    space = build_space(
        scene, coordinates, fixed, margin=margin, margin_self=margin_self, passive=passive,
        area=scene.area,
    )  # fmt: skip
    for end in ends:
        _lower_margins(space, build_scratch(space), end)
    return space, ends


@njit(cache=True, error_model="numpy")
def _lower_margins(spaces: Space, scratch: Scratch, c: Array) -> None:
    """Lower the margins of the robot's parts that are closer at c, to `SLACK` below that.

    Parts whose cores are within `SLACK` are not checked: if the axis of a link is inside a box, the
    distance is minus the radius at every depth.
    """
    space, k = spaces[0], scratch[0]
    k.d[:] = 0.0
    place_shapes(space, c, k.d, k)
    for i in range(space.n_pairs):
        if space.pairs[i, 2] == PAIR_SELF:
            distance = pair_distance(space, k, i)
            if distance < space.margin[i]:
                overlap = space.s_radius[space.pairs[i, 0]] + space.s_radius[space.pairs[i, 1]]
                low = distance - SLACK
                space.margin[i] = low if low > -overlap else UNCHECKED


def _find_touch(scene: PlanningScene, space: Space, rows: Array) -> str:
    """Return the names of two parts of the robot that touch on a path (m, n); "" if none do.

    The simulated scene has the exact shapes, and pairs that the planner's coarse shapes lack, such
    as first links with propellers. It is checked in postures `TOUCH_Q` apart.
    """
    if not len(rows):
        return ""
    joints = space[0]["map"][JOINT0:, : rows.shape[1]]
    samples = [rows[:1]]
    for a, b in itertools.pairwise(rows):
        turn = float(np.sum(np.abs(joints @ (b - a))))
        steps = np.arange(1, max(math.ceil(turn / TOUCH_Q), 1) + 1)[:, None]
        samples.append(a + steps / len(steps) * (b - a))
    c = np.vstack(samples)
    u = np.zeros((len(c), int(space[0]["nu"])))
    fill_motion(space, build_scratch(space), c, np.zeros_like(c), u, np.zeros_like(u))
    return find_self_contact(scene.contacts, u[:, JOINT0:])


def describe_blocked(
    space: Space, scene: PlanningScene, ends: Array, blocked: int, key: str
) -> str:
    """Return which of the `ends` (2, n) is blocked, by the nearest obstacle if there is one.

    `blocked` is the pair that the search found; two parts of the robot if no obstacle is too near.
    """
    k = int(check_state(space, ends[0], build_scratch(space)))
    near, nearest = measure_clearance(space, ends[[k, k]])
    end, margins = ("start", "goal")[k], space[0]["margin"]
    if nearest >= 0 and near < margins[nearest]:
        return f"{end}: {describe_pair(space, scene, nearest, key, distance=near)}"
    return f"{end}: {describe_pair(space, scene, blocked, key)}"


def describe_pair(
    space: Space, scene: PlanningScene, pair: int, key: str, margin_self: float = 0.0,
    distance: float | None = None,
) -> str:  # fmt: skip
    """Return which two things are closer than their margin, which `key` sets.

    Parts of the robot with a margin below `margin_self` (m) are those that are close at an end.
    `distance` (m) between the two is stated if it is given.
    """
    a, b, kind = (int(x) for x in space[0]["pairs"][pair])
    names = [*scene.names, "bar"]  # the carried bar comes last
    margin = float(space[0]["margin"][pair])
    if kind == PAIR_WORLD:
        other = scene.world_names[b]
    elif kind == PAIR_LIMIT:
        other = "the ground" if b == 4 else f"the area's limit in {'xyz'[b // 2]}"
    else:
        other, key = names[b], f"twice {BETWEEN_PARTS}: shapes are coarse"
    both = f"{names[a].removesuffix(' shell')} and {other}"
    if kind == PAIR_SELF and margin < margin_self:
        return f"{both} more than {100 * SLACK:.0f} cm closer than at the start or the goal"
    required = f"{margin:.3g} m" + (f" ({key})" if key else "")
    if distance is None:
        return f"{both} closer than {required}"
    if distance <= 0.0:
        gap = "overlap" if kind == PAIR_WORLD else f"overlap by {-distance:.3f} m"
    elif distance < 0.001:
        gap = "are less than 1 mm apart"
    else:
        gap = f"are {math.floor(1e3 * distance) / 1e3:.3f} m apart"
    return f"{both} {gap}; required distance: {required}"
