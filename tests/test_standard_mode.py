"""Standard stabilisation of Sanchez-Cuevas 2020: a linear cascade with coplanar logic."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest

from skywright.core.record import View
from skywright.core.rotations import exp_so3
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.missions.flight_modes.metrics import compute_coupling, compute_tilt
from skywright.models.rotors import build_rotors
from skywright.run.backends import build_vehicle
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.laws._standard_mode import compute_coplanar_mix, follow_trim, stabilise
from skywright.vehicle.laws.backstepping import Backstepping


@functools.cache
def build_law() -> tuple[Any, Any]:
    d = load_description("flight-modes")
    return build_vehicle(d).assembly.get(Backstepping.Me, "law").copy(), d.robot.control


def compute_command(
    turn: tuple[float, ...] = (0, 0, 0), rate: tuple[float, ...] = (0, 0, 0), up: float = 0.0,
    climb: float = 0.0, saturated: float = 0.0,
) -> tuple[np.ndarray, Any]:  # fmt: skip
    """Return the wrench (6,) for errors of the estimate, and what the law remembers after it."""
    me = build_law()[0].copy()
    me["trim"] = 0.0
    ref, est, body, cmd = (
        np.zeros(1, r.dtype)[0] for r in (Reference, Estimate, Body, WrenchCommand)
    )
    R = np.empty((3, 3))
    exp_so3(np.array(turn, dtype=float), R)
    ref["R_WB"], est["R_WB"], est["w_WB_B"] = np.eye(3), R, rate
    est["p_WB"][2], est["v_WB"][2], body["mass"], body["gravity"] = up, climb, 2.5, 9.81
    stabilise(*(View(x) for x in (me, ref, est, body)), saturated, View(cmd))
    return np.concatenate([cmd["f_B"], cmd["t_B"]]), me


def test_gains_are_those_of_a_critically_damped_pair() -> None:
    """About each axis t = -J (w^2 e + 2 zeta w e'), and so of the height."""
    me, control = build_law()
    hover, _ = compute_command()
    np.testing.assert_allclose(hover[2:], [2.5 * 9.81, 0.0, 0.0, 0.0], atol=1e-9)
    step = 1e-5
    for i in range(3):
        unit = tuple(step * np.eye(3)[i])
        stiff = (compute_command(turn=unit)[0] - hover)[2:] / step
        damp = (compute_command(rate=unit)[0] - hover)[2:] / step
        poles = np.roots([me["inertia"][i], -damp[i + 1], -stiff[i + 1]])
        w = control.attitude_bandwidth_rad_s
        if i < 2:  # yaw is slower: the rotors' reaction
            np.testing.assert_allclose(np.abs(poles), w, rtol=1e-3)
        np.testing.assert_allclose(
            -damp[i + 1] / np.sqrt(-stiff[i + 1] * me["inertia"][i]), 2.0, rtol=2e-3
        )
        others = [k for k in range(4) if k != i + 1]
        np.testing.assert_allclose([*stiff[others], *damp[others]], 0.0, atol=1e-6)
    w = control.position_bandwidth_rad_s
    lift = (compute_command(up=step)[0] - hover)[2] / step
    drag = (compute_command(climb=step)[0] - hover)[2] / step
    np.testing.assert_allclose([lift, drag], [-2.5 * w * w, -2.5 * 2 * w], rtol=2e-3)


def test_the_controller_is_linear() -> None:
    a, b = {"rate": (0.3, -0.1, 0.2), "up": 0.4}, {"rate": (-0.1, 0.5, 0.1), "climb": -0.7}
    both = {"rate": (0.2, 0.4, 0.3), "up": 0.4, "climb": -0.7}
    rest = compute_command()[0]
    of_a, of_b, of_both = (compute_command(**x)[0] - rest for x in (a, b, both))  # type: ignore[arg-type]
    np.testing.assert_allclose(of_a + of_b, of_both, atol=1e-9)


def test_the_mixer_makes_thrust_and_torques_and_lets_the_rest_go() -> None:
    B = build_rotors(load_robot("f550-bridge")[0].rotors).B
    mix = compute_coplanar_mix(B)
    np.testing.assert_allclose(mix[2:], np.eye(4), atol=1e-12)
    assert np.abs(mix[:2]).max() < 1e-9  # by symmetry: a robot with level rotors, as the paper says
    weaker = B * np.array([0.9, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert np.abs(compute_coplanar_mix(weaker)[:2]).max() > 0.01  # then it takes what there is
    thrust = np.linalg.pinv(B[2:]) @ [20.0, 0.1, 0.0, 0.0]
    more = np.linalg.svd(B[2:])[2][4:]  # thrusts that make none of the four
    np.testing.assert_allclose(more @ thrust, 0.0, atol=1e-9)


def test_the_mixer_of_level_rotors_would_diverge_in_yaw() -> None:
    """The tilt turns the robot against the propellers' drag, and six times as hard."""
    robot, _ = load_robot("f550-bridge")
    B = build_rotors(robot.rotors).B
    level = robot.rotors.model_copy(update={"alpha_deg": [0.0] * 6, "beta_deg": [0.0] * 6})
    made = B[2:] @ np.linalg.pinv(build_rotors(level).B[2:])
    assert made[0, 0] > 0.8 and made[1, 1] > 0.5 and made[2, 2] > 0.5
    assert made[3, 3] == pytest.approx(0.88 * (1.0 - 6.2), rel=0.1)


def test_the_trim_integrates_unless_saturated_and_follows_other_modes() -> None:
    _, me = compute_command(turn=(0.1, 0.0, 0.0), up=0.1)
    assert me["trim"][0] < 0.0 and me["trim"][1] < 0.0 and me["trim"][2] == 0.0
    assert not np.any(compute_command(turn=(0.1, 0.0, 0.0), up=0.1, saturated=1.0)[1]["trim"])
    body, cmd = (np.zeros(1, r.dtype)[0] for r in (Body, WrenchCommand))
    body["mass"], body["gravity"] = 2.5, 9.81
    cmd["f_B"][2], cmd["t_B"] = 26.0, [0.1, -0.2, 0.3]
    for _ in range(5000):
        follow_trim(View(me), View(body), View(cmd))
    np.testing.assert_allclose(me["trim"], [26.0 - 2.5 * 9.81, 0.1, -0.2, 0.3], rtol=1e-3)


def test_coupling_is_one_of_a_coplanar_robot_and_none_of_one_that_stays() -> None:
    t = np.arange(0.0, 4.0, 0.01)
    dtype = [("t", float), ("p_WB", float, 3), ("q_WB", float, 4)]
    s, angle = np.zeros(len(t), dtype), 0.05 * np.sin(t)
    s["t"], s["q_WB"][:, 0], s["q_WB"][:, 2] = t, np.cos(angle / 2), np.sin(angle / 2)
    assert compute_coupling(s, 9.81) == 0.0
    s["p_WB"][:, 0] = -9.81 * 0.05 * np.sin(t)
    assert compute_coupling(s, 9.81) == pytest.approx(1.0, abs=0.01)


def test_the_mode_is_flown_without_a_jump_and_moves_where_it_tilts() -> None:
    result = fly_and_evaluate(load_description("flight-modes", seed=2))
    assert result.outcome == "succeeded", result.reason
    m, s = result.metrics, result.samples
    assert 0.8 < m["modes.standard_coupling"] < 1.2
    assert abs(m["modes.angle_coupling"]) < 0.05
    assert 0.1 < m["modes.standard_drift_m"] < 2.0
    names = [p.name for p in result.phases]
    mode = s[s["phase"] == names.index("standard stabilisation")]
    assert np.degrees(compute_tilt(mode)[:100].max()) < 1.0  # before it is told to tilt
    assert np.degrees(compute_tilt(mode).max()) == pytest.approx(2.0, abs=0.5)
    assert np.max(np.abs(mode["p_WB"][:, 2] - mode["ref_p_WB"][:, 2])) < 0.06
