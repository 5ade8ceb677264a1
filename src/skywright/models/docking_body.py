"""The docking gear in the scene: legs, and feet lined with rubber."""

import math
from typing import Any

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.description.robot.docking import Docking
from skywright.models.part_masses import build_docking_parts

IMPEDANCE = 0.05
"""MuJoCo's d, constant over the penetration, so that stiffness and damping are constant. It is
small because a contact's regularisation acts like a mass d / ((1 - d) w) on the foot."""
NOSLIP_ITERATIONS = 5
"""Contacts of this softness creep sideways under load; the noslip solver prevents the creep."""


def list_feet(docking: Docking) -> Array:
    """Return the contact points of the feet (n, 3) m in B."""
    turn = math.radians(docking.azimuth_deg) + 2 * math.pi * np.arange(docking.feet) / docking.feet
    r = docking.radius_m
    return np.column_stack(
        [r * np.cos(turn), r * np.sin(turn), np.full(docking.feet, docking.height_m)]
    )


def add_docking(
    base: mujoco.MjsBody,
    docking: Docking,
    hub_radius: float,
    leg: dict[str, Any],
    foot: dict[str, Any],
) -> None:
    """Add the gear to the platform; `leg` and `foot` are collision classes.

    The feet are a separate body, so that docking contacts do not count as collisions.
    """
    own, com, inertia = build_docking_parts(docking)
    body = base.add_body(name="docking")
    body.mass, body.ipos, body.inertia = own, com, np.diag(inertia)
    body.explicitinertial = True
    r = docking.foot_radius_m
    for i, point in enumerate(list_feet(docking)):
        start = np.array([*(hub_radius / docking.radius_m * point[:2]), 0.0])
        centre = point - np.array([0.0, 0.0, r])
        base.add_geom(
            name=f"docking leg{i}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.006, 0, 0],
            fromto=[*start, *(centre - [0.0, 0.0, r])], rgba=[0.55, 0.55, 0.6, 1], **leg,
        )  # fmt: skip
        body.add_geom(
            name=f"docking foot{i}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[r, 0, 0],
            pos=centre, rgba=[0.1, 0.1, 0.1, 1], mass=0.0, priority=1, condim=3,
            friction=[docking.friction, 0.005, 0.0001],
            solimp=[IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0], **foot,
        )  # fmt: skip


def set_foot_stiffness(model: mujoco.MjModel, docking: Docking, spec: mujoco.MjSpec) -> None:
    """Set stiffness and damping of the feet in a compiled model, and in its spec for the MJCF.

    MuJoCo's contact force is the reference acceleration over R = (1 - d) / d w, where w is the
    inverse mass of the foot's body (`body_invweight0`, available after compilation). The direct
    `solref` (-k, -b) gives the reference acceleration (k / d) r + (b / d) v at the penetration r,
    so k = K d R and b = C d R produce a spring K and a damper C.
    """
    for i in range(docking.feet):
        geom = model.geom(f"docking foot{i}").id
        weight = model.body_invweight0[model.geom_bodyid[geom], 0]
        scale = (1.0 - IMPEDANCE) * weight
        model.geom_solref[geom] = [
            -docking.stiffness_n_per_m * scale, -docking.damping_ns_per_m * scale,
        ]  # fmt: skip
        spec.geom(f"docking foot{i}").solref = model.geom_solref[geom]
