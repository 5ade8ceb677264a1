"""Components of the plant: sensors, actuators, effects, the link and the recorder."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from plant_parts import Plant, build_context, build_part, build_plant, view
from skywright.core.record import View
from skywright.core.rotations import quat_to_rot
from skywright.core.streams import build_stream
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.vehicle.assembly import NEAR
from skywright.vehicle.bus import Clock, MuJoCo, RotorDrive, Truth
from skywright.vehicle.given_forces import GivenForces
from skywright.vehicle.link import BATCH, FRESH, LATEST, get_rule
from skywright.vehicle.plant import AirForce, JointTruth, RotorGain, RotorState, Surface
from skywright.vehicle.readings import Fix, ImuBatch, MocapSample, Shafts
from skywright.vehicle.recorder import SAMPLES, Recorder
from skywright.vehicle.sensors.gnss import SatelliteReceiver
from skywright.vehicle.sensors.inertial import Inertial
from skywright.vehicle.sensors.mocap import MotionCapture

HARD = [
    "world.link.delay_s=0.006", "world.link.jitter_s=0.003", "world.link.loss_fraction=0.05",
    "world.wind.kind=dryden", "world.wind.mean_mps=4", "world.mocap.outlier_fraction=0.05",
    "world.pipe.friction_variation=0.3",
]  # fmt: skip
QUIET = [
    "robot.sensors.gyro_noise_rad_s_sqrthz=0", "robot.sensors.accel_noise_mps2_sqrthz=0",
    "robot.sensors.gyro_bias_rad_s=0", "robot.sensors.accel_bias_mps2=0",
    "robot.sensors.gyro_walk_rad_s2_sqrthz=0", "robot.sensors.accel_walk_mps3_sqrthz=0",
]  # fmt: skip


@pytest.fixture(scope="module")
def hard() -> Plant:
    plant = build_plant(build_context(sets=HARD))
    plant.drives.rotors.speed[:6] = 420.0
    plant.drives.servos.motor[:2] = [0.4, -0.5]
    return plant


def snapshot(plant: Plant) -> list[bytes]:
    rows = plant.assembly.components
    recorder = next(c for c in rows if isinstance(c, Recorder))
    return [
        plant.sim.data.qpos.tobytes(),
        plant.assembly.arena.tobytes(),
        recorder.take().tobytes(),
    ]


def test_saved_and_in_both_ways_of_running_the_plant_repeats_itself(hard):
    hard.run(30)
    parts = hard.assembly.components
    saved = hard.assembly.save(), hard.sim.save(), [c.save() for c in parts]
    snapshot(hard)
    ends = []
    for interactive in (False, True):
        hard.sim.restore(saved[1])
        for c, kept in zip(parts, saved[2], strict=True):
            c.restore(kept)
        hard.assembly.restore(saved[0])
        hard.run(60, interactive)
        ends.append(snapshot(hard))
    assert ends[0] == ends[1]
    assert len(ends[0][2]) > 0


def test_rotors_follow_their_exact_lag():
    context = build_context()
    plant = build_plant(context)
    plant.drives.rotors.speed[:6] = 400.0
    plant.run(25)
    w = 400.0 * (1.0 - math.exp(-25 * context.dt / context.rotors.time_constant))
    state = plant.read(RotorState)
    np.testing.assert_allclose(state.speed[:6], w, rtol=1e-12)
    gain = plant.read(RotorGain).gain[:6]  # it stands on the ground
    np.testing.assert_allclose(plant.sim.ctrl[:6], context.rotors.k_f * w**2 * gain, rtol=1e-12)
    assert np.all(state.thrust[6:] == 0.0)


def test_drag_is_as_by_hand_and_forces_add():
    sets = ["world.wind.kind=steady", "world.wind.mean_mps=5", "world.wind.toward_deg=90"]
    context = build_context(sets=sets)
    plant = build_plant(context)
    given = next(c for c in plant.assembly.components if isinstance(c, GivenForces))
    plant.run(1)
    expected = 0.5 * 1.2 * context.robot.platform.drag_area_y_m2 * 25.0
    np.testing.assert_allclose(plant.read(AirForce).f_W, [0.0, expected, 0.0], atol=1e-9)
    platform = context.scene.places.platform_body
    given.push(context.scene.model.body(platform).name, np.array([1.0, 0.0, 0.0]))
    for _ in range(3):  # not summed up from tick to tick
        plant.run(1)
        air = plant.read(AirForce).f_W
        np.testing.assert_allclose(plant.sim.xfrc[platform, :3] - air, [1, 0, 0], atol=1e-12)
    with pytest.raises(InputError, match="unknown body 'wing'"):
        given.push("wing", np.zeros(3))


def test_a_recorded_row_is_what_the_records_hold(hard):
    recorder = next(c for c in hard.assembly.components if isinstance(c, Recorder))
    recorder.take()
    every = round(0.01 / float(hard.read(Clock).dt))
    hard.run(1 + (-int(hard.read(Clock).tick)) % every)  # a sample is the last thing that ran
    rows = recorder.take()
    row, truth = rows[-1], hard.read(Truth)
    assert row["t"] == pytest.approx(float(hard.read(Clock).t) - float(hard.read(Clock).dt))
    np.testing.assert_array_equal(row["p_WB"], truth.p_WB)
    np.testing.assert_array_equal(row["q"], hard.read(JointTruth).q[:2])
    assert row["gap"] == hard.read(Surface).gap and row["ec"].shape == (2,)
    R = np.empty((3, 3))
    quat_to_rot(row["q_WT"], R)
    np.testing.assert_allclose(R, truth.R_WT, atol=1e-12)
    assert row["rotor_thrust"].shape == (6,)
    hard.run(every * (SAMPLES - 20))
    assert not recorder.is_full
    hard.run(every * 10)
    assert recorder.is_full and len(recorder.take()) > SAMPLES - 16


@pytest.mark.parametrize(
    ("sets", "delay"),
    [(["world.link.delay_s=0.004"], 0.004), (["world.link.loss_fraction=0.3"], 0.0)],
)
def test_the_link_delays_or_loses_what_sensors_fill_and_drives_tell(sets, delay):
    plant = build_plant(build_context(sets=sets))
    ages, samples, told = [], 0, []
    for k in range(400):
        plant.drives.rotors.speed[0] = float(k)
        t = float(plant.read(Clock).t)
        plant.run(1)
        ages.append(t - float(plant.read(ImuBatch).t))
        samples += int(plant.read(ImuBatch).n)
        told.append(k - float(plant.read(RotorDrive).speed[0]))
    dt, n_steps = float(plant.read(Clock).dt), plant.ticker.n_steps
    if delay:
        np.testing.assert_allclose(ages[50:], delay, atol=1e-12)
        np.testing.assert_allclose(np.array(told[50:]) * dt, delay, atol=1e-9)
        assert samples == n_steps * (400 - 1 - round(delay / dt))
    else:
        assert samples == pytest.approx(0.7 * n_steps * 400, rel=0.1)
        assert np.mean(np.array(ages) > 0) == pytest.approx(0.3, abs=0.07)


def test_a_perfect_link_carries_every_reading():
    plant = build_plant(build_context(sets=["world.link.loss_fraction=1e-9"]))
    records = plant.assembly.records
    carried = [(record, name) for record, name in records if name.endswith(NEAR)]
    assert {r for r, _ in carried} >= {ImuBatch, Shafts, MocapSample, RotorDrive}
    for k in range(20):
        plant.drives.rotors.speed[0] = float(k)
        plant.run(1)
        for record, name in carried:
            near, far = records[record, name][0], records[record, ""][0]
            fields = record.dtype.names if get_rule(record) != BATCH else ("t", "n")
            if get_rule(record) != FRESH or near["fresh"]:
                assert all(np.array_equal(near[f], far[f]) for f in fields), record


def test_how_a_record_is_merged_follows_from_its_fields():
    assert [get_rule(r) for r in (Shafts, MocapSample, ImuBatch)] == [LATEST, FRESH, BATCH]


def test_errors_of_the_inertial_unit_have_their_densities():
    context = build_context()
    s, h, n = context.robot.sensors, context.h, 2000
    unit = Inertial("inertial", s)
    me = build_part(unit, context)
    rng, blocks, ends = build_stream(3, "gyro"), [], []
    for _ in range(40):
        blocks.append(unit.draw(Inertial.GyroError, rng, n))
        ends.append(np.array(me.gyro_walk.bias))
    steps = np.concatenate([b.reshape(-1, 10, 3).mean(axis=1) for b in blocks])
    white = np.concatenate([b - np.repeat(b.reshape(-1, 10, 3).mean(1), 10, 0) for b in blocks])
    std = np.std(white, axis=0) * math.sqrt(h * 10 / 9)
    np.testing.assert_allclose(std, s.gyro_noise_rad_s_sqrthz, rtol=0.02)
    walk = np.std(np.diff(ends, axis=0), axis=0) / math.sqrt(n * h)
    np.testing.assert_allclose(walk, s.gyro_walk_rad_s2_sqrthz, rtol=0.35)
    assert np.all(np.isfinite(steps))


def sample(me: Any, steps: int, qpos: Any, qvel: Any, speed: float = 0.0) -> Any:
    """Take samples of an inertial unit; `qpos(k)`, `qvel(k)` give the state after step k."""
    state = np.zeros(13)
    mj = view(MuJoCo, qpos=state.ctypes.data, nq=7, qvel=state[7:].ctypes.data, nv=6)
    rotors, zero = view(RotorState, n=1), view(Inertial.GyroError)
    rotors.speed[0] = speed
    gyro, accel = np.empty((steps, 3)), np.empty((steps, 3))
    for k in range(steps):
        me.n = k % 2
        state[:7], state[7:] = qpos(k), qvel(k)
        Inertial.sample(me, mj, rotors, zero, view(Inertial.AccelError))
        gyro[k], accel[k] = me.gyro[k % 2], me.accel[k % 2]
    return gyro, accel


UPRIGHT = np.array([0, 0, 1, 1, 0, 0, 0.0])


def test_specific_force_at_rest_and_on_a_turntable():
    context = build_context(sets=[*QUIET, "robot.sensors.imu_x_m=0.1"])
    me = build_part(Inertial("inertial", context.robot.sensors), context)
    gyro, accel = sample(me, 4, lambda k: UPRIGHT, lambda k: np.zeros(6))
    np.testing.assert_allclose(accel[-1], [0, 0, 9.81], atol=1e-9)
    np.testing.assert_allclose(gyro[-1], 0.0, atol=1e-12)
    rate = 3.0

    def turned(k: int) -> Any:
        a = rate * context.h * (k + 1)
        return np.array([0, 0, 1, math.cos(a / 2), 0, 0, math.sin(a / 2)])

    gyro, accel = sample(me, 50, turned, lambda k: np.array([0, 0, 0, 0, 0, rate]))
    np.testing.assert_allclose(accel[-1], [-(rate**2) * 0.1, 0, 9.81], atol=2e-3)
    np.testing.assert_allclose(gyro[-1], [0, 0, rate], atol=1e-12)


def test_vibration_sits_at_the_rotor_speed_and_aliases():
    context = build_context(sets=QUIET)
    me = build_part(Inertial("inertial", context.robot.sensors), context)
    me.n_rotors = 1
    n, speed = 1000, 2 * math.pi * 170.0
    _, accel = sample(me, n, lambda k: UPRIGHT, lambda k: np.zeros(6), speed)
    spectrum = np.abs(np.fft.rfft(accel - accel.mean(axis=0), axis=0)) * 2 / n
    reach = me.accel_shake[0] * speed**2
    assert spectrum[170, 0] == pytest.approx(reach, rel=0.01)
    assert spectrum[340, 2] == pytest.approx(0.5 * reach, rel=0.01)
    assert spectrum[1000 - 4 * 170, 0] == pytest.approx(0.25 * reach, rel=0.01)  # 680 Hz at 320


def test_motion_capture_has_rate_latency_and_noise():
    context = build_context(sets=["world.mocap.rate_hz=50", "world.mocap.latency_s=0.012"])
    mocap = MotionCapture("mocap", context.world.mocap)
    me, truth, clock = build_part(mocap, context), view(Truth), view(Clock, dt=context.dt)
    truth.R_WB[:], truth.R_WT[:] = np.eye(3), np.eye(3)
    rng = np.random.default_rng(1)
    seen = []
    for k in range(2000):
        clock.t = k * context.dt
        truth.p_WB[0] = clock.t
        out = view(MocapSample)
        draws = [
            View(mocap.draw(d, rng, 1).view(d.dtype).reshape(-1)[0])
            for d in (MotionCapture.Noise, MotionCapture.Chance, MotionCapture.Artefact)
        ]
        MotionCapture.step(me, clock, truth, *draws, out)
        if out.fresh:
            seen.append((clock.t - out.t, out.t - out.p_WB[0], out.period))
    ages, errors, periods = np.array(seen).T
    np.testing.assert_allclose(ages, 0.012, atol=1e-9)
    assert np.std(errors) == pytest.approx(context.world.mocap.position_noise_m, rel=0.4)
    assert np.median(periods) == pytest.approx(0.02)
    assert len(seen) == pytest.approx(0.99 * 200, abs=6)


def test_errors_of_satellite_fixes_are_white_and_slow():
    d = load_description("pipe-weld-scan", sets=["world.localisation=gnss"])
    context = build_context(sets=["world.localisation=gnss"])
    receiver = SatelliteReceiver("gnss", d.world.gnss)
    me, truth, clock = build_part(receiver, context), view(Truth), view(Clock)
    truth.R_WB[:] = np.eye(3)
    n, e = 4000, d.world.gnss.errors
    noise = receiver.draw(SatelliteReceiver.Noise, build_stream(5, "gnss"), n)
    assert np.any(me.error != 0.0)
    found = []
    for k in range(n):
        clock.t = k / d.world.gnss.rate_hz
        out = view(Fix)
        draw = View(noise[k : k + 1].view(SatelliteReceiver.Noise.dtype).reshape(-1)[0])
        SatelliteReceiver.step(
            me, clock, truth, draw, view(SatelliteReceiver.Chance, drop=1.0), out
        )
        if out.fresh:
            found.append(np.array(out.p))
    error = np.array(found) - me.p_BG
    fast = np.std(np.diff(error, axis=0), axis=0) / math.sqrt(2.0)
    np.testing.assert_allclose(fast[:2], e.noise_level_m, rtol=0.1)
    whole = math.hypot(e.noise_level_m, e.drift_level_m)
    assert np.std(error[:, 0]) < 1.6 * whole
