"""Laws (2)-(4): identities, integral with dead zone, and stability of the reduced model."""

from __future__ import annotations

import numpy as np
import pytest

from law_parts import build_case, call
from skywright.core.record import View
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.vehicle.laws.push_and_slide import PushAndSlide
from skywright.vehicle.laws.thrust_vectoring import ThrustVectoring
from skywright.vehicle.loops import arm_velocity, attitude_torque, position_force


@pytest.fixture
def b():
    out = build_case()
    out["body"]["p_BC"] = [0.07, 0.01, -0.02]
    return out


def test_at_rest_the_rotors_carry_the_weight_and_its_torque(b):
    """g_1 and g_2 of laws (4) and (3): f = m g up, torque = p_BC x f, in any attitude."""
    r = rot_z(0.4) @ rot_y(0.15) @ rot_x(-0.1)
    b["ref"]["R_WB"] = b["est"]["R_WB"] = r
    call(PushAndSlide, b)
    weight_B = r.T @ [0, 0, 2.25 * 9.81]
    np.testing.assert_allclose(b["cmd"]["f_B"], weight_B, atol=1e-12)
    np.testing.assert_allclose(b["cmd"]["t_B"], np.cross(b["body"]["p_BC"], weight_B), atol=1e-12)


def test_attitude_law_is_the_paper_s_error_times_inertia(b):
    r_n, r = rot_x(0.2) @ rot_z(0.1), rot_y(0.1)
    b["est"]["R_WB"] = r
    b["est"]["w_WB_B"] = [0.1, -0.2, 0.3]
    w_n, wd_n = np.array([0.2, 0.1, -0.1]), np.array([0.5, 0.4, 0.3])
    f_B, t_B = np.array([1.0, -0.5, 20.0]), np.zeros(3)
    me, est, body = (View(b[name]) for name in ("me", "est", "body"))
    attitude_torque(me, r_n, w_n, wd_n, est, body, f_B, 0.0, t_B)
    skew = 0.5 * (r.T @ r_n - r_n.T @ r)
    e_R = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    e_w = r.T @ r_n @ w_n - b["est"]["w_WB_B"]
    c = b["body"]["p_BC"]
    inertia = b["body"]["I_B"] - 2.25 * (c @ c * np.eye(3) - np.outer(c, c))
    w = b["est"]["w_WB_B"]
    expected = inertia @ (wd_n + 121 * e_R + 22 * e_w) + np.cross(c, f_B)
    expected += np.cross(w, inertia @ w)
    np.testing.assert_allclose(t_B, expected, atol=1e-12)
    np.testing.assert_allclose(b["me"]["theta"], 0.002 * 0.5 * 121 * inertia @ e_R, atol=1e-12)


@pytest.mark.parametrize("law", [PushAndSlide, ThrustVectoring])
def test_motors_off_means_no_wrench_and_no_integral(b, law):
    b["ref"]["active"] = 0.0
    b["me"]["sigma"] = b["me"]["theta"] = 1.0
    b["ref"]["p_WB"] = [1.0, 2.0, 3.0]
    call(law, b)
    for value in (b["cmd"]["f_B"], b["cmd"]["t_B"], b["me"]["sigma"], b["me"]["theta"]):
        assert np.all(value == 0.0)


def test_integral_leaves_the_intended_penetration_alone_and_takes_the_rest(b):
    """sigma_dot = R_I diag(1,1,0) R_I^T e inside the dead zone, e outside (E001-1 corrected)."""
    r_ws = rot_y(-np.pi / 2) @ rot_x(0.3)  # a surface frame that is no axis permutation
    b["ref"]["R_WS"], b["ref"]["track_tip"] = r_ws, 1.0
    normal = r_ws[:, 2]
    tangent = r_ws[:, 0]
    b["ref"]["dead_zone"] = 0.04
    b["ref"]["p_WT"] = -0.03 * normal + 0.01 * tangent
    f = np.zeros(3)
    args = (*(View(b[name]) for name in ("me", "ref", "est", "body")), 0.0, f)
    position_force(*args)
    kp = 2.25 * 36.0
    np.testing.assert_allclose(b["me"]["sigma"], 0.002 * 0.5 * kp * 0.01 * tangent, atol=1e-12)
    b["me"]["sigma"] = 0.0
    b["ref"]["p_WT"] = -0.05 * normal  # beyond the dead zone everything is integrated
    position_force(*args)
    np.testing.assert_allclose(b["me"]["sigma"], -0.002 * 0.5 * kp * 0.05 * normal, atol=1e-12)
    b["me"]["sigma"] = 0.0
    position_force(*args[:4], 1.0, f)  # saturated rotors: the integral rests
    assert np.all(b["me"]["sigma"] == 0.0)


