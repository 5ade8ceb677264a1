"""Rotors and body keep their angular momentum together."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from plant_parts import build_context, build_plant
from skywright.core.rotations import quat_to_rot
from skywright.description.loader import load_description
from skywright.models.allocation import build_allocator
from skywright.models.rotor_reaction import compute_reaction_times, limit_bandwidth
from skywright.models.rotors import build_rotors
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


@pytest.mark.parametrize("robot", ["othex", "f550-bridge", "hexarotor"])
def test_reaction_time_is_the_plant_s_answer_to_a_step(robot: str):
    """A step of commanded yaw torque: first the spin-up's push T / lag, later the torque itself."""
    d = load_description("waypoints", robot)
    rotors = build_rotors(d.robot.rotors)
    allocator = build_allocator(rotors)
    weight = d.robot.platform.mass_kg * 9.81
    times = compute_reaction_times(rotors, allocator, weight)
    step, dt, tau = 1e-4, 1e-5, rotors.time_constant
    wrench = np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0])
    speed = np.sqrt(allocator.P @ wrench / rotors.k_f)
    wrench[5] = step
    told = np.sqrt(allocator.P @ wrench / rotors.k_f)
    later = told + (speed - told) * np.exp(-dt / tau)
    push = -rotors.inertia * (rotors.spin * (later - speed) / dt) @ rotors.axis
    assert push[2] == pytest.approx(step * times[2] / tau, rel=1e-3)


def test_signs_of_the_reaction_are_those_of_the_layouts():
    """Coplanar and OTHex push the right way at once; the F550's printed spins the wrong way."""
    times = {}
    for robot in ("othex", "f550-bridge", "hexarotor"):
        d = load_description("waypoints", robot)
        rotors = build_rotors(d.robot.rotors)
        weight = d.robot.platform.mass_kg * 9.81
        times[robot] = compute_reaction_times(rotors, build_allocator(rotors), weight)[2]
    assert times["othex"] == pytest.approx(0.026, abs=0.005)
    assert times["f550-bridge"] == pytest.approx(-0.05, abs=0.01)
    assert times["hexarotor"] == pytest.approx(0.41, abs=0.05)


def test_an_attitude_loop_keeps_its_margin_beside_a_zero_in_the_right_half_plane():
    lag, delay, zeta = 0.03, 0.003, 1.0
    assert limit_bandwidth(9.0, zeta, 0.02, lag, delay) == 9.0
    w = limit_bandwidth(9.0, zeta, -0.05, lag, delay)
    assert 3.0 < w < 6.0

    def margin(w: float) -> float:
        f = np.geomspace(0.1, 1e4, 200_000)
        s = 1j * f
        loop = (
            (w**2 + 2 * zeta * w * s) / s**2 * (1 - 0.05 * s) / (1 + lag * s) * np.exp(-delay * s)
        )
        at = np.flatnonzero((np.abs(loop[:-1]) >= 1) & (np.abs(loop[1:]) < 1))[-1]
        return float(np.degrees(np.unwrap(np.angle(loop))[at]) + 180.0) % 360.0

    assert margin(w) == pytest.approx(30.0, abs=0.5)
    assert margin(9.0) > 180.0  # beyond: that loop would ring itself up
