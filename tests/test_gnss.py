"""Satellite navigation: what a fix is worth, how it is fused, and who may not rely on it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plant_parts import view
from skywright.core.record import View
from skywright.core.streams import build_stream
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.world.gnss import FIXES, Gnss
from skywright.errors import InputError
from skywright.run.backends import build_vehicle
from skywright.run.parts import build_estimator
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.estimators._position_fix import fuse_fix, start_from_fix
from skywright.vehicle.estimators.filter import Filter
from skywright.vehicle.readings import Fix
from skywright.vehicle.sensors.gnss import SatelliteReceiver

G = 9.81


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


@pytest.fixture
def records():
    rng = np.random.default_rng(4)
    f = np.zeros(1, Filter.Me.dtype)[0]
    f["h"], f["p_ba"], f["p_bg"] = 1e-3, 0.1**2, 0.005**2
    f["p_BI"], f["p_BF"] = [0.05, -0.02, 0.03], [0.1, 0.0, 0.2]
    f["r_fix"], f["r_heading"] = np.array([0.01, 0.02, 0.03]) ** 2, 0.02**2
    f["R_f"] = Rotation.from_euler("ZYX", [0.8, 0.05, -0.03]).as_matrix()
    a = rng.normal(size=(15, 15)) * np.repeat([1e-2, 1e-2, 1e-2, 1e-4, 1e-2], 3)[:, None]
    f["P"] = a @ a.T
    return f, np.zeros(1, Fix.dtype)[0]


def test_a_fix_is_fused_as_the_textbook_does(records):
    """All four parts at once, H by finite differences of what a fix measures."""
    f, fix = records

    def predict(dp, turn):
        R = Rotation.from_rotvec(turn).as_matrix() @ f["R_f"]
        p = f["p_f"] + dp + R @ (f["p_BF"] - f["p_BI"])
        return np.append(p, math.atan2(R[1, 0], R[0, 0]))

    step, H = 1e-6, np.zeros((4, 15))
    for i, e in enumerate(np.eye(3)):
        H[:, i] = (predict(step * e, 0 * e) - predict(-step * e, 0 * e)) / (2 * step)
        H[:, 6 + i] = (predict(0 * e, step * e) - predict(0 * e, -step * e)) / (2 * step)
    nu = np.array([0.008, -0.01, 0.02, 0.015])
    z = predict(np.zeros(3), np.zeros(3)) + nu
    fix["p"], fix["heading"] = z[:3], z[3] + 2 * math.pi  # a whole turn is no error
    H[3, 6:8] = 0.0  # a level heading: the tilt's share of 5 % of it is left out
    S = H @ f["P"] @ H.T + np.diag(np.append(f["r_fix"], f["r_heading"]))
    K = f["P"] @ H.T @ np.linalg.inv(S)
    P, p, R, dx = f["P"].copy(), f["p_f"].copy(), f["R_f"].copy(), K @ nu
    assert fuse_fix(View(f), View(fix))
    assert f["nis"] == pytest.approx(nu @ np.linalg.solve(S, nu), rel=1e-6)
    np.testing.assert_allclose(f["P"], P - K @ S @ K.T, atol=1e-9)
    np.testing.assert_allclose(f["p_f"], p + dx[:3], atol=1e-9)
    np.testing.assert_allclose(f["ba"], dx[12:], atol=1e-9)
    np.testing.assert_allclose(f["R_f"], Rotation.from_rotvec(dx[6:9]).as_matrix() @ R, atol=1e-9)


def test_the_gate_lets_a_jump_change_nothing(records):
    f, fix = records
    fix["p"] = f["p_f"] + [0.0, 3.0, 0.0]
    fix["heading"] = 0.8
    before = f.copy()
    assert not fuse_fix(View(f), View(fix))
    np.testing.assert_array_equal(f["P"], before["P"])
    np.testing.assert_array_equal(f["p_f"], before["p_f"])


def test_the_filter_starts_level_and_knows_why_it_is_not(records):
    """Held still with a biased accelerometer: the attitude's error lies within what P says."""
    f, fix = records
    true = Rotation.from_euler("ZYX", [0.8, 0.1, -0.06]).as_matrix()
    bias = np.array([0.08, -0.05, 0.0])
    f["accel"], f["n"] = true.T @ [0.0, 0.0, G] + bias, 400
    fix["p"], fix["heading"] = [3.0, 1.0, 2.0], 0.8
    start_from_fix(View(f), View(fix), 380, G, 0.3)
    R = f["R_f"]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(0.8, abs=1e-9)
    turn = Rotation.from_matrix(true @ R.T).as_rotvec()
    assert np.linalg.norm(turn[:2]) < np.linalg.norm(bias) / G * 1.05
    # told the bias, the filter would level itself: E[turn | bias] is the turn that there is
    expected = f["P"][6:8, 12:15] @ bias / f["p_ba"]
    np.testing.assert_allclose(turn[:2], expected, atol=3e-4)
    antenna = f["p_f"] + R @ (f["p_BF"] - f["p_BI"])
    np.testing.assert_allclose(antenna, [3.0, 1.0, 2.0], atol=1e-12)
    assert np.min(np.linalg.eigvalsh(f["P"])) > -1e-12


