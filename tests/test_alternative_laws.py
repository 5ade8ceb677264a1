"""The laws that Tognon 2018 argues against: what each feeds back, and what it leaves alone."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.control.inverse_kinematics import step as inverse_kinematics
from skywright.control.joint_space import step as joint_space
from skywright.control.push_and_slide import step as push_and_slide
from skywright.control.registry import FULLY_ACTUATED, LAWS, load_law
from skywright.control.tip_pd import DERIVATIVE
from skywright.control.tip_pd import step as tip_pd
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.core.types import BELIEF

MASS, KP = 2.25, 2.25 * 36.0


@pytest.fixture
def belief():
    out = np.zeros(1, BELIEF)
    b = out[0]
    par, body = b["par"], b["body"]
    par["dt"], par["wn_p"], par["zeta_p"], par["wi_p"] = 0.002, 6.0, 1.2, 0.0
    par["wn_R"], par["zeta_R"], par["wi_R"], par["k_arm"] = 11.0, 1.0, 0.5, 3.0
    par["f_integral_max"], par["t_integral_max"] = 8.0, 2.0
    par["belt"][:2, :2] = [[1, 0], [-1, 1]]
    par["belt_inv"][:2, :2] = [[1, 0], [1, 1]]
    par["motor_speed_max"] = 5.0
    body["mass"], body["gravity"], body["n_joints"] = MASS, 9.81, 2
    body["I_B"] = np.diag([0.07, 0.14, 0.2])
    body["J_BT"][:, :2] = [[-0.1, -0.3], [0.0, 0.0], [-0.6, -0.2]]
    for part in ("ref", "est"):
        for name in ("R_WB", "R_WT"):
            b[part][name] = np.eye(3)
    b["ref"]["R_WS"], b["ref"]["active"], b["ref"]["track_tip"] = np.eye(3), 1.0, 1.0
    return out


def call(law, b):
    law(b["par"], b["mem"], b["ref"], b["est"], b["body"], b["cmd"])
    return b["cmd"]["f_B"] - [0.0, 0.0, MASS * 9.81]


@pytest.mark.parametrize("law", [joint_space, inverse_kinematics])
def test_the_platform_is_blind_to_the_tip(belief, law):
    b = belief[0]
    b["ref"]["p_WT"] = [0.02, -0.01, 0.03]
    np.testing.assert_allclose(call(law, b), 0.0, atol=1e-12)
    b["ref"]["p_WB"], b["ref"]["v_WB"] = [0.01, 0.0, -0.02], [0.0, 0.1, 0.0]
    expected = KP * np.array([0.01, 0.0, -0.02]) + [0.0, 2.4 * MASS * 6.0 * 0.1, 0.0]
    np.testing.assert_allclose(call(law, b), expected, atol=1e-9)


def test_joint_space_arm_is_the_nominal_arm(belief):
    b = belief[0]
    b["ref"]["p_WT"] = [0.02, -0.01, 0.03]
    b["ref"]["q"][:2] = [0.1, -0.1]
    call(joint_space, b)
    np.testing.assert_allclose(b["cmd"]["qd"][:2], [0.3, -0.3], atol=1e-12)


def test_inverse_kinematics_moves_the_tip_towards_its_place(belief):
    """J qd = K e_E within the arm's plane, up to the damping of the inverse, in any attitude."""
    b = belief[0]
    r = rot_z(0.5) @ rot_y(0.1) @ rot_x(-0.2)
    b["est"]["R_WB"] = r
    e_B = np.array([0.002, 0.01, -0.003])
    b["ref"]["p_WT"] = r @ e_B
    call(inverse_kinematics, b)
    moved = b["body"]["J_BT"] @ b["cmd"]["qd"]
    wanted = 3.0 * np.array([0.002, 0.0, -0.003])
    np.testing.assert_allclose(moved, wanted, atol=0.1 * np.linalg.norm(wanted))
    j = b["body"]["J_BT"][:, :2]
    exact = np.linalg.solve(j.T @ j + 0.05**2 * np.eye(2), j.T @ (3.0 * e_B))
    np.testing.assert_allclose(b["cmd"]["qd"][:2], exact, rtol=1e-9)


def test_inverse_kinematics_does_not_push_into_the_surface(belief):
    b = belief[0]
    r_ws = rot_y(-1.2)
    b["ref"]["R_WS"], b["ref"]["dead_zone"] = r_ws, 0.04
    b["ref"]["p_WT"] = -0.025 * r_ws[:, 2]
    call(inverse_kinematics, b)
    np.testing.assert_allclose(b["cmd"]["qd"], 0.0, atol=1e-12)
    b["ref"]["dead_zone"] = 0.0
    call(inverse_kinematics, b)
    assert np.linalg.norm(b["cmd"]["qd"]) > 0.01


def test_inverse_kinematics_respects_the_motors(belief):
    b = belief[0]
    b["ref"]["p_WT"] = [5.0, 0.0, 5.0]
    call(inverse_kinematics, b)
    motors = b["par"]["belt_inv"][:2, :2] @ b["cmd"]["qd"][:2]
    assert np.max(np.abs(motors)) == pytest.approx(5.0)


def test_tip_pd_damps_the_tip_and_not_the_platform(belief):
    b = belief[0]
    v = np.array([0.03, -0.02, 0.01])
    for i in range(40):  # ten time constants of the derivative
        b["est"]["p_WT"] = v * 0.002 * i
        b["ref"]["p_WT"] = b["est"]["p_WT"]
        b["est"]["v_WB"] = [1.0, 1.0, 1.0]
        force = call(tip_pd, b)
    assert 10 * DERIVATIVE < 40 * 0.002
    np.testing.assert_allclose(force, -2.4 * MASS * 6.0 * v, rtol=1e-3)
    b["est"]["p_WT"] += v * 0.002
    b["ref"]["p_WT"] = b["est"]["p_WT"] + [0.01, 0.0, 0.0]
    b["ref"]["v_WT"] = v
    np.testing.assert_allclose(call(tip_pd, b), [KP * 0.01, 0.0, 0.0], atol=1e-3)


def test_in_free_flight_tip_pd_is_law_4(belief):
    b = belief[0]
    b["ref"]["track_tip"] = 0.0
    b["ref"]["p_WB"], b["est"]["v_WB"] = [0.1, 0.0, 0.05], [0.0, 0.2, 0.0]
    assert np.array_equal(call(tip_pd, b), call(push_and_slide, b))


@pytest.mark.parametrize("name", ["joint_space", "inverse_kinematics", "tip_pd"])
def test_motors_off_and_registry(belief, name):
    law = load_law(name)
    assert name in LAWS and name in FULLY_ACTUATED and law.compiled is not None
    belief[0]["ref"]["active"] = 0.0
    belief[0]["mem"]["sigma"] = 1.0
    belief[0]["ref"]["p_WB"] = 1.0
    law.step(belief)
    assert np.all(belief[0]["cmd"]["f_B"] == 0.0) and np.all(belief[0]["mem"]["sigma"] == 0.0)
