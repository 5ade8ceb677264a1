"""The plain estimator against simulated truth: rates, latency, drop-outs, bias."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor
from skywright.vehicle.estimators.observer import Observer
from skywright.vehicle.sensors.inertial import Inertial


def fly(sets):
    d = load_description(
        "waypoints", "othex", sets=["mission.estimator=observer", "mission.timestep_ms=2", *sets]
    )
    blocks = []
    v = build_vehicle(d, blocks.append)
    Supervisor(v, d.mission, plan_mission(d), d.robot.platform.gear_height_m).fly()
    v.flush()
    s = np.concatenate(blocks)
    return s[(s["t"] > 7.0) & (s["t"] < s["t"][-1] - 10.0)], v  # in free flight


@pytest.mark.parametrize(
    ("rate", "latency"), [(30, 0.0), (30, 0.03), (60, 0.008), (100, 0.0), (100, 0.03)]
)
def test_position_error_stays_at_the_level_of_the_noise(rate, latency):
    s, _ = fly([f"world.mocap.rate_hz={rate}", f"world.mocap.latency_s={latency}"])
    error = np.linalg.norm(s["est_p_WB"] - s["p_WB"], axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.003
    velocity = np.linalg.norm(s["est_v_WB"] - s["v_WB"], axis=1)
    assert np.sqrt(np.mean(velocity**2)) < 0.02


def test_external_force_is_the_model_error_of_the_plant():
    """Hovering 5 % heavier and 5 % weaker than believed: the observer sees the missing lift."""
    s, v = fly(
        ["plant.mass_error=0.05", "plant.rotor_gain_error=-0.05", "plant.rotor_gain_spread=0"]
    )
    held = s[s["t"] > s["t"][-1] - 2.0]
    mass = v.sim.scene.model.body_mass.sum()
    believed = mass / 1.05
    thrust_believed = mass * 9.81 / 0.95
    expected = believed * 9.81 - thrust_believed
    assert np.mean(held["est_f_ext_W"][:, 2]) == pytest.approx(expected, rel=0.05)


def test_gyroscope_bias_is_found():
    _, v = fly(["robot.sensors.gyro_bias_rad_s=0.02"])
    true = v.read(Inertial.Me, "inertial")["gyro_walk"]["bias"]
    found = v.read(Observer.Me, "estimator")["bias"]
    assert np.linalg.norm(true) > 0.005
    assert np.linalg.norm(found - true) < 0.3 * np.linalg.norm(true) + 0.002


def test_drop_outs_are_survived():
    s, _ = fly(["world.mocap.dropout_fraction=0.5", "world.mocap.rate_hz=60"])
    error = np.linalg.norm(s["est_p_WB"] - s["p_WB"], axis=1)
    assert error.max() < 0.05
