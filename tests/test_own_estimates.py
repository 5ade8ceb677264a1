"""An estimator of the Python API on a user's own arrays: noise, units, missing inputs."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import skywright
from skywright.errors import InputError
from skywright.vehicle.own_data import check_samples


def simulate_imu(h, seconds=6.0, rest=0.0):
    """A body that rests, then swings along x and turns about z: exact samples and poses."""
    t = h * np.arange(1, round(seconds / h) + 1)
    s, m = np.maximum(t - rest, 0.0), t - 0.5 * h - rest  # a sample is a mean over its period
    on, o = m > 0.0, 0.0 * t
    yaw, p = 0.4 * np.sin(s), np.stack([0.5 * (1 - np.cos(2 * s)), o, o + 1], axis=1)
    a_W = np.stack([on * 2.0 * np.cos(2 * m), o, o + 9.81], axis=1)
    R = Rotation.from_euler("z", (on * 0.4 * np.sin(m))[:, None]).as_matrix()
    gyro = np.stack([o, o, on * 0.4 * np.cos(m)], axis=1)
    return t, gyro, np.einsum("nji,nj->ni", R, a_W), p, yaw


@pytest.mark.parametrize("h", [0.001, 0.004])
def test_an_estimator_follows_ones_own_arrays(h):
    t, gyro, accel, p, yaw = simulate_imu(h)
    at = slice(9, None, round(0.02 / h))
    R = Rotation.from_euler("z", yaw[at][:, None]).as_matrix()
    found = skywright.run_estimator(
        "waypoints", t=t + 1e6, gyro=gyro, accel=accel, t_fix=t[at] + 1e6, p_fix=p[at], R_fix=R
    )
    late = found["t"] > 1e6 + 3.0
    assert found["ready"][late].all() and not found["ready"][0]
    for name in ("p_WB", "v_WB", "R_WB", "w_WB_B", "p_std"):
        known = np.isfinite(found[name]).reshape(len(found), -1)
        assert np.array_equal(known.all(axis=1), found["ready"]), name
        assert np.array_equal(known.any(axis=1), found["ready"]), name
    true = np.stack([np.interp(found["t"] - 1e6, t, x) for x in p.T], axis=1)
    assert np.abs(found["p_WB"] - true)[late].max() < 0.005
    assert np.abs(found["v_WB"][:, 0] - np.sin(2 * (found["t"] - 1e6)))[late].max() < 0.05
    assert np.abs(found["w_WB_B"][:, 2] - 0.4 * np.cos(found["t"] - 1e6))[late].max() < 0.02


def test_attitudes_may_be_quaternions() -> None:
    """w first; scalar-last ones of other programs would be another rotation."""
    turn = Rotation.from_rotvec([[0.1, -0.2, 0.3], [0.0, 0.0, 2.0]])
    fixes = ([0.0, 1.0], np.zeros((2, 3)), np.zeros((2, 3)), [0.0, 1.0], np.zeros((2, 3)))
    found = check_samples(*fixes, turn.as_quat(scalar_first=True), None)
    assert np.allclose(found[5], turn.as_matrix(), atol=1e-12) and found[6] is None


def test_an_estimator_takes_fixes_of_the_antenna_with_a_heading():
    d = skywright.load("waypoints", sets={"world.localisation": "gnss"})
    t, gyro, accel, p, yaw = simulate_imu(0.002, 12.0, 3.0)
    s = d.robot.sensors
    lever = Rotation.from_euler("z", yaw[:, None]).apply(
        [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
    )
    found = skywright.run_estimator(
        d, t=t, gyro=gyro, accel=accel, t_fix=t[::50], p_fix=(p + lever)[::50], heading=yaw[::50]
    )
    assert found["ready"][-1] and np.abs(found["p_WB"][-2500:] - p[-2500:]).max() < 0.1


def test_fixes_may_come_faster_than_control_ticks():
    """The newest fix of a tick counts; those before it do not pile up."""
    d = skywright.load("waypoints", sets={"world.localisation": "gnss"})
    tick = skywright.build_vehicle(d).dt
    t, gyro, accel, p, yaw = simulate_imu(tick / 4.0, 12.0, 3.0)
    s = d.robot.sensors
    antenna = Rotation.from_euler("z", yaw[:, None]).apply(
        [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
    )
    found = skywright.run_estimator(
        d, t=t, gyro=gyro, accel=accel, t_fix=t, p_fix=p + antenna, heading=yaw
    )
    assert len(found) == len(t) // 4
    last = p[3::4][: len(found)]
    assert found["ready"][-1] and np.abs(found["p_WB"] - last)[len(found) // 2 :].max() < 0.1


def rest(noise, rate=20, seconds=10.0, **change):
    """Arrays of a level robot at rest at (0, 0, 1) m, with position noise (m) of the fixes."""
    rng, h = np.random.default_rng(1), 0.001
    t = h * np.arange(1, round(seconds / h) + 1)
    at = t[9 :: round(1.0 / rate / h)]
    turns = rng.normal(0.0, 0.002, (len(at), 3))
    case = {
        "description": "waypoints", "t": t, "gyro": rng.normal(0.0, 0.01, (len(t), 3)),
        "accel": rng.normal(0.0, 0.1, (len(t), 3)) + [0.0, 0.0, 9.81], "t_fix": at,
        "p_fix": rng.normal(0.0, noise, (len(at), 3)) + [0.0, 0.0, 1.0],
        "R_fix": Rotation.from_rotvec(turns).as_matrix(),
    }  # fmt: skip
    return {**case, **change}


def test_fixes_that_are_noisier_than_stated_are_learned_and_told():
    """2 mm instead of 0.3 mm: the error becomes that of the right key, and is stated."""
    with pytest.warns(UserWarning, match=r"position_noise_m = 0.0003 \(found: 0.002") as told:
        found = skywright.run_estimator(**rest(0.002))
    assert len(told) == 1
    assert re.search(r"attitude_noise_rad = 0.002 \(found: 0.00(1[89]|2)", str(told[0].message))
    sets = {"world.mocap.position_noise_m": 0.002}
    right = skywright.run_estimator(
        **rest(0.002, description=skywright.load("waypoints", sets=sets))
    )
    late = found["t"] > 2.0
    rms = [
        np.sqrt(np.mean(np.sum((x["p_WB"][late] - [0.0, 0.0, 1.0]) ** 2, axis=1)))
        for x in (found, right)
    ]
    assert rms[1] < 0.002 and rms[0] < 1.25 * rms[1]
    stated = np.sqrt(np.mean(np.sum(found["p_std"][late] ** 2, axis=1)))
    assert stated == pytest.approx(rms[0], rel=0.3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("noise", "rate"), [(0.0002, 20), (0.0006, 100)])
def test_fixes_as_stated_are_accepted_without_a_warning(noise, rate):
    found = skywright.run_estimator(**rest(noise, rate, 4.0))
    error = found["p_WB"][found["ready"]] - [0.0, 0.0, 1.0]
    assert np.sqrt(np.mean(error**2)) < noise


REST = rest(0.0003, seconds=2.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": 1e3 * REST["t"], "t_fix": 1e3 * REST["t_fix"]}, "^t: 1 samples per second; .*in s"),
        ({"t": 1e-3 * REST["t"], "t_fix": 1e-3 * REST["t_fix"]}, "^t: 1e.06 samples per second"),
        ({"t_fix": 1e3 * REST["t_fix"] - 9.0}, "^t_fix: 50 s from fix to fix"),
        ({"gyro": REST["gyro"] + 40.0}, "^gyro: 69.* rad/s rms; valid: at most 35"),
        ({"accel": REST["accel"] / 9.81}, r"^accel: magnitude 0.999. m/s\^2; valid: 2.94 to"),
        ({"accel": 1e3 * REST["accel"]}, "^accel: magnitude 98"),
        ({"accel": -REST["accel"]}, r"^accel, R_fix: .* in W is \(.*-9.81\)"),
        ({"R_fix": REST["R_fix"] @ np.diag([1.0, -1.0, -1.0])}, "^accel, R_fix: .*up"),
        ({"p_fix": 1e5 * REST["t_fix"][:, None] * [1.0, 0.0, 0.0]}, "^p_fix: .* m from its median"),
        ({"p_fix": 150.0 * REST["t_fix"][:, None] * [1.0, 0.0, 0.0]}, "^p_fix: moves at 150 m/s"),
        ({"p_fix": 1e3 * (REST["p_fix"] - [0.0, 0.0, 1.0])}, "^p_fix: 40 fixes did not start"),
    ],
)  # fmt: skip
def test_implausible_arrays_are_refused_with_their_unit(change, words):
    with pytest.raises(InputError, match=words):
        skywright.run_estimator(**{**REST, **change})


def test_a_turned_gyroscope_is_told():
    t, gyro, accel, p, yaw = simulate_imu(0.002)
    R = Rotation.from_euler("z", yaw[::5][:, None]).as_matrix()
    with pytest.warns(UserWarning, match="compare axes, clocks and units"):
        skywright.run_estimator(
            "waypoints", t=t, gyro=-gyro, accel=accel, t_fix=t[::5], p_fix=p[::5], R_fix=R
        )


def test_the_observer_uses_the_period_of_the_fixes():
    """Its gains depend on it: with the control period (2 ms) the error is five times as large."""
    description = skywright.load("waypoints", sets={"mission.estimator": "observer"})
    t, t_fix, w = 0.001 * np.arange(6000), 0.01 * np.arange(600), 2.0 * np.pi * 0.5  # 0.5 Hz
    accel = np.zeros((len(t), 3)) + [0.0, 0.0, 9.81]
    accel[:, 0] = -0.5 * w**2 * np.sin(w * t)
    p = np.stack([0.5 * np.sin(w * t_fix), 0.0 * t_fix, 0.0 * t_fix + 1.0], axis=1)
    found = skywright.run_estimator(
        description, t=t, gyro=np.zeros((len(t), 3)), accel=accel, t_fix=t_fix, p_fix=p,
        R_fix=np.tile(np.eye(3), (len(t_fix), 1, 1)),
    )  # fmt: skip
    late = found[found["t"] > 2.0]
    error = late["p_WB"][:, 0] - 0.5 * np.sin(w * late["t"])
    assert np.sqrt(np.mean(error**2)) < 0.015


GNSS = skywright.load("waypoints", sets={"world.localisation": "gnss"})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gyro": np.zeros((99, 3))}, r"gyro: has the shape \(99, 3\); valid: \(100, 3\)"),
        ({"accel": np.full((100, 3), np.nan)}, "accel: row 0 is not finite"),
        ({"t": np.linspace(0, 1, 100) ** 3}, "t: .*evenly spaced"),
        ({"t_fix": [0.2, 0.1]}, "t_fix: .*ascending"),
        ({"t": np.zeros(100)}, "t: .*ascending"),
        ({"t": -0.001 * np.arange(100)}, "t: .*ascending"),
        ({"t": 1e9 + 0.001 * np.arange(100)}, "t_fix: 0.01 to 0.02 s; .*same clock"),
        ({"t": [0.0, 0.001], "gyro": np.zeros((2, 3)), "accel": np.zeros((2, 3))},
         "t_fix: .*within the times t"),
        ({"t_fix": [], "p_fix": np.zeros((0, 3)), "R_fix": np.zeros((0, 3, 3))},
         "t_fix: no fixes"),
        ({"R_fix": np.zeros((2, 3, 3))}, "R_fix: row 0 is not a rotation"),
        ({"R_fix": np.stack([np.eye(3), 2.0 * np.eye(3)])}, "R_fix: row 1 is not a rotation"),
        ({"R_fix": np.stack([np.eye(3), -np.eye(3)])}, "R_fix: row 1 is not a rotation"),
        ({"R_fix": None}, "R_fix: missing"),
        ({"R_fix": [[1.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]]}, "R_fix: row 1 is not a rotation"),
        ({"R_fix": [[1.0, 0.0], [0.0]]}, r"R_fix: .* \(\); valid: \(2, 3, 3\) or \(2, 4\)"),
        ({"t": [0.2, 0.1]}, "t: steps from -0.1 to -0.1 s; valid: ascending"),
        ({"t_fix": [0.1, 0.1]}, "t_fix: steps from 0 to 0 s; valid: ascending"),
        ({"heading": [0.0, 0.0]}, "heading: not read; .*give R_fix only"),
        ({"description": GNSS, "R_fix": None}, "heading: missing"),
        ({"description": GNSS, "heading": [0.0, 0.0]}, "R_fix: not read; .*give heading only"),
        ({"description": skywright.load("waypoints", sets={"mission.estimator": "truth"})},
         "reads no inertial samples"),
        ({"description": skywright.load("bridge-contact", sets={
            "world.localisation": "total-station"})}, "no input for odometry of a tracking camera"),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused(change, words):
    case = {
        "description": "waypoints", "t": 0.001 * np.arange(100), "gyro": np.zeros((100, 3)),
        "accel": np.zeros((100, 3)), "t_fix": [0.01, 0.02], "p_fix": np.zeros((2, 3)),
        "R_fix": np.tile(np.eye(3), (2, 1, 1)),
    }  # fmt: skip
    with pytest.raises(InputError, match=words):
        skywright.run_estimator(**{**case, **change})
