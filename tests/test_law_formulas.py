"""Laws on random states against their equations, written once more with NumPy.

Every vector and gain differs from zero and from the others, so that a wrong sign, axis or factor
shows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import skywright
from law_parts import build_case, call
from skywright.core.record import View
from skywright.vehicle.follower import Press
from skywright.vehicle.laws.direct_force import DirectForce
from skywright.vehicle.laws.inverse_kinematics import DAMPING, InverseKinematics
from skywright.vehicle.laws.push_and_slide import PushAndSlide
from skywright.vehicle.laws.thrust_vectoring import ThrustVectoring
from skywright.vehicle.laws.tip_pd import DERIVATIVE, TipPd
from skywright.vehicle.loops import SLOW, AttitudeGains, compute_delay_margin

Z = np.array([0.0, 0.0, 1.0])


@pytest.fixture(params=[1, 2, 3])
def b(request: pytest.FixtureRequest) -> dict[str, Any]:
    """A random state near the hover."""
    rng = np.random.default_rng(request.param)
    b = build_case()
    for part in ("ref", "est"):
        for name in ("p_WB", "p_WT"):
            b[part][name] = rng.uniform(0.5, 1.5, 3)
        for name, size in (("v_WB", 0.3), ("w_WB_B", 0.2), ("v_WT", 0.2)):
            if name in b[part].dtype.names:
                b[part][name] = rng.uniform(-size, size, 3)
        for name in ("R_WB", "R_WT"):
            b[part][name] = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, 3)).as_matrix()
        b[part]["q"][:2] = rng.uniform(-1.0, 1.0, 2)
    b["ref"]["a_WB"], b["ref"]["wd_WB_B"] = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
    b["ref"]["R_WS"] = Rotation.random(random_state=request.param).as_matrix()
    b["ref"]["qd"][:2] = rng.uniform(-0.5, 0.5, 2)
    me, body = b["me"], b["body"]
    me["sigma"], me["theta"] = rng.uniform(-1, 1, 3), rng.uniform(-0.2, 0.2, 3)
    me["wn_R"], me["zeta_R"], me["zeta_p"], me["friction"] = [9, 11, 5], 0.9, 1.2, 0.3
    me["thrust_max"] = 200.0
    inertia = np.diag([0.07, 0.14, 0.2])
    inertia[0, 2] = inertia[2, 0] = 0.01
    body["I_B"], body["p_BC"] = inertia, rng.uniform(-0.05, 0.05, 3)
    body["J_BT"][:, :2] = rng.uniform(-0.5, 0.5, (3, 2))
    return b


def gains(b: dict[str, Any]) -> tuple[float, float]:
    m, wn = 2.25, 6.0
    assert b["body"]["mass"] == m and b["me"]["wn_p"] == wn
    return m * wn**2, 2.0 * 1.2 * m * wn


def force(b: dict[str, Any], e: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Law (4), with the friction of what is pressed."""
    kp, kd = gains(b)
    ref = b["ref"]
    out = 2.25 * ref["a_WB"] + kd * v + kp * e + b["me"]["sigma"] + 2.25 * 9.81 * Z
    depth = -float(ref["R_WS"][:, 2] @ e)
    if ref["dead_zone"] > 0.0 and depth > 0.0:
        speed = math.sqrt(ref["v_WT"] @ ref["v_WT"] + SLOW**2)
        out = out + 0.3 * kp * depth * ref["v_WT"] / speed
    return np.asarray(out)


def torque(b: dict[str, Any], R_des: np.ndarray, w_des: Any, wd_des: Any, f_B: Any) -> np.ndarray:
    """Law (3) about the centre of mass."""
    R, w, c = b["est"]["R_WB"], b["est"]["w_WB_B"], b["body"]["p_BC"]
    inertia = b["body"]["I_B"] - 2.25 * (c @ c * np.eye(3) - np.outer(c, c))
    skew = 0.5 * (R.T @ R_des - R_des.T @ R)
    e_R, wn = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]), b["me"]["wn_R"]
    acc = wd_des + wn**2 * e_R + 2.0 * 0.9 * wn * (R.T @ R_des @ w_des - w)
    return np.asarray(
        inertia @ acc + np.cross(c, f_B) + np.cross(w, inertia @ w) + b["me"]["theta"]
    )


@pytest.mark.parametrize("tracked", ["WB", "WT"])
@pytest.mark.parametrize("zone", [0.0, 10.0])
def test_law_4_and_its_integral(b: dict[str, Any], tracked: str, zone: float) -> None:
    ref, est, me = b["ref"], b["est"], b["me"]
    ref["track_tip"], ref["dead_zone"] = float(tracked == "WT"), zone
    e = ref[f"p_{tracked}"] - est[f"p_{tracked}"]
    if zone and ref["R_WS"][:, 2] @ e > 0.0:
        ref["R_WS"][:, 1:] *= -1.0  # the reference lies inside the surface
    f_W = force(b, e, ref["v_WB"] - est["v_WB"])
    n, kp, before = ref["R_WS"][:, 2], gains(b)[0], me["sigma"].copy()
    t_B = torque(b, ref["R_WB"], ref["w_WB_B"], ref["wd_WB_B"], est["R_WB"].T @ f_W)
    call(PushAndSlide, b)
    np.testing.assert_allclose(b["cmd"]["f_B"], est["R_WB"].T @ f_W, atol=1e-9)
    np.testing.assert_allclose(b["cmd"]["t_B"], t_B, atol=1e-9)
    slides = e - (n @ e) * n if zone else e
    np.testing.assert_allclose(me["sigma"], before + 0.002 * 0.5 * kp * slides, atol=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.95, 1.05])
