"""The configuration space of a planner, described by data, and its kinematics.

Coordinates c (n,) drive the platform and the joints linearly: (x, y, z, yaw, q) = offset + map c.
The first `n_move` coordinates are the platform's translations (m), the others angles (rad). One
coordinate may drive several joints, as both arms of a robot that hold one bar. A passive joint is
not driven: it follows the static equilibrium of what hangs on it, platform level.

Bounds on how far any point moves for a change of c are part of the data; they make the edge
checks rigorous.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import cross, mat_mat, mat_vec
from skywright.errors import InputError
from skywright.models.kinematic_tree import (
    BOX,
    CAPSULE,
    HINGE,
    SLIDE,
    PlanningScene,
    Shapes,
    Tree,
    build_shapes,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

X, Y, Z, YAW = range(4)
"""Rows of `map` before the joints."""
JOINT0 = 4


MAX_COORDINATES = 16
MAX_BODIES = 16
MAX_SHAPES = 24
MAX_OBSTACLES = 96
MAX_PAIRS = 2400
MAX_U = 16

f8, i8 = np.float64, np.int64

SPACE = np.dtype(
    [
        ("n", i8),  # coordinates
        ("n_move", i8),  # of them, translations
        ("nb", i8),  # bodies
        ("ns", i8),  # shapes of the robot and what it carries
        ("nw", i8),  # obstacles
        ("n_pairs", i8),
        ("nu", i8),  # 4 + joints
        ("passive", i8),  # body of the passive joint, -1: none
        # coordinates
        ("offset", f8, MAX_U),
        ("map", f8, (MAX_U, MAX_COORDINATES)),
        ("low", f8, MAX_COORDINATES),
        ("high", f8, MAX_COORDINATES),
        ("weight", f8, MAX_COORDINATES),  # in cost (6): p1, or p2 times the driven joints
        # the tree, see models.kinematic_tree.Tree
        ("parent", i8, MAX_BODIES),
        ("kind", i8, MAX_BODIES),
        ("joint", i8, MAX_BODIES),
        ("pos", f8, (MAX_BODIES, 3)),
        ("rot", f8, (MAX_BODIES, 3, 3)),
        ("axis", f8, (MAX_BODIES, 3)),
        ("mass", f8, MAX_BODIES),
        ("com", f8, (MAX_BODIES, 3)),
        # the robot's shapes, see models.kinematic_tree.Shapes
        ("s_body", i8, MAX_SHAPES),
        ("s_kind", i8, MAX_SHAPES),
        ("s_p0", f8, (MAX_SHAPES, 3)),
        ("s_p1", f8, (MAX_SHAPES, 3)),
        ("s_rot", f8, (MAX_SHAPES, 3, 3)),
        ("s_half", f8, (MAX_SHAPES, 3)),
        ("s_radius", f8, MAX_SHAPES),
        # obstacles
        ("w_kind", i8, MAX_OBSTACLES),
        ("w_p0", f8, (MAX_OBSTACLES, 3)),
        ("w_p1", f8, (MAX_OBSTACLES, 3)),
        ("w_rot", f8, (MAX_OBSTACLES, 3, 3)),
        ("w_half", f8, (MAX_OBSTACLES, 3)),
        ("w_radius", f8, MAX_OBSTACLES),
        # bounds
        ("reach", f8, MAX_SHAPES),  # m, chain from the platform's origin to a shape's far end
        ("chain", i8, (MAX_SHAPES, MAX_BODIES)),  # 1: the body is between platform and shape
        ("moment", f8, MAX_BODIES),  # kg m, mass beyond a joint times its largest distance
        ("moment_min", f8),  # kg m, smallest first moment about the passive joint
        ("bound", f8, MAX_SHAPES),  # m, radius around the shape's middle that holds it
        # pairs of shapes that must keep apart
        ("pairs", i8, (MAX_PAIRS, 3)),  # robot's shape, other, kind of pair
        ("margin", f8, MAX_PAIRS),  # m
        ("area", f8, (3, 2)),  # m, limits of every shape's surface, before the margin
    ]
)
"""A configuration space as compiled code sees it; arrays of one record are passed around."""

Space = NDArray[Any]
Record = Any  # one SPACE or SCRATCH record inside compiled code

SCRATCH = np.dtype(
    [
        # where the bodies are, and how fast they move along an edge (a unit of s)
        ("u", f8, MAX_U),
        ("du", f8, MAX_U),
        ("p", f8, (MAX_BODIES, 3)),  # m, in W
        ("R", f8, (MAX_BODIES, 3, 3)),
        ("v", f8, (MAX_BODIES, 3)),  # m, of the body's origin
        ("w", f8, (MAX_BODIES, 3)),  # rad, in W
        # shapes in W: ends, middle, and their velocities
        ("p0", f8, (MAX_SHAPES, 3)),
        ("p1", f8, (MAX_SHAPES, 3)),
        ("mid", f8, (MAX_SHAPES, 3)),
        ("v0", f8, (MAX_SHAPES, 3)),
        ("v1", f8, (MAX_SHAPES, 3)),
        ("vm", f8, (MAX_SHAPES, 3)),
        ("box", f8, (MAX_SHAPES, 3, 3)),  # axes of boxes
        ("omega", f8, MAX_SHAPES),  # rad, bound on the turning of a shape
        ("acc", f8, MAX_SHAPES),  # m, bound on the second derivative of its points
        # of the edge check
        ("active", i8, MAX_PAIRS),
        ("stack", f8, (64, 3)),
        ("c", f8, MAX_COORDINATES),
        ("d", f8, MAX_COORDINATES),
        ("normal", f8, 3),
        ("blocked", i8),  # pair that blocked the last check
        ("local", f8, (3, 3)),
        ("turn", f8, (3, 3)),
        ("a3", f8, 3),
        ("r3", f8, 3),
        ("x3", f8, 3),
        ("y3", f8, 3),
    ]
)
"""Memory of the checks; one a thread."""

Scratch = NDArray[Any]


def build_scratch(space: Space) -> Scratch:
    """Allocate the memory of the checks of one space."""
    scratch = np.zeros(1, SCRATCH)
    scratch[0]["active"] = np.arange(MAX_PAIRS)
    return scratch


PAIR_WORLD, PAIR_SELF, PAIR_LIMIT = range(3)
"""A pair with an obstacle, with another part of the robot, or with a plane of the area (other =
2 axis + side)."""


class Coordinate(NamedTuple):
    """One coordinate: what it drives ("x", "y", "z", "yaw" or joint names), and its range."""

    name: str
    drives: tuple[str, ...]
    low: float
    high: float
    gains: tuple[float, ...] = ()
    """How far each moves for one unit of the coordinate; empty: 1."""


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
    """Build the space of `coordinates`; what they do not drive stays at `fixed` (default 0).

    `margin` (m) is kept from obstacles, ground and the limits of `area` (3, 2), `margin_self`
    between parts of the robot that can meet. `p1`, `p2` are the weights of cost (6).
    Raises InputError on an unknown name or crossing limits.
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
                f"coordinate {c.name}: its limits cross, {c.low:g} is not below {c.high:g}"
            )
        for name, gain in zip(c.drives, c.gains or (1.0,) * len(c.drives), strict=True):
            cmap[_row(rows, name), i] = gain
    moves = [any(r in (X, Y, Z) for r in np.flatnonzero(cmap[:, i])) for i in range(n)]
    n_move = sum(moves)
    if not all(moves[:n_move]):
        raise InputError("coordinates: translations come before angles")
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
    reach, chain = _chain_lengths(tree, shapes)
    moment, moment_min = _first_moments(tree, passive_body)
    bound = np.linalg.norm(shapes.p1 - shapes.p0, axis=1) / 2 + shapes.radius
    bound += np.linalg.norm(shapes.half, axis=1)
    box = np.full((3, 2), [-math.inf, math.inf]) if area is None else np.asarray(area, dtype=float)
    if scene.with_ground:
        box = box.copy()
        box[Z, 0] = max(box[Z, 0], 0.0)
    pairs = _list_pairs(tree, shapes, scene.world, box)
    if not cmap[[Y, YAW]].any():
        pairs = _drop_beside(tree, shapes, scene.world, box, pairs, offset, margin)
    keep = np.array([margin_self if kind == PAIR_SELF else margin for _, _, kind in pairs])
    space = np.zeros(1, SPACE)
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
    """Attach the bar to the first hand; its mass is shared by all hands."""
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
        com[b] *= mass[b] / (mass[b] + share)  # the share sits at the hand's origin
        mass[b] += share
    return tree._replace(mass=mass, com=com), build_shapes([*rows, row])


