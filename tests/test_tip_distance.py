"""The laser at the tip."""

from __future__ import annotations

import math
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from plant_parts import build_context, build_plant, take_samples
from skywright.core.record import View
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence.bench.flights import fly_to_hover
from skywright.vehicle.bus import Truth
from skywright.vehicle.schedule import count_calls, is_due
from skywright.vehicle.sensors.tip_distance import TipDistance


def test_distance_at_the_tip_is_that_to_the_pipe():
    context = build_context(sets=["world.pipe.x_m=1.5", "world.pipe.z_m=0.45"])
    sensor = TipDistance("laser", TipDistance.Table(noise_m=0.0, range_max_m=5.0))
    plant = build_plant(context, sensor)
    data, pipe = context.sim.data, context.world.pipe
    data.qpos[context.scene.places.joint_qpos] = [-0.7, 0.7]  # the probe looks ahead
    mujoco.mj_forward(context.scene.model, data)
    plant.run(1)
    truth = View(plant.assembly.get(Truth))
    p, axis = np.array(truth.p_WT), np.array(truth.R_WT)[:, 2]
    # the ray against the cylinder along y, in the plane of x and z
    d, n = (p - [pipe.x_m, 0, pipe.z_m])[[0, 2]], axis[[0, 2]]
    a, b, c = n @ n, d @ n, d @ d - (0.5 * pipe.diameter_m) ** 2
    expected = (-b - math.sqrt(b * b - a * c)) / a
    assert 0.1 < expected < 3.0
    assert View(plant.assembly.get(TipDistance.Reading)).distance == pytest.approx(
        expected, abs=1e-3
    )
    assert "tip_distance" in take_samples(plant).dtype.names


def test_wrong_tables_are_told():
    with pytest.raises(InputError, match=r"range_min_m 2 must be below range_max_m 1"):
        laser = TipDistance("laser", TipDistance.Table(range_min_m=2.0, range_max_m=1.0))
        build_plant(build_context(), laser)
    with pytest.raises(InputError, match="has no tip"):
        build_plant(build_context("waypoints"), TipDistance("laser"))


def test_it_flies_by_a_table_of_the_robot():
    """Hovering with the arm folded, the laser sees the ground or nothing within its range."""
    sets = ["robot.sensors.laser.kind=tip_distance", "robot.sensors.laser.range_max_m=20.0"]
    vehicle = fly_to_hover(load_description("pipe-weld-scan", sets=sets))
    blocks: list[np.ndarray] = []
    vehicle.on_samples = blocks.append
    vehicle.flush()
    for _ in range(50):
        vehicle.tick()
    vehicle.flush()
    row = np.concatenate(blocks)[-1]
    truth = vehicle.read(Truth)
    axis = truth["R_WT"][:, 2]
    assert axis[2] < -0.2  # it looks down
    assert row["tip_distance"] == pytest.approx(-truth["p_WT"][2] / axis[2], abs=0.03)


@pytest.mark.parametrize("rate", [30.0, 50.0, 400.0])
def test_a_sample_is_never_older_than_a_mission_tick(rate):
    """The ray is cast in the mission tick in which its sample is due, at any rate."""
    sensor = TipDistance("laser", TipDistance.Table(rate_hz=rate))
    context = build_context()
    build_plant(context, sensor)
    cast = []
    sensor._sight = SimpleNamespace(measure=lambda p, axis: cast.append(tick) or 0.5)
    dt, n, ends = context.dt, 10, []
    for tick in range(200):  # mission ticks of 10 control ticks
        sensor.before_tick(tick * n * dt, n)
        every, calls = count_calls(1.0 / rate, dt)
        due = [k for k in range(tick * n, (tick + 1) * n) if is_due(k, every, calls, 0)]
        ends += [tick] * bool(due)
    assert cast == ends
