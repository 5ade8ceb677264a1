"""The nominal scene as a kinematic tree with collision shapes, for planners.

The simulated scene is the only source: bodies, joints, masses and shapes are read from the compiled
model. Capsules and boxes enclose the geoms of robot and obstacles: a sphere or capsule exactly, a
cylinder as the capsule of its axis and radius (rounder ends, so never smaller), the platform's
parts together as one box in B.
"""

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Ints
from skywright.core.rotations import rot_from_quat
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import joint_names
from skywright.models.scene import Scene
from skywright.models.self_contact import SelfContacts, build_self_contacts

FIXED, HINGE, SLIDE = range(3)
CAPSULE, BOX = range(2)

_GEOM = mujoco.mjtGeom


class Shapes(NamedTuple):
    """Capsules (p0 to p1, radius) and boxes (centre p0, axes in `rot`, half sizes)."""

    body: Ints  # (n,) body that carries the shape; -1: the world
    kind: Ints  # (n,) CAPSULE or BOX
    p0: Array  # (n, 3) m, in the body's frame
    p1: Array  # (n, 3) m; of a box: its centre again
    rot: Array  # (n, 3, 3) of a box
    half: Array  # (n, 3) m, of a box
    radius: Array  # (n,) m, around the segment or the box


class Tree(NamedTuple):
    """Bodies, parents first; body 0 is the platform, which floats with (x, y, z, yaw)."""

    parent: Ints  # (nb,) -1 for the platform
    kind: Ints  # (nb,) FIXED, HINGE or SLIDE
    joint: Ints  # (nb,) index in q, -1 where fixed
    pos: Array  # (nb, 3) m, of the joint in the parent's frame
    rot: Array  # (nb, 3, 3) of the body in the parent's frame at q = 0
    axis: Array  # (nb, 3) of the joint, in the body's frame
    mass: Array  # (nb,) kg
    com: Array  # (nb, 3) m, in the body's frame


class PlanningScene(NamedTuple):
    """Robot and world for a motion planner."""

    tree: Tree
    robot: Shapes
    world: Shapes
    names: tuple[str, ...]  # of the robot's shapes
    world_names: tuple[str, ...]
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    q_min: Array  # (nj,) rad
    q_max: Array
    with_ground: bool  # the plane z = 0
    area: Array | None  # (3, 2) m, limits of every shape's surface in W
    contacts: SelfContacts  # of the robot's parts, with their exact shapes


def build_planning_scene(scene: Scene, robot: Robot, area: Array | None = None) -> PlanningScene:
    """Read tree and shapes from the nominal scene of `robot`; `area` (3, 2) m limits its paths."""
    model = scene.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    joints = tuple(joint_names(robot))
    # movable things of the world are bodies too, but no parts of the robot
    bodies = np.flatnonzero(model.body_rootid == scene.places.platform_body).tolist()
    index = {b: i for i, b in enumerate(bodies)}
    n = len(bodies)
    tree = Tree(
        parent=np.array([index.get(int(model.body_parentid[b]), -1) for b in bodies], np.int64),
        kind=np.zeros(n, np.int64),
        joint=np.full(n, -1, np.int64),
        pos=np.array([model.body_pos[b] for b in bodies]),
        rot=np.array([rot_from_quat(model.body_quat[b]) for b in bodies]),
        axis=np.tile([0.0, 0.0, 1.0], (n, 1)),
        mass=np.array([model.body_mass[b] for b in bodies]),
        com=np.array([model.body_ipos[b] for b in bodies]),
    )
    for j in range(model.njnt):
        kind = model.jnt_type[j]
        name = model.joint(j).name
        if kind == mujoco.mjtJoint.mjJNT_FREE or name not in joints:
            continue  # the platform; the probe's spring, released
        i = index[int(model.jnt_bodyid[j])]
        assert not np.any(model.jnt_pos[j]), "joints sit at their body's origin"
        tree.kind[i] = HINGE if kind == mujoco.mjtJoint.mjJNT_HINGE else SLIDE
        tree.joint[i] = joints.index(name)
        tree.axis[i] = model.jnt_axis[j]
    robot_shapes, names = _robot_shapes(model, data, scene, index)
    world_shapes, world_names = _world_shapes(model, data, scene)
    reach = np.array([limb.link.reach for limb in list_joints(robot)]).reshape(-1, 2)
    return PlanningScene(
        tree, robot_shapes, world_shapes, names, world_names,
        tuple(model.body(b).name for b in bodies), joints,
        reach[:, 0], reach[:, 1], True, area, build_self_contacts(model, robot),
    )  # fmt: skip