def _ancestors(tree: Tree, body: int) -> list[int]:
    """Bodies from `body` up to, but without, the platform."""
    out = []
    while body > 0:
        out.append(body)
        body = int(tree.parent[body])
    return out


def _slide_room(tree: Tree, body: int) -> float:
    return 1.0 if tree.kind[body] == SLIDE else 0.0  # m, a slide's travel; generous


def _chain_lengths(tree: Tree, shapes: Shapes) -> tuple[Array, NDArray[np.bool_]]:
    ns, nb = len(shapes.body), len(tree.parent)
    reach, chain = np.zeros(ns), np.zeros((ns, nb), dtype=np.bool_)
    for s in range(ns):
        far = max(np.linalg.norm(shapes.p0[s]), np.linalg.norm(shapes.p1[s]))
        reach[s] = far + np.linalg.norm(shapes.half[s])
        for b in _ancestors(tree, int(shapes.body[s])):
            reach[s] += np.linalg.norm(tree.pos[b]) + _slide_room(tree, b)
            chain[s, b] = True
    return reach, chain


def _first_moments(tree: Tree, passive: int) -> tuple[Array, float]:
    """Bounds for the equilibrium: first moment beyond each joint, the smallest about `passive`."""
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
        if passive in _ancestors(tree, b) and b != passive:
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
            "the passive joint: what hangs on it can balance, it has no one rest angle"
        )
    return moment, least


