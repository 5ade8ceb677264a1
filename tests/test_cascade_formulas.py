"""The formulas of the cascade and of the laws of backstepping, on cases with a known answer.

The flights of test_cascade.py and test_backstepping.py show that a robot holds its place; a term
that matters little there is seen here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numba import njit
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from skywright.core.record import View
from skywright.core.types import MAX_JOINTS
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.world.spec import Wind
from skywright.models.body_records import MAX_LINKS, Kinematics
from skywright.models.floating import compute_free_inertia
from skywright.models.link_motion import Motion
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import (
    build_body_model,
    compute_kinematics,
    fill_body,
    fill_kinematics,
    posture,
)
from skywright.vehicle.arms.ports import Floating, Hands, Wrench
from skywright.vehicle.bus import Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.follower import Press
from skywright.vehicle.laws import _cascade_gains, _standard_mode, backstepping, cascade
from skywright.vehicle.laws._cascade_gains import SwingModel
from skywright.vehicle.laws._cascade_gusts import build_across, build_along, build_masses
from skywright.vehicle.laws.backstepping_torque import (
    BacksteppingTorque,
    TorqueLoop,
    compute_sensitivity,
    press_with,
)
from skywright.vehicle.laws.model_inversion import invert_translation
from skywright.vehicle.loops import compute_delay

G = 9.81
TURN = Rotation.from_euler("ZYX", [0.8, 0.15, -0.1]).as_matrix()
YAW = Rotation.from_euler("Z", math.atan2(TURN[1, 0], TURN[0, 0])).as_matrix()


def make(record: Any, **fields: Any) -> View:
    view = View(np.zeros(1, record.dtype)[0])
    for name, value in fields.items():
        view[name] = value
    return view


# Cascade


def build_cascade() -> tuple[View, View, View, View, View, View]:
    me = make(
        cascade.Cascade.Me, dt=1e-3, k_position=[1.0, 1.2, 1.5], k_velocity=[3.0, 3.5, 4.0],
        k_attitude=[8.0, 9.0, 4.0], k_swing=0.7, speed_max=10.0, f_external_max=100.0,
    )  # fmt: skip
    est, floating = make(Estimate, R_WB=TURN), make(Floating, swing=-1)
    body = make(Body, mass=6.0, gravity=G, p_BT=[0.0, 0.0, -1.7])
    return me, make(Reference), est, body, floating, make(Wrench)


def test_position_and_velocity_act_along_the_platforms_level_axes() -> None:
    me, ref, est, body, floating, wrench = build_cascade()
    rng = np.random.default_rng(1)
    ref.p_WB, est.p_WB, ref.v_WB, est.v_WB, ref.a_WB = rng.normal(size=(5, 3))
    a = np.zeros(3)
    cascade.acceleration_for_motion(me, ref, est, body, floating, wrench, None, a)
    e, v = YAW.T @ (ref.p_WB - est.p_WB), YAW.T @ (ref.v_WB - est.v_WB)
    wanted = YAW @ (me.k_velocity * (me.k_position * e + v)) + ref.a_WB
    np.testing.assert_allclose(a, wanted, rtol=1e-9)
    me.speed_max = 0.1  # however far the place is
    cascade.acceleration_for_motion(me, ref, est, body, floating, wrench, None, a)
    way = me.k_position * e
    wanted = YAW @ (me.k_velocity * (0.1 * way / np.linalg.norm(way) + v)) + ref.a_WB
    np.testing.assert_allclose(a, wanted, rtol=1e-9)


@pytest.mark.parametrize("law", ["cascade", "model_inversion"])
def test_external_forces_are_cancelled_up_to_a_limit(law: str) -> None:
    me, _, est, body, floating, wrench = build_cascade()
    wrench.f_hands_W, wrench.f_rest_W, a = [3.0, -2.0, 1.0], [1.0, 4.0, -6.0], np.array([1, 2, 3.0])
    outside = np.array([4.0, 2.0, -5.0])
    for most, share in ((100.0, 1.0), (2.0, 2.0 / np.linalg.norm(outside))):
        me.f_external_max, f = most, a.copy()
        if law == "cascade":
            cascade.force_for_motion(me, body, wrench, f)
        else:
            invert_translation(me, est, body, floating, wrench, a, f)
        np.testing.assert_allclose(f, 6.0 * (a + [0, 0, G]) - share * outside, rtol=1e-9)


def build_swing(axis: list[float]) -> tuple[View, View, View, View, View, View]:
    """A link of 1.6 kg m below the platform, turning about `axis` of B."""
    me, ref, est, body, floating, wrench = build_cascade()
    ref.track_tip, floating.swing, floating.axis = 1.0, 0, axis
    floating.L_s = 1.6 * np.cross(axis, [0.0, 0.0, -1.0])
    body.J_BT[:, 0] = 1.7 * np.cross(axis, [0.0, 0.0, -1.0])
    est.R_WB = YAW
    return me, ref, est, body, floating, wrench


def settle(me: View, *records: Any, seconds: float = 10.0) -> np.ndarray:
    shift = np.zeros(3)
    for _ in range(round(seconds / me.dt)):
        cascade.shift_for_tip(me, *records, shift, np.zeros(3))
    return shift


@pytest.mark.parametrize("axis", [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
def test_the_platform_gives_way_so_that_the_tip_stays(axis: list[float]) -> None:
    me, ref, est, body, floating, wrench = build_swing(axis)
    me.dt = 0.01
    hands = make(Hands, p_BA=[0.0, 0.0, -0.2])
    wrench.s_slow = 0.8
    angle = 0.8 / (1.6 * G)  # at which the link's weight holds that torque
    tip = YAW @ (angle * 1.7 * np.cross(axis, [0.0, 0.0, -1.0]))
    shift = settle(me, ref, est, body, floating, wrench, hands)
    np.testing.assert_allclose(shift, -tip, atol=1e-6)

    # a level force leans the platform by f / (m g): the link's end along its axis, and the joint
    # alone across it, where the link hangs freely
    wrench.s_slow, wrench.f_rest_W = 0.0, YAW @ [0.6, 0.4, 0.0]
    lever = np.where(np.abs(axis) > 0.5, -1.7, -0.2)
    lean = YAW @ (lever * [0.6, 0.4, 0.0] / (6.0 * G))
    shift = settle(me, ref, est, body, floating, wrench, hands)
    np.testing.assert_allclose(shift, lean, atol=1e-6)


def test_the_shift_for_the_tip_has_two_equal_poles() -> None:
    me, ref, est, body, floating, wrench = build_swing([0.0, 1.0, 0.0])
    wrench.s_slow, me.dt = 0.8, 2e-4
    w = 2.0 * cascade.SHIFT_BANDWIDTH
    part = settle(me, ref, est, body, floating, wrench, None, seconds=1.0 / w)
    whole = 0.8 / (1.6 * G) * 1.7
    assert np.linalg.norm(part) / whole == pytest.approx(1.0 - 2.0 / math.e, rel=0.01)


@pytest.mark.parametrize("axis", [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
def test_the_platform_moves_with_a_link_that_swings_and_not_with_one_that_lags(
    axis: list[float],
) -> None:
    me, ref, est, body, floating, wrench = build_swing(axis)
    forward, left = YAW[:2, 0], YAW[:2, 1]
    end = np.cross(axis, [0.0, 0.0, -1.0])  # the way that the link's end goes as it turns

    def damp() -> np.ndarray:
        a = np.zeros(3)
        cascade.damp_swing(me, ref, est, body, floating, wrench, forward, left, a)
        return a

    est.w_WB_B, est.qd[0], ref.qd[0], wrench.balance_rate = [0.3, -0.2, 0.1], 0.5, 0.1, 0.05
    rate = 0.5 - 0.1 - 0.05 + np.dot(axis, [0.3, -0.2, 0.1])
    np.testing.assert_allclose(damp(), 0.7 * rate * end, atol=1e-9)
    # of a reference whose acceleration grows, the link lags by a / g: that is no swing
    jerk = np.array([1.2, -0.7, 0.0])
    ref.a_WB = me.dt * jerk
    est.w_WB_B, ref.qd, wrench.balance_rate = 0.0, 0.0, 0.0
    est.qd[0] = -(YAW.T @ jerk) @ end / G
    a = damp()
    lean = YAW.T @ jerk / [9.0, 8.0, 1.0]  # what the attitude loop is late by
    np.testing.assert_allclose(a[:2], lean[:2], rtol=1e-6)


def test_the_torque_leads_what_the_rotors_lag() -> None:
    """Its step answer is that of (1 + tau s) / (1 + lead s), but for yaw."""
    me, _, est, body, floating, wrench = build_cascade()
    me.lead, me.rotor_tau, est.R_WB, body.gravity = 0.01, 0.03, np.eye(3), 0.0
    floating.I_eff, acc = np.diag([0.2, 0.3, 0.5]), np.array([1.0, -2.0, 3.0])
    cmd = make(WrenchCommand)
    for k in range(31):
        cascade.torque_for_turn(me, est, body, floating, wrench, 1.0, cmd, acc)
        over = 2.0 * math.exp(-k * 0.1)
        wanted = np.array([0.2, -0.6, 1.5]) * [1.0 + over, 1.0 + over, 1.0]
        np.testing.assert_allclose(cmd.t_B, wanted, rtol=1e-6)


# Gains of the cascade


def test_the_swing_model_is_that_of_two_masses() -> None:
    m = SwingModel(6.0, 1.6, 1.5, G)
    inertia, weight = np.array([[6.0, -1.6], [-1.6, 1.5]]), np.diag([0.0, 1.6 * G])
    assert m.natural == pytest.approx(math.sqrt(eigh(weight, inertia)[0][1]))
    # a platform that stands, and a link at a small angle on its own: its joint is pulled
    angle_acc = -1.6 * G / 1.5
    assert m.pull == pytest.approx(-1.6 * angle_acc / 6.0)


def test_the_rate_loop_may_rise_until_the_margin_is_left() -> None:
    k_rate, lead, delay = 20.0, 0.004, 0.006
    k = k_rate * _cascade_gains.compute_free_factor(k_rate, lead, delay)
    w = np.geomspace(1.0, 1000.0, 200001)
    loop = k / (1j * w * (1.0 + 1j * w * lead)) * np.exp(-1j * w * delay)
    at = np.argmin(np.abs(np.abs(loop) - 1.0))
    margin = math.pi + np.unwrap(np.angle(loop))[at]
    assert margin == pytest.approx(_cascade_gains.FREE_MARGIN, abs=1e-3)


@pytest.mark.parametrize("name", ["bimanual", "bimanual-longreach"])
def test_the_integral_is_as_slow_as_configured_and_the_swing_is_damped(name: str) -> None:
    d = load_description("waypoints", robot=name)
    c = d.robot.control
    g = _cascade_gains.compute_cascade_gains(c, d.robot, d.world, build_body_model(d.robot)[0])
    asked = c.attitude_integral_rad_s / c.attitude_bandwidth_rad_s
    np.testing.assert_allclose(g.k_integral / g.k_attitude, asked)
    assert (g.k_swing > 0.0) == (d.robot.pendulum is not None)


# Backstepping


def build_backstepping() -> tuple[View, View, View, View, View, View]:
    me = make(
        backstepping.Backstepping.Me, dt=0.01, k_p=[1.0, 2.0, 0.5], f_integral_max=6.0,
        t_integral_max=0.3, k_R=[[3.0, 4.0, 0.6], [4.0, 5.0, 0.7], [2.0, 3.0, 0.4]],
    )  # fmt: skip
    est, ref = make(Estimate, R_WB=TURN), make(Reference, R_WB=TURN)
    body = make(Body, mass=3.0, gravity=G, R_BT=np.eye(3))
    return me, ref, make(Press), est, body, make(WrenchCommand)


def test_the_torque_is_eulers_about_the_centre_of_mass() -> None:
    me, ref, _, est, body, cmd = build_backstepping()
    I_C = np.array([[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.5]])
    c, w, wd = np.array([0.1, -0.2, 0.3]), np.array([0.5, -0.7, 0.9]), np.array([1.0, 2.0, -1.5])
    body.p_BC, body.I_B = c, I_C + 3.0 * (c @ c * np.eye(3) - np.outer(c, c))
    est.w_WB_B = ref.w_WB_B = w
    ref.wd_WB_B = wd
    f, t_C = np.array([2.0, -1.0, 28.0]), np.array([0.3, 0.2, -0.1])
    backstepping.command_torque(me, ref, est, body, cmd, f, t_C, False)
    wanted = I_C @ wd + np.cross(w, I_C @ w) + np.cross(c, f) - t_C
    np.testing.assert_allclose(cmd.t_B, wanted, rtol=1e-9)
    ref.w_WB_B = w + [0.1, -0.2, 0.3]  # the damping is k_1 + k_2
    backstepping.command_torque(me, ref, est, body, cmd, f, t_C, False)
    more = I_C @ (np.array([7.0, 9.0, 5.0]) * [0.1, -0.2, 0.3])
    np.testing.assert_allclose(cmd.t_B, wanted + more, rtol=1e-9)


def test_the_integrals_grow_at_their_rate_up_to_their_limit() -> None:
    """K_i = k_2 lambda of what is integrated, in 0.5 s and after 30 s."""
    me, ref, press, est, body, cmd = build_backstepping()
    body.I_B = np.diag([0.3, 0.4, 0.5])
    turn = np.array([0.02, -0.01, 0.03])
    ref.R_WB = TURN @ Rotation.from_rotvec(turn).as_matrix()
    ref.p_WB = [0.3, -0.2, 0.1]
    first_f = first_t = np.zeros(3)
    for k in range(351):
        backstepping.command_platform(me, ref, press, est, body, 0.0, cmd)
        f, t = TURN @ cmd.f_B, cmd.t_B.copy()
        if k == 0:
            first_f, first_t = f, t
        if k == 50:
            np.testing.assert_allclose(f - first_f, 0.5 * 3.0 * 2.0 * 0.5 * ref.p_WB, rtol=1e-6)
            rate = np.array([0.3, 0.4, 0.5]) * [4.0 * 0.6, 5.0 * 0.7, 3.0 * 0.4]
            np.testing.assert_allclose(t - first_t, 0.5 * rate * turn, rtol=2e-3)
            me.dt = 0.1
    assert np.linalg.norm(f - first_f) == pytest.approx(6.0, rel=0.02)
    np.testing.assert_allclose(t - first_t, 0.3 * np.sign(turn), rtol=1e-3)
    np.testing.assert_allclose(me.trim[1:], cmd.t_B, rtol=1e-3)  # what the standard mode begins at
    assert me.trim[0] == pytest.approx(cmd.f_B[2] - 3.0 * G, rel=1e-3)


def test_the_trim_follows_at_its_rate() -> None:
    me, _, _, _, body, cmd = build_backstepping()
    cmd.f_B, cmd.t_B = [0.0, 0.0, 3.0 * G + 2.0], [0.1, -0.2, 0.3]
    for _ in range(100):  # one second
        _standard_mode.follow_trim(me, body, cmd)
    gone = 1.0 - math.exp(-_standard_mode.TRIM)
    np.testing.assert_allclose(me.trim, gone * np.array([2.0, 0.1, -0.2, 0.3]), rtol=0.01)


def test_the_standard_mode_is_a_cascade_of_angle_and_rate() -> None:
    me, ref, _, est, body, cmd = build_backstepping()
    me.k_angle, me.k_rate, me.inertia = [3.0, 4.0, 2.0], [6.0, 8.0, 5.0], [0.3, 0.4, 0.5]
    me.k_climb, me.k_lift, me.mix = 1.5, 2.5, np.eye(6)[:, 2:]
    turn, w, wanted_w = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.2, -0.3]), np.ones(3) * 0.05
    ref.R_WB, est.w_WB_B = TURN @ Rotation.from_rotvec(turn).as_matrix(), w
    ref.w_WB_B, ref.p_WB, ref.v_WB = wanted_w, [5.0, 6.0, 0.4], [7.0, 8.0, 0.2]
    est.p_WB, est.v_WB, ref.a_WB = [1.0, 2.0, 0.1], [1.0, 1.0, -0.1], [0.0, 0.0, 0.3]
    _standard_mode.stabilise(me, ref, est, body, 1.0, cmd)
    wanted = me.inertia * me.k_rate * (me.k_angle * turn + wanted_w - w)
    np.testing.assert_allclose(cmd.t_B, wanted, atol=1e-3)
    assert cmd.f_B[2] == pytest.approx(3.0 * (G + 0.3 + 2.5 * (1.5 * 0.3 + 0.3)))


def test_friction_opposes_the_sliding_with_its_share_of_the_force() -> None:
    me, ref, _, est, body, _ = build_backstepping()
    me.friction, est.f_tip = 0.4, 5.0
    body.R_BT = Rotation.from_rotvec([0.3, 0.2, -0.1]).as_matrix()
    way = body.R_BT @ [0.6, -0.8, 0.0]
    ref.v_WB = TURN @ (way + 0.5 * body.R_BT[:, 2])  # the part along the probe does not slide
    f = np.zeros(3)
    backstepping.add_friction(me, ref, est, body, f)
    np.testing.assert_allclose(f, -0.4 * 5.0 * way, rtol=1e-2, atol=1e-3)


def test_the_platform_follows_the_arm_and_goes_back() -> None:
    """It follows while the arm presses in flight; then the shift falls with FOLLOW."""
    me, ref, press, est, body, _ = build_backstepping()
    shift, axis = np.zeros(3), TURN @ body.R_BT[:, 2]
    body.p_BT = [0.0, 0.0, 0.02]  # 2 cm ahead of the reference, at the origin
    press.press = 1.0
    for _ in range(100):
        backstepping.follow_arm(me, ref, press, est, body, shift)
    np.testing.assert_allclose(shift, backstepping.FOLLOW * 0.02 * axis, rtol=1e-6)
    press.docked = 1.0
    for _ in range(200):
        backstepping.follow_arm(me, ref, press, est, body, shift)
    np.testing.assert_allclose(
        shift, backstepping.FOLLOW * 0.02 * axis * math.exp(-2.0 * backstepping.FOLLOW), rtol=0.01
    )


def build_arm(f_tip: float, force: float) -> tuple[View, View, View, View, View, View]:
    """Two joints that move the tip along x and z of T, which are those of B."""
    me, ref, press, est, body, cmd = build_backstepping()
    me.k_force, me.k_arm, me.spring, me.knee, me.soft = 3.0, 3.0, 600.0, 10.0, 200.0
    me.q_min[:2], me.q_max[:2], me.motor_speed_max[:2] = -1.0, 1.0, 10.0
    body.n_joints, body.J_BT[0, 0], body.J_BT[2, 1] = 2, 1.0, 1.0
    press.press, press.force, est.f_tip, press.docked = 1.0, force, f_tip, 1.0
    return me, ref, press, est, body, cmd


@pytest.mark.parametrize(
    ("f_tip", "force", "offset", "tip"),
    [
        (4.0, 6.0, 0.0, (0.0, 0.01)),  # 3 / s of 2 N over the spring
        (6.0, 4.0, 0.0, (0.0, -0.01)),
        (12.0, 11.0, 0.0, (0.0, -0.015)),  # beyond the knee it is softer
        (4.0, 16.0, 0.0, (0.0, backstepping.TIP_SPEED)),
        (4.0, 6.0, 0.005, (0.0, 0.01)),  # friction holds it aside
        (0.0, 2.0, 0.005, (0.015, 0.01)),
        (0.0, 2.0, -0.1, (-backstepping.TIP_SPEED, 0.01)),
    ],
)
def test_the_tip_moves_as_the_force_and_the_place_ask(
    f_tip: float, force: float, offset: float, tip: tuple[float, float]
) -> None:
    me, ref, press, est, body, cmd = build_arm(f_tip, force)
    ref.p_WT = TURN @ [offset, 0.0, 0.0]
    backstepping.command_arm(me, ref, press, est, body, cmd)
    np.testing.assert_allclose(cmd.qd[:2], tip, rtol=1e-2, atol=1e-6)
    press.docked, est.v_WB = 0.0, TURN @ [0.0, 0.0, 0.004]  # in flight the platform's way is less
    backstepping.command_arm(me, ref, press, est, body, cmd)
    np.testing.assert_allclose(cmd.qd[:2], np.subtract(tip, [0.0, 0.004]), rtol=1e-2, atol=1e-6)


def test_the_sensitivity_of_torques_is_that_of_the_loop_in_time() -> None:
    """Without dead time: |S| of the rational loop, by its frequency response in state space."""
    loop = TorqueLoop(20.0, 125.0, 1e-9, 0.8, 1200.0)
    k_f, w = 0.5, np.geomspace(0.3, 3000.0, 4000)
    s = 1j * w
    # torque of the tip: damped by the filtered speed, pushed by the force of the spring
    answer = (loop.mass * 40.0 * s / (1.0 + s / 125.0) + k_f * 1200.0) / (0.8 * s**2 + 1200.0)
    worst = float(np.max(1.0 / np.abs(1.0 + answer)))
    assert compute_sensitivity(loop, k_f) == pytest.approx(worst, rel=1e-3)
    # a loop at the edge of its delay margin is unstable beyond it
    margins = [compute_sensitivity(loop._replace(delay=d), k_f) for d in (0.002, 0.01, 0.1)]
    assert margins == sorted(margins) and margins[-1] == math.inf


def test_a_loop_of_torques_is_unstable_beyond_its_delay_margin() -> None:
    loop, w = TorqueLoop(20.0, 125.0, 0.0, 0.8, 1200.0), np.geomspace(1.0, 1000.0, 100001)
    s = 1j * w
    answer = (loop.mass * 40.0 * s / (1.0 + s / 125.0) + loop.mass * 400.0) / (0.8 * s**2)
    at = np.argmin(np.abs(np.abs(answer) - 1.0))
    margin = (math.pi + np.unwrap(np.angle(answer))[at] % (2.0 * math.pi) - 2.0 * math.pi) / w[at]
    for share, stable in ((0.97, True), (1.03, False)):
        late = loop._replace(delay=share * margin)
        assert math.isfinite(compute_sensitivity(late, in_air=True)) == stable


@njit
def press_tip(
    me: Any, ref: Any, press: Any, est: Any, body: Any, model: Any, kin: Any, qdd: Any
) -> float:
    scratch = Motion(np.zeros((MAX_LINKS, 3)), np.zeros((MAX_LINKS, 3)), np.zeros((MAX_LINKS, 3)))
    fill_kinematics(model, est.q, kin)
    fill_body(model, kin, body)
    return float(press_with(me, ref, press, est, body, model, kin, scratch, qdd))


@pytest.mark.parametrize("case", ["drifts", "docked", "reaches"])
def test_a_tip_of_torques_makes_up_for_the_platform_and_stops_where_nothing_is(case: str) -> None:
    robot = load_robot("f550-bridge-torque")[0]
    model, q = build_body_model(robot)[0], posture(robot, "working")
    kin, body, est, me = make(Kinematics), make(Body), make(Estimate), make(BacksteppingTorque.Me)
    est.q[: len(q)], est.R_WB, est.f_tip = q, TURN, 4.0
    at = compute_kinematics(build_body_model(robot), q)
    me.damp, me.stiff, me.k_f, axis = 40.0, 400.0, 0.5, at["R_BT"][:, 2]
    press, ref = make(Press, press=1.0, force=4.0), make(Reference, R_WB=TURN)
    ref.p_WT = TURN @ at["p_BT"]
    if case == "reaches":  # 1 cm more than the tip may be ahead
        ref.p_WT -= TURN @ axis * (backstepping.REACH + 0.01)
    else:
        est.v_WB, press.docked = TURN @ axis * 0.02, float(case == "docked")
    qdd, records = np.zeros(MAX_JOINTS), [v._row for v in (me, ref, press, est, body)]
    force = press_tip(*records, model, kin._row, qdd)
    along = axis @ body.J_BT[:, : len(q)] @ qdd[: len(q)]
    wanted = {"drifts": -40.0 * 0.02, "docked": 0.0, "reaches": -400.0 * 0.01}[case]
    assert along == pytest.approx(wanted, rel=0.02, abs=1e-6)
    assert force == pytest.approx(0.0 if case == "reaches" else 4.0)


def test_the_motion_of_a_long_reach_keeps_its_sensitivity_and_settles() -> None:
    d = load_description("waypoints", robot="bimanual-longreach")
    c, model = d.robot.control, build_body_model(d.robot)
    g = _cascade_gains.compute_cascade_gains(c, d.robot, d.world, model[0])
    body, floating = _cascade_gains.compute_bodies(d.robot, model[0])
    free = compute_free_inertia(d.robot, d.world, posture(d.robot, "working"))
    along_mass, across_mass = build_masses(d.robot, body, floating, free)
    delay = compute_delay(c, d.world)
    along = build_along(along_mass, _cascade_gains.build_loops(g, delay, 0, 0))
    across = build_across(across_mass, _cascade_gains.build_loops(g, delay, 1, 0))
    for system in (along, across):
        assert system.is_stable() and system.compute_sensitivity() <= c.motion_sensitivity + 1e-9
    settling = along.compute_settling(_cascade_gains.SETTLED)
    assert settling <= _cascade_gains.SETTLING
    predicted = _cascade_gains.build_gust_model(c, g, Nominal(d.robot, d.world), 0.0)
    assert predicted is not None
    motion = predicted(Wind(kind="dryden", mean_mps=2.0))
    assert motion.settle(_cascade_gains.SETTLED) == pytest.approx(settling)


def test_a_link_that_swings_to_the_side_has_the_gains_of_one_that_swings_forward() -> None:
    """About the other axis. The inertias about both axes differ by a few percent."""
    gains = []
    for axis in ("y", "x"):
        d = load_description(
            "waypoints", robot="bimanual-longreach", sets=[f"robot.pendulum.axis={axis}"]
        )
        model = build_body_model(d.robot)
        g = _cascade_gains.compute_cascade_gains(d.robot.control, d.robot, d.world, model[0])
        gains.append(np.array([g.k_position, g.k_velocity, g.k_attitude, g.k_rate, g.wrench]))
    np.testing.assert_allclose(gains[1][:, [1, 0, 2]], gains[0], rtol=0.06)
