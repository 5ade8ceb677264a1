"""The inertial unit and the control link in flight."""

from __future__ import annotations

import numpy as np
import pytest

from exact_map import EXACT
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor
from skywright.vehicle.sensors.inertial import Inertial
from skywright.vehicle.sensors.mocap import MotionCapture

HARD = [
    *EXACT,
    "mission.task.passes=1", "mission.task.pass_length_m=0.03", "mission.timestep_ms=2",
    "world.link.delay_s=0.004", "world.link.jitter_s=0.001", "world.link.loss_fraction=0.01",
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
    for sensor, draws in ((Inertial, Inertial.GyroError), (MotionCapture, MotionCapture.Noise)):
        drawn = [v.assembly._find_block(v.find(sensor), draws) for v in (a, b)]
        assert len(drawn[0]) and drawn[0].tobytes() == drawn[1].tobytes()
    assert b.assembly.arena.nbytes < 500_000


@pytest.mark.parametrize("setting", ["delay_s=-0.001", "delay_s=1", "loss_fraction=1"])
def test_wrong_links_are_told(setting):
    with pytest.raises(InputError, match=r"world\.link"):
        load_description("pipe-weld-scan", sets=[f"world.link.{setting}"])
