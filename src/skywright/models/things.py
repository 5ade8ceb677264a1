"""Movable things and the bench in the scene (description/world/things.py)."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from skywright.core.rotations import quat_from_rot, rot_y, rot_z
from skywright.description.world.spec import World
from skywright.models.arm_body import FEET, PEN, ROBOT, WORLD
from skywright.models.docking_body import NOSLIP_ITERATIONS

OBJECT = "object "
"""Names of things' bodies and joints start with it."""
BENCH = "bench"


def add_things(spec: mujoco.MjSpec, world: World, plant: bool) -> None:
    """Add the world's movable things; in the nominal scene they stand where the file puts them.

    MuJoCo's soft friction creeps by millimetres a second under a load; what hands hold would sink.
    """
    if world.objects:
        spec.option.noslip_iterations = NOSLIP_ITERATIONS
    for name, thing in world.objects.items():
        turn = rot_z(math.radians(thing.yaw_deg)) @ rot_y(math.radians(thing.pitch_deg))
        body = spec.worldbody.add_body(
            name=OBJECT + name, pos=[thing.x_m, thing.y_m, thing.z_m], quat=quat_from_rot(turn)
        )
        box = thing.shape == "box"
        kwargs: dict[str, Any] = {
            "contype": WORLD, "conaffinity": ROBOT | FEET | PEN | WORLD, "mass": thing.mass_kg,
            "friction": [thing.friction, 0.005, 0.0001], "condim": 4, "rgba": [0.3, 0.6, 0.4, 1],
            "solref": [0.008, 1.0], "solimp": [0.9, 0.95, 0.001, 0.5, 2.0],
        }  # fmt: skip
        if box:
            assert thing.size_y_m is not None
            half = [0.5 * thing.size_x_m, 0.5 * thing.size_y_m, 0.5 * thing.size_z_m]
            body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=half, **kwargs)
        else:
            body.add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                size=[0.5 * thing.size_x_m, 0.5 * thing.size_z_m, 0], **kwargs,
            )  # fmt: skip
        if not plant:
            continue
        body.add_freejoint(name=OBJECT + name)
        spec.add_sensor(
            name=f"touch {name}", type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_BODY, objname=OBJECT + name,
            intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1],
        )  # fmt: skip
        if thing.held_n is not None:
            hold = spec.add_equality(
                name=f"hold {name}", type=mujoco.mjtEq.mjEQ_WELD,
                objtype=mujoco.mjtObj.mjOBJ_BODY, name1=OBJECT + name,
            )  # fmt: skip
            hold.solref = [0.01, 1.0]
            anchor = [thing.x_m, thing.y_m, thing.z_m]  # else it would hang on a long lever
            hold.data = np.array([*anchor, 0, 0, 0, 0, 0, 0, 0, 1.0, 0])


def add_bench(spec: mujoco.MjSpec, world: World, plant: bool) -> None:
    """Clamp the platform to a body that is moved by hand (MuJoCo's "mocap" body)."""
    if world.bench is None or not plant:
        return
    place = [world.bench.x_m, world.bench.y_m, world.bench.z_m]
    spec.worldbody.add_body(name=BENCH, mocap=True, pos=place, quat=list(world.bench.q_WB))
    clamp = spec.add_equality(
        name=BENCH, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="platform", name2=BENCH,
    )  # fmt: skip
    clamp.solref = [0.005, 1.0]
    clamp.data = np.array([0, 0, 0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0])  # same frame