def _list_pairs(tree: Tree, s: Shapes, world: Shapes, box: Array) -> list[tuple[int, int, int]]:
    """Pairs that can meet: with every obstacle and limit, and between parts two joints apart."""
    pairs = []
    for a in range(len(s.body)):
        pairs += [(a, b, PAIR_WORLD) for b in range(len(world.body))]
        for axis in range(3):
            pairs += [
                (a, 2 * axis + side, PAIR_LIMIT) for side in (0, 1) if np.isfinite(box[axis, side])
            ]
    for a in range(len(s.body)):
        above = _ancestors(tree, int(s.body[a]))
        for b in range(len(s.body)):
            if a == b or s.kind[a] == BOX:
                continue
            # b further up the same chain, with a joint on each side of what lies between
            if int(s.body[b]) in [0, *above] and int(s.body[b]) != int(s.body[a]):
                between = [x for x in above if x not in _ancestors(tree, int(s.body[b]))]
                if len(between) >= 2:
                    pairs.append((a, b, PAIR_SELF))
    return pairs


def _drop_beside(
    tree: Tree,
    s: Shapes,
    world: Shapes,
    box: Array,
    pairs: list[tuple[int, int, int]],
    offset: Array,
    margin: float,
) -> list[tuple[int, int, int]]:
    """Drop pairs that stay apart in y because nothing here ever moves in y.

    Holds where all joints turn about y (or slide across it) and the platform keeps y and yaw.
    """
    if offset[YAW] != 0.0:
        return pairs
    rots, places = [np.eye(3)], [np.array([0.0, offset[Y], 0.0])]
    for b in range(1, len(tree.parent)):
        up = int(tree.parent[b])
        places.append(places[up] + rots[up] @ tree.pos[b])
        rots.append(rots[up] @ tree.rot[b])
        along = abs((rots[b] @ tree.axis[b])[1])
        if tree.joint[b] >= 0 and abs(along - (1.0 if tree.kind[b] == HINGE else 0.0)) > 1e-9:
            return pairs

    def reach(shapes: Shapes, i: int, p: Array, rot: Array) -> tuple[float, float]:
        ends = [(p + rot @ shapes.p0[i])[1], (p + rot @ shapes.p1[i])[1]]
        more = shapes.radius[i] + np.abs((rot @ shapes.rot[i])[1]) @ shapes.half[i]
        return min(ends) - more, max(ends) + more

    own = [reach(s, i, places[int(b)], rots[int(b)]) for i, b in enumerate(s.body)]
    other = [reach(world, i, np.zeros(3), np.eye(3)) for i in range(len(world.body))]

    def meets(pair: tuple[int, int, int]) -> bool:
        a, b, kind = pair
        low, high = own[a]
        if kind == PAIR_LIMIT and b // 2 == Y:
            return bool(low - box[Y, 0] < margin or box[Y, 1] - high < margin)
        if kind == PAIR_WORLD:
            return max(low - other[b][1], other[b][0] - high) < margin
        return True

    return [pair for pair in pairs if meets(pair)]


