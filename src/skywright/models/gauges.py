"""Gauges that measure the loads of a collision on a platform.

The plant has them in worlds with gauged parts (models/things/pad.py): force and torque sensors at
the mounts of arms or passive link on the platform, and a sensor of the net contact force on every
gauged part.
"""

import mujoco
import numpy as np

from skywright.core.arrays import Ints
from skywright.description.robot.limbs import list_limbs
from skywright.description.robot.spec import Robot
from skywright.description.world.thing import Things
from skywright.models.things._build import IMPACT

GAUGE = "gauge "
"""Names of the sensors at the mounts start with it."""


def has_gauges(things: Things) -> bool:
    """Whether a world has a thing with gauges."""
    return any(part.gauged for thing in things.values() for part in thing.list_parts())


def add_gauges(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add force and torque sensors at the mounts of the platform's moving parts."""
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


def find_gauges(model: mujoco.MjModel) -> tuple[Ints, int, Ints]:
    """Return rows of (site, force address, torque address), the platform's site, and parts'
    addresses."""
    address = {model.sensor(i).name: int(model.sensor_adr[i]) for i in range(model.nsensor)}
    sites = [model.site(i).name for i in range(model.nsite)]
    origin = f"{GAUGE}origin"
    rows = [
        (i, address[f"{n} force"], address[f"{n} torque"])
        for i, n in enumerate(sites) if n.startswith(GAUGE) and n != origin
    ]  # fmt: skip
    pads = [a for n, a in address.items() if n.startswith(IMPACT)]
    return (
        np.array(rows, dtype=np.int64).reshape(-1, 3),
        sites.index(origin) if origin in sites else -1,
        np.array(pads, dtype=np.int64),
    )
