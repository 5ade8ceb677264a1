"""Rotors and allocation: geometry, limits, priorities and drag."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Rotors
from skywright.errors import InputError
from skywright.models.allocation import (
    ATTITUDE_OR_THRUST_REDUCED,
    EXACT,
    LATERAL_REDUCED,
    NOT_FINITE,
    OMNIDIRECTIONAL,
    THRUST_BAND,
    YAW_REDUCED,
    Allocator,
    allocate,
    build_allocator,
    thrust_to_speed,
)
from skywright.models.rotors import (
    build_rotors,
    compute_electrical_power,
    compute_rotor_drag,
    compute_rotor_wrench,
    step_rotor_speed,
)

COMMON = dict(
    propeller_radius_m=0.165,
    thrust_coefficient_n_per_rad2s2=2.85e-5,
    torque_per_thrust_m=0.0213,
    thrust_min_n=0.29,
    thrust_max_n=10.15,
    time_constant_s=0.02,
    drag_coefficient_n_per_rads_mps=1.7e-4,
)
TILTED = Rotors(
    azimuth_deg=[42.5, 97.5, 152.5, 207.5, 262.5, 317.5],
    radius_m=0.43,
    alpha_deg=[35, -35] * 3,
    beta_deg=[-10] * 6,
    spin=["ccw", "cw"] * 3,
    **COMMON,
)
FLAT = Rotors(
    azimuth_deg=[30, 90, 150, 210, 270, 330],
    radius_m=0.43,
    alpha_deg=[0] * 6,
    beta_deg=[0] * 6,
    spin=["ccw", "cw"] * 3,
    **COMMON,
)
OCTO = Rotors(  # redundant and fully actuated
    azimuth_deg=[22.5 + 45 * i for i in range(8)],
    radius_m=0.43,
    alpha_deg=[25, -25] * 4,
    beta_deg=[10, 10, -10, -10] * 2,
    spin=["ccw", "cw"] * 4,
    **COMMON,
)
WEIGHT = 2.25 * 9.81
UP = np.array([0.0, 0.0, 1.0])
ZERO = np.zeros(3)


def call(
    a: Allocator, f: object, t: object, up: object = UP, com: object = ZERO
) -> tuple[int, np.ndarray, np.ndarray]:
    """Return (flag, thrusts, wrench made)."""
    thrust = np.full(a.P.shape[0], 3.0)
    args = [np.ascontiguousarray(v, dtype=np.float64) for v in (f, t, up, com)]
    flag = allocate(a.B, a.P, a.t_min, a.t_max, a.full, *args, thrust)
    return flag, thrust, a.B @ thrust


def test_axes_follow_the_stated_rotations() -> None:
    """axis = Rz(azimuth) Rx(alpha) Ry(beta) z, against SciPy's rotations."""
    from scipy.spatial.transform import Rotation

    r = build_rotors(TILTED)
    for i in range(6):
        turn = (
            Rotation.from_euler("z", TILTED.azimuth_deg[i], degrees=True)
            * Rotation.from_euler("x", TILTED.alpha_deg[i], degrees=True)
            * Rotation.from_euler("y", TILTED.beta_deg[i], degrees=True)
        )
        assert np.allclose(r.axis[i], turn.apply([0, 0, 1]), atol=1e-12)
        assert np.allclose(r.position[i], 0.43 * turn_z(TILTED.azimuth_deg[i]), atol=1e-12)


def turn_z(angle_deg: float) -> np.ndarray:
    return np.array([math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg)), 0.0])


def test_drag_torque_opposes_the_spin_and_adds_to_the_tilt() -> None:
    flat = build_rotors(FLAT)
    assert flat.B[5, 0] == pytest.approx(-0.0213)  # ccw propeller turns the body clockwise
    assert flat.B[5, 1] == pytest.approx(+0.0213)
    tilted = build_rotors(TILTED)
    for i in range(6):
        from_tilt = np.cross(tilted.position[i], tilted.axis[i])[2]
        assert np.sign(from_tilt) == np.sign(tilted.B[5, i] - from_tilt)


@settings(max_examples=300)
@given(
    f=st.tuples(*[st.floats(-60, 60)] * 3),
    t=st.tuples(*[st.floats(-15, 15)] * 3),
    tilt=st.floats(0, 3.1),
    about=st.floats(0, 6.3),
    com=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    which=st.sampled_from([TILTED, FLAT, OCTO]),
)
def test_never_outside_the_limits(
    f: tuple[float, ...],
    t: tuple[float, ...],
    tilt: float,
    about: float,
    com: tuple[float, ...],
    which: Rotors,
) -> None:
    a = build_allocator(build_rotors(which))
    up = [math.sin(tilt) * math.cos(about), math.sin(tilt) * math.sin(about), math.cos(tilt)]
    flag, thrust, _ = call(a, f, t, up, com)
    assert flag in (EXACT, LATERAL_REDUCED, YAW_REDUCED, ATTITUDE_OR_THRUST_REDUCED)
    assert np.all(thrust >= a.t_min) and np.all(thrust <= a.t_max)