@njit(cache=True, error_model="numpy")
def _rodrigues(a: Array, angle: float, out: Array) -> None:
    c, s = math.cos(angle), math.sin(angle)
    k = 1.0 - c
    x, y, z = a[0], a[1], a[2]
    out[0, 0] = c + k * x * x
    out[1, 1] = c + k * y * y
    out[2, 2] = c + k * z * z
    out[0, 1], out[1, 0] = k * x * y - s * z, k * x * y + s * z
    out[0, 2], out[2, 0] = k * x * z + s * y, k * x * z - s * y
    out[1, 2], out[2, 1] = k * y * z - s * x, k * y * z + s * x


@njit(cache=True, error_model="numpy")
def _copy(a: Array, out: Array) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, j]


@njit(cache=True, error_model="numpy")
def compute_pose(space: Record, c: Array, d: Array, pose: Record) -> None:
    """Fill `pose` at coordinates c (n,), with the velocities for c' = d (n,)."""
    t = space
    u, du = pose.u, pose.du
    for i in range(space.nu):
        x, dx = space.offset[i], 0.0
        for j in range(space.n):
            m = space.map[i, j]
            if m != 0.0:
                x += m * c[j]
                dx += m * d[j]
        u[i], du[i] = x, dx
    for i in range(3):
        pose.p[0, i], pose.v[0, i] = u[i], du[i]
        pose.w[0, i] = 0.0
        for j in range(3):
            pose.R[0, i, j] = 1.0 if i == j else 0.0
    if u[YAW] != 0.0:
        cy, sy = math.cos(u[YAW]), math.sin(u[YAW])
        pose.R[0, 0, 0], pose.R[0, 1, 1] = cy, cy
        pose.R[0, 0, 1], pose.R[0, 1, 0] = -sy, sy
    pose.w[0, 2] = du[YAW]
    local, turn, a, r, x = pose.local, pose.turn, pose.a3, pose.r3, pose.x3
    for b in range(1, t.nb):
        up = t.parent[b]
        mat_vec(pose.R[up], t.pos[b], r)
        cross(pose.w[up], r, x)
        for i in range(3):
            pose.p[b, i] = pose.p[up, i] + r[i]
            pose.v[b, i] = pose.v[up, i] + x[i]
            pose.w[b, i] = pose.w[up, i]
        mat_mat(pose.R[up], t.rot[b], local)
        j = t.joint[b]
        if j < 0 or b == space.passive:
            _copy(local, pose.R[b])
        elif t.kind[b] == HINGE:
            _rodrigues(t.axis[b], u[JOINT0 + j], turn)
            mat_mat(local, turn, pose.R[b])
            mat_vec(local, t.axis[b], a)
            for i in range(3):
                pose.w[b, i] += du[JOINT0 + j] * a[i]
        else:
            _copy(local, pose.R[b])
            mat_vec(local, t.axis[b], a)
            for i in range(3):
                pose.p[b, i] += u[JOINT0 + j] * a[i]
                r[i] = u[JOINT0 + j] * a[i]
            cross(pose.w[up], r, x)
            for i in range(3):
                pose.v[b, i] += x[i] + du[JOINT0 + j] * a[i]
    if space.passive >= 0:
        _hang(space, pose, a, r, x, local, turn)


