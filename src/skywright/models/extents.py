"""Extents of a robot's shapes and the swing of its passive link, from the nominal scene."""

import math

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.compliant_arms import compute_gravity_torque
from skywright.models.rigid_body import build_body_model
from skywright.models.scene import Scene, build_scene


def compute_extents(robot: Robot, q: Array) -> tuple[list[str], Array, Array]:
    """Return names, lower and upper corners (n, 3) m in B of boxes around all shapes."""
    scene = build_scene(robot, World(name="empty"))
    data = _pose(scene, q)
    model, names, low, high = scene.model, [], [], []
    for g in scene.places.robot_geoms:
        R = data.geom_xmat[g].reshape(3, 3)
        r, h = float(model.geom_size[g, 0]), float(model.geom_size[g, 1])
        kind = mujoco.mjtGeom(model.geom_type[g])
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            half = np.abs(R[:, 2]) * h + r
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            half = np.abs(R[:, 2]) * h + r * np.sqrt(1.0 - np.minimum(R[:, 2] ** 2, 1.0))
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            half = np.full(3, r)
        else:
            half = np.abs(R) @ model.geom_size[g]
        names.append(model.geom(int(g)).name)
        low.append(data.geom_xpos[g] - half)
        high.append(data.geom_xpos[g] + half)
    return names, np.array(low), np.array(high)


def _pose(scene: Scene, q: Array) -> mujoco.MjData:
    data = mujoco.MjData(scene.model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[scene.places.joint_qpos] = q
    mujoco.mj_forward(scene.model, data)
    return data


def compute_swing_period(robot: Robot, q: Array) -> float:
    """Period (s) of the passive link with the platform held."""
    scene = build_scene(robot, World(name="empty"))
    data = _pose(scene, q)
    full = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, data, full)
    dof = scene.places.joint_dof[0]
    model, step = build_body_model(robot), 1e-4
    up, down = q.copy(), q.copy()
    up[0] += step
    down[0] -= step
    k = (compute_gravity_torque(model, up)[0] - compute_gravity_torque(model, down)[0]) / (2 * step)
    return 2.0 * math.pi * math.sqrt(float(full[dof, dof]) / float(k))
