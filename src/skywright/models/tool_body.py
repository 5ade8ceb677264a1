"""The inspection tool in the scene: one free body, held by contact alone.

Contact settings. Friction is Coulomb's on an elliptic cone, with MuJoCo's no-slip step, since its
soft friction creeps under load. Softness (`world.tool.contact_time_constant_s`): time constant
8 ms, critically damped, eight steps of 1 ms (MuJoCo's documentation asks for at least two), so that
a tool of half a kilogram sinks in by less than a tenth of a millimetre. Priority 2: the tool's
friction holds for every pair, whatever the pipe or the hook says. The torsional coefficient, 5 mm,
is a contact patch of that size.
"""

from __future__ import annotations

import copy
import itertools
import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_from_rot, rot_z
from skywright.description.world.spec import World
from skywright.description.world.tool import Tool, list_tool_parts
from skywright.models.arm_body import FEET, PEN, ROBOT, WORLD
from skywright.models.docking_body import NOSLIP_ITERATIONS

Array = NDArray[np.float64]

TOOL = "tool"
FAR = 2.0  # m, beyond which a distance is reported as this


def find_tool_place(world: World) -> tuple[Array, Array]:
    """Return (p_WO (3,) m, R_WO (3, 3)) of the tool where the world puts it."""
    assert world.tool is not None
    tool, under = world.tool, world.obstacles[world.tool.on]
    top = under.z_m + 0.5 * under.size_z_m
    return (
        np.array([tool.x_m, tool.y_m, top + tool.foot_height_m]),
        rot_z(math.radians(tool.yaw_deg)),
    )


def add_tool(spec: mujoco.MjSpec, world: World, name: str, plant: bool) -> None:
    """Add the tool as the body `name`; in the nominal scene it stands where the file puts it."""
    if world.tool is None:
        return
    spec.option.noslip_iterations = NOSLIP_ITERATIONS
    p, R = find_tool_place(world)
    body = spec.worldbody.add_body(name=name, pos=p, quat=quat_from_rot(R))
    add_tool_parts(body, world.tool, {"contype": WORLD, "conaffinity": ROBOT | FEET | PEN | WORLD})
    if plant:
        body.add_freejoint(name=name)


def add_tool_parts(body: mujoco.MjsBody, tool: Tool, collide: dict[str, int]) -> None:
    """Add the tool's solids to a body whose frame is O."""
    kwargs: dict[str, Any] = {
        "friction": [tool.friction, 0.005, 0.0001], "condim": 4, "priority": 2,
        "solref": [tool.contact_time_constant_s, 1.0], "solimp": [0.9, 0.95, 0.001, 0.5, 2.0],
        **collide,
    }  # fmt: skip
    for part in list_tool_parts(tool):
        if part.half is not None:
            body.add_geom(
                name=part.name, type=mujoco.mjtGeom.mjGEOM_BOX, size=part.half, pos=part.a,
                mass=part.mass, rgba=[0.9, 0.9, 0.85, 1], **kwargs,
            )  # fmt: skip
        else:
            color = [0.75, 0.2, 0.2, 1] if part.name == "tool handle" else [0.65, 0.68, 0.72, 1]
            body.add_geom(
                name=part.name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[part.radius, 0, 0],
                fromto=[*part.a, *part.b], mass=part.mass, rgba=color, **kwargs,
            )  # fmt: skip


def find_tool_clearance(
    model: mujoco.MjModel, way: Array, hang: Array, step: float = 0.03
) -> tuple[float, str]:
    """Return the least distance (m) of the carried tool to the world's solids, and to which.

    `way` (n, 4) m, rad are way-points of the platform, straight between each other, `hang` (3,) m
    is the tool's O from the platform in a level frame with its heading. `model` is a nominal scene
    with the tool; the ground is left out.
    """
    model = copy.copy(model)
    data = mujoco.MjData(model)
    body = next(i for i in range(model.nbody) if model.body(i).name.endswith(" " + TOOL))
    mine = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
    others = [
        g for g in range(model.ngeom)
        if model.geom_bodyid[g] == 0 and model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE
    ]  # fmt: skip
    least, what = FAR, ""
    for a, b in itertools.pairwise(way):
        count = max(math.ceil(float(np.linalg.norm(b[:3] - a[:3])) / step), 1)
        for u in np.linspace(0.0, 1.0, count + 1):
            pose = a + u * (b - a)
            R = rot_z(float(pose[3]))
            model.body_pos[body] = pose[:3] + R @ hang
            model.body_quat[body] = quat_from_rot(R)
            mujoco.mj_kinematics(model, data)
            for g in mine:
                for other in others:
                    distance = mujoco.mj_geomDistance(model, data, g, other, least, None)
                    if distance < least:
                        least, what = distance, model.geom(other).name
    return least, what
