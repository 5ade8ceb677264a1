"""The physics step: what a scene allows, and what follows it."""

from __future__ import annotations

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence.bench.flights import fly_to_hover
from skywright.models.scene import build_scene
from skywright.models.timestep import find_stiff_contact, list_time_constants
from skywright.run.planning import plan_mission
from skywright.run.setup import Setup
from skywright.vehicle.bus import Clock
from skywright.vehicle.set_up import check_rate


def build(name: str, timestep: float = 0.001):
    setup = Setup(load_description(name))
    return build_scene(setup.robot, setup.world, setup.deviation, timestep=timestep)


def test_a_weld_scan_flies_at_two_milliseconds():
    model = build("pipe-weld-scan", 0.002).model
    assert model.opt.timestep == 0.002
    times = dict((name, t) for t, name in list_time_constants(model))
    assert times["end stop of spring"] == 0.004 and times["contact touch"] == 0.008
    assert find_stiff_contact(model, 0.0021) is not None


@pytest.mark.parametrize(
    ("name", "what"), [("bridge-contact", "docking foot0"), ("impact", "contact of pad")]
)
def test_too_stiff_contacts_are_refused_by_name(name, what):
    with pytest.raises(InputError, match="timestep_ms = 2 is too long") as told:
        build(name, 0.002)
    assert what in str(told.value) and "ms" in str(told.value)
    build(name, 0.001)


def test_a_plan_refuses_what_would_not_fly():
    sets = ["mission.timestep_ms=2"]
    with pytest.raises(InputError, match="timestep_ms = 2 is too long for 'f550-bridge'"):
        plan_mission(load_description("bridge-contact", sets=sets))


def test_docking_feet_grow_unstable_where_the_rule_says():
    """What slips is multiplied by 1 - h b / d_max a step; b / d_max = 4 / time constant."""
    times = {name: t for t, name in list_time_constants(build("bridge-contact").model)}
    rate = 4.0 / times["contact of docking foot0"]
    assert abs(1.0 - 0.001 * rate) < 1.0 < abs(1.0 - 0.002 * rate)


def test_the_control_rate_must_be_whole_steps():
    d = load_description("pipe-weld-scan", sets={"robot.control.rate_hz": 1000.0})
    assert check_rate(d.robot, 0.001) == (1, 0.001)
    with pytest.raises(InputError, match=r"physics rate 500 Hz .*valid: 500, 250, 125, 100"):
        check_rate(d.robot, 0.002)


def test_only_one_and_two_milliseconds_are_steps():
    for bad in (4, 0.5, "fast"):
        with pytest.raises(InputError, match="timestep_ms"):
            load_description("waypoints", sets={"mission.timestep_ms": bad})


def test_rates_and_times_do_not_follow_the_step():
    """The same hover: control ticks, samples and simulated time as with 1 ms."""
    seen = {}
    for step in (1, 2):
        d = load_description("waypoints", sets={"mission.timestep_ms": step})
        vehicle = fly_to_hover(d)
        blocks: list[np.ndarray] = []
        vehicle.on_samples = blocks.append
        vehicle.flush()
        before, start = int(vehicle.assembly.get(Clock)["tick"]), vehicle.t
        for _ in range(100):
            vehicle.tick()
        vehicle.flush()
        rows = np.concatenate(blocks)
        rows = rows[rows["t"] > start + 1e-9]
        seen[step] = (int(vehicle.assembly.get(Clock)["tick"]) - before, len(rows))
        assert vehicle.sim.data.time == pytest.approx(vehicle.t, abs=1e-6)
        assert np.linalg.norm(rows["p_WB"] - rows["est_p_WB"], axis=1).max() < 0.02
    assert seen[1] == seen[2]
