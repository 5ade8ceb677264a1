"""Padded obstacles in the scene, and the gauges that measure what a collision does to a platform.

The plant has gauges where the world has something padded to hit: force and torque sensors where
arms or passive link are mounted on the platform, and the net contact force on every pad.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.description.robot.limbs import list_limbs
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import Box, World
from skywright.models.arm_body import FEET, LIMITED, PEN, ROBOT, WORLD

Array = NDArray[np.float64]

PAD = "pad "
"""Names of pads' geometries, joints and sensors start with it."""
GAUGE = "gauge "
"""Likewise of the sensors at the mounts."""
REBOUND = 0.01  # m that a plate may swing out beyond its rest


def has_pads(world: World) -> bool:
    """Whether the world has something padded."""
    return any(box.pad is not None for box in world.obstacles.values())


def locate_pad(box: Box) -> tuple[Array, Array]:
    """Return the middle (3,) m of the plate's outer face and the direction (3,) of running in."""
    assert box.pad is not None
    ahead = rot_z(math.radians(box.yaw_deg))[:, 0]
    depth = 0.5 * box.size_x_m + box.pad.travel_m + box.pad.thickness_m
    return np.array([box.x_m, box.y_m, box.z_m]) - depth * ahead, ahead


def add_pads(spec: mujoco.MjSpec, world: World, plant: bool) -> None:
    """Add the plates: fixed in the nominal scene, on their springs in the plant."""
    for name, box in world.obstacles.items():
        if box.pad is None:
            continue
        pad, (face, ahead) = box.pad, locate_pad(box)
        half = math.radians(box.yaw_deg) / 2
        body = spec.worldbody.add_body(
            name=PAD + name, pos=face + 0.5 * pad.thickness_m * ahead,
            quat=[math.cos(half), 0, 0, math.sin(half)],
        ) if plant else spec.worldbody  # fmt: skip
        place: dict[str, Any] = {} if plant else {
            "pos": face + 0.5 * pad.thickness_m * ahead,
            "quat": [math.cos(half), 0, 0, math.sin(half)],
        }  # fmt: skip
        body.add_geom(
            name=PAD + name, type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.5 * pad.thickness_m, 0.5 * box.size_y_m, 0.5 * box.size_z_m],
            rgba=[0.95, 0.75, 0.2, 1], contype=WORLD, conaffinity=ROBOT | FEET | PEN,
            mass=pad.mass_kg, priority=2, friction=[0.5, 0.005, 0.0001],
            solref=[0.002, 1.0], solimp=[0.95, 0.95, 0.001, 0.5, 2.0], **place,
        )  # fmt: skip
        if not plant:
            continue
        joint = body.add_joint(
            name=PAD + name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0],
            limited=LIMITED, range=[-REBOUND, pad.travel_m], solref_limit=[0.004, 1.0],
        )  # fmt: skip
        for key, value in (("stiffness", pad.stiffness_n_per_m), ("damping", pad.damping_ns_per_m)):
            poly = np.ndim(getattr(joint, key)) > 0
            setattr(joint, key, np.array([value, 0.0, 0.0]) if poly else value)
        spec.add_sensor(
            name=PAD + name, type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_BODY, objname=PAD + name,
            intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1],
        )  # fmt: skip


def add_gauges(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add force and torque sensors where the platform carries something that moves."""
    spec.body("platform").add_site(name=f"{GAUGE}origin")
    for limb in list_limbs(robot):
        if limb.parent >= 0:
            continue
        name = GAUGE + limb.name
        spec.body(limb.name).add_site(name=name)
        for kind, what in (
            (mujoco.mjtSensor.mjSENS_FORCE, "force"),
            (mujoco.mjtSensor.mjSENS_TORQUE, "torque"),
        ):
            spec.add_sensor(
                name=f"{name} {what}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=name
            )


def find_gauges(model: mujoco.MjModel) -> tuple[NDArray[np.int64], int, NDArray[np.int64]]:
    """Return (site, force address, torque address) a row, the platform's site, pads' addresses."""
    address = {model.sensor(i).name: int(model.sensor_adr[i]) for i in range(model.nsensor)}
    sites = [model.site(i).name for i in range(model.nsite)]
    origin = f"{GAUGE}origin"
    rows = [
        (i, address[f"{n} force"], address[f"{n} torque"])
        for i, n in enumerate(sites) if n.startswith(GAUGE) and n != origin
    ]  # fmt: skip
    pads = [a for n, a in address.items() if n.startswith(PAD)]
    return (
        np.array(rows, dtype=np.int64).reshape(-1, 3),
        sites.index(origin) if origin in sites else -1,
        np.array(pads, dtype=np.int64),
    )
