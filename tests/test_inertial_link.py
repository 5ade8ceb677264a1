"""The inertial unit's errors against their closed forms, and the control link."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.core.streams import build_stream
from skywright.core.types import MEASUREMENT
from skywright.description.loader import load_description
from skywright.description.world.spec import Link
from skywright.errors import InputError
from skywright.run.planning import plan_mission
from skywright.run.run import build_vehicle
from skywright.run.supervisor import Supervisor
from skywright.sim.inertial import IMU_BLOCK, build_inertial, draw_inertial, sense_inertial
from skywright.sim.link import (
    LINK,
    build_link,
    draw_link,
    receive_measurement,
    send_command,
    send_measurement,
)

H = 1e-3


def build(sets=(), seed=3):
    d = load_description("pipe-weld-scan", sets=sets)
    streams = {n: build_stream(seed, n) for n in ("gyro", "accelerometer", "vibration")}
    return d.robot, build_inertial(d.robot, 9.81, H, streams), streams


QUIET = [
    "robot.sensors.gyro_noise_rad_s_sqrthz=0", "robot.sensors.accel_noise_mps2_sqrthz=0",
    "robot.sensors.gyro_bias_rad_s=0", "robot.sensors.accel_bias_mps2=0",
    "robot.sensors.gyro_walk_rad_s2_sqrthz=0", "robot.sensors.accel_walk_mps3_sqrthz=0",
]  # fmt: skip


def sample(im, steps, qpos, qvel, speed):
    """Sample `steps` times; `qpos(k)`, `qvel(k)` give the state after step k."""
    gyro, accel = np.empty((steps, 3)), np.empty((steps, 3))
    for k in range(steps):
        im[0]["n"] = k % 2
        im[0]["index"] = k % IMU_BLOCK
        sense_inertial(im[0], qpos(k), qvel(k), speed)
        gyro[k], accel[k] = im[0]["gyro"][k % 2], im[0]["accel"][k % 2]
    return gyro, accel


def test_noise_and_walk_have_their_densities():
    robot, im, streams = build()
    s = robot.sensors
    errors, biases = [], []
    for _ in range(40):
        draw_inertial(im[0], robot, streams)
        errors.append(im[0]["error"] - np.repeat(im[0]["bias"], 10, axis=0))
        biases.append(im[0]["bias"].copy())
    white = np.std(np.concatenate(errors), axis=0) * np.sqrt(H)  # sigma = N / sqrt(h)
    np.testing.assert_allclose(white[:3], s.gyro_noise_rad_s_sqrthz, rtol=0.02)
    np.testing.assert_allclose(white[3:], s.accel_noise_mps2_sqrthz, rtol=0.02)
    steps = np.diff(np.concatenate(biases), axis=0) / np.sqrt(10 * H)  # across blocks too
    np.testing.assert_allclose(np.std(steps[:, :3], axis=0), s.gyro_walk_rad_s2_sqrthz, rtol=0.05)
    np.testing.assert_allclose(np.std(steps[:, 3:], axis=0), s.accel_walk_mps3_sqrthz, rtol=0.05)


def test_specific_force_at_rest_and_on_a_turntable():
    """At rest it reads g upwards; off the axis of a turn also the centripetal acceleration."""
    robot, im, streams = build([*QUIET, "robot.sensors.imu_x_m=0.1"])
    draw_inertial(im[0], robot, streams)
    rate, still = 3.0, np.zeros(12)
    zero = np.zeros(6)
    gyro, accel = sample(im, 4, lambda k: np.array([0, 0, 1, 1, 0, 0, 0.0]), lambda k: zero, still)
    np.testing.assert_allclose(accel[-1], [0, 0, 9.81], atol=1e-9)
    np.testing.assert_allclose(gyro[-1], 0.0, atol=1e-12)

    def qpos(k):
        a = rate * H * (k + 1)
        return np.array([0, 0, 1, np.cos(a / 2), 0, 0, np.sin(a / 2)])

    gyro, accel = sample(im, 50, qpos, lambda k: np.array([0, 0, 0, 0, 0, rate]), still)
    np.testing.assert_allclose(accel[-1], [-(rate**2) * 0.1, 0, 9.81], atol=2e-3)
    np.testing.assert_allclose(gyro[-1], [0, 0, rate], atol=1e-12)


def test_vibration_sits_at_the_rotor_speed_and_aliases():
    """One per turn in the plane, two along z, and what lies above half the rate folds back."""
    robot, im, streams = build(QUIET)
    draw_inertial(im[0], robot, streams)
    hertz = 170.0
    speed = np.zeros(12)
    speed[0] = 2 * np.pi * hertz
    upright = np.array([0, 0, 1, 1, 0, 0, 0.0])
    n = 1000
    _, accel = sample(im, n, lambda k: upright, lambda k: np.zeros(6), speed)
    spectrum = np.abs(np.fft.rfft(accel - accel.mean(axis=0), axis=0)) * 2 / n
    size = im[0]["accel_shake"][0] * speed[0] ** 2
    assert spectrum[170, 0] == pytest.approx(size, rel=0.01)
    assert spectrum[340, 2] == pytest.approx(0.5 * size, rel=0.01)
    assert spectrum[1000 - 4 * 170, 0] == pytest.approx(0.25 * size, rel=0.01)  # 680 Hz at 320
    # amplitude grows with thrust: with the square of the speed
    _, half = sample(im, n, lambda k: upright, lambda k: np.zeros(6), 0.5 * speed)
    assert np.std(half[:, 0]) == pytest.approx(0.25 * np.std(accel[:, 0]), rel=0.02)


def drive(link, ticks, dt=0.002):
    """Send stamped packets both ways; returns ages of measurement and command, samples come."""
    lk, meas = build_link(link), np.zeros(1, MEASUREMENT)
    draw_link(lk[0], np.random.default_rng(1))
    ages, applied, samples = [], [], 0
    for k in range(ticks):
        t = k * dt
        lk[0]["sent"]["t"], lk[0]["sent"]["imu_n"] = t, 2
        send_measurement(lk[0], t)
        receive_measurement(lk[0], t, meas[0])
        samples += int(meas[0]["imu_n"])
        send_command(lk[0], t, np.full(12, t), np.full(8, t))
        ages.append(t - meas[0]["t"])
        applied.append(t - lk[0]["speed"][0])
    return np.array(ages[50:]), np.array(applied[50:]), samples


def test_packets_are_late_by_the_delay():
    up, down, samples = drive(Link(delay_s=0.004), 500)
    np.testing.assert_allclose(up, 0.004, atol=1e-12)
    np.testing.assert_allclose(down, 0.004, atol=1e-12)
    assert samples == 2 * (500 - 2)


def test_jitter_keeps_the_order_and_loses_nothing():
    up, down, samples = drive(Link(delay_s=0.004, jitter_s=0.002), 900)
    for age in (up, down):
        assert np.std(age) > 5e-4 and age.min() >= 0.0 and age.max() < 0.02
        assert np.all(np.diff(age) < 0.002 + 1e-9)  # never an older packet after a newer one
    assert samples >= 2 * (900 - 10)


def test_losses_are_lost():
    _, _, samples = drive(Link(loss_fraction=0.3), 900)
    assert samples == pytest.approx(2 * 900 * 0.7, rel=0.06)


HARD = [
    "mission.task.passes=1", "mission.task.pass_length_m=0.03",
    "world.link.delay_s=0.004", "world.link.jitter_s=0.002", "world.link.loss_fraction=0.01",
    "world.mocap.rate_hz=30", "world.mocap.outlier_fraction=0.02",
]  # fmt: skip


def fly(sets):
    d = load_description("pipe-weld-scan", sets=[*HARD, *sets])
    blocks = []
    v = build_vehicle(d, blocks.append)
    flight = Supervisor(v, d.mission, plan_mission(d), d.robot.platform.gear_height_m).fly()
    v.flush()
    return np.concatenate(blocks), flight


def test_the_scan_holds_over_a_bad_link_in_both_ways_of_running():
    fast, flight = fly(["mission.mode=fast"])
    assert flight.completed
    slow, _ = fly(["mission.mode=interactive"])
    assert fast.tobytes() == slow.tobytes()
    flown = fast[fast["t"] > 5.0]
    assert np.linalg.norm(flown["est_p_WB"] - flown["p_WB"], axis=1).max() < 0.004


def test_the_link_draws_from_its_own_stream():
    """The loss of packets does not change what the sensors draw."""
    d = load_description("pipe-weld-scan")
    other = load_description("pipe-weld-scan", sets=["world.link.loss_fraction=0.5"])
    a, b = build_vehicle(d), build_vehicle(other)
    for v in (a, b):
        for _ in range(5):
            v.tick()
    np.testing.assert_array_equal(a.inertial[0]["error"], b.inertial[0]["error"])
    np.testing.assert_array_equal(a.plant[0]["noise_mocap"], b.plant[0]["noise_mocap"])
    assert LINK.itemsize < 2_000_000


@pytest.mark.parametrize("setting", ["delay_s=-0.001", "delay_s=1", "loss_fraction=1"])
def test_wrong_links_are_told(setting):
    with pytest.raises(InputError, match=r"world\.link"):
        load_description("pipe-weld-scan", sets=[f"world.link.{setting}"])