def test_the_integral_of_the_force_has_a_length_at_most(b: dict[str, Any], share: float) -> None:
    b["ref"]["p_WB"] = b["est"]["p_WB"] + [30.0, -40.0, 20.0]
    before, kp = b["me"]["sigma"].copy(), gains(b)[0]
    grown = before + 0.002 * 0.5 * kp * np.array([30.0, -40.0, 20.0])
    b["me"]["f_integral_max"] = share * np.linalg.norm(grown)
    call(PushAndSlide, b)
    np.testing.assert_allclose(b["me"]["sigma"], min(share, 1.0) * grown, atol=1e-9)


@pytest.mark.parametrize("far", [0.0, 3.0])
def test_thrust_points_along_the_force_with_the_references_heading(
    b: dict[str, Any], far: float
) -> None:
    """Beyond the tilt limit the lateral force is cut, its direction stays."""
    ref, est = b["ref"], b["est"]
    ref["R_WB"] = Rotation.from_euler("z", 0.3 + 0.1 * far).as_matrix()
    ref["p_WB"] = est["p_WB"] + [0.03 + far, 0.02 + 2.0 * far, 0.1]
    ref["v_WB"] = est["v_WB"] + 0.2 * ref["v_WB"]
    f_W = force(b, ref["p_WB"] - est["p_WB"], ref["v_WB"] - est["v_WB"])
    lateral, most = float(np.hypot(f_W[0], f_W[1])), f_W[2] * math.tan(0.4)
    assert (lateral > most) == (far > 0.0)
    f_W[:2] *= min(1.0, most / lateral)
    z = f_W / np.linalg.norm(f_W)
    y = np.cross(z, ref["R_WB"][:, 0])
    y /= np.linalg.norm(y)
    R_des = np.column_stack([np.cross(y, z), y, z])
    thrust = float(f_W @ est["R_WB"][:, 2])
    w_des, wd_des = ref["w_WB_B"] * Z, ref["wd_WB_B"] * Z
    t_B = torque(b, R_des, w_des, wd_des, thrust * Z)
    call(ThrustVectoring, b)
    np.testing.assert_allclose(b["cmd"]["f_B"], thrust * Z, atol=1e-9)
    np.testing.assert_allclose(b["cmd"]["t_B"], t_B, atol=1e-9)


@pytest.mark.parametrize(("down", "thrust"), [(-9.0, 0.3 * 2.25 * 9.81), (9.0, 60.0)])
def test_thrust_has_a_least_and_a_most(down: float, thrust: float) -> None:
    b = build_case()
    b["ref"]["p_WB"] = [0.0, 0.0, down]
    call(ThrustVectoring, b)
    np.testing.assert_allclose(b["cmd"]["f_B"], thrust * Z, atol=1e-9)


def test_tip_pd_takes_the_filtered_derivative_of_the_tip(b: dict[str, Any]) -> None:
    ref, est, me = b["ref"], b["est"], b["me"]
    ref["track_tip"] = 1.0
    before, speed = est["p_WT"].copy(), np.array([0.3, -0.2, 0.1])
    call(TipPd, b)  # the first step has no derivative
    me["v_WT"], me["sigma"] = [0.05, 0.06, -0.07], [0.1, 0.2, 0.3]
    est["p_WT"] = before + 0.002 * speed
    v = me["v_WT"] + 0.002 / (DERIVATIVE + 0.002) * (speed - me["v_WT"])
    f_W = force(b, ref["p_WT"] - est["p_WT"], ref["v_WT"] - v)
    call(TipPd, b)
    np.testing.assert_allclose(b["cmd"]["f_B"], est["R_WB"].T @ f_W, atol=1e-9)


@pytest.mark.parametrize("zone", [0.0, 0.02])
def test_inverse_kinematics_solves_damped_least_squares(b: dict[str, Any], zone: float) -> None:
    ref, est, me = b["ref"], b["est"], b["me"]
    ref["track_tip"], ref["dead_zone"], me["motor_speed_max"] = 1.0, zone, 1e3
    e, n = 3.0 * (ref["p_WT"] - est["p_WT"]), ref["R_WS"][:, 2]
    if zone:
        e = e - (n @ e) * n
    J = b["body"]["J_BT"][:, :2]
    qd = ref["qd"][:2] + J.T @ np.linalg.solve(J @ J.T + DAMPING**2 * np.eye(3), est["R_WB"].T @ e)
    f_W = force(b, ref["p_WB"] - est["p_WB"], ref["v_WB"] - est["v_WB"])
    call(InverseKinematics, b)
    np.testing.assert_allclose(b["cmd"]["qd"][:2], qd, atol=1e-9)
    np.testing.assert_allclose(b["cmd"]["f_B"], est["R_WB"].T @ f_W, atol=1e-9)
    fastest = float(np.max(np.abs(me["belt_inv"][:2, :2] @ qd)))
    me["motor_speed_max"] = 0.5 * fastest
    call(InverseKinematics, b)
    np.testing.assert_allclose(b["cmd"]["qd"][:2], 0.5 * qd, atol=1e-9)


