"""Periods that are no multiple of the control period: rows, mission ticks, readings, the gauge."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plant_parts import build_context, build_plant
from skywright import run_estimator
from skywright.core.record import Record, View
from skywright.description.loader import load_description
from skywright.inspection.spikes import FOOTPRINT, count_per_footprint
from skywright.models.localisation.trajectory import Trajectory
from skywright.models.range_finder import RangePrecision, build_range_finder, step_range_finder
from skywright.recordings.period import compute_period
from skywright.run.backends import build_vehicle
from skywright.vehicle.component import Component
from skywright.vehicle.readings import Telemetry
from skywright.vehicle.schedule import count_calls, is_due
from skywright.vehicle.sensors.airspeed import Airspeed


@given(st.sampled_from([1.0, 20.0, 30.0, 50.0, 100.0, 300.0, 400.0, 500.0, 1000.0]),
       st.sampled_from([1, 2, 4, 5, 8, 10]))  # fmt: skip
def test_a_row_runs_at_the_rate_of_its_period(rate, milliseconds):
    dt = 1e-3 * milliseconds
    every, calls = count_calls(1.0 / rate, dt)
    ticks = np.array([k for k in range(round(10.0 / dt)) if is_due(k, every, calls, 0)])
    assert len(ticks) == pytest.approx(10.0 * min(rate, 1.0 / dt), abs=1.0)
    if len(ticks) > 1:
        assert np.ptp(np.diff(ticks)) <= 1
    assert ticks[0] == 0 and not any(is_due(k, 2, calls, 2) for k in range(20))


def test_whole_periods_are_multiples_of_the_tick():
    assert count_calls(0.0, 0.002) == (1, 1) and count_calls(0.01, 0.002) == (5, 1)
    assert count_calls(0.01, 0.004) == (5, 2) and count_calls(1.0 / 3000.0, 0.002) == (1, 1)


@pytest.mark.parametrize("rate", [500.0, 250.0, 125.0])
def test_the_gauge_and_the_mission_run_in_seconds_at_every_control_rate(rate):
    d = load_description("waypoints", sets={"robot.control.rate_hz": rate})
    v, rows = build_vehicle(d), []
    v.on_samples = lambda s: rows.append(s.copy())
    for _ in range(100):
        v.tick()
    v.flush()
    assert v.t == pytest.approx(2.0)
    s = np.concatenate(rows)
    assert len(s) == pytest.approx(200, abs=1)
    used = float(np.sum(s["power"][1:] * np.diff(s["t"])))
    full = 3600.0 * d.robot.battery.energy_wh
    assert full * (1.0 - float(v.look(Telemetry).charge)) == pytest.approx(used, rel=0.01)


@pytest.mark.parametrize("rate", [50.0, 300.0, 2000.0])
def test_the_lag_of_a_reading_does_not_depend_on_its_rate(rate):
    wind = ["world.wind.kind=steady", "world.wind.mean_mps=5", "world.wind.toward_deg=180"]
    context = build_context(sets=wind)
    table = Airspeed.Table(noise_mps=0.0, lag_s=0.1, rate_hz=rate)
    plant = build_plant(context, Airspeed("pitot", table))
    plant.run(round(0.1 / context.dt))
    v = float(View(plant.assembly.get(Airspeed.Reading)).v)
    assert v == pytest.approx(5.0 * (1.0 - math.exp(-1.0)), abs=0.6)


def test_a_range_finder_keeps_its_rate_between_ticks():
    rf = build_range_finder(np.random.default_rng(0), RangePrecision(rate_hz=30.0))[0]
    seen = 0
    for k in range(4000):  # 20 s at 200 Hz, with 6.67 ticks a sample
        step_range_finder(rf, 0.005 * k, 3.0)
        seen += rf["fresh"] > 0.0
    assert seen == pytest.approx(600, abs=1)


@pytest.mark.parametrize(
    ("steps", "period"),
    [([10] * 50, 10), ([8, 12] * 25, 10), ([16, 8, 8, 8] * 12, 10), ([10] * 20 + [3000], 10)],
)
def test_the_period_of_samples_is_their_mean_without_gaps(steps: list[int], period: int) -> None:
    t = 3.0 + 1e-3 * np.cumsum([0, *steps])
    assert compute_period(t) == pytest.approx(1e-3 * period)


UNEVEN = 1e-3 * np.cumsum(np.resize([8, 8, 8, 16], 400))
"""s, times of samples each 10 ms on average."""


def test_the_rate_of_a_trajectory_is_that_of_its_samples() -> None:
    assert Trajectory("", UNEVEN, np.zeros((400, 3))).rate == pytest.approx(100.0, rel=0.01)


def test_samples_within_the_footprint_are_counted_by_their_mean_interval() -> None:
    p = np.outer(0.01 * UNEVEN, [1.0, 0.0, 0.0])
    assert count_per_footprint(UNEVEN, p) == pytest.approx(FOOTPRINT / 1e-4, rel=0.01)


def test_an_estimator_integrates_over_the_mean_interval_of_the_samples() -> None:
    """Times are even within 20 %, fixes rare: most of the turn comes from the gyroscope."""
    t = 1e-3 * np.cumsum(np.resize([2.0, 2.0, 2.35], 3000))
    yaw, o = np.sin(t), 0.0 * t
    fixes = slice(0, None, 500)
    found = run_estimator(
        "waypoints", t=t, gyro=np.stack([o, o, np.cos(t)], axis=1),
        accel=np.stack([o, o, o + 9.81], axis=1), t_fix=t[fixes], p_fix=np.zeros((6, 3)),
        R_fix=Rotation.from_euler("z", yaw[fixes, None]).as_matrix(),
    )  # fmt: skip
    turned = np.arctan2(found["R_WB"][:, 1, 0], found["R_WB"][:, 0, 0])
    assert np.abs(turned - np.sin(found["t"]))[found["ready"]].max() < 0.02


def test_one_sample_has_no_period() -> None:
    assert compute_period([1.0]) == compute_period([]) == 0.0


class Counter(Component):
    """A user's observer in plain Python, at 50 Hz."""

    slot, side, compiled = "record", "plant", False

    class Me(Record):
        n: float

    @staticmethod
    def step(me: Me) -> None:
        me.n += 1.0

    def get_period(self, step: str, context: Any) -> float:
        return 0.02


@pytest.mark.parametrize("backend", ["physics", "kinematic"])
def test_a_component_in_python_runs_at_its_rate(backend: str) -> None:
    v = build_vehicle(load_description("waypoints"), backend=backend, parts=[Counter("counter")])
    for _ in range(100):
        v.tick()
    assert v.read_memory("counter")["n"] == pytest.approx(100, abs=1)
