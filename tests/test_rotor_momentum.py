"""Rotors and body keep their angular momentum together."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from plant_parts import build_context, build_plant
from skywright.core.rotations import quat_to_rot
from skywright.description.loader import load_description
from skywright.vehicle.plant import RotorState

SPACE = [
    "robot.rotors.drag_coefficient_n_per_rads_mps=0",
    *(f"robot.platform.drag_area_{axis}_m2=0" for axis in "xyz"),
]


def fly(spin: list[int], rates: list[float], ticks: int, speed: float):
    """Let a hexarotor without air turn freely at `rates` while its rotors spin up."""
    context = build_context("waypoints", SPACE)
    context.rotors.spin[:] = spin
    plant = build_plant(context)
    data, m = plant.sim.data, context.scene.model
    m.opt.gravity[:] = 0.0
    m.actuator_gear[:] = 0.0  # no thrust
    data.qpos[2] = 50.0
    data.qvel[3:6] = rates
    mujoco.mj_forward(m, data)
    plant.drives.rotors.speed[:6] = speed * np.arange(1, 7)
    body, total, R = m.body("platform"), [], np.empty((3, 3))
    rotors = context.rotors
    for _ in range(ticks):
        quat_to_rot(np.array(data.qpos[3:7]), R)
        h = (rotors.inertia * rotors.spin * plant.read(RotorState).speed[:6]) @ rotors.axis
        mujoco.mj_forward(m, data)  # speeds of bodies at the end of the step
        mujoco.mj_subtreeVel(m, data)
        total.append(data.subtree_angmom[body.id] + R @ h)
        plant.run(1)
    return np.array(total), h, np.array(data.qvel[3:6])


def test_spin_up_turns_the_body_the_other_way():
    total, h, w = fly([1] * 6, [0.0, 0.0, 0.0], 250, 100.0)
    assert h[2] > 0.1
    izz = load_description("waypoints").robot.platform.inertia_zz_kgm2
    assert w[2] == pytest.approx(-h[2] / izz, rel=1e-3)
    np.testing.assert_allclose(total, 0.0, atol=1e-9 + 1e-6 * h[2])


def test_momentum_of_rotors_and_body_is_conserved_while_it_tumbles():
    total, h, _ = fly([1, -1, 1, 1, -1, 1], [0.8, -0.5, 0.3], 500, 60.0)
    start = total[0]
    assert np.linalg.norm(h) > 0.2 * np.linalg.norm(start)  # the rotors carry a good part of it
    # the torque is held for a tick of 2 ms: first order in it
    assert np.max(np.linalg.norm(total - start, axis=1)) < 2e-3 * np.linalg.norm(start)


def test_a_robot_without_rotor_inertia_has_no_such_effect():
    plant = build_plant(build_context("waypoints", ["robot.rotors.rotor_inertia_kgm2=0"]))
    assert "rotor momentum" not in [c.name for c in plant.assembly.components]