@settings(max_examples=200)
@given(st.lists(st.floats(0.29, 10.15), min_size=6, max_size=6))
def test_exact_when_feasible(loads: list[float]) -> None:
    """Any wrench that thrusts within the limits make is made exactly, with those thrusts."""
    a = build_allocator(build_rotors(TILTED))
    wrench = a.B @ np.array(loads)
    flag, thrust, made = call(a, wrench[:3], wrench[3:])
    assert flag == EXACT
    assert np.allclose(thrust, loads, atol=1e-6)
    assert np.allclose(made, wrench, atol=1e-6)


def test_coplanar_rotors_make_the_controllable_part() -> None:
    a = build_allocator(build_rotors(FLAT))
    assert a.full == 0
    flag, _, made = call(a, [5.0, -3.0, WEIGHT], [0.2, -0.1, 0.05])
    assert flag == EXACT
    assert np.allclose(made, [0, 0, WEIGHT, 0.2, -0.1, 0.05], atol=1e-9)


def test_lateral_force_is_given_up_first_and_at_the_centre_of_mass() -> None:
    a = build_allocator(build_rotors(TILTED))
    com = np.array([0.06, 0.0, -0.05])
    force = np.array([0.0, 9.0, WEIGHT])
    flag, _, made = call(a, force, np.cross(com, force) + [0.1, -0.2, 0.05], UP, com)
    assert flag == LATERAL_REDUCED
    assert 0.0 < made[1] < 9.0
    assert made[[0, 2]] == pytest.approx([0.0, WEIGHT], abs=1e-9)
    about_com = made[3:] - np.cross(com, made[:3])
    assert about_com == pytest.approx([0.1, -0.2, 0.05], abs=1e-9)


def test_the_reduced_lateral_force_is_the_largest_possible() -> None:
    """The scale is set by a limit: some rotor is at it."""
    a = build_allocator(build_rotors(TILTED))
    _, thrust, _ = call(a, [20.0, 3.0, WEIGHT], ZERO)
    assert min((thrust - a.t_min).min(), (a.t_max - thrust).min()) < 1e-9


def test_yaw_is_given_up_before_thrust_and_roll() -> None:
    for layout in (TILTED, FLAT):
        a = build_allocator(build_rotors(layout))
        flag, _, made = call(a, [0, 0, WEIGHT], [0.5, -0.3, 30.0])
        assert flag == YAW_REDUCED
        assert made[2:5] == pytest.approx([WEIGHT, 0.5, -0.3], abs=1e-9)
        assert 0.0 < made[5] < 30.0


def test_thrust_gives_way_to_torque_within_its_band() -> None:
    a = build_allocator(build_rotors(TILTED))
    flag, _, made = call(a, [0, 0, 30.0], [0, 7.0, 0])
    assert flag == ATTITUDE_OR_THRUST_REDUCED
    assert abs(made[2] - 30.0) <= THRUST_BAND * 30.0 + 1e-9
    assert made[4] > 4.0
    assert abs(made[3]) < 1e-9 and abs(made[5]) < 1e-9 and abs(made[0]) < 1e-9


def test_too_much_thrust_is_capped_without_torque() -> None:
    a = build_allocator(build_rotors(TILTED))
    flag, thrust, made = call(a, [0, 0, 500.0], ZERO)
    assert flag == ATTITUDE_OR_THRUST_REDUCED
    assert thrust.max() == pytest.approx(10.15)
    assert np.allclose(made[[0, 1, 3, 4, 5]], 0.0, atol=1e-9)


def test_tilted_body_keeps_its_height_before_its_place() -> None:
    """Beyond the hover tilt limit the vertical force is kept and a lateral one appears."""
    a = build_allocator(build_rotors(TILTED))
    roll = math.radians(30)
    up = np.array([0.0, math.sin(roll), math.cos(roll)])
    flag, _, made = call(a, WEIGHT * up, ZERO, up)
    assert flag == LATERAL_REDUCED
    assert made[:3] @ up == pytest.approx(WEIGHT)
    assert np.linalg.norm(made[:3] - WEIGHT * up) > 1.0
    assert np.allclose(made[3:], 0.0, atol=1e-9)


