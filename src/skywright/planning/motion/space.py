"""The configuration space of a planner, defined by data.

Coordinates c (n,) drive the platform and the joints linearly: (x, y, z, yaw, q) = offset + map c.
The first `n_move` coordinates are the platform's translations (m), the others angles (rad). One
coordinate may drive several joints, such as those of both arms of a robot that hold one bar. A
passive joint is not driven: it follows the static equilibrium of its load, with a level platform.

Bounds on the motion of any point for a change of c are part of the data; they make the edge checks
rigorous.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Mask
from skywright.core.record import Array, Integers, Mat3, Record, Vec3
from skywright.errors import InputError
from skywright.models.kinematic_tree import (
    CAPSULE,
    SLIDE,
    PlanningScene,
    Shapes,
    Tree,
    build_shapes,
)
from skywright.planning.motion.pairs import PAIR_SELF, drop_beside, list_ancestors, list_pairs

X, Y, Z, YAW = range(4)
"""Rows of `map` before the joints."""
JOINT0 = 4


MAX_COORDINATES = 16
MAX_BODIES = 16
MAX_SHAPES = 24
MAX_OBSTACLES = 96
MAX_PAIRS = MAX_SHAPES * (MAX_OBSTACLES + 6) + MAX_SHAPES * (MAX_SHAPES - 1) // 2
"""Pairs of each shape with each obstacle, with six limits of the area, and with other shapes."""
MAX_U = 16

f8, i8 = np.float64, np.int64


class SpaceRecord(Record):
    """A configuration space for compiled code, as arrays of one record."""

    n: int  # coordinates
    n_move: int  # translations among them
    nb: int  # bodies
    ns: int  # shapes of the robot and what it carries
    nw: int  # obstacles
    n_pairs: int
    nu: int  # 4 + joints
    passive: int  # body of the passive joint, -1: none
    # coordinates
    offset: Annotated[Array, MAX_U]
    map: Annotated[Array, MAX_U, MAX_COORDINATES]
    low: Annotated[Array, MAX_COORDINATES]
    high: Annotated[Array, MAX_COORDINATES]
    weight: Annotated[Array, MAX_COORDINATES]  # in cost (6): p1, or p2 times the driven joints
    # the tree, see models.kinematic_tree.Tree
    parent: Annotated[Integers, MAX_BODIES]
    kind: Annotated[Integers, MAX_BODIES]
    joint: Annotated[Integers, MAX_BODIES]
    pos: Annotated[Array, MAX_BODIES, 3]
    rot: Annotated[Array, MAX_BODIES, 3, 3]
    axis: Annotated[Array, MAX_BODIES, 3]
    mass: Annotated[Array, MAX_BODIES]
    com: Annotated[Array, MAX_BODIES, 3]
    # shapes of the robot, see models.kinematic_tree.Shapes
    s_body: Annotated[Integers, MAX_SHAPES]
    s_kind: Annotated[Integers, MAX_SHAPES]
    s_p0: Annotated[Array, MAX_SHAPES, 3]
    s_p1: Annotated[Array, MAX_SHAPES, 3]
    s_rot: Annotated[Array, MAX_SHAPES, 3, 3]
    s_half: Annotated[Array, MAX_SHAPES, 3]
    s_radius: Annotated[Array, MAX_SHAPES]
    # obstacles
    w_kind: Annotated[Integers, MAX_OBSTACLES]
    w_p0: Annotated[Array, MAX_OBSTACLES, 3]
    w_p1: Annotated[Array, MAX_OBSTACLES, 3]
    w_rot: Annotated[Array, MAX_OBSTACLES, 3, 3]
    w_half: Annotated[Array, MAX_OBSTACLES, 3]
    w_radius: Annotated[Array, MAX_OBSTACLES]
    # bounds
    reach: Annotated[Array, MAX_SHAPES]  # m, chain from the platform's origin to a shape's far end
    chain: Annotated[Integers, MAX_SHAPES, MAX_BODIES]  # 1: the body is between platform and shape
    moment: Annotated[Array, MAX_BODIES]  # kg m, mass beyond a joint times its largest distance
    moment_min: float  # kg m, smallest first moment about the passive joint
    bound: Annotated[Array, MAX_SHAPES]  # m, radius about its middle that contains it
    # pairs of shapes whose distance is checked
    pairs: Annotated[Integers, MAX_PAIRS, 3]  # robot's shape, other, kind of pair
    margin: Annotated[Array, MAX_PAIRS]  # m
    area: Annotated[Array, 3, 2]  # m, limits of every shape's surface, before the margin


Space = NDArray[Any]


class ScratchRecord(Record):
    """Working memory of the checks, one per thread."""

    # poses of the bodies and their velocities along an edge (per unit of s)
    u: Annotated[Array, MAX_U]
    du: Annotated[Array, MAX_U]
    p: Annotated[Array, MAX_BODIES, 3]  # m, in W
    R: Annotated[Array, MAX_BODIES, 3, 3]
    v: Annotated[Array, MAX_BODIES, 3]  # m, of the body's origin
    w: Annotated[Array, MAX_BODIES, 3]  # rad, in W
    # shapes in W: ends, middle, and their velocities
    p0: Annotated[Array, MAX_SHAPES, 3]
    p1: Annotated[Array, MAX_SHAPES, 3]
    mid: Annotated[Array, MAX_SHAPES, 3]
    v0: Annotated[Array, MAX_SHAPES, 3]
    v1: Annotated[Array, MAX_SHAPES, 3]
    vm: Annotated[Array, MAX_SHAPES, 3]
    box: Annotated[Array, MAX_SHAPES, 3, 3]  # axes of boxes
    omega: Annotated[Array, MAX_SHAPES]  # rad, bound on the rotation of a shape
    acc: Annotated[Array, MAX_SHAPES]  # m, bound on the second derivative of its points
    # of the edge check
    active: Annotated[Integers, MAX_PAIRS]
    stack: Annotated[Array, 64, 3]
    c: Annotated[Array, MAX_COORDINATES]
    d: Annotated[Array, MAX_COORDINATES]
    normal: Vec3
    blocked: int  # pair that blocked the last check
    local: Mat3
    turn: Mat3
    a3: Vec3
    r3: Vec3
    x3: Vec3
    y3: Vec3


Scratch = NDArray[Any]


def build_scratch(space: Space) -> Scratch:
    """Allocate the working memory of the checks of one space."""
    scratch = np.zeros(1, ScratchRecord.dtype)
    scratch[0]["active"] = np.arange(MAX_PAIRS)
    return scratch


class Coordinate(NamedTuple):
    """One coordinate: the quantities that it drives ("x", "y", "z", "yaw" or joint names), its
    range."""

    name: str
    drives: tuple[str, ...]
    low: float
    high: float
    gains: tuple[float, ...] = ()
    """Motion of each driven quantity per unit of the coordinate; empty: 1."""


class Carried(NamedTuple):
    """A straight bar held by the hands, across the robot: along y of the body that holds it."""

    bodies: tuple[str, ...]  # hands that hold it, at their origins
    length: float  # m
    radius: float  # m
    mass: float  # kg


def build_space(
    scene: PlanningScene,
    coordinates: Sequence[Coordinate],
    fixed: dict[str, float],
    *,
    margin: float,
    area: Array | None = None,
    passive: str | None = None,
    carried: Carried | None = None,
    margin_self: float = 0.02,
    p1: float = 1.0,
    p2: float = 0.1,
) -> Space:
    """Build the space of `coordinates`; all other quantities stay at `fixed` (default 0).

    `margin` (m) applies to obstacles, ground and the limits of `area` (3, 2), `margin_self` between
    parts of the robot that can collide. `p1`, `p2` are the weights of cost (6). Raises InputError
    on an unknown name or crossing limits.
    """
    rows = {"x": X, "y": Y, "z": Z, "yaw": YAW}
    rows |= {name: JOINT0 + i for i, name in enumerate(scene.joints)}
    n, nj = len(coordinates), len(scene.joints)
    offset, cmap = np.zeros(JOINT0 + nj), np.zeros((JOINT0 + nj, n))
    for name, value in fixed.items():
        offset[_row(rows, name)] = value
    for i, c in enumerate(coordinates):
        if not c.low < c.high:
            raise InputError(
                f"coordinate {c.name}: lower limit {c.low:g} is not below upper limit {c.high:g}"
            )
        for name, gain in zip(c.drives, c.gains or (1.0,) * len(c.drives), strict=True):
            cmap[_row(rows, name), i] = gain
    moves = [any(r in (X, Y, Z) for r in np.flatnonzero(cmap[:, i])) for i in range(n)]
    n_move = sum(moves)
    if not all(moves[:n_move]):
        first = coordinates[moves.index(False)].name
        raise InputError(
            f"coordinates: {first}, an angle, comes before a translation; valid: all coordinates "
            "that drive x, y or z first"
        )
    weight = np.array(
        [
            p1 if m else p2 * sum(abs(gain) for gain in c.gains or (1.0,) * len(c.drives))
            for m, c in zip(moves, coordinates, strict=True)
        ]
    )
    tree, shapes, names = scene.tree, scene.robot, list(scene.names)
    if carried is not None:
        tree, shapes = _add_carried(scene, carried)
        names.append("bar")
    passive_body = -1
    if passive is not None:
        passive_body = int(np.flatnonzero(tree.joint == scene.joints.index(passive))[0])
        cmap[JOINT0 + scene.joints.index(passive)] = 0.0
    reach, chain = compute_reach(tree, shapes)
    moment, moment_min = _first_moments(tree, passive_body)
    bound = np.linalg.norm(shapes.p1 - shapes.p0, axis=1) / 2 + shapes.radius
    bound += np.linalg.norm(shapes.half, axis=1)
    box = np.full((3, 2), [-math.inf, math.inf]) if area is None else np.asarray(area, dtype=float)
    if scene.with_ground:
        box = box.copy()
        box[Z, 0] = max(box[Z, 0], 0.0)
    pairs = list_pairs(tree, shapes, scene.world, box)
    if carried is not None:
        pairs = _drop_held(scene, carried, pairs)
    if not cmap[[Y, YAW]].any() and offset[YAW] == 0.0:
        pairs = drop_beside(tree, shapes, scene.world, box, pairs, offset[Y], margin, margin_self)
    keep = np.array([margin_self if kind == PAIR_SELF else margin for _, _, kind in pairs])
    space = np.zeros(1, SpaceRecord.dtype)
    r = space[0]
    sizes = {
        "n": n, "n_move": n_move, "nb": len(tree.parent), "ns": len(shapes.body),
        "nw": len(scene.world.body), "n_pairs": len(pairs), "nu": JOINT0 + nj,
    }  # fmt: skip
    most = (MAX_COORDINATES, n, MAX_BODIES, MAX_SHAPES, MAX_OBSTACLES, MAX_PAIRS, MAX_U)
    for (name, size), limit in zip(sizes.items(), most, strict=True):
        if size > limit:
            raise InputError(f"the planner's {name} is {size}; at most {limit} are supported")
        r[name] = size
    r["passive"], r["moment_min"], r["area"] = passive_body, moment_min, box
    values: dict[str, Any] = {
        "offset": offset, "low": [c.low for c in coordinates], "weight": weight,
        "high": [c.high for c in coordinates], "reach": reach, "moment": moment,
        "bound": bound, "margin": keep, **tree._asdict(),
        **{f"s_{k}": v for k, v in shapes._asdict().items()},
        **{f"w_{k}": v for k, v in scene.world._asdict().items() if k != "body"},
    }  # fmt: skip
    for name, value in values.items():
        r[name][: len(value)] = value
    r["map"][: JOINT0 + nj, :n] = cmap
    r["chain"][: len(reach), : len(tree.parent)] = chain
    r["pairs"][: len(pairs)] = np.array(pairs, np.int64).reshape(-1, 3)
    return space


def _row(rows: dict[str, int], name: str) -> int:
    if name not in rows:
        raise InputError(f"unknown coordinate or joint {name!r}; valid: {', '.join(rows)}")
    return rows[name]


def _add_carried(scene: PlanningScene, carried: Carried) -> tuple[Tree, Shapes]:
    """Attach the bar to the first hand; all hands share its mass."""
    tree, s = scene.tree, scene.robot
    holder = scene.bodies.index(carried.bodies[0])
    # the middle of the bar lies in the robot's plane of symmetry, y = 0 of B
    y, body = 0.0, holder
    while body >= 0:
        y += float(tree.pos[body, 1])
        body = int(tree.parent[body])
    middle = np.array([0.0, -y, 0.0])
    along = np.array([0.0, carried.length / 2, 0.0])
    row = (holder, CAPSULE, middle - along, middle + along, np.eye(3), np.zeros(3), carried.radius)
    rows = [tuple(column[i] for column in s) for i in range(len(s.body))]
    mass, com = tree.mass.copy(), tree.com.copy()
    share = carried.mass / len(carried.bodies)
    for name in carried.bodies:
        b = scene.bodies.index(name)
        com[b] *= mass[b] / (mass[b] + share)  # the share is located at the hand's origin
        mass[b] += share
    return tree._replace(mass=mass, com=com), build_shapes([*rows, row])


def _drop_held(
    scene: PlanningScene, carried: Carried, pairs: list[tuple[int, int, int]]
) -> list[tuple[int, int, int]]:
    """Drop the pairs of a carried bar, the last shape, with the arms of the other hands."""
    bar, tree, body = len(scene.robot.body), scene.tree, scene.robot.body
    holders = [list_ancestors(tree, scene.bodies.index(name)) for name in carried.bodies]
    others = {x for chain in holders[1:] for x in chain} - set(holders[0])
    return [
        (a, b, kind) for a, b, kind in pairs
        if kind != PAIR_SELF or bar not in (a, b) or int(body[min(a, b)]) not in others
    ]  # fmt: skip


def _slide_room(tree: Tree, body: int) -> float:
    return 1.0 if tree.kind[body] == SLIDE else 0.0  # m, a slide's travel; generous


def compute_reach(tree: Tree, shapes: Shapes) -> tuple[Array, Mask]:
    """Return bounds of how far (m) each shape's segment or box reaches from the platform's origin,
    (ns,), and whether each body is between platform and shape, (ns, nb).
    """
    ns, nb = len(shapes.body), len(tree.parent)
    reach, chain = np.zeros(ns), np.zeros((ns, nb), dtype=np.bool_)
    for s in range(ns):
        far = max(np.linalg.norm(shapes.p0[s]), np.linalg.norm(shapes.p1[s]))
        reach[s] = far + np.linalg.norm(shapes.half[s])
        for b in list_ancestors(tree, int(shapes.body[s])):
            reach[s] += np.linalg.norm(tree.pos[b]) + _slide_room(tree, b)
            chain[s, b] = True
    return reach, chain


def _first_moments(tree: Tree, passive: int) -> tuple[Array, float]:
    """Return bounds for the equilibrium: first moment beyond each joint, least about `passive`."""
    nb = len(tree.parent)
    moment = np.zeros(nb)
    for b in range(1, nb):
        length, body = float(np.linalg.norm(tree.com[b])), b
        while body > 0:
            moment[body] += tree.mass[b] * length
            length += float(np.linalg.norm(tree.pos[body])) + _slide_room(tree, body)
            body = int(tree.parent[body])
    if passive < 0:
        return moment, 1.0
    steady = tree.mass[passive] * tree.com[passive]
    moving = 0.0
    for b in range(nb):
        if passive in list_ancestors(tree, b) and b != passive:
            root = b
            while int(tree.parent[root]) != passive:
                root = int(tree.parent[root])
            steady = steady + tree.mass[b] * tree.pos[root]
            if root == b:
                moving += moment[b]
    across = steady - (steady @ tree.axis[passive]) * tree.axis[passive]
    least = float(np.linalg.norm(across)) - moving
    if least <= 0.0:
        raise InputError(
            "the passive joint has no unique equilibrium angle: some posture of the arms balances "
            "its load; valid: arms whose centre of mass stays off the axis of the joint"
        )
    return moment, least