@pytest.mark.parametrize("touching", [True, False])
def test_direct_force_presses_across_and_is_law_4_along(b: dict[str, Any], touching: bool) -> None:
    ref, est, asked = b["ref"], b["est"], 4.0
    ref["track_tip"], ref["dead_zone"] = 1.0, 0.03
    n = ref["R_WS"][:, 2]
    ref["p_WT"] = est["p_WT"] + 0.01 * ref["R_WS"][:, 0] - 0.02 * ref["R_WS"][:, 1] - 0.03 * n
    est["f_tip"] = 3.2 if touching else 0.0
    me = np.zeros(1, DirectForce.Me.dtype)[0]
    for name in b["me"].dtype.names:
        if name in me.dtype.names:
            me[name] = b["me"][name]
    me["damper"], me["kp_force"], me["ki_force"] = 30.0, 1.7, 8.0
    me["approach"], me["approach_max"] = 0.02, 0.05
    press = np.zeros(1, Press.dtype)[0]
    press["force"] = asked
    records = {**b, "me": me, "press": press}
    kp, kd = gains(b)
    e, v = ref["p_WT"] - est["p_WT"], ref["v_WB"] - est["v_WB"]
    along, sliding = e - (n @ e) * n, v - (n @ v) * n
    push = asked * 2.7 - 1.7 * 3.2 if touching else min(asked * 2.7, 30.0 * min(0.08, 0.05))
    speed = math.sqrt(ref["v_WT"] @ ref["v_WT"] + SLOW**2)
    f_W = 2.25 * ref["a_WB"] + kd * sliding + kp * along + me["sigma"] + 2.25 * 9.81 * Z
    f_W += (30.0 * (n @ v) - push) * n + 0.3 * asked * ref["v_WT"] / speed
    wind_up = 8.0 * (asked - 3.2) * n if touching else 0.0 * n
    sigma = me["sigma"] + 0.002 * (0.5 * kp * along - wind_up)
    ports = ("me", "ref", "press", "est", "body", "allocated", "cmd")
    DirectForce.step(*(View(records[name]) for name in ports))
    np.testing.assert_allclose(b["cmd"]["f_B"], est["R_WB"].T @ f_W, atol=1e-9)
    np.testing.assert_allclose(me["sigma"], sigma, atol=1e-9)


@pytest.mark.parametrize(("w", "zeta", "wi", "tau"), [(8.0, 1.0, 0.5, 0.03), (5.0, 0.8, 1.0, 0.05)])
def test_the_delay_margin_brings_the_loop_to_its_limit(
    w: float, zeta: float, wi: float, tau: float
) -> None:
    """With the margin as dead time, spare phase 0, the open loop passes -1."""

    def loop(x: float, delay: float) -> complex:
        s = 1j * x
        top = w**2 + 2.0 * zeta * w * s + wi * w**2 / s
        return complex(top / (s**2 * (1.0 + tau * s)) * np.exp(-s * delay))

    cross = brentq(lambda x: abs(loop(x, 0.0)) - 1.0, 0.3 * w, 100.0 * w)
    margin = compute_delay_margin(AttitudeGains(w, zeta, wi), tau, 0.0)
    assert loop(cross, margin) == pytest.approx(-1.0, abs=5e-3)
    spare = compute_delay_margin(AttitudeGains(w, zeta, wi), tau, 0.4)
    assert margin - spare == pytest.approx(0.4 / cross, rel=5e-3)


@pytest.mark.parametrize(("robot", "mass"), [("othex", 1.0), ("tilthex-arm", 6.0)])
def test_the_integrals_hold_a_share_of_the_weight(robot: str, mass: float) -> None:
    """A lasting error adds four tenths of the weight W, or the torque of a tenth of W at 1 m."""
    d = skywright.load("waypoints", robot=robot, sets={"robot.platform.mass_kg": mass})
    weight = float(np.linalg.norm(skywright.build_law(d).step().f_B))
    for name in ("f_B", "t_B"):
        law = skywright.build_law(d)
        if name == "f_B":
            law.estimate.p_WB = law.reference.p_WB + [0.0, 0.1, 0.0]
        else:
            law.estimate.R_WB = Rotation.from_rotvec([0.1, 0.0, 0.0]).as_matrix()
        first = getattr(law.step(), name).copy()
        for _ in range(6000):
            last = law.step()
        held = np.linalg.norm(getattr(last, name) - first)
        assert held == pytest.approx({"f_B": 0.4, "t_B": 0.1}[name] * weight, rel=0.01)