@pytest.mark.parametrize("roll", [30.0, 60.0, 90.0, 120.0, 180.0])
def test_an_omnidirectional_robot_keeps_its_height_at_any_attitude(roll: float) -> None:
    """Eight rotors that push both ways: what is reduced does not depend on which way is up."""
    robot = load_robot("omnicopter")[0]
    a = build_allocator(build_rotors(robot.rotors))
    assert a.full == OMNIDIRECTIONAL
    weight, c = robot.platform.mass_kg * 9.81, math.radians(roll)
    R = np.array([[1, 0, 0], [0, math.cos(c), -math.sin(c)], [0, math.sin(c), math.cos(c)]])
    flag, _, made = call(a, R.T @ [60.0, 0.0, weight], R.T @ [1.0, 0.0, 0.0], R[2])
    assert flag == LATERAL_REDUCED
    assert (R @ made[:3])[2] == pytest.approx(weight) and (R @ made[:3])[0] > 10.0
    flag, _, made = call(a, R.T @ [0.0, 0.0, weight], [12.0, 0.0, 0.0], R[2])
    assert flag == ATTITUDE_OR_THRUST_REDUCED
    assert (1.0 - THRUST_BAND) * weight - 1e-9 <= (R @ made[:3])[2] <= weight + 1e-9
    assert 6.0 < made[3] < 12.0 and np.allclose(made[4:], 0.0, atol=1e-9)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_not_finite_leaves_the_thrusts_alone(bad: float) -> None:
    a = build_allocator(build_rotors(TILTED))
    flag, thrust, _ = call(a, [0, bad, WEIGHT], ZERO)
    assert flag == NOT_FINITE
    assert np.all(thrust == 3.0)


def test_result_is_continuous_across_the_limits() -> None:
    """No jump while only lateral force is reduced: steps of the thrusts stay in proportion.

    With a rotor pinned at its limit by roll, pitch or yaw the next ray may start inward or outward;
    a small jump is then inherent to scaling by priority.
    """
    a = build_allocator(build_rotors(TILTED))
    com = np.array([0.05, 0.01, -0.02])
    for direction in np.random.default_rng(1).normal(size=(20, 6)):
        last = None
        for s in np.linspace(0.0, 30.0, 3001):
            wrench = np.concatenate([WEIGHT * UP, np.cross(com, WEIGHT * UP)])
            wrench += s * direction * np.array([1, 1, 1, 0.3, 0.3, 0.3])
            flag, thrust, _ = call(a, wrench[:3], wrench[3:], UP, com)
            if last is not None:
                limit = 0.1 if flag <= LATERAL_REDUCED else 1.5
                assert np.abs(thrust - last).max() < limit
            last = thrust


def test_uncontrollable_layout_is_refused() -> None:
    same = Rotors(
        azimuth_deg=[0, 120, 240],
        radius_m=0.3,
        alpha_deg=[0] * 3,
        beta_deg=[0] * 3,
        spin=["ccw"] * 3,
        **COMMON,
    )
    with pytest.raises(InputError, match="cannot control"):
        build_allocator(build_rotors(same))


def test_speeds_make_the_thrusts() -> None:
    thrust, speed = np.array([0.29, 4.0, 10.15]), np.zeros(12)
    thrust_to_speed(thrust, 3, 2.85e-5, speed)
    assert np.allclose(2.85e-5 * speed[:3] ** 2, thrust)
    assert np.all(speed[3:] == 0.0)


def test_rotor_speed_is_the_exact_lag_for_any_step() -> None:
    once, often = np.array([100.0]), np.array([100.0])
    command = np.array([500.0])
    step_rotor_speed(once, command, 1, 0.02, 0.02)
    for _ in range(20):
        step_rotor_speed(often, command, 1, 0.001, 0.02)
    assert once[0] == pytest.approx(often[0], rel=1e-12)
    assert once[0] == pytest.approx(500 - 400 * math.exp(-1))


def test_wrench_and_drag_agree_with_plain_formulas() -> None:
    r = build_rotors(TILTED)
    rng = np.random.default_rng(0)
    thrust, speed = rng.uniform(1, 9, 6), rng.uniform(200, 500, 6)
    f, t, v, w = np.zeros(3), np.zeros(3), rng.normal(size=3), rng.normal(size=3)
    compute_rotor_wrench(r.B, thrust, f, t)
    assert np.allclose(np.concatenate([f, t]), r.B @ thrust)
    compute_rotor_drag(r.position, r.axis, speed, r.drag_coefficient, v, w, f, t)
    hub = v + np.cross(w, r.position)
    across = hub - np.sum(hub * r.axis, axis=1)[:, None] * r.axis
    force = -r.drag_coefficient * speed[:, None] * across
    assert np.allclose(f, force.sum(axis=0))
    assert np.allclose(t, np.cross(r.position, force).sum(axis=0))
    power = np.sum(force * hub)
    assert power <= 0.0  # drag takes energy out


def test_electrical_power_is_momentum_theory() -> None:
    """Induced velocity sqrt(T / 2 rho A) times thrust, over the two efficiencies."""
    r = build_rotors(TILTED)
    thrust = np.array([4.0])
    induced = math.sqrt(4.0 / (2 * 1.2 * math.pi * 0.165**2))
    assert compute_electrical_power(r, thrust) == pytest.approx(4.0 * induced / (0.6 * 0.8))