@pytest.mark.parametrize("fix", ["rtk", "plain"])
def test_fixes_are_as_late_frequent_and_wrong_as_stated(fix):
    robot, _ = load_robot("ars-lrm")
    d = load_description(
        "bar-transport", sets={"world.localisation": "gnss", "world.gnss.fix": fix}
    )
    e, dt = FIXES[fix], 0.1
    rng = np.random.default_rng(3)
    errors, steps = [], []
    for seed in range(60):  # many short flights: the slow error has minutes of memory
        receiver = SatelliteReceiver("gnss", d.world.gnss)
        me = View(np.zeros(1, SatelliteReceiver.Me.dtype)[0])
        receiver.build(me, d.world.gnss, SimpleNamespace(robot=robot))
        receiver.draw(SatelliteReceiver.Noise, build_stream(seed, "gnss"), 1)
        last, truth, sure = None, view(Truth), view(SatelliteReceiver.Chance, drop=1.0)
        truth.R_WB[:] = np.eye(3)
        for k in range(80):
            clock, fix_ = view(Clock, t=0.5 * dt * k), view(Fix)
            white, slow, heading = np.split(rng.standard_normal(7), [3, 6])
            noise = view(SatelliteReceiver.Noise, white=white, drift=slow, heading=heading[0])
            SatelliteReceiver.step(me, clock, truth, noise, sure, fix_)
            if fix_.fresh:
                assert clock.t - fix_.t == pytest.approx(0.15)  # first tick after 0.11
                err = fix_.p - [0.0, 0.0, robot.sensors.antenna_z_m]
                errors.append(err)
                if last is not None:
                    steps.append(err - last)
                last = err
    assert len(errors) == 60 * 39
    total = np.hypot([e.noise_level_m, e.noise_up_m], [e.drift_level_m, e.drift_up_m])
    found = np.std(errors, axis=0)
    np.testing.assert_allclose(found[[0, 2]], total, rtol=0.25)  # 60 independent draws
    # from fix to fix the white part shows, and little of the slow one
    white = 2 * np.array([e.noise_level_m, e.noise_up_m]) ** 2
    slow = 2 * (1 - math.exp(-dt / e.drift_time_s)) * np.array([e.drift_level_m, e.drift_up_m]) ** 2
    np.testing.assert_allclose(np.std(steps, axis=0)[[0, 2]], np.sqrt(white + slow), rtol=0.06)


def test_numbers_of_a_file_replace_those_of_the_kind():
    g = Gnss(fix="rtk", noise_level_m=0.03)
    assert g.errors.noise_level_m == 0.03
    assert g.errors.drift_up_m == FIXES["rtk"].drift_up_m


def test_the_transport_is_refused_where_fixes_are_wider_than_the_margin():
    sets = {"world.localisation": "gnss", "world.gnss.fix": "plain"}
    with pytest.raises(InputError, match=r"world.gnss.fix = 'plain': .*'rtk'"):
        plan_mission(load_description("bar-transport", sets=sets))


def test_robots_that_need_motion_capture_are_refused():
    sets = {"world.localisation": "gnss"}
    with pytest.raises(InputError, match="requires motion capture of its markers"):
        build_estimator(load_description("pipe-weld-scan", sets=sets))
    sets["mission.estimator"] = "observer"
    with pytest.raises(InputError, match="'observer' requires motion capture"):
        build_estimator(load_description("bar-transport", sets=sets))
    with pytest.raises(InputError, match="localisation"):
        load_description("bar-transport", sets={"world.localisation": "gps"})


def test_the_bar_is_carried_by_rtk():
    sets = {"world.localisation": "gnss", "mission.task.planner_slices": 100,
            "mission.timestep_ms": 2}  # fmt: skip
    result = fly_and_evaluate(load_description("bar-transport", sets=sets))
    assert result.outcome == "succeeded", result.reason
    # the estimate is as far from the truth as the fixes' slow errors are, not better
    rms = 1e-3 * result.metrics["estimate.position_rms_mm"]
    assert 0.002 < rms < 3.0 * result.description.world.gnss.position_error_m


@pytest.mark.parametrize("latency", [0.05, 0.11, 0.2])
def test_every_fix_is_fused_at_every_latency(latency):
    d = load_description(
        "waypoints", sets={"world.localisation": "gnss", "world.gnss.latency_s": latency}
    )
    v = build_vehicle(d)
    for _ in range(300):
        v.tick()
    me = v.get_memory(next(c.name for c in v.assembly.components if isinstance(c, Filter)))
    assert me.late == 0 and me.fused >= d.world.gnss.rate_hz * (6.0 - latency) - 4


@pytest.mark.parametrize(
    ("sensor", "jump", "rate", "seed"),
    [
        ("gyroscope", [0.2, 0.0, 0.0], 10, 1),
        ("gyroscope", [0.14, 0.1, -0.1], 10, 2),
        ("gyroscope", [0.2, -0.04, 0.0], 5, 7),
        ("gyroscope", [0.12, -0.16, 0.03], 3, 86),
        ("accelerometer", [2.0, 0.0, 0.0], 10, 1),
        ("accelerometer", [-0.11, -0.99, -0.11], 5, 58),
    ],
)
def test_a_bias_that_jumps_is_estimated_again_and_the_robot_lands(sensor, jump, rate, seed):
    """Five rejected fixes later: the fixes move with the robot, and agree nevertheless."""
    sets = [
        "world.localisation=gnss", f"world.gnss.rate_hz={rate}", "plant.faults.a.kind=sensor",
        f"plant.faults.a.sensor={sensor}", f"plant.faults.a.jump={jump}",
        "plant.faults.a.start_s=10",
    ]  # fmt: skip
    flown = fly_and_evaluate(load_description("waypoints", "hexarotor", seed=seed, sets=sets))
    s = flown.samples
    error = np.linalg.norm(s["est_p_WB"] - s["p_WB"], axis=1)
    assert flown.outcome == "aborted" and "control was lost" not in flown.reason
    assert error.max() < {3: 4.0, 5: 1.5, 10: 0.8}[rate] and error[-1] < 0.15
    assert flown.metrics["response.landed"] == 1.0
