"""Contacts between parts of the robot.

Arms, the things that they hold and propellers collide with each other; hub, booms and legs do not,
because their coarse shapes surround the arms' mounts. Links are capsules with round ends. Parts
whose shapes touch in a regular posture (folded, landed, working) are neighbours by design, and
their contact would be an artefact. All other pairs collide.
"""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.description.robot.spec import Robot
from skywright.models.arm_body import OWN
from skywright.models.rigid_body import joint_names, posture

if TYPE_CHECKING:
    from skywright.models.geometry import ClearanceQuery

TOUCH_Q = 0.05  # rad between the postures checked for contact of the robot's parts
POSTURES = ("folded", "landed", "working")


def add_propeller_pairs(spec: mujoco.MjSpec) -> None:
    """Add contacts of the propellers with each arm's first moving link and what is fixed to it.

    MuJoCo drops all contacts of a body with its parent, except those of explicit pairs.
    """
    platform = spec.body("platform")
    propellers = [geom for geom in platform.geoms if geom.contype & OWN]
    for link in _list_first_moving(platform):
        for part, propeller in product(_list_rigid_geoms(link), propellers):
            if part.conaffinity & OWN:
                spec.add_pair(geomname1=part.name, geomname2=propeller.name)


def _list_first_moving(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """Return the bodies below `body` that have joints, without bodies below these."""
    out = []
    for child in body.bodies:
        out += [child] if child.joints else _list_first_moving(child)
    return out


def _list_rigid_geoms(body: mujoco.MjsBody) -> list[mujoco.MjsGeom]:
    """Return the geoms of a body and of the bodies that are fixed to it."""
    out = list(body.geoms)
    for child in body.bodies:
        out += [] if child.joints else _list_rigid_geoms(child)
    return out


def exclude_neighbours(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Exclude contacts of bodies of the robot that touch in one of POSTURES."""
    model = spec.compile()
    touching, body = _list_neighbours(model, robot), model.geom_bodyid
    explicit = {frozenset((pair.geomname1, pair.geomname2)): pair for pair in spec.pairs}
    for a, b in sorted({(int(body[g]), int(body[h])) for g, h in touching}):
        spec.add_exclude(bodyname1=model.body(a).name, bodyname2=model.body(b).name)
        for g, h in product(np.flatnonzero(body == a), np.flatnonzero(body == b)):
            names = model.geom(g).name, model.geom(h).name
            collide = model.geom_contype[g] & model.geom_contype[h] & OWN
            pair = explicit.get(frozenset(names))
            if (int(g), int(h)) in touching:
                if pair is not None:
                    spec.delete(pair)
            elif collide and pair is None:  # other shapes of the two bodies may still collide
                spec.add_pair(geomname1=names[0], geomname2=names[1])


class SelfContacts(NamedTuple):
    """A scene's model and the pairs of its geoms that are neighbours by design."""

    model: mujoco.MjModel
    at: Ints  # (n_joints,) places of the joints in qpos
    neighbours: frozenset[tuple[int, int]]


def build_self_contacts(model: mujoco.MjModel, robot: Robot) -> SelfContacts:
    """Read a robot's neighbours by design from the model of its scene."""
    return SelfContacts(
        model, _find_joints(model, robot), frozenset(_list_neighbours(model, robot))
    )


def find_self_contact(parts: SelfContacts, q: Array) -> str:
    """Return "NAME and NAME" of parts of the robot that touch in a posture of q (m, n_joints) rad.

    Returns "" if no parts but neighbours by design touch in any of the postures.
    """
    model, data = parts.model, mujoco.MjData(parts.model)
    for row in q:
        for g, h in sorted(_list_contacts(model, data, parts.at, row) - parts.neighbours):
            return f"{model.geom(g).name} and {model.geom(h).name}"
    return ""


def is_apart(query: ClearanceQuery | None, a: Array, b: Array) -> bool:
    """Whether parts that are apart in posture a stay apart on the path to posture b.

    Both are (n_joints,) rad, in the nominal scene. Returns False without a query.
    """
    if query is None:
        return False
    data = mujoco.MjData(query.model)
    met = set[tuple[int, int]]()
    n = max(math.ceil(float(np.max(np.abs(b - a), initial=0.0)) / TOUCH_Q), 1)
    for i in range(n + 1):
        meets = _list_contacts(query.model, data, query.core.joint_qpos, a + i / n * (b - a))
        met = meets if i == 0 else met
        if meets - met:
            return False
    return True


def _find_joints(model: mujoco.MjModel, robot: Robot) -> Ints:
    places = [int(model.jnt_qposadr[model.joint(name).id]) for name in joint_names(robot)]
    return np.array(places, np.int64)


def _list_neighbours(model: mujoco.MjModel, robot: Robot) -> set[tuple[int, int]]:
    """Return the pairs of the robot's geoms that touch in one of POSTURES."""
    data, at = mujoco.MjData(model), _find_joints(model, robot)
    touching = set[tuple[int, int]]()
    for name in POSTURES:
        touching |= _list_contacts(model, data, at, posture(robot, name))
    return touching


def _list_contacts(
    model: mujoco.MjModel, data: mujoco.MjData, at: Ints, q: Array
) -> set[tuple[int, int]]:
    """Return the pairs of the robot's geoms that touch; `at` (n_joints,) are places in qpos."""
    data.qpos[:3] = 0.0, 0.0, 100.0  # far from the world
    data.qpos[at] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    root = model.body("platform").id
    own = model.body_rootid[model.geom_bodyid[data.contact.geom]] == root
    return {(int(min(g)), int(max(g))) for g in data.contact.geom[np.all(own, axis=1)]}
