"""Comparison of a robot file with the model that it was imported from, at random postures.

The robot file is read in the usual way; mass, centre of mass and inertia come from the controllers'
rigid body, and again from the compiled scene. The reference is MuJoCo's compiled model of the
imported file.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.importing.chain import Chain, combine
from skywright.models.rigid_body import build_body_model, compute_body, compute_kinematics
from skywright.models.scene import build_scene, set_pose

POSTURES = 20
TOLERANCE = 1e-6
FAR = 100.0
"""rad or m of the farthest posture: differences of far larger numbers have no digits left."""


class Deviations(NamedTuple):
    """Largest deviations over all postures."""

    mass: float  # relative
    com: float  # m
    inertia: float  # over the trace
    tip: float  # m
    jacobian: float  # m/rad; slides m/m
    postures: int

    def worst(self) -> tuple[str, float]:
        """Return the largest deviation and its name."""
        both = self._asdict()
        del both["postures"]
        name = max(both, key=lambda key: float(both[key]))
        return name, float(both[name])


def compare(model: mujoco.MjModel, root: int, chain: Chain, robot: Robot) -> Deviations:
    """Compare a robot with the model at `POSTURES` random joint positions, seeded."""
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    own, scene = build_body_model(robot), build_scene(robot, World(name="nowhere"))
    mine = mujoco.MjData(scene.model)
    n = len(chain.joints)
    reach = np.array([part.span or (-np.pi, np.pi) for part in chain.parts[1:]]).reshape(-1, 2)
    reach = np.clip(reach, -FAR, FAR)
    bodies = [b for b in range(1, model.nbody) if model.body_rootid[b] == root]
    at_tip = _local_tip(model, chain)
    worst = np.zeros(5)
    for _ in range(POSTURES):
        q = rng.uniform(reach[:, 0], reach[:, 1])
        data.qpos[:] = chain.qpos
        data.qpos[[int(model.jnt_qposadr[j]) for j in chain.joints]] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mass, com, inertia = combine(model, data, bodies)
        about = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
        set_pose(scene, mine, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), q)
        mujoco.mj_kinematics(scene.model, mine)
        mujoco.mj_comPos(scene.model, mine)
        platform = scene.places.platform_body
        ours = [b for b in range(scene.model.nbody) if scene.model.body_rootid[b] == platform]
        m2, c2, i2 = combine(scene.model, mine, ours)
        i2 = i2 + m2 * (c2 @ c2 * np.eye(3) - np.outer(c2, c2))
        for m, c, inertia_B in (compute_body(own, q), (m2, c2, i2)):
            worst[:3] = np.maximum(worst[:3], [
                abs(m / mass - 1.0), np.linalg.norm(c - com),
                np.max(np.abs(inertia_B - about)) / np.trace(about),
            ])  # fmt: skip
        if n:
            k = compute_kinematics(own, q)
            jac, place = _jacobian(model, data, chain, at_tip)
            worst[3] = max(worst[3], float(np.linalg.norm(k["p_BT"] - place)))
            worst[4] = max(worst[4], float(np.max(np.abs(k["J_BT"][:, :n] - jac))))
    mass_off, com_off, inertia_off, tip_off, jacobian_off = (float(x) for x in worst)
    return Deviations(mass_off, com_off, inertia_off, tip_off, jacobian_off, POSTURES)


def _local_tip(model: mujoco.MjModel, chain: Chain) -> Array:
    data = mujoco.MjData(model)
    data.qpos[:] = chain.qpos
    mujoco.mj_kinematics(model, data)
    R, p = data.xmat[chain.carrier].reshape(3, 3), data.xpos[chain.carrier]
    return np.asarray(R.T @ (chain.tip - p))


def _jacobian(
    model: mujoco.MjModel, data: mujoco.MjData, chain: Chain, at: Array
) -> tuple[Array, Array]:
    """Return J (3, n) of the tip in the frame of the root, and the tip's position (3,) m."""
    place = data.xpos[chain.carrier] + data.xmat[chain.carrier].reshape(3, 3) @ at
    full = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, full, None, place, chain.carrier)
    return full[:, [int(model.jnt_dofadr[j]) for j in chain.joints]], place
