"""A push on the platform moves the robot as m x'' = F says, with and without its controller."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from plant_parts import build_context, build_plant
from skywright.description.loader import load_description
from skywright.run.backends import build_vehicle
from skywright.vehicle.bus import Truth
from skywright.vehicle.given_forces import GivenForces
from skywright.vehicle.moves import Moves
from skywright.vehicle.plant import AirForce

PUSH = np.array([40.0, 0.0, 0.0])  # N


def get_momentum(sim) -> np.ndarray:
    """Momentum (3,) kg m/s of the whole robot, in W."""
    model, data = sim.scene.model, sim.data
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    body = sim.scene.places.platform_body
    return model.body_subtreemass[body] * data.subtree_linvel[body]


def test_a_robot_without_control_flies_off():
    calm = [f"robot.platform.drag_area_{axis}_m2=0" for axis in "xyz"]
    context = build_context("waypoints", calm)
    plant = build_plant(context)
    plant.sim.data.qpos[2] = 50.0
    mujoco.mj_forward(context.scene.model, plant.sim.data)
    start = plant.sim.data.qpos[:3].copy()
    next(c for c in plant.assembly.components if isinstance(c, GivenForces)).push("platform", PUSH)
    plant.run(round(1.0 / context.dt))
    mass = context.scene.model.body_subtreemass[context.scene.places.platform_body]
    moved = plant.sim.data.qpos[:3] - start
    np.testing.assert_allclose(moved, [20.0 / mass, 0.0, -0.5 * 9.81], rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("robot", ["othex", "bimanual"])
def test_a_controlled_robot_moves_by_all_forces_on_it(robot: str):
    d = load_description("waypoints", robot, sets=["mission.estimator=truth"])
    v = build_vehicle(d)
    uav = Moves(v)
    uav.take_off(1.5)
    while not v.tick().arrived:
        pass
    before = v.read(Truth).p_WB.copy()
    v.devices.helper.push("platform", PUSH)
    v.n_ticks = 1  # what acts is held for a control tick
    model, platform = v.scene.model, v.scene.places.platform_body
    mass = model.body_subtreemass[platform]
    axes = model.actuator_gear[: len(v.nominal.rotors.axis), :3].T
    start, impulse = get_momentum(v.sim), np.zeros(3)
    for _ in range(round(0.2 / v.dt)):
        R = np.array(v.sim.data.xmat[platform]).reshape(3, 3)
        v.tick()
        thrust = R @ axes @ v.sim.ctrl[: axes.shape[1]]
        air = v.read(AirForce).f_W
        impulse += v.dt * (PUSH + thrust + air - mass * np.array([0.0, 0.0, 9.81]))
    change = get_momentum(v.sim) - start
    np.testing.assert_allclose(change, impulse, atol=0.01 * 0.2 * PUSH[0])
    # its rotors cannot hold 40 N at once: most of what F / m says is moved
    assert v.read(Truth).p_WB[0] - before[0] > 0.5 * 0.5 * PUSH[0] / mass * 0.2**2
    v.devices.helper.push("platform", np.zeros(3))
    v.tick()
    np.testing.assert_allclose(v.sim.xfrc[platform, :3], v.read(AirForce).f_W, atol=0.5)
