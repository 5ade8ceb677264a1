"""A lost rotor: what the others can hold, at which lean, and how laws and allocation are told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from skywright.core.rotations import rot_z
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.models.allocation import build_allocator
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.rotor_loss import SPARE, RotorsLeft, compute_rotors_left, list_rotors_left
from skywright.models.rotors import build_rotors
from skywright.run.backends import build_vehicle
from skywright.run.run import run_mission
from skywright.vehicle.stepped import LawStep

ROBOT = load_robot("omnicopter")[0]
ROTORS = build_rotors(ROBOT.rotors)
ALLOCATOR = build_allocator(ROTORS)
WEIGHT, AT = 9.81 * ROBOT.platform.mass_kg, np.zeros(3)
TILT_MAX = math.radians(ROBOT.control.tilt_max_deg)


def lose(rotor: int, tilt_max: float = TILT_MAX) -> RotorsLeft | None:
    """Lose a rotor, counted from 1."""
    return compute_rotors_left(ALLOCATOR, rotor - 1, WEIGHT, AT, tilt_max)


def find_reserve(lost: int, lean: float, azimuth: float) -> float:
    """Return by how much (N) all thrusts of a hover can keep from their limits; below 0: none."""
    up = np.array([
        math.sin(lean) * math.cos(azimuth), math.sin(lean) * math.sin(azimuth), math.cos(lean)
    ])  # fmt: skip
    left = [i for i in range(8) if i != lost - 1]
    B, low, high = ROTORS.B[:, left], ROTORS.thrust_min[left], ROTORS.thrust_max[left]
    room = np.vstack([np.hstack([-np.eye(7), np.ones((7, 1))]),
                      np.hstack([np.eye(7), np.ones((7, 1))])])  # fmt: skip
    found = linprog(
        np.append(np.zeros(7), -1.0), A_ub=room, b_ub=np.concatenate([-low, high]),
        A_eq=np.hstack([B, np.zeros((6, 1))]), b_eq=[*(WEIGHT * up), 0.0, 0.0, 0.0],
        bounds=[(None, None)] * 8,
    )  # fmt: skip
    return float(found.x[-1])


def test_the_cube_has_two_combinations_without_a_wrench() -> None:
    """Equal thrusts of the upper four, and of the lower four: without one rotor one is left."""
    for four in ([1.0] * 4 + [0.0] * 4, [0.0] * 4 + [1.0] * 4):
        np.testing.assert_allclose(ROTORS.B @ four, 0.0, atol=1e-6)
    for lost in range(8):
        left = [i for i in range(8) if i != lost]
        sizes = np.linalg.svd(ROTORS.B[:, left], compute_uv=False)
        assert sizes[-1] > 0.2 * sizes[0]
        null = np.linalg.svd(ROTORS.B[:, left])[2][-1]
        mine = [k for k, i in enumerate(left) if (i < 4) == (lost < 4)]
        np.testing.assert_allclose(null[mine], 0.0, atol=1e-6)


@pytest.mark.parametrize("rotor", [2, 3, 6, 7])
def test_the_others_make_every_wrench_near_a_leaned_hover(rotor: int) -> None:
    left = lose(rotor)
    assert left is not None and left.holds_heading
    assert math.degrees(left.lean) == pytest.approx(11.4, abs=0.4)
    up = left.R_WB.T @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(left.R_WB @ left.R_WB.T, np.eye(3), atol=1e-12)
    wrench = np.array([*(WEIGHT * up), 0.0, 0.0, 0.0])
    thrust = left.P @ wrench + left.preload
    i = rotor - 1
    assert thrust[i] == left.t_min[i] == left.t_max[i] == 0.0 and not np.any(left.P[i])
    others = np.arange(8) != i
    reserve = np.minimum(thrust - ROTORS.thrust_min, ROTORS.thrust_max - thrust)[others]
    spare = SPARE * (ROBOT.rotors.thrust_max_n - ROBOT.rotors.thrust_min_n)
    assert np.min(reserve) == pytest.approx(spare, abs=1e-6)
    np.testing.assert_allclose((left.t_min + left.preload)[others], ROTORS.thrust_min[others])
    np.testing.assert_allclose((left.t_max + left.preload)[others], ROTORS.thrust_max[others])
    for change in np.random.default_rng(1).uniform(-1.0, 1.0, (20, 6)):
        np.testing.assert_allclose(
            ROTORS.B @ (left.P @ (wrench + change) + left.preload), wrench + change, atol=1e-6
        )


def test_no_smaller_lean_has_that_reserve() -> None:
    """A search over directions, independent of the programme that finds the lean."""
    left = lose(2)
    assert left is not None
    spare = SPARE * (ROBOT.rotors.thrust_max_n - ROBOT.rotors.thrust_min_n)
    around = np.radians(np.arange(0.0, 360.0, 10.0))
    assert max(find_reserve(2, 0.97 * left.lean, a) for a in around) < spare
    up = left.R_WB.T @ [0.0, 0.0, 1.0]
    assert find_reserve(2, left.lean, math.atan2(up[1], up[0])) == pytest.approx(spare, abs=0.02)
    assert find_reserve(2, 0.0, 0.0) < 0.0  # level: a rotor would have to give less than its least


@pytest.mark.parametrize("rotor", [1, 4, 5, 8])
def test_without_a_rotor_that_lifts_most_only_a_large_lean_hovers(rotor: int) -> None:
    assert lose(rotor) is None
    around = np.radians(np.arange(0.0, 360.0, 15.0))
    assert max(find_reserve(rotor, math.radians(54.0), a) for a in around) < 0.0
    assert max(find_reserve(rotor, math.radians(66.0), a) for a in around) > 0.5
    assert find_reserve(rotor, 0.0, 0.0) < -7.0  # level: others would have to pull down


def test_what_cannot_lean_or_has_too_few_rotors_cannot_go_on() -> None:
    assert lose(2, tilt_max=0.0) is None  # a law that follows no attitude
    again = lose(2)
    assert again is not None
    once = ALLOCATOR._replace(
        P=again.P, t_min=again.t_min, t_max=again.t_max, preload=again.preload
    )
    assert compute_rotors_left(once, 5, WEIGHT, AT, TILT_MAX) is None  # a second one
    for name in ("othex", "f550-bridge", "tilthex-arm"):
        robot = load_robot(name)[0]
        mass, com, _ = compute_body(build_body_model(robot), posture(robot, "folded"))
        assert not list_rotors_left(build_rotors(robot.rotors), 9.81 * mass, com, 0.5)


def test_parallel_rotors_stay_level_and_give_up_yaw() -> None:
    robot = load_robot("hexarotor")[0]
    mass, com, _ = compute_body(build_body_model(robot), np.zeros(0))
    found = list_rotors_left(build_rotors(robot.rotors), 9.81 * mass, com, 0.5)
    assert list(found) == [1, 2, 3, 4, 5, 6]
    for left in found.values():
        assert not left.holds_heading and left.lean == 0.0 and not np.any(left.preload)
        assert not np.any(left.P[:, [0, 1, 5]])


@pytest.mark.parametrize("law", ["whole_body_qp", "push_and_slide"])
def test_law_and_allocation_use_the_others(law: str) -> None:
    """Near the leaned hover both make the wrench that the law asks for, without rotor 2."""
    d = load_description("waypoints", robot="omnicopter", sets=[f"mission.law={law}"])
    flown = LawStep(build_vehicle(d))
    saved = flown.vehicle.save()
    left = flown.vehicle.give_up_rotor(1)
    assert left is not None
    for row in (flown.reference, flown.estimate):
        row.R_WB = rot_z(0.4) @ left.R_WB
    flown.estimate.v_WB = flown.estimate.v_WB + [0.05, -0.04, 0.03]
    cmd = flown.step()
    if law == "whole_body_qp":
        told = flown.ports["told"]
        assert told.given == 1.0 and told.limits == 0.0 and told.thrust[1] == 0.0
        wrench = ROTORS.B @ told.thrust[:8]
        np.testing.assert_allclose(wrench[:5], [*cmd.f_B, *cmd.t_B[:2]], atol=1e-6)
        flown.estimate.w_WB_B = flown.estimate.w_WB_B + [9.0, 9.0, 0.0]  # beyond what they can
        flown.step()
        assert told.limits == 1.0 and told.thrust[1] == 0.0
        assert np.min(np.delete(told.thrust[:8], 1)) == pytest.approx(0.3, abs=1e-6)
    flown.vehicle.restore(saved)
    assert flown.vehicle.give_up_rotor(1) is not None  # all are in use again after a restore


@pytest.mark.parametrize(("rotor", "start"), [(2, 6.0), (2, 16.8), (3, 9.6)])
def test_a_platform_of_eight_rotors_lands_without_one(tmp_path, rotor: int, start: float) -> None:
    """On the way to the lean at which it hovers, the torque has priority over the lift."""
    keys = ("kind=rotor", f"rotor={rotor}", "efficiency=0", f"start_s={start}")
    sets = [f"plant.faults.a.{k}" for k in keys]
    result = run_mission(
        load_description("waypoints", robot="omnicopter", sets=sets), out=tmp_path / "run"
    )
    (acted,) = result.acted
    assert acted.rule == "rotor_lost" and acted.response == "land_here"
    assert start < acted.t_s < start + 0.1
    m = result.metrics
    assert m["response.landed"] == 1.0 and m["contact.collisions"] == 0.0
    assert m["response.deviation_max_m"] < 0.4