def build_shapes(rows: list[tuple[int, int, Array, Array, Array, Array, float]]) -> Shapes:
    """Collect rows of (body, kind, p0, p1, rot, half, radius)."""
    n = len(rows)
    out = Shapes(
        np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3)), np.zeros((n, 3)),
        np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.zeros(n),
    )  # fmt: skip
    for i, row in enumerate(rows):
        columns: tuple[NDArray[Any], ...] = out
        for column, value in zip(columns, row, strict=True):
            column[i] = value
    return out


def _geom_row(
    model: mujoco.MjModel, g: int, body: int
) -> tuple[int, int, Array, Array, Array, Array, float]:
    """One geom in its body's frame."""
    p, rot = model.geom_pos[g].copy(), rot_from_quat(model.geom_quat[g])
    size, none = model.geom_size[g], np.zeros(3)
    kind = int(model.geom_type[g])
    if kind == _GEOM.mjGEOM_SPHERE:
        return body, CAPSULE, p, p, np.eye(3), none, float(size[0])
    if kind in (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER):
        along = rot[:, 2] * size[1]
        return body, CAPSULE, p - along, p + along, np.eye(3), none, float(size[0])
    if kind == _GEOM.mjGEOM_BOX:
        return body, BOX, p, p, rot, size.copy(), 0.0
    raise AssertionError(f"geom {model.geom(g).name} is neither capsule, sphere, cylinder nor box")


def _robot_shapes(
    model: mujoco.MjModel, data: mujoco.MjData, scene: Scene, index: dict[int, int]
) -> tuple[Shapes, tuple[str, ...]]:
    rows, names = [], []
    low, high = np.full(3, math.inf), np.full(3, -math.inf)
    platform = scene.places.platform_body
    for g in scene.places.robot_geoms.tolist():
        body = int(model.geom_bodyid[g])
        if _is_rigid_with(model, body, platform):
            centre, half = _extent(model, data, g, platform)
            low, high = np.minimum(low, centre - half), np.maximum(high, centre + half)
        else:
            rows.append(_geom_row(model, g, index[body]))
            names.append(model.geom(g).name)
    middle, half = (low + high) / 2, (high - low) / 2
    rows.insert(0, (0, BOX, middle, middle, np.eye(3), half, 0.0))
    return build_shapes(rows), ("platform", *names)


def _is_rigid_with(model: mujoco.MjModel, body: int, other: int) -> bool:
    while body not in (0, other):
        if model.body_jntnum[body]:
            return False
        body = int(model.body_parentid[body])
    return body == other


def _extent(model: mujoco.MjModel, data: mujoco.MjData, g: int, body: int) -> tuple[Array, Array]:
    """Return centre and half size (3,) of a geom's box along the axes of `body`."""
    R_WB, p_WB = data.xmat[body].reshape(3, 3), data.xpos[body]
    rot = R_WB.T @ data.geom_xmat[g].reshape(3, 3)
    p = R_WB.T @ (data.geom_xpos[g] - p_WB)
    size, kind = model.geom_size[g], int(model.geom_type[g])
    if kind == _GEOM.mjGEOM_SPHERE:
        return p, np.full(3, size[0])
    if kind == _GEOM.mjGEOM_CAPSULE:
        return p, np.abs(rot[:, 2]) * size[1] + size[0]
    if kind == _GEOM.mjGEOM_CYLINDER:
        across = np.sqrt(np.maximum(1.0 - rot[:, 2] ** 2, 0.0))
        return p, np.abs(rot[:, 2]) * size[1] + across * size[0]
    return p, np.abs(rot) @ size


def _world_shapes(
    model: mujoco.MjModel, data: mujoco.MjData, scene: Scene
) -> tuple[Shapes, tuple[str, ...]]:
    """Return shapes in W; free-standing things such as a tool are separate bodies."""
    solid = [
        g for g in scene.places.world_geoms.tolist() if model.geom_type[g] != _GEOM.mjGEOM_PLANE
    ]
    rows = []
    for g in solid:
        body, kind, p0, p1, rot, half, radius = _geom_row(model, g, -1)
        b = model.geom_bodyid[g]
        p, R = data.xpos[b], data.xmat[b].reshape(3, 3)
        rows.append((body, kind, p + R @ p0, p + R @ p1, R @ rot, half, radius))
    return build_shapes(rows), tuple(model.geom(g).name.removeprefix("tube ") for g in solid)
