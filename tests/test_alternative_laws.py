"""The laws that Tognon 2018 argues against: what each feeds back, and what it leaves alone."""

from __future__ import annotations

import numpy as np
import pytest

import law_parts
from law_parts import build_case
from skywright.core.find import find
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.vehicle.laws.inverse_kinematics import InverseKinematics
from skywright.vehicle.laws.joint_space import JointSpace
from skywright.vehicle.laws.push_and_slide import PushAndSlide
from skywright.vehicle.laws.tip_pd import DERIVATIVE, TipPd

MASS, KP = 2.25, 2.25 * 36.0


@pytest.fixture
def b():
    out = build_case()
    out["me"]["wi_p"], out["ref"]["track_tip"] = 0.0, 1.0
    out["body"]["J_BT"][:, :2] = [[-0.1, -0.3], [0.0, 0.0], [-0.6, -0.2]]
    return out


def call(law, b):
    law_parts.call(law, b)
    return b["cmd"]["f_B"] - [0.0, 0.0, MASS * 9.81]


@pytest.mark.parametrize("law", [JointSpace, InverseKinematics])
def test_the_platform_is_blind_to_the_tip(b, law):
    b["ref"]["p_WT"] = [0.02, -0.01, 0.03]
    np.testing.assert_allclose(call(law, b), 0.0, atol=1e-12)
    b["ref"]["p_WB"], b["ref"]["v_WB"] = [0.01, 0.0, -0.02], [0.0, 0.1, 0.0]
    expected = KP * np.array([0.01, 0.0, -0.02]) + [0.0, 2.4 * MASS * 6.0 * 0.1, 0.0]
    np.testing.assert_allclose(call(law, b), expected, atol=1e-9)


def test_joint_space_arm_is_the_nominal_arm(b):
    b["ref"]["p_WT"] = [0.02, -0.01, 0.03]
    b["ref"]["q"][:2] = [0.1, -0.1]
    call(JointSpace, b)
    np.testing.assert_allclose(b["cmd"]["qd"][:2], [0.3, -0.3], atol=1e-12)


def test_inverse_kinematics_moves_the_tip_towards_its_place(b):
    """J qd = K e_E within the arm's plane, up to the damping of the inverse, in any attitude."""
    r = rot_z(0.5) @ rot_y(0.1) @ rot_x(-0.2)
    b["est"]["R_WB"] = r
    e_B = np.array([0.002, 0.01, -0.003])
    b["ref"]["p_WT"] = r @ e_B
    call(InverseKinematics, b)
    moved = b["body"]["J_BT"] @ b["cmd"]["qd"]
    wanted = 3.0 * np.array([0.002, 0.0, -0.003])
    np.testing.assert_allclose(moved, wanted, atol=0.1 * np.linalg.norm(wanted))
    j = b["body"]["J_BT"][:, :2]
    exact = np.linalg.solve(j.T @ j + 0.05**2 * np.eye(2), j.T @ (3.0 * e_B))
    np.testing.assert_allclose(b["cmd"]["qd"][:2], exact, rtol=1e-9)


def test_inverse_kinematics_does_not_push_into_the_surface(b):
    r_ws = rot_y(-1.2)
    b["ref"]["R_WS"], b["ref"]["dead_zone"] = r_ws, 0.04
    b["ref"]["p_WT"] = -0.025 * r_ws[:, 2]
    call(InverseKinematics, b)
    np.testing.assert_allclose(b["cmd"]["qd"], 0.0, atol=1e-12)
    b["ref"]["dead_zone"] = 0.0
    call(InverseKinematics, b)
    assert np.linalg.norm(b["cmd"]["qd"]) > 0.01


def test_inverse_kinematics_respects_the_motors(b):
    b["ref"]["p_WT"] = [5.0, 0.0, 5.0]
    call(InverseKinematics, b)
    motors = b["me"]["belt_inv"][:2, :2] @ b["cmd"]["qd"][:2]
    assert np.max(np.abs(motors)) == pytest.approx(5.0)


def test_tip_pd_damps_the_tip_and_not_the_platform(b):
    v = np.array([0.03, -0.02, 0.01])
    for i in range(40):  # ten time constants of the derivative
        b["est"]["p_WT"] = v * 0.002 * i
        b["ref"]["p_WT"] = b["est"]["p_WT"]
        b["est"]["v_WB"] = [1.0, 1.0, 1.0]
        force = call(TipPd, b)
    assert 10 * DERIVATIVE < 40 * 0.002
    np.testing.assert_allclose(force, -2.4 * MASS * 6.0 * v, rtol=1e-3)
    b["est"]["p_WT"] += v * 0.002
    b["ref"]["p_WT"] = b["est"]["p_WT"] + [0.01, 0.0, 0.0]
    b["ref"]["v_WT"] = v
    np.testing.assert_allclose(call(TipPd, b), [KP * 0.01, 0.0, 0.0], atol=1e-3)


def test_in_free_flight_tip_pd_is_law_4(b):
    b["ref"]["track_tip"] = 0.0
    b["ref"]["p_WB"], b["est"]["v_WB"] = [0.1, 0.0, 0.05], [0.0, 0.2, 0.0]
    assert np.array_equal(call(TipPd, b), call(PushAndSlide, b))


@pytest.mark.parametrize("name", ["joint_space", "inverse_kinematics", "tip_pd"])
def test_motors_off_and_what_it_needs(b, name):
    law = find("law", name).cls
    assert law.needs_full_actuation and law.compiled
    b["ref"]["active"] = 0.0
    b["me"]["sigma"] = 1.0
    b["ref"]["p_WB"] = 1.0
    law_parts.call(law, b)
    assert np.all(b["cmd"]["f_B"] == 0.0) and np.all(b["me"]["sigma"] == 0.0)
