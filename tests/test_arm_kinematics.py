"""Closed-form kinematics of the 4-DoF arm: FK against the rigid body, FK(IK), limits, workspace."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.arm_inverse_kinematics import (
    build_arm_chain,
    compute_arm_fk,
    compute_arm_ik,
)
from skywright.models.arm_nearest import arm_jacobian
from skywright.models.body_records import Kinematics
from skywright.models.rigid_body import (
    build_body_model,
    compute_tip,
    compute_tips,
    fill_hands,
    fill_kinematics,
)

ROBOT = load_robot("bimanual")[0]
CHAINS = [build_arm_chain(ROBOT, side) for side in (0, 1)]
share = st.floats(0.0, 1.0)
sides = st.sampled_from([0, 1])


def angles(chain, shares):
    return chain.q_min + np.array(shares) * (chain.q_max - chain.q_min)


@given(sides, st.tuples(share, share, share, share))
def test_forward_kinematics_are_those_of_the_rigid_body(side, shares):
    chain, model, k = CHAINS[side], build_body_model(ROBOT), np.zeros(1, Kinematics.dtype)
    q = np.zeros(9)
    q[chain.first : chain.first + 4] = angles(chain, shares)
    fill_kinematics(model[0], q, k[0])
    fill_hands(model[0], k[0])
    p = chain.p_shoulder + compute_arm_fk(chain, q[chain.first : chain.first + 4])
    np.testing.assert_allclose(p, k[0]["p_BH"][side], atol=1e-14)
    J = np.empty((3, 4))
    arm_jacobian(chain.upper, chain.fore, angles(chain, shares), J)
    np.testing.assert_allclose(J, k[0]["J_BH"][side][:, chain.first : chain.first + 4], atol=1e-14)


@given(sides, st.tuples(share, share, share, share), share)
def test_ik_returns_to_every_point_of_the_workspace(side, shares, roll):
    """Any posture within the limits, any roll asked for: exact to 1e-10 m, limits kept."""
    chain = CHAINS[side]
    goal = compute_arm_fk(chain, angles(chain, shares))
    asked = chain.q_min[1] + roll * (chain.q_max[1] - chain.q_min[1])
    s = compute_arm_ik(chain, goal, roll=asked)
    assert s.status == "reached"
    assert np.linalg.norm(compute_arm_fk(chain, s.q) - goal) < 1e-10
    np.testing.assert_array_equal(s.p, compute_arm_fk(chain, s.q))
    assert np.all(s.q >= chain.q_min) and np.all(s.q <= chain.q_max)


@given(sides, st.tuples(share, share, share, share))
def test_the_posture_comes_back_when_its_roll_is_asked_for(side, shares):
    """(7): with q2 = phi and the branch near the posture, IK is the inverse of FK."""
    chain, q = CHAINS[side], angles(CHAINS[side], shares)
    # where the forearm is stretched or the shoulder's yaw at a quarter turn, branches meet
    assume(abs(math.sin(q[3])) > 0.05 and abs(math.cos(q[2])) > 0.05)
    assume(abs(math.cos(q[1])) > 0.05)
    goal = compute_arm_fk(chain, q)
    assume(math.hypot(goal[0], goal[2]) > 0.02)  # else the shoulder's pitch turns nothing
    s = compute_arm_ik(chain, goal, roll=q[1], near=q)
    np.testing.assert_allclose(s.q, q, atol=1e-8)


@given(st.tuples(share, share, share, share), share)
def test_the_right_arm_is_the_mirror_image(shares, roll):
    left, right = CHAINS
    goal = compute_arm_fk(left, angles(left, shares))
    asked = left.q_min[1] + roll * (left.q_max[1] - left.q_min[1])
    mirror = np.array([1.0, -1.0, -1.0, 1.0])
    a = compute_arm_ik(left, goal, roll=asked)
    b = compute_arm_ik(right, goal * [1.0, -1.0, 1.0], roll=-asked)
    np.testing.assert_allclose(b.p, a.p * [1.0, -1.0, 1.0], atol=1e-9)
    # at a tie between two rolls or two branches either may come
    if abs(a.q[1] - asked) < 1e-12 and 1e-6 < abs(a.q[2]) < 1.57:
        np.testing.assert_allclose(b.q, a.q * mirror, atol=1e-7)


@given(sides, st.tuples(*[st.floats(-0.9, 0.9)] * 3))
def test_outside_the_workspace_the_answer_is_the_nearest_point(side, goal):
    chain, goal = CHAINS[side], np.array(goal)
    s = compute_arm_ik(chain, goal)
    assert np.all(s.q >= chain.q_min - 1e-12) and np.all(s.q <= chain.q_max + 1e-12)
    assert (s.status == "reached") == (s.error < 1e-10)
    rho = np.linalg.norm(goal)
    if rho > chain.upper + chain.fore + 1e-9:
        assert s.status == "out of reach"
    # no posture on a grid comes closer
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 13)] * 4), axis=-1).reshape(-1, 4)
    best = min_distance(chain, chain.q_min + grid * (chain.q_max - chain.q_min), goal)
    assert s.error <= best + 1e-5


def min_distance(chain, q, goal):
    a, h = -chain.fore * np.sin(q[:, 3]), chain.upper + chain.fore * np.cos(q[:, 3])
    x, y = a * np.cos(q[:, 2]), a * np.sin(q[:, 2])
    z = y * np.sin(q[:, 1]) - h * np.cos(q[:, 1])
    s1, c1 = np.sin(q[:, 0]), np.cos(q[:, 0])
    p = np.stack([x * c1 + z * s1, y * np.cos(q[:, 1]) + h * np.sin(q[:, 1]), -x * s1 + z * c1], 1)
    return float(np.min(np.linalg.norm(p - goal, axis=1)))


def test_special_points():
    chain = CHAINS[0]
    straight = compute_arm_ik(chain, np.array([0.0, 0.0, -0.5]))
    assert straight.status == "reached" and abs(straight.q[3]) < 1e-7
    far = compute_arm_ik(chain, np.array([0.0, 0.0, -0.7]))
    assert far.status == "out of reach"
    assert far.error == pytest.approx(0.2, abs=1e-9)
    np.testing.assert_allclose(far.p, [0.0, 0.0, -0.5], atol=1e-9)
    shoulder = compute_arm_ik(chain, np.zeros(3))  # the elbow bends 135 deg: 191 mm is the least
    assert shoulder.status == "out of reach"
    nearest = math.sqrt(0.125 + 0.125 * math.cos(math.radians(135)))
    assert shoulder.error == pytest.approx(nearest, abs=1e-9)
    inward = compute_arm_ik(chain, np.array([0.0, -0.45, -0.1]))  # roll goes 10 deg inward only
    assert inward.status == "at a joint limit"
    L = compute_arm_ik(chain, np.array([0.25, 0.0, -0.25]))  # the L pose of section V-D
    np.testing.assert_allclose(L.q, [0.0, 0.0, 0.0, -math.pi / 2], atol=1e-12)


def test_input_errors():
    with pytest.raises(InputError, match="four hinges"):
        build_arm_chain(load_robot("othex")[0])
    with pytest.raises(InputError, match=r"no arm 2; valid: 0 \(left\), 1 \(right\)"):
        build_arm_chain(ROBOT, 2)
    with pytest.raises(InputError, match="finite"):
        compute_arm_ik(CHAINS[0], np.array([0.0, np.nan, 0.0]))


@pytest.mark.parametrize("name", ["othex", "f550-bridge"])
def test_tips_of_many_postures_are_those_of_each(name):
    model = build_body_model(load_robot(name)[0])
    n = int(model[0]["n_joints"])
    low, high = model[0]["q_min"][:n], model[0]["q_max"][:n]
    postures = low + np.random.default_rng(1).random((20, n)) * (high - low)
    for q, p_BT, R_BT in zip(postures, *compute_tips(model, postures), strict=True):
        k, full = np.zeros(1, Kinematics.dtype), np.zeros(9)
        full[:n] = q
        fill_kinematics(model[0], full, k[0])
        assert np.array_equal(p_BT, k[0]["p_BT"]) and np.array_equal(R_BT, k[0]["R_BT"])
        assert np.array_equal(compute_tip(model, q)[0], p_BT)
