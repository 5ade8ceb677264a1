"""Things of a world that overlap at the start."""

from __future__ import annotations

import mujoco
import numpy as np

from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.arm_body import Deviation
from skywright.models.fixed_body import FIXED
from skywright.models.scene import build_scene
from skywright.models.things._build import OBJECT

TOLERATED = 0.003
"""m, upper bound of the penetration of soft contacts under the weight of things on them."""


def find_overlaps(robot: Robot, world: World) -> list[tuple[str, str, float]]:
    """Return the pairs of things that overlap at the start, and the depth (m).

    Only pairs with a movable thing count: their contact forces separate them at the first step of
    the simulation. Fixed things may overlap, such as a post and its pipe.
    """
    scene = build_scene(robot, world, Deviation())
    model, data = scene.model, mujoco.MjData(scene.model)
    mujoco.mj_forward(model, data)
    own = set(np.asarray(scene.places.robot_geoms).tolist())
    deepest: dict[tuple[str, str], float] = {}
    for contact in data.contact:
        first, second = (int(g) for g in contact.geom)
        if first in own or second in own or contact.dist > -TOLERATED:
            continue
        names = sorted(_name(model, g) for g in (first, second))
        pair = (names[0], names[1])
        deepest[pair] = max(deepest.get(pair, 0.0), -float(contact.dist))
    return [(*pair, depth) for pair, depth in sorted(deepest.items())]


def _name(model: mujoco.MjModel, geom: int) -> str:
    """Return the thing of a shape: its body, or the shape's own name in the world."""
    body = int(model.geom_bodyid[geom])
    if not body:
        return str(model.geom(geom).name)
    return str(model.body(body).name).removeprefix(OBJECT).removeprefix(FIXED)
