"""Gusts on a platform with a hanging link: its two planar models, its gains, and refusals."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.linalg import expm

from cut_flights import fly_until
from exact_map import EXACT
from plant_parts import build_context, build_plant
from skywright.description.loader import load_description
from skywright.description.robot.limbs import list_limbs
from skywright.errors import InputError
from skywright.missions.sensor_install.plan import plan
from skywright.models.arm_body import Deviation
from skywright.models.floating import compute_free_inertia
from skywright.models.part_masses import link_direction
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.run.gust_limits import find_exceeded_motion
from skywright.run.parts import build_law
from skywright.run.setup import Setup
from skywright.vehicle.effects.wind import build_dryden_filter
from skywright.vehicle.laws import _cascade_gains as gains
from skywright.vehicle.laws._cascade_gusts import (
    System,
    build_across,
    build_along,
    build_masses,
    build_rigid,
    compute_link_drag,
)
from skywright.vehicle.plant import JointTruth

DESCRIPTION = load_description("sensor-install")
DRYDEN = "world.wind.kind=dryden"


def build_systems(sets: tuple[str, ...] = ()) -> tuple[Any, tuple[System, System]]:
    d = load_description("sensor-install", sets=list(sets))
    setup, c = Setup(d), d.robot.control
    found = gains.compute_cascade_gains(c, d.robot, d.world, setup.model[0])
    body, floating = gains.compute_bodies(d.robot, setup.model[0])
    free = compute_free_inertia(d.robot, d.world, posture(d.robot, "working"))
    masses = build_masses(d.robot, body, floating, free)
    loops = [gains.build_loops(found, 0.003, axis, 0) for axis in (0, 1)]
    return masses, (build_along(masses[0], loops[0]), build_across(masses[1], loops[1]))


def test_the_page_of_the_paper_states_the_motion_that_the_models_predict() -> None:
    predicted = []
    for toward in (0, 90):  # along the swing and across
        air = (DRYDEN, "world.wind.mean_mps=3", f"world.wind.toward_deg={toward}")
        d = load_description("sensor-install", sets=list(air))
        model = build_law(d, setup := Setup(d)).build_gust_model(setup, 0.0)
        assert model is not None
        predicted.append(f"{1e3 * model(d.world.wind).place:.1f} mm")
    page = Path(__file__).parents[1] / "docs/papers/suarez-2020.md"
    assert f"in this direction, rms, model | {' | '.join(predicted)} |" in page.read_text("utf-8")


def compute_scene_masses() -> tuple[Any, int, int]:
    """MuJoCo's mass matrix of the built-in robot in its working posture, and two joints' rows."""
    robot = DESCRIPTION.robot
    scene, q = build_scene(robot, DESCRIPTION.world, Deviation()), posture(robot, "working")
    data = mujoco.MjData(scene.model)
    data.qpos[:7] = [0, 0, 2, 1, 0, 0, 0]
    data.qpos[scene.places.joint_qpos] = q
    mujoco.mj_forward(scene.model, data)
    M = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, data, M)
    swing, bend = (int(scene.model.joint(n).dofadr[0]) for n in ("pendulum", "pendulum lateral"))
    return M, swing, bend


def test_the_planes_accelerate_as_the_scene_does() -> None:
    """A tilt along the swing and a rolling torque across it, through MuJoCo's mass matrix."""
    M, swing, bend = compute_scene_masses()
    (m, _), (along, across) = build_systems()
    x, psi = np.linalg.solve(M[np.ix_([0, swing], [0, swing])], [m.mass * m.gravity, 0.0])
    np.testing.assert_allclose(np.abs(along.free[[1, 3], 4]), np.abs([x, psi]), rtol=0.03)
    rows = [1, 3, bend]
    y, phi, turn = np.linalg.solve(M[np.ix_(rows, rows)], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(across.free[[1, 3, 5], 7], [y, phi, phi + turn], rtol=0.03)


def test_the_planes_have_the_mass_matrix_of_the_scene() -> None:
    """MuJoCo's mass matrix in place, lean and link, all other joints held."""
    M, swing, bend = compute_scene_masses()
    (along, across), _ = build_systems()
    for m, dofs, sign in ((along, [0, 4, swing], -1.0), (across, [1, 3, bend], 1.0)):
        d, b, lever = m.below, m.first, m.carried * m.below
        ours = np.array([
            [m.mass, sign * (lever + b), sign * b],
            [0.0, m.platform + lever * d + 2.0 * b * d + m.second, b * d + m.second],
            [0.0, 0.0, m.second],
        ])  # fmt: skip
        theirs = np.triu(M[np.ix_(dofs, dofs)])
        np.testing.assert_allclose(ours, theirs, rtol=0.03, atol=0.03)


def test_the_sensitivity_is_that_of_the_closed_loop() -> None:
    """1 + L is the ratio of the characteristic polynomials, closed over cut."""
    for system in build_systems()[1]:
        w = np.geomspace(0.5, 30.0, 40)
        s = system._replace(delay=0.0)
        ratio = [
            np.linalg.det(1j * x * np.eye(10) - s.free)
            / np.linalg.det(1j * x * np.eye(10) - s.closed)
            for x in w
        ]
        assert s.compute_sensitivity(w) == pytest.approx(np.abs(ratio).max(), rel=1e-6)
        assert system.is_stable() and system.compute_sensitivity() <= 2.0


def test_a_platform_without_a_link_yields_to_a_push_by_its_stiffness() -> None:
    """F = m k_v k_x x at rest, and nothing once the force is estimated."""
    loops = gains.build_loops(gains.compute_cascade_gains(
        DESCRIPTION.robot.control, DESCRIPTION.robot, DESCRIPTION.world,
        Setup(DESCRIPTION).model[0],
    ), 0.0, 0, 0)._replace(swing=0.0)  # fmt: skip
    for k, x in ((loops, 0.0), (loops._replace(force=0.0), 1.0)):
        system = build_rigid(3.0, 9.81, k)
        push = system.drag[:, 0]
        if k.force == 0.0:  # a force that is never estimated is no state
            system = system._replace(free=system.free - np.diag([0.0] * 5 + [1.0]))
        rest = -np.linalg.solve(system.closed, push)
        assert rest[0] == pytest.approx(x / (3.0 * k.velocity * k.position), abs=1e-9)
        assert system.is_stable()


@pytest.mark.parametrize("along", [True, False])
def test_the_variance_is_that_of_a_simulated_gust(along: bool) -> None:
    """Against the filter that the plant draws its gusts with."""
    system, dt, steps, many = build_systems()[1][0], 0.02, 4000, 200
    phi, noise, out = build_dryden_filter(0.7, 7.6, dt, along)
    drag = np.array([0.9, 0.2, 0.15])
    whole = np.zeros((11, 11))
    whole[:10, :10], whole[:10, 10] = system.closed, system.drag @ drag
    step = expm(dt * whole)[:10]
    rng, gust, state = np.random.default_rng(1), np.zeros((many, 2)), np.zeros((many, 10))
    seen = np.empty((steps, many, 2))
    for i in range(steps):
        gust = gust @ phi.T + rng.standard_normal((many, 2)) @ noise.T
        state = state @ step[:, :10].T + np.outer(gust @ out, step[:, 10])
        seen[i, :, 0], seen[i, :, 1] = state[:, 0], state[:, 2] - state[:, 4]
    told = system.compute_variance(drag, 0.7, 7.6, along)
    np.testing.assert_allclose(np.sqrt(told), seen[2000:].std(axis=(0, 1)), rtol=0.06)


def test_no_motion_is_fast_enough_for_a_link_that_nothing_damps() -> None:
    with pytest.raises(
        InputError, match=r"motion_sensitivity = 2: .* no bandwidth of the motion forw"
    ):
        build_systems(("robot.control.swing_damping=0.05",))


def refuse(*sets: str) -> str:
    d = load_description("sensor-install", sets=[DRYDEN, *sets])
    return str(plan(Setup(d)).blocked_by)


def test_gusts_beyond_a_derived_wind_are_refused() -> None:
    """The wind that the refusal names is flown, a little more is not; slower loops bear less."""
    told = refuse("world.wind.mean_mps=4")
    most = float(re.search(r"largest permitted mean is (\S+) m/s \(world.wind.mean_mps\)", told)[1])  # type: ignore[index]
    assert 2.4 < most < 2.7 and "30 mm are allowed" in told
    assert refuse(f"world.wind.mean_mps={most - 0.02}") == "None"
    assert "displace the platform by 30." in refuse(f"world.wind.mean_mps={most + 0.02}")
    slow = refuse("world.wind.mean_mps=4", "robot.control.motion_sensitivity=0")
    assert float(re.search(r"permitted mean is (\S+) m/s", slow)[1]) < 0.8 * most  # type: ignore[index]
    # a start at 20 deg has less time left for what gusts add
    assert "reduce mission.task.swing_deg" in refuse(
        "world.wind.mean_mps=2.4", "mission.task.swing_deg=25"
    )
    setup = Setup(load_description("sensor-install"))  # still air
    assert find_exceeded_motion(setup, 0.0, 1e-9, 1.0, 1e-9, 0.0, 2.0) is None


@pytest.mark.parametrize(("toward", "mean", "swing"), [(0, 2.5, 10), (90, 2.5, 10), (0, 2.0, 20)])
def test_in_gusts_of_2_and_a_half_mps_platform_and_swing_stay_within_their_limits(
    toward: int, mean: float, swing: int
) -> None:
    sets = [*EXACT, DRYDEN, f"world.wind.mean_mps={mean}", f"world.wind.toward_deg={toward}",
            "mission.timestep_ms=2",
            "mission.task.hover_s=0", f"mission.task.swing_deg={swing}"]  # fmt: skip
    m = fly_until("return", load_description("sensor-install", sets=sets, seed=2)).metrics
    assert m["platform.excursion_m"] < 0.03 and m["swing.decay_s"] < 2.0
    assert m["swing.start_deg"] > 0.8 * swing and m["sensor.installed"] == 1.0
    assert m["arm.lever_min"] > 0.1 and m["arm.lever_felt_min"] > 0.2
    assert math.isfinite(m["force.mean_error_n"]) and m["force.mean_error_n"] < 0.1


def test_the_drag_of_the_links_is_the_plants() -> None:
    sets = ["world.wind.kind=steady", "world.wind.mean_mps=5", "world.wind.toward_deg=30"]
    context = build_context("sensor-install", sets)
    plant = build_plant(context)
    plant.run(1)  # it stands, rotors at rest: no downwash
    model, force, moment = context.scene.model, np.zeros(2), np.zeros(2)
    joint = plant.sim.data.body("pendulum").xpos[2]
    for limb in list_limbs(context.robot):
        body = plant.sim.data.body(limb.name)
        middle = body.xpos + 0.5 * limb.link.length_m * (
            body.xmat.reshape(3, 3) @ link_direction(limb.link)
        )
        pushed = plant.sim.xfrc[model.body(limb.name).id, :2]
        force += pushed
        moment += (joint - middle[2]) * pushed
    wind = 5.0 * np.array([math.cos(math.radians(30.0)), math.sin(math.radians(30.0))])
    q = np.array(plant.read(JointTruth).q)
    computed = compute_link_drag(
        context.robot, context.nominal.model, q, context.world.air_density_kg_m3, wind
    )
    np.testing.assert_allclose(computed, (force, moment), atol=1e-3 * np.linalg.norm(force))
