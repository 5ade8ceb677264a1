"""The six-axis force-torque sensor in the arm."""

from __future__ import annotations

import numpy as np
import pytest

from plant_parts import build_context, build_plant
from skywright.core.record import View
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence.bench.flights import fly_to_hover
from skywright.vehicle.readings import WrenchSample
from skywright.vehicle.sensors.force_torque import ForceTorque


def test_a_wrist_carries_the_weight_beyond_it():
    sensor = ForceTorque("ft", ForceTorque.Table(force_bias_n=0.0, torque_bias_nm=0.0))
    context = build_context(extend=(sensor,))
    plant = build_plant(context, sensor)
    model, data = context.scene.model, context.sim.data
    plant.run(round(1.5 / context.dt))  # it stands on its gear
    holder = model.body("holder").id
    beyond = [b for b in range(model.nbody) if b == holder or model.body_parentid[b] == holder]
    weight = float(sum(model.body_mass[b] for b in beyond)) * context.world.gravity_mps2
    R = data.xmat[holder].reshape(3, 3)
    force_W = R @ np.array(View(plant.assembly.get(WrenchSample)).force)
    np.testing.assert_allclose(force_W, [0.0, 0.0, -weight], atol=0.03 * weight + 0.01)
    arm = sum(model.body_mass[b] * (data.xipos[b] - data.xpos[holder]) for b in beyond)
    turn = np.cross(arm, [0.0, 0.0, -context.world.gravity_mps2])
    torque_W = R @ np.array(View(plant.assembly.get(WrenchSample)).torque)
    np.testing.assert_allclose(torque_W, turn, atol=0.05 * weight * 0.1 + 1e-3)


def test_a_place_that_is_no_part_of_the_arm_is_refused():
    sensor = ForceTorque("ft", ForceTorque.Table(at="elbow"))
    with pytest.raises(InputError, match="'elbow' is not a part of the arm; valid: wrist, probe"):
        build_context(extend=(sensor,))


def test_it_flies_by_a_table_of_the_robot():
    sets = ["robot.sensors.ft.kind=force_torque", "robot.sensors.ft.at=probe"]
    vehicle = fly_to_hover(load_description("pipe-weld-scan", sets=sets))
    blocks: list[np.ndarray] = []
    vehicle.on_samples = blocks.append
    vehicle.flush()
    for _ in range(50):
        vehicle.tick()
    vehicle.flush()
    rows = np.concatenate(blocks)[-50:]
    slider = vehicle.robot.probe.slider_mass_kg * vehicle.world.gravity_mps2
    force = np.linalg.norm(rows["wrench_force"].mean(axis=0))
    assert force == pytest.approx(slider, abs=0.2)  # its spring's preload is not in it
    assert rows["wrench_torque"].shape == (50, 3)
