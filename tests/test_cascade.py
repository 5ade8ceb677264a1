"""The cascade: gains against simulated loops, dynamics against MuJoCo, and short flights."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

from bench import set_joints
from skywright.core.types import MAX_JOINTS
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.models.body_records import Kinematics
from skywright.models.floating import compute_free_inertia, fill_floating
from skywright.models.rigid_body import (
    build_body_model,
    fill_body,
    fill_kinematics,
    posture,
)
from skywright.models.scene import build_scene
from skywright.run.backends import build_vehicle
from skywright.vehicle.arms.ports import Floating, Wrench
from skywright.vehicle.bus import Body, Estimate
from skywright.vehicle.effects.limb_drag import downwash
from skywright.vehicle.estimates import RotorForce
from skywright.vehicle.laws._cascade_gains import (
    SwingModel,
    attitude_lag,
    compute_free_factor,
    compute_lead,
    place_swing_poles,
)
from skywright.vehicle.link_arc import compute_link_arc, plan_landing, plan_take_off
from skywright.vehicle.plant import RotorState
from skywright.vehicle.simulated import SimulatedVehicle

LONG = "bimanual-longreach"


def compute_floating(name: str, q: Any) -> tuple[Any, Any, Any]:
    robot = load_description("waypoints", robot=name).robot
    model = build_body_model(robot)
    w, k, body = np.zeros(1, Floating.dtype), np.zeros(1, Kinematics.dtype), np.zeros(1, Body.dtype)
    w[0]["swing"] = 0 if robot.pendulum is not None else -1
    full = np.zeros(MAX_JOINTS)
    full[: len(q)] = q
    fill_kinematics(model[0], full, k[0])
    fill_body(model[0], k[0], body[0])
    fill_floating(model[0], k[0], body[0], w[0])
    return w[0], body[0], robot


# -- dynamics -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["bimanual", LONG])
def test_effective_inertia_is_the_mass_matrix_with_the_passive_joint_free(name: str) -> None:
    """I_eff and A against MuJoCo's mass matrix, in a pose without symmetry."""
    rng = np.random.default_rng(3)
    n = 9 if name == LONG else 8
    q = rng.uniform(-0.8, 0.8, n)
    w, _, robot = compute_floating(name, q)
    scene = build_scene(robot, load_description("waypoints", robot=name).world)
    data = mujoco.MjData(scene.model)
    data.qpos[:7] = [0, 0, 2, 1, 0, 0, 0]
    data.qpos[scene.places.joint_qpos] = q
    mujoco.mj_forward(scene.model, data)
    M = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, data, M)
    x = [0, 1, 2, 6] if name == LONG else [0, 1, 2]
    turn = [3, 4, 5]
    A = M[np.ix_(turn, x)] @ np.linalg.inv(M[np.ix_(x, x)])
    np.testing.assert_allclose(w["A"][:, : len(x)], A, atol=1e-9)
    inertia = M[np.ix_(turn, turn)] - A @ M[np.ix_(x, turn)]
    np.testing.assert_allclose(w["I_eff"], inertia, atol=1e-9)


def test_with_a_swinging_link_pitch_is_the_bare_platform_and_roll_the_whole_robot() -> None:
    robot = load_description("waypoints", robot=LONG).robot
    w, _, _ = compute_floating(LONG, posture(robot, "working"))
    p = robot.platform
    assert w["I_eff"][1, 1] == pytest.approx(p.inertia_yy_kgm2, rel=0.02)
    assert w["I_eff"][0, 0] > 5.0 * p.inertia_xx_kgm2
    world = load_description("waypoints", robot=LONG).world
    free = compute_free_inertia(robot, world, posture(robot, "working"))
    assert free[0] == pytest.approx(p.inertia_xx_kgm2, rel=0.02)  # above the bending's resonance


# -- gains ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("margin_deg", [45.0, 60.0])
def test_the_lead_leaves_the_phase_margin_at_the_crossover(margin_deg: float) -> None:
    """At least the margin asked for, at the true crossover of the sampled loop."""
    k, delay = 20.0, 0.003
    lead = compute_lead(k, 0.05, delay, math.radians(margin_deg))
    w = np.linspace(1.0, 100.0, 200_000)
    loop = k / (1j * w * (lead * 1j * w + 1.0)) * np.exp(-1j * w * delay)
    i = int(np.argmin(np.abs(np.abs(loop) - 1.0)))
    assert 180.0 + math.degrees(np.angle(loop[i])) >= margin_deg
    factor = compute_free_factor(k, lead, delay)
    i = int(np.argmin(np.abs(np.abs(factor * loop) - 1.0)))
    assert 180.0 + math.degrees(np.angle(loop[i])) == pytest.approx(35.0, abs=0.1)


