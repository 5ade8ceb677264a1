"""The slider's force sensor: two-slope calibration, converter, and what one servo count does."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from skywright.description.loader import load_description
from skywright.description.robot.force_sensor import ForceSensor
from skywright.description.robot.loader import load_robot
from skywright.models.arm_body import Deviation
from skywright.models.force_resolution import compute_force_resolution
from skywright.models.force_sensor import (
    build_force_sensor,
    compute_count,
    compute_force,
    compute_spring_force,
    compute_travel,
    convert_travel,
    measure_travel,
)
from skywright.models.rigid_body import build_body_model, compute_tip, posture
from skywright.models.scene import build_scene

ROBOT = load_robot("f550-bridge")[0]
assert ROBOT.force_sensor is not None
SENSOR = build_force_sensor(ROBOT.force_sensor)[0]
FULL_N = 16.368  # at count 0
STEP_N = 8.8239e-3  # the coarser of the two slopes

forces = st.floats(0.0, FULL_N)


def convert_force(sensor, force: float, noise: float) -> float:
    return convert_travel(sensor, compute_travel(sensor, force), noise)


def measure_force(sensor, force: float, noise: float) -> float:
    return measure_travel(sensor, compute_travel(sensor, force), noise)


def test_table_3() -> None:
    """The printed lines, and where they meet: 7.80 and 7.81 N at count 2705."""
    assert compute_force(SENSOR, 0.0) == pytest.approx(16.368)
    assert compute_force(SENSOR, 2704.999) == pytest.approx(7.80, abs=0.005)
    assert compute_force(SENSOR, 2705.0) == pytest.approx(7.81, abs=0.005)
    assert abs(compute_force(SENSOR, 2704.999) - compute_force(SENSOR, 2705.0)) < STEP_N
    assert compute_count(SENSOR, 0.0) == pytest.approx(3590, abs=1)


@given(forces)
def test_inverse(force: float) -> None:
    """Force to count to force is the identity, but for the 1.6 mN step where the lines meet."""
    assert compute_force(SENSOR, compute_count(SENSOR, force)) == pytest.approx(force, abs=1.7e-3)


@given(st.integers(0, 4095))
def test_inverse_of_every_count(count: int) -> None:
    force = compute_force(SENSOR, float(count))
    if force > 0.0:
        assert compute_count(SENSOR, force) == pytest.approx(count, abs=0.51)


@given(forces, forces)
def test_monotone(a: float, b: float) -> None:
    """More force, never a higher count nor a lower reading."""
    a, b = sorted((a, b))
    assert compute_count(SENSOR, a) >= compute_count(SENSOR, b)
    assert measure_force(SENSOR, a, 0.0) <= measure_force(SENSOR, b, 0.0)


@given(st.floats(0.0, FULL_N))
def test_quantisation(force: float) -> None:
    """Without noise a reading is whole counts and off by at most half of one."""
    count = convert_force(SENSOR, force, 0.0)
    assert count == round(count) and 0 <= count <= 4095
    half = 0.5 * (STEP_N if force < 7.82 else 3.1661e-3)
    assert abs(measure_force(SENSOR, force, 0.0) - force) <= half + 1.7e-3


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(-6, 6))
def test_reading_is_always_finite_and_in_range(force: float, noise: float) -> None:
    reading = measure_force(SENSOR, force, noise)
    assert 0.0 <= reading <= FULL_N


def test_noise_is_in_counts() -> None:
    draws = np.random.default_rng(0).standard_normal(4000)
    counts = np.array([convert_force(SENSOR, 5.0, n) for n in draws])
    assert counts.std() == pytest.approx(math.hypot(SENSOR["noise"], 1 / math.sqrt(12)), rel=0.05)


def test_spring_of_the_robot_is_the_calibration_s() -> None:
    assert ROBOT.probe is not None and ROBOT.force_sensor is not None
    assert ROBOT.probe.spring_n_per_m == pytest.approx(ROBOT.force_sensor.stiffness_n_per_m, 0.01)
    for stroke, stiffness in ((0.04, 904), (0.02, 1807)):
        sensor = ROBOT.force_sensor.model_copy(update={"stroke_m": stroke})
        assert sensor.stiffness_n_per_m == pytest.approx(stiffness, abs=1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"limit_count": 2600}, "must meet"),
        ({"limit_count": 4095}, "must be below 4095"),
        ({"adc_bits": 10}, "must be below 1023"),
        ({"hard_slope_n_per_count": 0.003}, "less than 0"),
        ({"limit_count": 3600, "hard_offset_n": 11.31}, "must be above 0"),
    ],
)
def test_calibrations_that_are_none(change: dict[str, float], said: str) -> None:
    assert ROBOT.force_sensor is not None
    with pytest.raises(ValidationError, match=said):
        ForceSensor(**{**ROBOT.force_sensor.model_dump(), **change})


def test_smallest_force_is_one_count_through_the_spring() -> None:
    """Turning the shoulder by one count moves the tip, and the spring makes a force of it."""
    fine = compute_force_resolution(ROBOT)
    assert fine is not None and ROBOT.probe is not None
    model, q = build_body_model(ROBOT), posture(ROBOT, "working")
    turned = q + np.array([2 * math.pi / 4096, 0.0])
    rise = compute_tip(model, turned)[0][2] - compute_tip(model, q)[0][2]
    assert fine.smallest == pytest.approx(abs(rise) * ROBOT.probe.spring_n_per_m, rel=0.01)
    assert fine.steps[1] == pytest.approx(0.0, abs=1e-4)  # the elbow moves the tip sideways
    assert fine.rms == pytest.approx(fine.smallest / math.sqrt(12), rel=1e-3)


def test_coarse_servo_makes_a_coarse_force() -> None:
    """Counts of 0.325 deg instead of 0.088 deg: 3.7 times the step."""
    assert ROBOT.arm is not None
    servos = {n: s.model_copy(update={"encoder_counts": 1108}) for n, s in ROBOT.arm.servos.items()}
    coarse = ROBOT.model_copy(update={"arm": ROBOT.arm.model_copy(update={"servos": servos})})
    a, b = compute_force_resolution(ROBOT), compute_force_resolution(coarse)
    assert a is not None and b is not None
    assert b.smallest / a.smallest == pytest.approx(4096 / 1108)


def test_robots_without_a_spring_have_no_resolution() -> None:
    assert compute_force_resolution(load_robot("hexarotor")[0]) is None


def test_spring_of_the_plant_follows_both_slopes_and_the_reading_follows_it() -> None:
    """Loads along the upright slider: where they hold it, and what the sensor says of them."""
    d = load_description("bridge-contact")
    scene = build_scene(d.robot, d.world, Deviation())
    m, data, probe, sensor = (
        scene.model,
        mujoco.MjData(scene.model),
        d.robot.probe,
        d.robot.force_sensor,
    )
    assert probe is not None and sensor is not None
    m.opt.gravity[:] = 0.0
    dof, at = m.joint("spring").dofadr[0], scene.places.slider_qpos
    rows = build_force_sensor(sensor, probe.spring_preload_n)[0]
    for force in (1.0, 5.0, 7.0, 9.0, 12.0, 15.0):
        low, high = 0.0, probe.spring_travel_m
        for _ in range(60):
            data.qpos[at] = -0.5 * (low + high)
            mujoco.mj_forward(m, data)
            if data.qfrc_passive[dof] < force:
                low = -data.qpos[at]
            else:
                high = -data.qpos[at]
        assert compute_spring_force(probe, sensor, low) == pytest.approx(force, abs=1e-6)
        soft = probe.spring_n_per_m
        by_hand = (
            force / soft if force < 7.806 else 7.806 / soft + (force - 7.806) / (0.3588 * soft)
        )
        assert low == pytest.approx(by_hand, rel=1e-3)
        assert measure_travel(rows, low, 0.0) == pytest.approx(force, abs=0.012)
    assert sensor.hard_share * probe.spring_n_per_m == pytest.approx(432.0, abs=1.0)
    assert compute_spring_force(probe, sensor, probe.spring_travel_m) == pytest.approx(
        16.37, abs=0.05
    )