def test_friction_is_fed_forward_along_the_sliding_only_in_contact(b):
    b["me"]["friction"], b["ref"]["track_tip"] = 0.2, 1.0
    b["ref"]["p_WT"], b["ref"]["v_WT"] = [0, 0, -0.02], [0.05, 0, 0]
    f = np.zeros(3)
    args = (*(View(b[name]) for name in ("me", "ref", "est", "body")), 1.0, f)
    position_force(*args)
    assert f[0] == 0.0
    b["ref"]["dead_zone"] = 0.03
    position_force(*args)
    assert f[0] == pytest.approx(0.2 * 2.25 * 36.0 * 0.02, rel=1e-3)


def test_arm_law_acts_on_the_motors_behind_the_belt(b):
    """Law (2) in motor space; both the loop and the speed limits are the motors'."""
    b["ref"]["q"][:2], b["ref"]["qd"][:2] = [0.1, -0.2], [0.3, 0.4]
    b["est"]["q"][:2] = [0.05, 0.1]
    qd = np.zeros(9)
    arm_velocity(*(View(b[name]) for name in ("me", "ref", "est", "body")), qd)
    belt = np.array([[1.0, 0.0], [-1.0, 1.0]])
    q_m, qn_m = np.linalg.solve(belt, [0.05, 0.1]), np.linalg.solve(belt, [0.1, -0.2])
    v_m = np.linalg.solve(belt, [0.3, 0.4]) + 3.0 * (qn_m - q_m)
    np.testing.assert_allclose(qd[:2], belt @ v_m, atol=1e-12)
    b["ref"]["q"][0] = 100.0
    arm_velocity(*(View(b[name]) for name in ("me", "ref", "est", "body")), qd)
    assert np.all(np.abs(np.linalg.solve(belt, qd[:2])) <= 5.0 + 1e-12)


def test_thrust_vectoring_respects_its_tilt_limit_and_points_to_the_force(b):
    b["body"]["p_BC"] = 0.0
    b["ref"]["p_WB"] = [50.0, 0.0, 0.0]  # asks for far more than the tilt limit allows
    call(ThrustVectoring, b)
    assert b["cmd"]["f_B"][0] == 0.0 and b["cmd"]["f_B"][1] == 0.0
    t = b["cmd"]["t_B"]
    assert t[1] > 0.0  # pitch forward (x down) to go to +x
    assert t[1] == pytest.approx(0.14 * 121 * np.sin(0.4), rel=1e-9)


def reduced_model(kp, kd, stiffness, displaced):
    """Vehicle m1 and tip m2 joined by a spring, force on m1 from the tip's position error.

    The damping acts on the vehicle's velocity (displaced, law 4) or on the tip's. Returns the
    largest real part of the closed loop's poles (paper, section V; facts: Routh criterion).
    """
    m1, m2, k = 1.8, 0.45, stiffness
    a = np.zeros((4, 4))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = [-k / m1, (k - kp) / m1, 0.0, 0.0]
    a[3] = [k / m2, -k / m2, 0.0, 0.0]
    a[2, 2 if displaced else 3] -= kd / m1
    return float(np.max(np.linalg.eigvals(a).real))


def test_displaced_feedback_is_stable_exactly_below_the_elastic_stiffness():
    for kd in (1.0, 10.0, 40.0):
        assert reduced_model(290.0, kd, 300.0, displaced=True) < 0.0
        assert reduced_model(310.0, kd, 300.0, displaced=True) > 0.0
        for kp in (1.0, 30.0, 290.0):
            assert reduced_model(kp, kd, 300.0, displaced=False) > 0.0


def test_the_othex_stays_well_below_its_elastic_stiffness():
    """The rule above for the shipped gains: K^P under half of arm and belt in series at the tip."""
    from skywright.description.loader import load_description
    from skywright.models.rigid_body import build_body_model, compute_body, posture

    robot = load_description("pipe-weld-scan").robot
    mass, _, _ = compute_body(build_body_model(robot), posture(robot, "working"))
    kp = mass * robot.control.position_bandwidth_rad_s**2
    reach2 = robot.arm.links["link2"].length_m + robot.probe.length_m
    reach1 = robot.arm.links["link1"].length_m + reach2
    k1 = robot.arm.links["link1"].flex_stiffness_nm_per_rad / reach1**2
    k2 = robot.arm.links["link2"].flex_stiffness_nm_per_rad / reach2**2
    assert kp < 0.5 / (1 / k1 + 1 / k2)
