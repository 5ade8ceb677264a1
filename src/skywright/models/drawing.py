"""Shapes of a scene as plain lists, for pictures, replay and live view.

The shapes are read from the compiled nominal scene, so that pictures show the geometry that
planners and physics use. No MuJoCo object leaves this module.
"""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Ints
from skywright.core.types import MAX_OBJECTS
from skywright.description.robot.mesh import decode_mesh
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.things import list_movers
from skywright.models.rigid_body import joint_names
from skywright.models.scene import Scene, build_scene
from skywright.models.things._build import OBJECT
from skywright.models.vectors import compute_cross
from skywright.recordings.columns import has_columns

_KINDS = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}
BOX = _KINDS[mujoco.mjtGeom.mjGEOM_BOX]


class Shape(NamedTuple):
    """One solid, in the frame of its part."""

    name: str  # as in the scene: hub, propeller0, pipe, ...
    kind: str  # plane, sphere, capsule, cylinder (both along z), box, mesh
    size: Array  # (3,) m: radius, half length (capsule without caps); box: half edges
    position: Array  # (3,) m
    quaternion: Array  # (4,) wxyz
    rgba: Array  # (4,) in 0..1
    mesh: tuple[Array, Ints] | None = None  # vertices (n, 3) m and triangles (m, 3) of a mesh


class Part(NamedTuple):
    """A rigid part with its frame. A parent comes before its children."""

    name: str  # platform, a link's name, holder, slider, gear
    parent: int  # index of the part that carries it; -1: the world
    position: Array  # (3,) m, in the parent's frame with the joint at zero
    quaternion: Array  # (4,) wxyz, in the parent's frame with the joint at zero
    motion: str
    """free (the platform), hinge, slide, spring (the probe's tip), finger, turning finger, object
    or fixed"""
    joint: int  # index into the joint angles (object: the world's; finger: hands); -1: none
    axis: Array  # (3,) of the motion, in the part's frame
    turned: (
        Array  # (4,) quaternion * (0, axis); rotated by a: cos(a/2) quaternion + sin(a/2) turned
    )
    shapes: tuple[Shape, ...]


class Drawing(NamedTuple):
    """A robot and its world as parts and shapes."""

    world: tuple[Shape, ...]  # fixed, in W
    parts: tuple[Part, ...]  # of the robot


def build_drawing(
    robot: Robot, world: World, error: Array | None = None, meshes: bool = True
) -> Drawing:
    """Return the shapes of a robot and a world from their nominal scene, or the robot's meshes.

    With `error` (6,) m, rad (`Deviation.socket_error`), tracked things have their true poses.
    """
    scene = build_scene(robot, world, error=error)
    model = scene.model
    parts = tuple(_build_part(scene, robot, world, body) for body in range(1, model.nbody))
    if meshes and robot.meshes:
        parts = tuple(part._replace(shapes=_dress(part, robot)) for part in parts)
    return Drawing(_collect_shapes(model, 0), parts)


def is_propeller(part: Part, shape: Shape) -> bool:
    """Whether a part's shape is a propeller, `propeller<i>`: a link's name may begin likewise."""
    return part.motion == "free" and shape.name.startswith("propeller")


def _dress(part: Part, robot: Robot) -> tuple[Shape, ...]:
    """Return the shapes that represent a part: its meshes and propellers, or its shapes without
    meshes."""
    mine = {name: mesh for name, mesh in robot.meshes.items() if mesh.on == part.name}
    if not mine:
        return part.shapes
    kept = [shape for shape in part.shapes if is_propeller(part, shape)]
    zero, one = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for name, mesh in mine.items():
        rgba = np.array([*mesh.rgb, 1.0])
        kept.append(Shape(name, "mesh", zero, zero, one, rgba, decode_mesh(mesh.data)))
    return tuple(kept)


def _collect_shapes(model: mujoco.MjModel, body: int) -> tuple[Shape, ...]:
    out = []
    for i in range(model.ngeom):
        kind = _KINDS.get(mujoco.mjtGeom(model.geom_type[i]))
        if model.geom_bodyid[i] == body and kind is not None:
            arrays = (model.geom_size, model.geom_pos, model.geom_quat, model.geom_rgba)
            size, place, turn, rgba = (np.array(a[i], dtype=float) for a in arrays)
            out.append(Shape(model.geom(i).name, kind, size, place, turn, rgba))
    return tuple(out)


