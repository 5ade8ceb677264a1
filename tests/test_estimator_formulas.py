"""The formulas of the estimators by themselves, on motions with a known answer.

The flights of test_error_state.py, test_observer.py and test_station_camera.py show that a robot
knows where it is; a term that matters little there is seen here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation

from skywright.core.record import View
from skywright.vehicle.bus import Allocated, Body, Estimate
from skywright.vehicle.estimates import EstimatorState, RotorForce
from skywright.vehicle.estimators import _fusion, _strapdown, filter, observer, station_camera
from skywright.vehicle.estimators._deviation import fill_deviation
from skywright.vehicle.estimators._noise import EARLY, ROW, compute_scatter, is_leaving
from skywright.vehicle.readings import Fix, ImuBatch, MocapSample, Odometry
from skywright.vehicle.sensors.station import StationCamera as Station

G = 9.81
P_BI = np.array([0.05, -0.02, 0.03])


def make(record: Any, **fields: Any) -> View:
    view = View(np.zeros(1, record.dtype)[0])
    for name, value in fields.items():
        view[name] = value
    return view


def rotate(*turn: float) -> np.ndarray:
    return Rotation.from_rotvec(turn).as_matrix()


# The inertial unit


def test_turning_about_any_axis_is_integrated_as_in_closed_form() -> None:
    w, f, n = np.array([0.9, -0.7, 1.1]), np.array([1.0, -2.0, 9.0]), 200
    me = make(filter.Filter.Me, h=1e-3, bg=[0.01, -0.02, 0.03], ba=[0.1, -0.2, 0.3])
    me.gyro[:], me.accel[:] = w + me.bg, f + me.ba
    R0, p, v, dv, turn = rotate(0.3, -0.5, 0.2), np.zeros(3), np.zeros(3), np.zeros(3), np.eye(3)
    R, T = R0.copy(), 1e-3 * n
    _strapdown.integrate(me, 0, n, G, p, v, R, dv, turn)

    def turned(t: float) -> np.ndarray:
        return np.asarray(R0 @ rotate(*(t * w)))

    whole = quad_vec(turned, 0.0, T)[0]  # v = whole f - g t; p = integral of (T - t) a
    np.testing.assert_allclose(R, turned(T), atol=1e-9)
    np.testing.assert_allclose(dv, whole @ f, atol=1e-5)
    np.testing.assert_allclose(v, whole @ f - [0.0, 0.0, G * T], atol=1e-5)
    np.testing.assert_allclose(
        p, quad_vec(lambda t: (T - t) * (turned(t) @ f - [0.0, 0.0, G]), 0.0, T)[0], atol=1e-5
    )
    np.testing.assert_allclose(turn, whole, atol=2e-3 * T)


@pytest.mark.parametrize("early", [2e-4, -2e-4])
def test_lost_samples_are_held_and_widen_velocity_and_attitude(early: float) -> None:
    me = make(filter.Filter.Me, h=1e-3, ready=2.0, n=40, t=0.040)
    imu = make(ImuBatch, t=0.046 - early, n=2)  # six periods later with two samples
    imu.gyro[:2], imu.accel[:2] = [[1, 2, 3], [4, 5, 6]], [[7, 8, 9], [1, 1, 1]]
    _strapdown.receive_inertial(me, imu, make(Body, p_BT=[0.1, 0.2, 0.3]))
    assert me.n == 46 and me.t == imu.t
    np.testing.assert_array_equal(me.gyro[40:46], [[1, 2, 3]] * 5 + [[4, 5, 6]])
    np.testing.assert_array_equal(me.accel[40:46], [[7, 8, 9]] * 5 + [[1, 1, 1]])
    np.testing.assert_array_equal(me.p_BT[40:46], [[0.1, 0.2, 0.3]] * 6)
    variance = np.zeros(15)  # of 4 ms at an unknown acceleration and rate
    variance[3:6], variance[6:9] = (4e-3 * 1.0) ** 2, (4e-3 * 0.2) ** 2
    np.testing.assert_allclose(np.diag(me.P), variance)


def test_noise_grows_from_its_density() -> None:
    """From certainty, after one step: variances of random walks over 10 ms."""
    me = make(
        station_camera.StationCamera.Me, h=1e-3, q_v=1.0, q_R=2.0, q_bg=3.0, q_ba=4.0, q_yaw=5.0,
        q_tilt=6.0, q_scale=7.0, q_rate=8.0, q_walk_s=9.0, q_walk_m=10.0, v_f=[0.3, 0.4, 1.2],
        T=np.eye(3), R_f=np.eye(3), p_BI=P_BI,
    )  # fmt: skip
    me.accel[:] = [0.0, 0.0, G]
    _fusion.advance(me, 10, G)
    walk = [9.0 + 10.0 * 1.3] * 3  # 1.3 m/s of path
    density = [0.0] * 3 + [1.0] * 3 + [2.0] * 3 + [3.0] * 3 + [4.0] * 3 + walk
    density += [6.0, 6.0, 5.0, 7.0, 0.0, 0.0, 8.0]
    np.testing.assert_allclose(me.P_full, np.diag(0.01 * np.array(density)), atol=1e-12)


def test_a_late_estimate_is_carried_on_with_its_acceleration_and_rate() -> None:
    late, w, R = 0.05, np.array([0.6, -0.4, 0.9]), rotate(0.2, 0.1, -0.4)
    me = make(filter.Filter.Me, t=2.0, R=R, p=[1, 2, 3], v=[0.5, -0.3, 0.2], p_BI=P_BI)
    me.a_W, me.bg = [1.0, -2.0, 3.0], [0.02, 0.01, -0.03]
    imu, est = make(ImuBatch, n=2), make(Estimate)
    imu.gyro[:2] = [w + me.bg + 0.1, w + me.bg - 0.1]
    _strapdown.fill_estimate(me, imu, 2.0 + late, est)
    now = R @ rotate(*(late * w))
    np.testing.assert_allclose(est.w_WB_B, w, atol=1e-12)
    np.testing.assert_allclose(est.R_WB, now, atol=1e-9)
    v = me.v + late * me.a_W
    np.testing.assert_allclose(est.v_WB, v - now @ np.cross(w, P_BI), atol=1e-9)
    p = me.p + late * me.v + late**2 / 2 * me.a_W
    np.testing.assert_allclose(est.p_WB, p - now @ P_BI, atol=1e-9)


def test_the_external_force_is_what_rotors_do_not_explain() -> None:
    """Both lags are of first order: 63 % after one time constant."""
    R = rotate(0.2, -0.1, 0.3)
    me = make(filter.Filter.Me, dt=1e-3, bandwidth=10.0, rotor_tau=0.05, R=R)
    body, est, rotor = make(Body, mass=2.0, gravity=G), make(Estimate), make(RotorForce)
    made, force = np.array([0.5, -0.4, 20.0]), np.array([1.0, -2.0, 0.5])
    allocated, dv = make(Allocated, f_B_alloc=made), 4e-3 * (R @ made + force) / 2.0
    for k in range(50):
        _strapdown.estimate_force(me, body, allocated, est, rotor, dv, 4e-3)
        if k == 49:
            np.testing.assert_allclose(rotor.f_B, (1 - 1 / math.e) * made, rtol=1e-9)
    rotor.f_B, est.f_ext_W = made, 0.0
    for _ in range(100):
        _strapdown.estimate_force(me, body, allocated, est, rotor, dv, 4e-3)
    np.testing.assert_allclose(est.f_ext_W, (1 - 1 / math.e) * force, rtol=1e-9)
    np.testing.assert_allclose(me.a_W, dv / 4e-3 - [0.0, 0.0, G], atol=1e-12)


def test_the_stated_deviation_is_that_of_the_covariance_brought_to_now() -> None:
    rng = np.random.default_rng(7)
    me = make(filter.Filter.Me, h=1e-3, n=300, n_f=100, R_f=rotate(0.3, -0.2, 0.5), q_v=1e-4)
    me.p_f, me.v_f = [1.0, 2.0, 3.0], [0.3, -0.2, 0.1]
    me.accel[:] = me.R_f.T @ [2.0, -3.0, 4.0 + G]
    a = rng.normal(size=(15, 15)) * np.repeat([1e-3, 5e-3, 5e-3, 0.0, 0.05], 3)[:, None]
    me.P = a @ a.T
    me.p, me.v, me.R = me.p_f, me.v_f, me.R_f
    _strapdown.integrate(me, 100, 300, G, me.p, me.v, me.R, np.zeros(3), np.zeros((3, 3)))
    P, state = np.zeros((15, 15)), make(EstimatorState)
    _strapdown.head_covariance(me, G, P)
    fill_deviation(me, me.P, G, state)
    exact = np.sqrt(np.diag(P)[:3])
    np.testing.assert_allclose(state.p_std, exact, rtol=1e-3)
    assert state.pose_std == max(state.p_std)
    me.p_slow = [0.1, 0.2, 0.3]
    fill_deviation(me, me.P, G, state)
    np.testing.assert_allclose(state.p_std, np.hypot(exact, me.p_slow), rtol=1e-3)


# Motion capture


def test_samples_agree_where_both_place_and_attitude_do() -> None:
    me = make(filter.Filter.Me)
    seen = [
        ([5.0, 1.0, 2.0], rotate(0.0, 0.0, 1.0), False),  # nothing to agree with yet
        ([5.05, 1.0, 2.05], rotate(0.0, 0.0, 1.1), True),
        ([5.05, 1.3, 2.05], rotate(0.0, 0.0, 1.1), False),
        ([5.05, 1.3, 2.05], rotate(0.0, 0.3, 1.1), False),
        ([5.05, 1.3, 2.05], rotate(0.0, 0.3, 1.1), True),
    ]
    for p, R, agrees in seen:
        sample = make(MocapSample, p_WB=p, R_WB=R)
        assert filter.agrees_with_last(me, sample) == agrees, p


def test_ten_fixes_that_agree_with_each_other_move_a_filter_that_does_not() -> None:
    me = make(filter.Filter.Me, h=1e-3, n=300, n_f=300, ready=2.0, r_fix=[1e-4] * 3, R_f=np.eye(3))
    me.P, me.fused, there = 1e-4 * np.eye(15), 5, np.array([5.0, 1.0, 2.0])
    fix = make(Fix, t=0.3)
    for k in range(12):
        fix.p = there + 0.01 * (-1.0) ** k
        assert filter.use_fix(me, fix, 0.3, G)
        moved = k + 1 >= filter.RESTART_AFTER
        assert (me.restarts == 1) == moved, k
        assert (np.linalg.norm(me.p_f - there) < 0.05) == moved


def test_scatter_is_the_noise_and_not_the_error_of_the_estimate() -> None:
    me, rng, k = make(filter.Filter.Me), np.random.default_rng(3), np.arange(10.0)
    me.rejected, me.when = 17, np.roll(0.05 * k, 7)  # the oldest is at 7
    drift = np.stack([0.3 + 0.2 * k, 1.0 - 0.1 * k**2, 0.05 * k**2], axis=1)
    me.row[:, :3] = np.roll(drift, 7, axis=0)
    assert compute_scatter(me, 0, 3, ROW) == pytest.approx(0.0, abs=1e-24)
    found = []
    for _ in range(2000):
        me.row[:, :3] = np.roll(drift + rng.normal(0.0, 0.02, (10, 3)), 7, axis=0)
        found.append(compute_scatter(me, 0, 3, ROW))
    assert np.mean(found) == pytest.approx(0.02**2, rel=0.03)
    me.when = np.roll(0.05 * k + 0.05 * (k > 4), 7)  # one was lost: an error of speed would count
    assert compute_scatter(me, 0, 3, ROW) == np.inf


def test_an_estimate_that_leaves_its_fixes_is_told_from_a_jump_and_from_noise() -> None:
    rng, k = np.random.default_rng(4), np.arange(float(EARLY))
    shares = []
    for grows in (0.5 * 9.81 * (0.4 + 0.1 * k) ** 2 * 0.1, np.full(EARLY, 5.0), np.zeros(EARLY)):
        for sigma in (0.005, 0.1):
            found = []
            for _ in range(500):
                me = make(filter.Filter.Me, rejected=ROW + EARLY)
                me.when = 0.1 * np.arange(ROW)
                for i in range(EARLY):
                    me.row[i, :3] = [grows[i], 0.0, 0.0] + rng.normal(0.0, sigma, 3)
                found.append(is_leaving(me))
            shares.append(float(np.mean(found)))
    # tilted by 0.1 rad: at once with RTK, not yet with a plain receiver
    assert shares[0] > 0.99 and shares[1] < 0.1
    assert max(shares[2:]) < 0.01


def test_fixes_that_are_noisier_than_stated_are_weighed_less() -> None:
    """Ten times the noise: it is learned, and the position is not reset."""
    me = make(filter.Filter.Me, h=1e-3, n=300, n_f=300, ready=2.0, r_fix=[4e-6] * 3, R_f=np.eye(3))
    me.r_heading = 4e-6
    me.P, me.p_f = 1e-8 * np.eye(15), [0.0, 0.0, 2.0]
    me.more_fix = me.more_heading = 1.0
    rng, fix = np.random.default_rng(2), make(Fix, t=0.3)
    for _ in range(60):
        fix.p, fix.heading = [0.0, 0.0, 2.0] + rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.02)
        assert filter.use_fix(me, fix, 0.3, G)
    assert me.restarts == 0 and me.rejected < 25
    assert np.sqrt(me.r_fix) == pytest.approx([0.02] * 3, rel=0.5)
    assert 0.005 < np.sqrt(me.r_heading) < 0.06
    assert np.linalg.norm(me.p_f - [0.0, 0.0, 2.0]) < 0.02
    rejected = me.rejected
    for _ in range(6000):  # the noise is that of the data sheet again
        fix.p, fix.heading = [0.0, 0.0, 2.0] + rng.normal(0.0, 0.002, 3), rng.normal(0.0, 0.002)
        assert filter.use_fix(me, fix, 0.3, G)
    assert me.restarts == 0 and me.rejected < rejected + 20  # 6 by chance
    assert np.sqrt(me.r_fix) == pytest.approx([0.002] * 3, rel=0.1)
    assert np.sqrt(me.r_heading) == pytest.approx(0.002, rel=0.1)


@pytest.mark.parametrize("case", ["half a turn", "elsewhere", "far more", "not a number"])
def test_a_wrong_sensor_is_not_taken_for_a_noisy_one(case: str) -> None:
    """Ten fixes that contradict the estimate, with some noise: the filter starts again at them."""
    me = make(filter.Filter.Me, h=1e-3, n=300, n_f=300, ready=2.0, r_fix=[1e-6] * 3, R_f=np.eye(3))
    me.r_heading, me.more_fix, me.more_heading, me.p_bg, me.p_ba = 4e-6, 1.0, 1.0, 1e-6, 1e-3
    me.P, me.p_f = 1e-8 * np.eye(15), [0.0, 0.0, 2.0]
    rng, fix = np.random.default_rng(2), make(Fix, t=0.3)
    place, heading, sigma = {
        "half a turn": (0.0, math.pi, 0.002), "elsewhere": (0.3, 0.0, 0.004),
        "far more": (0.0, 0.0, 0.025), "not a number": (0.0, math.nan, 0.002),
    }[case]  # fmt: skip
    for _ in range(40):
        fix.p = [place, 0.0, 2.0] + rng.normal(0.0, sigma, 3)
        fix.heading = heading + rng.normal(0.0, 0.002)
        filter.use_fix(me, fix, 0.3, G)
        if me.restarts:
            break
    assert me.restarts == 1 and me.more_fix == me.more_heading == 1.0


def test_the_observer_follows_a_push_through_late_samples() -> None:
    """An acceleration is what an observer of third order follows without an error."""
    dt, late, mass, w = 2e-3, 0.03, 2.0, np.array([0.2, -0.1, 0.5])
    me = make(observer.Observer.Me, dt=dt, bandwidth=12.0, rotor_tau=0.03, gyro=w)
    force, v0 = np.array([0.6, -0.4, 0.2]), np.array([0.5, 0.3, -0.2])
    body, est, rotor = make(Body, mass=mass, gravity=G), make(Estimate), make(RotorForce)
    p_BT, slip = np.array([0.3, 0.0, -0.1]), np.array([0.01, -0.02, 0.005])  # of the tip
    body.R_BT, body.p_BT = np.eye(3), p_BT

    def see(t: float) -> View:
        R, p = rotate(*(t * w)), t * v0 + t**2 / 2 * force / mass
        p_WT = p + R @ (p_BT + slip)
        return make(MocapSample, t=t, period=0.01, p_WB=p, R_WB=R, p_WT=p_WT)

    observer.start(me, see(0.0), p_BT, est)
    for k in range(1, 701):
        t = k * dt
        weight = mass * np.array([0.0, 0.0, G])
        rotor.f_B = est.R_WB.T @ weight  # rotors carry the weight
        allocated = make(Allocated, f_B_alloc=rotor.f_B)
        observer.predict(me, body, allocated, est, rotor)
        i = me.head
        me.p[i], me.R[i], me.p_BT[i] = est.p_WB, est.R_WB, p_BT
        me.head = (i + 1) % observer.HISTORY
        if k % 5 == 0 and t > late:
            observer.correct(me, see(t - late), t, mass, est)
    now = see(1.4)
    np.testing.assert_allclose(est.f_ext_W, force, rtol=0.02)
    np.testing.assert_allclose(est.p_WB, now.p_WB, atol=3e-4)
    np.testing.assert_allclose(est.v_WB, v0 + 1.4 * force / mass, atol=3e-3)
    np.testing.assert_allclose(est.R_WB, now.R_WB, atol=1e-3)
    np.testing.assert_allclose(me.c_B, slip, atol=1e-3)


# Total station and camera


def build_station_filter() -> View:
    """It has run for 0.4 s; the camera's frame is turned, scaled and 0.2 m off."""
    me = make(
        station_camera.StationCamera.Me, h=1e-3, n=400, t=0.4, p_BI=P_BI, p_BP=[0.1, 0.0, -0.2],
        R_WC=rotate(0.1, -0.2, 0.7), scale=1.1, clock=0.5, r_fix=1e-6, r_odo=1e-6, r_odo_R=1e-6,
        std_0=[0.01, 0.02, 0.01, 2e-3], lag=0.25,
    )  # fmt: skip
    me.accel[:] = [0.0, 0.0, G]
    return me