def test_a_rate_loop_too_fast_for_its_sampling_is_refused() -> None:
    with pytest.raises(InputError, match="valid: below 175 rad/s"):
        compute_lead(200.0, 0.05, 0.003, math.radians(60.0))


@pytest.mark.parametrize("first, second", [(1.511, 1.359), (1.30, 1.02), (1.58, 1.50)])
@pytest.mark.parametrize("damping", [0.3, 0.4])
def test_swing_poles_are_where_they_were_placed(
    first: float, second: float, damping: float
) -> None:
    """Poles of the planar model with the inner loops as states, an independent assembly."""
    m = SwingModel(7.12, first, second, 9.81)
    k_att, k_rate, lead = 8.0, 20.0, 0.025
    gains = place_swing_poles(m, lambda s: attitude_lag(s, k_att, k_rate, lead), 1.0, 2.5, damping)
    M = np.array([[m.mass, -m.first], [-m.first, m.second]])
    minv = np.linalg.inv(M)
    A = np.zeros((7, 7))  # x, psi, x', psi', force, its rate, its second rate
    A[:2, 2:4] = np.eye(2)
    A[2:4, 1] = -minv @ [0.0, m.first * m.gravity]
    A[2:4, 4] = minv[:, 0]
    A[4, 5] = A[5, 6] = 1.0
    command = -m.mass * np.array([gains.position, 0.0, gains.velocity, gains.swing, 0, 0, 0])
    A[6] = k_att * k_rate / lead * command
    A[6, 4] -= k_att * k_rate / lead
    A[6, 5] -= k_rate / lead
    A[6, 6] -= 1.0 / lead
    poles = np.linalg.eigvals(A)
    assert np.max(poles.real) < -1.0
    for pole in gains.poles:
        assert np.min(np.abs(poles - pole)) < 1e-6
    swing = gains.poles[1]
    assert -swing.real / abs(swing) == pytest.approx(damping)


def test_a_swing_damping_out_of_reach_is_refused_with_the_most_that_is_not() -> None:
    m = SwingModel(7.12, 1.511, 1.359, 9.81)
    with pytest.raises(InputError, match=r"at most 0\.\d\d is within reach"):
        place_swing_poles(m, lambda s: attitude_lag(s, 8.0, 20.0, 0.025), 1.0, 2.5, 0.9)


# -- flights --------------------------------------------------------------------------------------


def hover(name: str, swing_deg: float = 0.0, sets: tuple[str, ...] = ()) -> SimulatedVehicle:
    """A vehicle in the air at 2 m, at rest, its link turned by `swing_deg`."""
    rows: list[Any] = []
    v = build_vehicle(load_description("waypoints", robot=name, sets=list(sets)), rows.append)
    q, n, get = posture(v.robot, "working"), v.n_joints, v.assembly.get
    if v.robot.pendulum is not None:
        q[0] = math.radians(swing_deg)
    model, data = v.scene.model, v.sim.data
    v.sim.qpos[2], v.sim.qpos[v.scene.places.joint_qpos] = 2.0, q
    mujoco.mj_forward(model, data)
    data.act[:] = data.actuator_length[model.nu - model.na :]
    set_joints(v, q)
    weight, rotors = float(get(Body)["mass"]) * 9.81, v.nominal.rotors
    count = len(rotors.thrust_min)
    get(RotorState)["speed"][:count] = math.sqrt(weight / count / rotors.k_f)
    get(RotorForce)["f_B"][2], get(Estimate)["p_WB"][2] = weight, 2.0
    row = v._table.copy()
    row["p_WB"][:, 2], row["active"], row["q"][:, :n] = 2.0, 1.0, q
    if v.robot.pendulum is not None:
        row["q"][:, 0] = 0.0
    v.track(row)
    v.rows = rows  # type: ignore[attr-defined]
    return v


