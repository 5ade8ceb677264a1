"""Rules of the back end mavlink:URL at the start, at take-off, and beside other components."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

import skywright
from mavlink_pair import Pair, plug
from short_mission import write_short
from skywright.core.rotations import rot_z
from skywright.errors import InputError
from skywright.links.mavlink import modes, offboard, reports
from skywright.links.mavlink.frames import move_point
from skywright.links.mavlink.stream import MavlinkStream
from skywright.run.result import RunResult
from skywright.run.run import run_mission
from skywright.run.session import Vehicle, open_vehicle
from skywright.vehicle.motions import Arrival

URL = "mavlink:udpin:14540"
ORIGIN = "world.origin={latitude_deg=47.4,longitude_deg=8.5,altitude_m=%s}"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("missions")
    write_short(folder)
    served = skywright.load(folder / "short.toml", sets=[ORIGIN % 488.0])
    backend = skywright.build_vehicle(served)
    return folder / "short.toml", served, backend, backend.save()


@pytest.fixture
def pair(built: Any, monkeypatch: pytest.MonkeyPatch) -> Pair:
    _, served, backend, ground = built
    backend.restore(ground)
    pair = Pair(served, backend)
    plug(monkeypatch, pair)
    return pair


def fly(pair: Pair, tmp_path: Path) -> RunResult:
    return run_mission(pair.description, backend=URL, out=tmp_path / "run")


def open_session(pair: Pair) -> Vehicle:
    arrival = Arrival(tolerance_m=0.15, dwell_s=0.2)
    return open_vehicle(pair.description, URL, arrival, checklist=False)


def height(pair: Pair) -> float:
    return float(pair.backend.sim.data.qpos[2])


def list_commands(pair: Pair) -> list[Any]:
    """Collect the mode changes and arm commands that the companion sends from now on."""
    found: list[Any] = []
    parser, put = MavlinkStream(), pair.up.put

    def spy(data: bytes) -> None:
        found.extend(
            (m.command, m.param1) for m in parser.feed(data)
            if m.get_type() == "COMMAND_LONG" and m.command in (176, 400)
        )  # fmt: skip
        put(data)

    pair.up.put = spy  # type: ignore[method-assign]
    return found


def test_a_gimbal_beside_the_autopilot_does_not_end_the_flight(pair: Pair, tmp_path: Path) -> None:
    gimbal = MavlinkStream(1, 154)

    def speak(p: Pair) -> None:
        if round(p.clock.t / 0.02) % 50 == 0:
            p.down.put(gimbal.pack(common.MAVLink_heartbeat_message(26, 0, 0, 0, 4, 3)))

    pair.on_tick = speak
    result = fly(pair, tmp_path)
    assert result.outcome == "succeeded", result.reason
    assert not pair.service.robot.armed


def test_another_autopilot_is_refused_and_named(
    pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "PX4", 3)
    commands = list_commands(pair)
    told = r"no PX4 was heard .*MAV_AUTOPILOT 3 \(system 1, component 1\); valid: MAV_AUTOPILOT 12"
    with pytest.raises(InputError, match=told):
        fly(pair, tmp_path)
    assert not commands


def test_the_height_comes_from_the_ground_at_the_start(
    built: Any, pair: Pair, tmp_path: Path
) -> None:
    """The mission's origin is 47 m higher than the vehicle's, as an ellipsoid above a geoid."""
    pair.description = skywright.load(built[0], sets=[ORIGIN % 535.0])
    highest = [0.0]
    pair.on_tick = lambda p: highest.__setitem__(0, max(highest[0], height(p)))
    result = fly(pair, tmp_path)
    assert result.outcome == "succeeded", result.reason
    assert highest[0] == pytest.approx(1.2, abs=0.15)


def test_a_vehicle_that_does_not_take_off_is_landed_and_disarmed(
    pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reports, "NAME", b"px4 1.14")  # it controls the lift-off itself
    monkeypatch.setattr(offboard, "LIFT_S", 0.05)
    commands = list_commands(pair)
    result = fly(pair, tmp_path)
    assert result.outcome == "aborted"
    assert "no take-off: it is still on the ground after 0.05 s; its motors" in result.reason
    assert not pair.service.robot.armed
    assert [c for c in commands if c[0] == 176] == [(176, 1.0), (176, 1.0)]  # Offboard, Land


def test_a_vehicle_whose_answers_to_arming_are_lost_is_disarmed(pair: Pair, tmp_path: Path) -> None:
    put = pair.down.put
    parser = MavlinkStream()

    def lose(data: bytes) -> None:
        acks = [m for m in parser.feed(data) if m.get_type() == "COMMAND_ACK"]
        if not any(m.command == 400 for m in acks):
            put(data)

    pair.down.put = lose  # type: ignore[method-assign]
    armed: list[bool] = []
    pair.on_tick = lambda p: armed.append(p.service.robot.armed)
    result = fly(pair, tmp_path)
    assert result.outcome == "aborted" and any(armed)
    assert "no answer to 3 requests; its motors were stopped" in result.reason
    assert not pair.service.robot.armed


def test_the_velocity_of_another_point_is_the_derivative_of_its_position() -> None:
    rng, dt = np.random.default_rng(1), 1e-6
    p, v, w, r = rng.normal(size=(4, 3))
    spin = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    here, there = move_point(p, v, R, w, r)
    later, _ = move_point(p + v * dt, v, R @ (np.eye(3) + spin * dt), w, r)
    assert (later - here) / dt == pytest.approx(there, abs=1e-5)
    back = move_point(here, there, R, w, -r)
    assert back[0] == pytest.approx(p) and back[1] == pytest.approx(v)


def test_position_and_velocity_of_estimate_and_set_point_are_those_of_the_same_point(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An autopilot reports and controls the centre of mass C; the mission's point is B's origin."""
    vehicle = open_session(pair)
    b: Any = vehicle.backend
    b._p_BC, b._shift = np.array([0.3, 0.1, 0.2]), np.zeros(3)
    w, R = np.array([0.0, 0.0, 0.8]), rot_z(0.7)
    row = np.array(b.reference)
    row["R_WB"], row["w_WB_B"], row["v_WB"] = R, w, [0.4, 0.0, 0.1]
    row["wd_WB_B"], row["a_WB"] = 0.0, 0.0
    b.track(row[None])
    aim, dt = b._aim(), 1e-4
    turning = rot_z(0.7 + 0.8 * dt) @ b._p_BC - R @ b._p_BC
    assert aim.v == pytest.approx(row["v_WB"] + turning / dt, abs=1e-3)
    inward = rot_z(0.7) @ [-0.64 * 0.3, -0.64 * 0.1, 0.0]
    assert aim.a == pytest.approx(inward, abs=1e-9)
    h = b.link.heard
    h.p, h.v, h.R_WB, h.w_B = aim.p, aim.v, R, w  # a vehicle that is where it is led
    monkeypatch.setattr(b.link, "age", lambda of: 0.0)
    b._move()
    assert b.estimate["p_WB"] == pytest.approx(row["p_WB"], abs=1e-9)
    assert b.estimate["v_WB"] == pytest.approx(row["v_WB"], abs=1e-9)


