"""The recorded load of the servos is what the arm's weight asks of them."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.run.backends import build_vehicle
from skywright.vehicle.observers.servos import ServoLoad


@pytest.mark.parametrize("stall", [2.5, 0.5])
def test_an_arm_at_rest_loads_its_servos_with_its_weight(stall: float) -> None:
    sets = {f"robot.arm.servo{i}.stall_torque_nm": stall for i in (1, 2)}
    vehicle = build_vehicle(load_description("arm-test-bench", sets=sets))
    for _ in range(100):
        vehicle.tick()
    joints = vehicle.scene.places.joint_dof  # the platform is clamped
    weight = np.abs(vehicle.sim.data.qfrc_bias[joints]).max()  # N m
    assert weight > 0.05
    # what is left is the motion of a servo that holds its angle
    assert vehicle.read(ServoLoad).load == pytest.approx(weight / stall, rel=0.02)