def fly(v: SimulatedVehicle, seconds: float) -> Any:
    """Samples of the next seconds."""
    v.rows.clear()  # type: ignore[attr-defined]
    for _ in range(round(seconds / 0.02)):
        assert v.tick().fired == 0
    v.flush()
    return np.concatenate(v.rows)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "start, sets",
    [
        (12.0, ()),
        (20.0, ()),
        (12.0, ("plant.mass_error=-0.05",)),
        (12.0, ("plant.mass_error=0.05", "world.wind.kind=steady", "world.wind.mean_mps=3")),
        (12.0, ("robot.pendulum.length_m=1.0", "robot.pendulum.com_m=0.785")),
        (12.0, ("robot.pendulum.length_m=0.5", "robot.pendulum.com_m=0.39")),
    ],
    ids=["calm", "20 deg", "lighter", "heavier in wind", "1 m link", "0.5 m link"],
)
def test_a_swing_falls_to_1_deg_within_2_s_and_stays(start: float, sets: tuple[str, ...]) -> None:
    v = hover(LONG, start, sets)
    s = fly(v, 9.0)
    swing = np.degrees(s["q"][:, 0])
    t = s["t"] - s["t"][0]
    off = np.abs(swing - np.mean(swing[t > 8.0]))
    assert off[0] > 8.0
    assert t[np.flatnonzero(off > 1.0)[-1]] < 2.0
    assert np.ptp(swing[t > 4.0]) < 0.5  # no limit cycle
    # on its way back, with a link of 1 m by 9 to 14 mm/s (seeds 1 to 5, with noise as told or not)
    assert np.ptp(s["p_WB"][t > 8.0, 0]) < 0.02


@pytest.mark.parametrize("name", ["bimanual", LONG])
def test_a_push_of_2_n_on_a_hand_moves_the_platform_by_at_most_3_cm(name: str) -> None:
    """As under a pipe: the hand presses up, the robot is pushed down."""
    v = hover(name)
    before = fly(v, 6.0)["p_WB"][-1]
    v.devices.helper.push("hand0", np.array([0.0, 0.0, -2.0]))
    s = fly(v, 3.0)
    assert np.max(np.linalg.norm(s["p_WB"] - before, axis=1)) < 0.03
    # the observer reads the force (the plant is 3 % off in mass and in rotor gain: a bias)
    bias = v.read(Wrench).f_rest_W
    v.devices.helper.push("hand0", np.zeros(3))
    fly(v, 3.0)
    np.testing.assert_allclose(bias - v.read(Wrench).f_rest_W, [0.0, 0.0, -2.0], atol=0.3)


def test_the_swing_angle_tells_a_level_force() -> None:
    """Suarez 2020, section VI-C: static balance of force and weight of the link."""
    v = hover(LONG)
    fly(v, 5.0)
    zero = v.read(Wrench).f_swing
    v.devices.helper.push("hand0", np.array([-2.0, 0.0, 0.0]))
    fly(v, 6.0)
    assert v.read(Wrench).f_swing - zero == pytest.approx(2.0, abs=0.3)


# -- take-off and landing -------------------------------------------------------------------------


def test_the_arc_keeps_the_end_of_the_link_in_its_place() -> None:
    robot = load_description("waypoints", robot=LONG).robot
    arc = compute_link_arc(robot, build_body_model(robot))
    assert arc is not None
    up = plan_take_off(arc, 2.0, 1.0, 0.8, 0.02)
    on_arc = up.swing < -1e-3
    joint = np.stack([up.forward, up.height + arc.joint[2]], axis=1)[on_arc]
    end = np.array([0.0, arc.top + arc.joint[2] - arc.radius])
    np.testing.assert_allclose(np.linalg.norm(joint - end, axis=1), arc.radius, atol=1e-9)
    assert up.height[0] == pytest.approx(robot.platform.gear_height_m, abs=1e-6)
    down = plan_landing(arc, 2.0, 1.0, 0.8, 0.02)
    for path in (up, down):  # both begin and end over the same place
        assert path.forward[0] == pytest.approx(path.forward[-1])
        assert np.max(np.abs(np.diff(path.height))) < 0.02 * 1.01
    plain = load_description("waypoints", robot="bimanual").robot
    assert compute_link_arc(plain, build_body_model(plain)) is None


# -- downwash -------------------------------------------------------------------------------------


def test_a_wake_carries_the_thrust_at_every_distance_and_starts_at_twice_v_i() -> None:
    """Integral of rho v^2 over a plane below the rotor equals the thrust."""
    thrust, radius, density = np.array([12.0]), 0.19, 1.2
    rotor = np.zeros((1, 3))
    v_i = math.sqrt(12.0 / (2.0 * density * math.pi * radius**2))
    at = downwash(density, radius / math.sqrt(2.0), rotor, thrust, 1, np.array([0.0, 0.0, -1e-6]))
    assert at == pytest.approx(2.0 * v_i, rel=1e-4)
    for z in (0.2, 0.8):
        r = np.linspace(0.0, 1.5, 3000)
        v = np.array([
            downwash(density, radius / math.sqrt(2.0), rotor, thrust, 1, np.array([x, 0.0, -z]))
            for x in r
        ])  # fmt: skip
        flux = np.trapezoid(density * v**2 * 2.0 * math.pi * r, r)
        assert flux == pytest.approx(12.0, rel=1e-3)
