"""Rotors that push against each other: the preload, the allocation with it, and what it permits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.models.allocation import EXACT, allocate, build_allocator, usable_limit
from skywright.models.capability import compute_capability
from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.rotors import build_rotors, compute_electrical_power
from skywright.models.statics import build_layout, compute_ray, compute_thrust, wrench_at

ROBOT = load_robot("omnicopter")[0]
ROTORS = build_rotors(ROBOT.rotors)
ALLOCATOR = build_allocator(ROTORS)
WEIGHT = 9.81 * ROBOT.platform.mass_kg


def turn(robot: Robot, **changes: object) -> Robot:
    rotors = robot.rotors.model_copy(update=changes)
    return robot.model_copy(update={"rotors": rotors})


def test_the_preload_makes_no_wrench_and_leaves_room_both_ways() -> None:
    preload = ALLOCATOR.preload
    np.testing.assert_allclose(ROTORS.B @ preload, 0.0, atol=1e-6)
    middle = 0.5 * (ROBOT.rotors.thrust_min_n + ROBOT.rotors.thrust_max_n)
    assert np.all(preload > 0.0)
    assert np.max(preload) <= ROBOT.rotors.thrust_max_n
    assert np.min(preload) == pytest.approx(middle, rel=0.05)
    np.testing.assert_allclose(ALLOCATOR.t_min + preload, ROTORS.thrust_min)
    np.testing.assert_allclose(ALLOCATOR.t_max + preload, ROTORS.thrust_max)
    np.testing.assert_allclose(
        usable_limit(ALLOCATOR, 0.9) + preload, 0.9 * ROTORS.thrust_max, atol=1e-12
    )


@pytest.mark.parametrize("name", ["othex", "hexarotor", "f550-bridge", "tilthex-arm"])
def test_robots_that_need_no_preload_have_none(name: str) -> None:
    rotors = build_rotors(load_robot(name)[0].rotors)
    a = build_allocator(rotors)
    assert not np.any(a.preload)
    assert np.array_equal(a.t_max, rotors.thrust_max)
    assert np.array_equal(usable_limit(a, 0.9), 0.9 * rotors.thrust_max)


def test_eight_rotors_that_all_lift_need_no_preload() -> None:
    alpha = [20.0 if i % 2 else -20.0 for i in range(8)]
    flat = turn(
        ROBOT, azimuth_deg=[45.0 * i for i in range(8)], radius_m=0.4, height_m=0.0,
        alpha_deg=alpha, beta_deg=[-10.0] * 8, spin=["ccw", "cw"] * 4,
    )  # fmt: skip
    assert not np.any(build_allocator(build_rotors(flat.rotors)).preload)


unit = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@settings(max_examples=200, deadline=None)
@given(force=unit, torque=unit, size=st.floats(0.0, 3.0))
def test_allocation_stays_within_the_limits_and_is_exact_where_it_says_so(
    force: tuple[float, float, float], torque: tuple[float, float, float], size: float
) -> None:
    a, thrust = ALLOCATOR, np.zeros(8)
    f, t = size * WEIGHT * np.array(force), size * np.array(torque)
    flag = allocate(
        a.B, a.P, a.t_min, a.t_max, a.full, f, t, np.array([0.0, 0.0, 1.0]), np.zeros(3), thrust
    )
    real = thrust + a.preload
    assert np.all(real >= ROTORS.thrust_min - 1e-9)
    assert np.all(real <= ROTORS.thrust_max + 1e-9)
    if flag == EXACT:
        np.testing.assert_allclose(ROTORS.B @ real, [*f, *t], atol=1e-5)


def test_it_hovers_at_every_attitude() -> None:
    """The whole weight in any direction of B, within the limits and with room for control."""
    rng = np.random.default_rng(3)
    layout = build_layout(ROTORS, ROBOT.rotors.thrust_fraction)
    for way in rng.normal(size=(200, 3)):
        way = way / np.linalg.norm(way)
        thrust = compute_thrust(layout, wrench_at(WEIGHT * way, np.zeros(3)))
        assert thrust is not None
        np.testing.assert_allclose(ROTORS.B @ thrust, [*(WEIGHT * way), 0, 0, 0], atol=1e-5)
        most = layout.t_max + layout.preload
        assert min(np.min(thrust - ROTORS.thrust_min), np.min(most - thrust)) > 1.5  # N
    # the analysis looks at tilts up to 90 deg
    np.testing.assert_allclose(np.degrees(compute_capability(ROBOT).hover_tilt), 90.0, atol=0.1)


def test_what_is_promised_with_the_preload_the_rotors_can_make() -> None:
    """Limits with a fixed preload are inside those of the linear programme over all thrusts."""
    layout = build_layout(ROTORS, 1.0)
    level = wrench_at(np.array([0.0, 0.0, WEIGHT]), np.zeros(3))
    for ray in np.eye(6):
        with_preload = compute_ray(layout, level, ray)
        cost = np.append(np.zeros(8), -1.0)
        found = linprog(
            cost, A_eq=np.hstack([ROTORS.B, -ray[:, None]]), b_eq=level,
            bounds=[*zip(ROTORS.thrust_min, ROTORS.thrust_max, strict=True), (None, None)],
        )  # fmt: skip
        assert 0.0 < with_preload.hi <= found.x[-1] + 1e-6


def test_the_preload_costs_power() -> None:
    mass, com, _ = compute_body(build_body_model(ROBOT), np.zeros(0))
    assert mass == pytest.approx(ROBOT.platform.mass_kg)
    layout = build_layout(ROTORS, 1.0)
    hover = compute_thrust(layout, wrench_at(np.array([0.0, 0.0, WEIGHT]), com))
    assert hover is not None
    np.testing.assert_allclose(ROTORS.B[2] @ hover, WEIGHT, atol=1e-5)
    assert compute_electrical_power(ROTORS, hover) > 900.0
