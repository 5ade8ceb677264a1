"""The same mission file and the same script on every back end that offers what they need."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import skywright
from skywright.errors import InputError
from skywright.run.run import run_mission
from skywright.vehicle.commands import State
from skywright.vehicle.motions import Arrival

QUICK = Arrival(tolerance_m=0.2, dwell_s=0.1)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    d = skywright.load("waypoints")
    return {b: run_mission(d, out=folder / b, backend=b) for b in ("physics", "kinematic")}


def fly_script(vehicle):
    """A script; returns the states that it passed."""
    seen = []
    vehicle.on_state = seen.append
    vehicle.take_off(1.0)
    vehicle.go_to((0.5, 0.0, 1.2), yaw=0.3)
    for _ in range(30):
        vehicle.set_velocity((0.0, 0.3, 0.0))
        vehicle.tick()
    vehicle.hold()
    vehicle.go_home()
    vehicle.land()
    return seen


def test_a_mission_has_the_same_phases_on_all_that_fly_it(runs):
    physics, kinematic = runs["physics"], runs["kinematic"]
    assert physics.outcome == kinematic.outcome == "succeeded", kinematic.reason
    assert [p.name for p in physics.phases] == [p.name for p in kinematic.phases]
    off = np.abs([a.end_s - b.end_s for a, b in zip(physics.phases, kinematic.phases, strict=True)])
    assert off.max() < 0.1  # references have the same length
    error = kinematic.samples["p_WB"] - kinematic.samples["ref_p_WB"]
    flying = kinematic.samples["ref_p_WB"][:, 2] > 0.4
    assert np.abs(error[flying]).max() < 1e-9 < np.abs(physics.samples["p_WB"]).max()
    assert kinematic.to_json()["backend"] == "kinematic"
    again = skywright.evaluate(kinematic.directory)
    assert again.backend == "kinematic" and again.outcome == "succeeded"


def test_a_recording_has_the_phases_of_its_run_and_refuses_commands(runs):
    vehicle = skywright.fly(mission=runs["physics"].directory, backend="recording")
    seen, states = [], []
    vehicle.on_state = states.append
    while not vehicle.backend.has_ended:
        vehicle.tick()
        if vehicle.backend.phase and vehicle.backend.phase not in seen[-1:]:
            seen.append(vehicle.backend.phase)
    assert seen == [p.name for p in runs["physics"].phases]
    assert states[:2] == [State.TAKING_OFF, State.FLYING_AUTO] and State.LANDING in states
    for handle in (vehicle.take_off(1.0), vehicle.go_home(), vehicle.stop_motors(confirm=True)):
        assert handle.result.reason.endswith("refused: the back end plays a recording")
    i = len(runs["physics"].samples) - 1
    np.testing.assert_allclose(vehicle.pose.p, runs["physics"].samples["est_p_WB"][i])


def test_a_script_passes_the_same_states_on_all_that_fly_it():
    passed = {b: fly_script(skywright.fly(backend=b, arrival=QUICK))
              for b in ("physics", "kinematic")}  # fmt: skip
    assert passed["physics"] == passed["kinematic"]
    assert passed["physics"][0] == State.TAKING_OFF
    assert passed["physics"][-1] == State.LANDED_DISARMED


def test_what_a_back_end_does_not_offer_is_refused_before_take_off():
    with pytest.raises(InputError, match="requires dynamics; the vehicle offers"):
        run_mission(skywright.load("excitation"), out=Path("never"), backend="kinematic")
    assert not Path("never").exists()
    with pytest.raises(InputError, match=r"'gazebo' is unknown; .*physics, kinematic"):
        skywright.fly(backend="gazebo")


def test_streams_tell_what_the_vehicle_does():
    vehicle = skywright.fly("othex", backend="kinematic")
    poses, states, joints = [], [], []
    vehicle.subscribe("pose", lambda t, p: poses.append((t, p.p[2])), rate_hz=10.0)
    vehicle.subscribe("state", lambda t, s: states.append(s))
    vehicle.subscribe("joints", lambda t, j: joints.append(j.q))
    vehicle.take_off(1.5)
    assert np.allclose(np.diff([t for t, _ in poses]), 0.1)
    assert poses[-1][1] == pytest.approx(1.5, abs=0.05) and set(states) == {State.TAKING_OFF}
    q = np.array(vehicle.joints.q)
    for _ in range(100):
        vehicle.set_joints(q + 0.2)
        vehicle.tick()
    np.testing.assert_allclose(joints[-1], q + 0.2, atol=1e-6)
    fastest = np.abs(np.diff(joints, axis=0)).max() / 0.02
    assert 0.5 * vehicle.backend.limits.joint_speed < fastest
    assert fastest <= vehicle.backend.limits.joint_speed * 1.01
    p, R = vehicle.transforms["world", "platform"].p, vehicle.backend.estimate["R_WB"]
    tip = p + R @ vehicle.transforms["platform", "tip"].p
    np.testing.assert_allclose(tip, vehicle.backend.tip_of(vehicle.backend.reference)[0], atol=1e-6)
    with pytest.raises(InputError, match="'poses' is unknown; valid: pose, velocity"):
        vehicle.subscribe("poses", print)
    with pytest.raises(InputError, match="rate_hz = 200"):
        vehicle.subscribe("pose", print, rate_hz=200)


def test_a_rule_that_acts_ends_the_command_with_its_reason():
    sets = {"mission.fence.x_max_m": 0.3}
    vehicle = skywright.fly(sets=sets, arrival=QUICK)
    vehicle.take_off(1.0)
    assert "geofence" in vehicle.go_to((1.0, 0.0, 1.0)).result.reason
    for _ in range(400):
        vehicle.set_velocity((0.5, 0.0, 0.0))
        vehicle.tick()
        if vehicle.acted:
            break
    assert vehicle.acted[0].startswith("geofence 0.2")
    assert vehicle.state == State.LANDED_DISARMED and not vehicle.is_turning
    assert np.hypot(*vehicle.pose.p[:2]) < 0.2  # it came home
    assert vehicle.samples["t"][-1] == pytest.approx(vehicle.t, abs=0.03)
    assert not math.isnan(vehicle.battery)