def test_during_a_silence_the_set_point_is_the_reference_at_rest(pair: Pair) -> None:
    vehicle = open_session(pair)
    assert vehicle.take_off(1.0).result
    vehicle.go_to([2.0, 0.0, 1.0], wait=False)
    vehicle.wait(1.5)
    b: Any = vehicle.backend
    began = pair.clock.t
    pair.down.lost = lambda t: began <= t < began + 3.0
    seen: list[Any] = []

    def look(p: Pair) -> None:
        if began + 2.0 < p.clock.t < began + 2.5:
            seen.append((b.link._target[1], b.reference_now["p_WB"] - b._shift))

    pair.on_tick = look
    vehicle.wait(1.5)
    assert seen
    for target, paused in seen:
        assert target.p == pytest.approx(paused)
        assert target.p == pytest.approx(seen[0][0].p)  # it does not follow the vehicle
        assert not np.any(target.v) and not np.any(target.a) and target.rate == 0.0
    vehicle.land()
    vehicle.close()


def test_closing_while_the_vehicle_follows_makes_it_hold(pair: Pair) -> None:
    vehicle = open_session(pair)
    assert vehicle.take_off(1.0).result
    assert pair.service.robot.mode == modes.OFFBOARD
    vehicle.close()
    assert pair.service.robot.mode == modes.HOLD and pair.service.robot.armed