def _build_part(scene: Scene, robot: Robot, world: World, body: int) -> Part:
    model = scene.model
    name = str(model.body(body).name)
    parent = int(model.body_parentid[body]) - 1
    position, quaternion = np.array(model.body_pos[body]), np.array(model.body_quat[body])
    motion, joint, axis = "fixed", -1, np.array([1.0, 0.0, 0.0])
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    if body == scene.places.platform_body:
        motion = "free"
    elif name.startswith(OBJECT):
        motion, joint = "object", list_movers(world.things).index(name.removeprefix(OBJECT))
    elif " finger" in name:  # likewise the opening of its gripper
        turns = robot.arm is not None and robot.arm.hand.finger == "turn"
        motion, joint = "turning finger" if turns else "finger", int(name[len("hand")])
    elif name == "slider":  # rigid in the nominal scene; a recording contains its compression
        motion, axis = "spring", np.array([-1.0, 0.0, 0.0])
    elif count:
        kind = mujoco.mjtJoint(model.jnt_type[first])
        motion = "slide" if kind == mujoco.mjtJoint.mjJNT_SLIDE else "hinge"
        joint = joint_names(robot).index(model.joint(first).name)
        axis = np.array(model.jnt_axis[first])
    turned = multiply_quaternions(quaternion[None], np.array([[0.0, *axis]]))[0]
    shapes = _collect_shapes(model, body)
    return Part(name, parent, position, quaternion, motion, joint, axis, turned, shapes)


def compute_part_poses(
    drawing: Drawing,
    p_WB: Array,
    q_WB: Array,
    q: Array,
    spring: Array,
    objects: list[tuple[Array, Array]] | None = None,
    opening: Array | None = None,
) -> list[tuple[Array, Array]]:
    """Return poses of the robot's parts in their parents' frames over `n` instants.

    p_WB (n, 3) m, q_WB (n, 4) wxyz, q (n, n_joints) rad (or m), spring (n,) m of compression.
    `objects` has positions (n, 3) and quaternions (n, 4) of each movable thing; by default the
    poses of the world file. `opening` (n, hands) m is that of grippers; by default they are open.
    Returns one (positions (n, 3), quaternions (n, 4)) per part; those of a fixed part may be
    read-only views.
    """
    n = len(p_WB)
    cos, sin = np.cos(0.5 * q), np.sin(0.5 * q)
    out = []
    for part in drawing.parts:
        if part.motion == "free":
            pose = np.asarray(p_WB, float), np.asarray(q_WB, float)
        elif part.motion == "object" and objects is not None:
            p_WO, q_WO = objects[part.joint]
            pose = np.asarray(p_WO, float), np.asarray(q_WO, float)
        else:
            position, quaternion = _repeat(part.position, n), _repeat(part.quaternion, n)
            if part.motion == "hinge":
                j = slice(part.joint, part.joint + 1)
                quaternion = cos[:, j] * part.quaternion + sin[:, j] * part.turned
            elif part.motion in ("slide", "spring"):
                way = spring if part.motion == "spring" else q[:, part.joint]
                position = position + rotate_vectors(quaternion, way[:, None] * part.axis)
            elif part.motion == "finger" and opening is not None:
                away = 0.5 * opening[:, part.joint] + part.shapes[0].size[1]
                position = np.array(position)
                position[:, 1] = np.copysign(away, position[:, 1])
            elif part.motion == "turning finger" and opening is not None:
                quaternion = _turn_finger(part, opening[:, part.joint])
            pose = position, quaternion
        out.append(pose)
    return out


def _turn_finger(part: Part, opening: Array) -> Array:
    """Return the quaternions (n, 4) of a rotating finger; its pad is the first shape."""
    pad, side = part.shapes[0], part.position[1]
    out = 0.5 * opening + pad.size[0] - abs(side)  # m, of the pad's axis from the pivot
    half = -0.5 * np.sign(side) * np.arcsin(np.clip(out / pad.position[2], -1.0, 1.0))
    return np.stack([np.cos(half), np.sin(half), 0.0 * half, 0.0 * half], axis=1)


def _repeat(row: Array, n: int) -> Array:
    """Return a row (k,) as (n, k); for one instant np.broadcast_to takes ten times as long."""
    return row[None] if n == 1 else np.broadcast_to(row, (n, len(row)))


def list_object_poses(samples: NDArray[Any]) -> list[tuple[Array, Array]]:
    """Return (positions (n, 3), quaternions (n, 4)) of the movable things in samples."""
    names = [(f"object{i}_p_WO", f"object{i}_q_WO") for i in range(MAX_OBJECTS)]
    return [(samples[p], samples[q]) for p, q in names if has_columns(samples, p)]


def get_opening(samples: NDArray[Any]) -> Array | None:
    """Return the opening (n, hands) m of grippers in samples, or None without grippers."""
    return np.asarray(samples["opening"]) if has_columns(samples, "opening") else None


def multiply_quaternions(a: Array, b: Array) -> Array:
    """Return the products (n, 4) of two arrays of wxyz quaternions (n, 4)."""
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    out = np.empty((len(a), 4))
    out[:, 0] = aw * bw - ax * bx - ay * by - az * bz
    out[:, 1] = aw * bx + ax * bw + ay * bz - az * by
    out[:, 2] = aw * by - ax * bz + ay * bw + az * bx
    out[:, 3] = aw * bz + ax * by - ay * bx + az * bw
    return out


def rotate_vectors(quaternion: Array, v: Array) -> Array:
    """Rotate vectors (n, 3) by wxyz quaternions (n, 4)."""
    w, u = quaternion[:, :1], quaternion[:, 1:]
    t = 2.0 * compute_cross(u, v)
    return np.asarray(v + w * t + compute_cross(u, t))
