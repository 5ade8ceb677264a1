"""What a simulated vehicle starts from: its rates, the bus, the reference at rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_to_rot, rot_z
from skywright.core.types import REFERENCE
from skywright.description.robot.limbs import list_grippers
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.thing import Fixture
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.models.compliant_arms import is_compliant
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_tip
from skywright.models.scene import TIMESTEP, Scene
from skywright.vehicle.assembly import Assembly
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.simulation import Simulation

Array = NDArray[np.float64]


def fill_bus(assembly: Assembly, sim: Simulation, scene: Scene, dt: float) -> None:
    """Tell the clock its periods (s) and the components where MuJoCo's arrays are."""
    clock, mj = assembly.get(Clock), assembly.get(MuJoCo)
    clock["dt"], clock["h"] = dt, scene.model.opt.timestep
    for name, array in sim.arrays.items():
        mj[name] = array.ctypes.data
    sizes = scene.model
    mj["nq"], mj["nv"], mj["nsensor"] = sizes.nq, sizes.nv, sizes.nsensordata
    mj["nsite"], mj["nbody"], mj["npair"] = sizes.nsite, sizes.nbody, sizes.npair
    mj["nu"], mj["na"] = sizes.nu, sizes.na


def build_home_row(
    nominal: Nominal, world: World, home: tuple[Array, Array, Array], yaw: float
) -> NDArray[Any]:
    """Return the reference of a robot that stands at its start with its motors off, (1,).

    `home` is the pose that scene.home_pose gives, `yaw` (rad) the heading.
    """
    p, q_WB, q = home
    table = np.zeros(1, REFERENCE)
    row = table[0]
    row["p_WB"], row["R_WB"] = p, rot_z(yaw)
    bench = find_first(world.things, Fixture)
    if bench is not None and bench.q_WB != (1.0, 0.0, 0.0, 0.0):
        quat_to_rot(q_WB, row["R_WB"])
    row["R_WS"] = np.eye(3)
    row["q"][: len(q)] = q
    p_BT, R_BT = compute_tip(nominal.model, row["q"])
    row["p_WT"], row["R_WT"] = row["p_WB"] + row["R_WB"] @ p_BT, row["R_WB"] @ R_BT
    return table


def list_offers(robot: Robot) -> frozenset[str]:
    """Return the offers of a robot to missions (vehicle/interface.py)."""
    return frozenset(
        ["uav", "dynamics"]
        + (["arms", "whole_body"] if robot.arm else [])
        + (["hands"] if is_compliant(robot) else [])
        + (["gripper"] if list_grippers(robot) else [])
        + (["probe"] if robot.probe else [])
    )


def check_rate(robot: Robot, timestep: float = TIMESTEP) -> tuple[int, float]:
    """Return the physics steps of a control tick, and its period (s).

    Raises InputError where the control rate does not divide the rate of the physics.
    """
    rate = robot.control.rate_hz
    n_steps = round(1.0 / (rate * timestep))
    if abs(n_steps * timestep * rate - 1.0) > 1e-9 or n_steps < 1:
        rates = (1000, 500, 250, 200, 125, 100)
        valid = [r for r in rates if abs(1.0 / (r * timestep) % 1.0) < 1e-9]
        raise InputError(
            f"robot.control.rate_hz = {rate:g} does not divide the physics rate "
            f"{1 / timestep:g} Hz (mission.timestep_ms = {1e3 * timestep:g}); valid: "
            f"{', '.join(map(str, valid))}"
        )
    return n_steps, n_steps * timestep