@njit(cache=True, error_model="numpy")
def _hang(
    space: Record, pose: Record, a: Array, r: Array, x: Array, old: Array, turn: Array
) -> None:
    """Turn what hangs on the passive joint into its equilibrium (it was placed at angle 0).

    The centre of mass m comes to lie under the joint: angle = atan2(a . (m x g), m . g), with m
    and gravity g taken across the axis a.
    """
    t, k = space, space.passive
    mat_vec(pose.R[k], t.axis[k], a)
    m0 = m1 = m2 = d0 = d1 = d2 = 0.0
    for b in range(k, t.nb):
        if not _hangs(t, b, k):
            continue
        mat_vec(pose.R[b], t.com[b], r)
        # relative to the joint's body, so that the turning of the platform drops out
        w0 = pose.w[b, 0] - pose.w[k, 0]
        w1 = pose.w[b, 1] - pose.w[k, 1]
        w2 = pose.w[b, 2] - pose.w[k, 2]
        p0, p1, p2 = (
            pose.p[b, 0] - pose.p[k, 0],
            pose.p[b, 1] - pose.p[k, 1],
            pose.p[b, 2] - pose.p[k, 2],
        )
        q0 = pose.w[k, 1] * p2 - pose.w[k, 2] * p1
        q1 = pose.w[k, 2] * p0 - pose.w[k, 0] * p2
        q2 = pose.w[k, 0] * p1 - pose.w[k, 1] * p0
        m = t.mass[b]
        m0 += m * (p0 + r[0])
        m1 += m * (p1 + r[1])
        m2 += m * (p2 + r[2])
        d0 += m * (pose.v[b, 0] - pose.v[k, 0] - q0 + w1 * r[2] - w2 * r[1])
        d1 += m * (pose.v[b, 1] - pose.v[k, 1] - q1 + w2 * r[0] - w0 * r[2])
        d2 += m * (pose.v[b, 2] - pose.v[k, 2] - q2 + w0 * r[1] - w1 * r[0])
    along = m0 * a[0] + m1 * a[1] + m2 * a[2]
    m0, m1, m2 = m0 - along * a[0], m1 - along * a[1], m2 - along * a[2]
    g0, g1, g2 = a[2] * a[0], a[2] * a[1], a[2] * a[2] - 1.0  # -z across the axis
    sine = a[0] * (m1 * g2 - m2 * g1) + a[1] * (m2 * g0 - m0 * g2) + a[2] * (m0 * g1 - m1 * g0)
    angle = math.atan2(sine, m0 * g0 + m1 * g1 + m2 * g2)
    square = m0 * m0 + m1 * m1 + m2 * m2
    rate = (
        -(a[0] * (m1 * d2 - m2 * d1) + a[1] * (m2 * d0 - m0 * d2) + a[2] * (m0 * d1 - m1 * d0))
        / square
    )
    pose.u[JOINT0 + t.joint[k]], pose.du[JOINT0 + t.joint[k]] = angle, rate
    _rodrigues(a, angle, turn)
    px, py, pz = pose.p[k, 0], pose.p[k, 1], pose.p[k, 2]
    vx, vy, vz = pose.v[k, 0], pose.v[k, 1], pose.v[k, 2]
    wx, wy, wz = pose.w[k, 0], pose.w[k, 1], pose.w[k, 2]
    for b in range(k, t.nb):
        if not _hangs(t, b, k):
            continue
        for i in range(3):
            for j in range(3):
                old[i, j] = pose.R[b, i, j]
        mat_mat(turn, old, pose.R[b])
        # position, and velocities relative to the joint's body, turn with it
        r[0], r[1], r[2] = pose.p[b, 0] - px, pose.p[b, 1] - py, pose.p[b, 2] - pz
        x[0] = pose.v[b, 0] - vx - (wy * r[2] - wz * r[1])
        x[1] = pose.v[b, 1] - vy - (wz * r[0] - wx * r[2])
        x[2] = pose.v[b, 2] - vz - (wx * r[1] - wy * r[0])
        p = pose.p[b]
        mat_vec(turn, r, p)
        v = pose.v[b]
        mat_vec(turn, x, v)
        r[0], r[1], r[2] = pose.w[b, 0] - wx, pose.w[b, 1] - wy, pose.w[b, 2] - wz
        w = pose.w[b]
        mat_vec(turn, r, w)
        sx, sy, sz = wx + rate * a[0], wy + rate * a[1], wz + rate * a[2]
        q0, q1, q2 = p[0], p[1], p[2]
        v[0] += vx + sy * q2 - sz * q1
        v[1] += vy + sz * q0 - sx * q2
        v[2] += vz + sx * q1 - sy * q0
        w[0] += sx
        w[1] += sy
        w[2] += sz
        p[0] += px
        p[1] += py
        p[2] += pz


@njit(cache=True, error_model="numpy")
def _hangs(t: Record, body: int, joint: int) -> bool:
    while body > joint:
        body = t.parent[body]
    return body == joint