def see_by_camera(me: View, t: float, p: np.ndarray, R: np.ndarray) -> View:
    inverse = me.R_WC.T
    return make(Odometry, t=t, p=inverse @ (p + [0.2, 0.0, 0.1]) / me.scale, R=inverse @ R)


def test_the_station_s_filter_starts_where_fix_and_camera_say() -> None:
    me, p, R = build_station_filter(), np.array([1.0, 2.0, 3.0]), np.eye(3)
    for t, x in ((0.05, 0.5), (0.1, 0.0), (0.15, 0.7)):  # the nearest in time counts
        station_camera.keep_odometry(me, see_by_camera(me, t, p + x, R))
    station_camera.keep_fix(me, make(Fix, t=0.5 + 0.102, p=p + R @ me.p_BP))
    station_camera.start(me)
    assert me.ready == 2.0 and me.n_f == 102 and me.last_fix == pytest.approx(0.102)
    np.testing.assert_allclose(me.p_f, p + R @ P_BI, atol=1e-9)
    np.testing.assert_allclose(me.R_f, R, atol=1e-9)
    np.testing.assert_allclose(me.drift, [0.2, 0.0, 0.1], atol=1e-9)
    # the attitude is the camera's: what it says of W is certain but for its noise
    parts = np.zeros((3, _fusion.N_FUSION))
    parts[:, _strapdown.R_ : _strapdown.R_ + 3] = parts[:, _fusion.T_ : _fusion.T_ + 3] = np.eye(3)
    np.testing.assert_allclose(parts @ me.P_full @ parts.T, me.r_odo_R * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(
        np.sqrt(np.diag(me.P_full)[_fusion.T_ : _fusion.T_ + 3]), [0.01, 0.01, 0.02]
    )


def test_what_waits_is_fused_in_order_once_it_is_old_enough() -> None:
    me, p, R = build_station_filter(), np.array([1.0, 2.0, 3.0]), np.eye(3)
    station_camera.keep_odometry(me, see_by_camera(me, 0.05, p, R))
    station_camera.keep_fix(me, make(Fix, t=0.55, p=p + R @ me.p_BP))
    station_camera.start(me)
    for t in (0.08, 0.11, 0.2):
        station_camera.keep_odometry(me, see_by_camera(me, t, p, R))
    for t in (0.02, 0.13, 0.18):  # the first came too late
        station_camera.keep_fix(me, make(Fix, t=0.5 + t, p=p + R @ me.p_BP))
    assert station_camera.use_pending(me, G)
    assert (me.n_f, me.late, me.fixes, me.jumps) == (130, 1, 1, 0)
    assert (me.fix_used, me.odo_used) == (3, 3)
    assert me.last_fix == pytest.approx(0.13)
    np.testing.assert_allclose(me.p_f, p + R @ P_BI, atol=1e-6)
    np.testing.assert_allclose(me.drift, [0.2, 0.0, 0.1], atol=1e-6)
    assert not station_camera.use_pending(me, G)


def test_the_station_s_filter_weighs_by_what_the_calibration_found() -> None:
    found = np.zeros(1, Station.Aligned.dtype)
    for name, value in {
        "scale": 1.1, "clock": 0.5, "rotation_std": 0.03, "scale_std": 0.02, "offset_std": 0.01,
        "station_noise": 2e-3, "per_sqrt_m": 4e-3, "per_sqrt_s": 3e-3,
    }.items():  # fmt: skip
        found[name] = value
    est = station_camera.StationCamera("estimator")
    est._me, est._records = make(est.Me), {(Station.Aligned, ""): found}
    est.before_tick(0.0, 0)
    me = est._me
    assert (me.scale, me.clock) == (1.1, 0.5)
    assert (me.r_fix, me.q_walk_m, me.q_walk_s) == pytest.approx((4e-6, 16e-6, 9e-6))
    since = [math.radians(0.2), math.radians(1.0), 0.005, 2e-3]  # what may change since
    np.testing.assert_allclose(me.std_0, np.hypot([0.03, 0.03, 0.02, 0.01], since))
