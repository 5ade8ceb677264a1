"""Contacts between parts of the robot.

Arms, the things that they hold and propellers collide with each other; hub, booms and legs do not,
because their coarse shapes surround the arms' mounts. Links are capsules with round ends. Parts
whose shapes touch in a regular posture (folded, landed, working) are neighbours by design, and
their contact would be an artefact. All other pairs collide.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.models.arm_body import OWN
from skywright.models.rigid_body import joint_names, posture

if TYPE_CHECKING:
    from skywright.models.geometry import ClearanceQuery

TOUCH_Q = 0.05  # rad between the postures checked for contact of the robot's parts
POSTURES = ("folded", "landed", "working")


def exclude_neighbours(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Exclude contacts of bodies of the robot that touch in one of POSTURES."""
    model = spec.compile()
    data = mujoco.MjData(model)
    root = model.body("platform").id
    q = [int(model.jnt_qposadr[model.joint(name).id]) for name in joint_names(robot)]
    touching: set[tuple[int, int]] = set()  # of geoms
    for name in POSTURES:
        data.qpos[:] = model.qpos0
        data.qpos[q] = posture(robot, name)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        own = np.all(model.body_rootid[model.geom_bodyid[data.contact.geom]] == root, axis=1)
        touching |= {(int(min(g)), int(max(g))) for g in data.contact.geom[own]}
    body = model.geom_bodyid
    for a, b in sorted({(int(body[g]), int(body[h])) for g, h in touching}):
        spec.add_exclude(bodyname1=model.body(a).name, bodyname2=model.body(b).name)
        for g, h in product(np.flatnonzero(body == a), np.flatnonzero(body == b)):
            names = model.geom(g).name, model.geom(h).name
            collide = model.geom_contype[g] & model.geom_contype[h] & OWN
            # other shapes of the two bodies may still collide
            if collide and (int(g), int(h)) not in touching:
                spec.add_pair(geomname1=names[0], geomname2=names[1])


def is_apart(query: ClearanceQuery | None, a: Array, b: Array) -> bool:
    """Whether parts that are apart in posture a stay apart on the path to posture b.

    Both are (n_joints,) rad, in the nominal scene. Returns False without a query.
    """
    if query is None:
        return False
    model, data = query.model, mujoco.MjData(query.model)
    root = model.body("platform").id
    met = set[tuple[int, int]]()
    n = max(math.ceil(float(np.max(np.abs(b - a), initial=0.0)) / TOUCH_Q), 1)
    for i in range(n + 1):
        data.qpos[:3] = 0.0, 0.0, 100.0  # far from the world
        data.qpos[query.core.joint_qpos] = a + i / n * (b - a)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        own = model.body_rootid[model.geom_bodyid[data.contact.geom]] == root
        meets = {(int(g), int(h)) for g, h in data.contact.geom[np.all(own, axis=1)]}
        met = meets if i == 0 else met
        if meets - met:
            return False
    return True
