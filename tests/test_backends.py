"""The same mission file and the same script on every back end that offers what they need."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import skywright
from skywright.errors import InputError, SkywrightError
from skywright.missions.skills.plan_flight import load_plan_description
from skywright.models.rigid_body import joint_names, posture
from skywright.planning.motion.plan_file import PlanFile, write_plan_file
from skywright.reports.replay import build_replay_data
from skywright.run import session
from skywright.run.kind import load_kind
from skywright.run.run import run_mission
from skywright.vehicle.commands import State
from skywright.vehicle.interface import require
from skywright.vehicle.kinematic import OFFERS
from skywright.vehicle.motions import Arrival
from skywright.vehicle.rest_to_rest import quintic
from skywright.vehicle.set_up import list_offers

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


def test_a_replay_shows_no_forces_where_none_were_simulated(runs):
    units = {b: {c["unit"] for c in build_replay_data(r)["layout"]["channels"]}
             for b, r in runs.items()}  # fmt: skip
    assert {"%", "W"} <= units["physics"] and units["kinematic"] == units["physics"] - {"%", "W"}
    assert build_replay_data(runs["kinematic"])["layout"]["arrows"] == []


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
        vehicle.set_joints(q + [0.2, -0.2])
        vehicle.tick()
    np.testing.assert_allclose(joints[-1], q + [0.2, -0.2], atol=1e-6)
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


def test_a_vehicle_without_a_position_is_closed_and_raises_an_error_of_skywright(monkeypatch):
    built, closed = [], []

    def build(*args, **more):
        built.append(session_build(*args, **more))
        built[0].close = lambda: closed.append(True)
        return built[0]

    session_build = session.build_vehicle
    monkeypatch.setattr(session, "build_vehicle", build)
    with pytest.raises(SkywrightError, match="gave no position within 10 s on the ground") as told:
        skywright.fly("hexarotor", sets=["plant.faults.a.kind=localisation"])
    assert closed == [True] and told.value.exit_code == 1


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


def build_plan(joints):
    """A plan of 4 s: 0.8 m ahead with half a turn of 0.6 rad, joints back by 0.2 rad."""
    t = np.linspace(0.0, 4.0, 201)
    s, ds, dds = quintic(t / 4.0)
    way = np.array([0.8, 0.0, 0.0, 0.6])
    pose = np.array([0.0, 0.0, 1.5, 0.0]) + s[:, None] * way
    q = np.repeat(joints[None], len(t), axis=0) - 0.2 * s[:, None]
    qd = np.repeat(-0.05 * ds[:, None], len(joints), axis=1)
    return t, pose, ds[:, None] * way / 4.0, dds[:, None] * way / 16.0, q, qd


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    robot = skywright.load("waypoints", robot="othex").robot
    file = tmp_path_factory.mktemp("plan") / "turn"
    rows = build_plan(posture(robot, "folded"))
    write_plan_file(file, PlanFile("othex", "open", 1, tuple(joint_names(robot)), *rows, {}))
    return file.with_suffix(".csv"), rows


def test_a_plan_file_has_the_same_phases_and_ends_in_the_same_pose(plan_file, tmp_path):
    file, rows = plan_file
    found = {
        b: run_mission(load_plan_description(file), out=tmp_path / b, backend=b)
        for b in ("physics", "kinematic")
    }
    assert [r.outcome for r in found.values()] == ["succeeded", "succeeded"], found
    names = [[p.name for p in r.phases] for r in found.values()]
    assert names[0] == names[1] and "plan" in names[0]
    for result in found.values():
        np.testing.assert_allclose(result.samples["p_WB"][-1], rows[1][-1, :3], atol=0.03)
        np.testing.assert_allclose(result.samples["q"][-1], rows[4][-1], atol=0.05)
        q = result.samples["q_WB"][-1]
        assert 2.0 * math.atan2(q[3], q[0]) == pytest.approx(0.6, abs=0.03)
    written = json.loads((found["physics"].directory / "metrics.json").read_text())
    checks = {c["name"]: c for c in written["checklist"]}
    assert checks["tilt"]["passed"] and checks["tilt"]["value"] < checks["tilt"]["limit"]
    assert checks["outside the geofence"]["value"] is None  # there is none
    assert skywright.evaluate(found["physics"].directory).checklist == found["physics"].checklist


@pytest.mark.parametrize("backend", ["physics", "kinematic"])
def test_a_script_dispatches_a_plan_at_50_hz(plan_file, backend):
    file, rows = plan_file
    vehicle = skywright.fly("othex", backend=backend)
    assert not vehicle.fly_plan(file)  # on the ground
    vehicle.take_off(1.5)
    start, seen = vehicle.t, []
    vehicle.subscribe("reference", lambda t, r: seen.append((t, r.pose.p[0], r.v_WB[0])))
    assert vehicle.fly_plan(file), vehicle.acted
    np.testing.assert_allclose(vehicle.pose.p, rows[1][-1, :3], atol=0.05)
    np.testing.assert_allclose(vehicle.joints.q_reference, rows[4][-1], atol=0.01)
    t, x, v = np.array(seen).T
    began = t[np.argmax(x > 0.01)]
    same = rows[0][np.argmax(rows[1][:, 0] > 0.01)]
    planned = np.interp(t - began + same, rows[0], rows[1][:, 0])
    late = np.abs(x - planned)[(t > began) & (t < began + 3.5)]
    assert late.max() < 0.06 and v.max() == pytest.approx(rows[2][:, 0].max(), rel=0.1)
    assert vehicle.t - start < 25.0
    with pytest.raises(InputError, match="no plan file"):
        vehicle.fly_plan("nowhere.csv")


def test_a_flight_that_begins_in_a_clamp_is_let_go(tmp_path):
    """The clamp held the kinematic robot for the whole flight; test_bar_transport has physics."""
    r = run_mission(skywright.load("bar-transport"), out=tmp_path / "r", backend="kinematic")
    assert r.outcome == "succeeded", r.reason
    names = [p.name for p in r.phases]
    assert names == ["start", "release", "start pose", "transport", "settle"]


MISSIONS = sorted(p.stem for p in Path(skywright.__file__).parent.glob("missions/*/*.toml"))


@pytest.mark.parametrize("name", MISSIONS)
def test_each_mission_is_built_or_refused_by_what_a_back_end_offers(name):
    sets = {"mission.task.plan_file": "none"} if name == "follow-plan" else {}
    d = skywright.load(name, sets=sets)
    needs, physics = load_kind(d.mission.kind).needs, list_offers(d.robot)
    assert needs <= physics  # the physics flies what is built in
    missing = needs - (physics & OFFERS)
    assert bool(missing) == (name not in ("waypoints", "follow-plan", "bar-transport"))
    if missing:
        with pytest.raises(InputError, match=f"requires {', '.join(sorted(missing))}; the vehicle"):
            offered = SimpleNamespace(offers=physics & OFFERS, devices=SimpleNamespace(names=set()))
            require(offered, needs, name)
