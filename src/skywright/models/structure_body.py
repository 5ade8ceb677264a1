"""The inspected structure in the scene: a plate, a pillar, or the staves of a tunnel's lining."""

import math
from typing import Any

import mujoco
import numpy as np

from skywright.core.rotations import quat_from_rot
from skywright.description.world.spec import World
from skywright.description.world.structure import ARCH, CYLINDER, Surface
from skywright.models.fixed_body import add_fixed

STRUCTURE = "structure"
"""Names of the structure's geometries begin with it."""
STAVE = math.radians(5.0)
"""Angle of a stave: MuJoCo has no hollow cylinder. At 3 m radius its edges deviate by 3 mm."""
SPAN = math.radians(75.0)  # of the arch, to each side
COLOUR = [0.62, 0.63, 0.62, 1]


def add_structure(
    spec: mujoco.MjSpec,
    world: World,
    surface: Surface | None,
    classes: dict[str, Any],
    plant: bool,
) -> None:
    """Add the world's structure with its `surface`; `classes` are its collision classes."""
    s = world.structure
    if s is None or surface is None:
        return
    body = add_fixed(spec, STRUCTURE, plant)
    p, R = surface.p_WS, surface.R_WS
    if surface.shape == CYLINDER:
        axis, half = R[:, surface.along], 0.5 * (s.width_m if surface.along else s.length_m)
        frame = np.column_stack([R[:, 2], np.cross(axis, R[:, 2]), axis])
        body.add_geom(
            name=STRUCTURE, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[surface.radius, half, 0],
            pos=p - surface.radius * R[:, 2], quat=quat_from_rot(frame), rgba=COLOUR, **classes,
        )  # fmt: skip
        return
    size = np.array([s.length_m, s.width_m, s.thickness_m]) / 2
    if surface.shape != ARCH:
        body.add_geom(
            name=STRUCTURE, type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=p - size[2] * R[:, 2],
            quat=quat_from_rot(R), rgba=COLOUR, **classes,
        )  # fmt: skip
        return
    centre = p + surface.radius * R[:, 2]
    size[1] = (surface.radius + s.thickness_m) * math.tan(0.5 * STAVE)
    n = round(SPAN / STAVE)
    for i in range(-n, n + 1):
        z = math.cos(i * STAVE) * R[:, 2] - math.sin(i * STAVE) * R[:, 1]
        frame = np.column_stack([R[:, 0], np.cross(z, R[:, 0]), z])
        body.add_geom(
            name=f"{STRUCTURE} {i + n}", type=mujoco.mjtGeom.mjGEOM_BOX, size=size,
            pos=centre - (surface.radius + size[2]) * z, quat=quat_from_rot(frame), rgba=COLOUR,
            **classes,
        )  # fmt: skip


def list_structure(spec: mujoco.MjSpec) -> list[str]:
    """Return the names of the structure's geometries."""
    return [g.name for g in spec.geoms if g.name.startswith(STRUCTURE)]
