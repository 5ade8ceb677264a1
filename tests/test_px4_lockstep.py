"""The simulator's side of PX4's protocol, against a peer that behaves as documented."""

from __future__ import annotations

import json
import math
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from pymavlink.dialects.v20 import common

from px4_peer import BOOT_SAMPLES, Misbehaviour, Px4Peer
from skywright.cli import main
from skywright.core.rotations import rot_from_quat
from skywright.description.loader import load_description
from skywright.errors import InputError, SimulationError
from skywright.links.mavlink.frames import FRD_FROM_FLU, NED_FROM_ENU
from skywright.links.mavlink.stream import MavlinkStream
from skywright.links.px4.flight import Options, SitlResult, fly_px4
from skywright.links.px4.lockstep import REFUSALS_MAX, Lockstep
from skywright.links.px4.parameters import build_airframe
from skywright.links.px4.sensors import Px4Sensors, compute_time_us
from skywright.links.px4.server import Px4Server
from skywright.links.sitl.pace import Pace
from skywright.links.sitl.plant import Placed, Reading, SitlPlant
from skywright.recordings.recording import read_recording


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as s:
        return int(s.getsockname()[1])


def describe(robot: str = "hexarotor", **sets: Any) -> Any:
    return load_description("waypoints", robot, "open", sets, 3)


def fly(
    tmp_path: Path, peer_options: dict[str, Any] | None = None, *, duration: float = 2.0,
    robot: str = "hexarotor", patience: float = 5.0, wait: float = 20.0, sets: Any = (),
    arm_after: int = 100,
) -> tuple[SitlResult, Px4Peer, list[str]]:  # fmt: skip
    """Fly with a peer that arms after some samples; returns what was said, too."""
    port, said = free_port(), list[str]()
    options = dict(peer_options or {})
    command = options.pop("command", np.zeros(6))

    def lead(peer: Px4Peer) -> Any:
        return command(peer) if callable(command) else command

    peer = Px4Peer(port, command=lead, **options)
    take = peer._take_sample

    def arm_then_take(s: Any, m: Any) -> bool:
        if peer.seen == arm_after:
            peer.arm()
        return take(s, m)

    peer._take_sample = arm_then_take  # type: ignore[method-assign]
    peer.start()
    try:
        result = fly_px4(
            load_description("waypoints", robot, "open", sets, 3),
            Options(
                port=port, telemetry=0, speed=math.inf, wait_s=wait, patience_s=patience,
                duration_s=duration, out=tmp_path / "run",
            ),
            said.append,
        )  # fmt: skip
    finally:
        peer.stop()
        peer.join(5.0)
    return result, peer, said


def test_lockstep_is_one_answer_a_sample_and_everything_is_recorded(tmp_path: Path) -> None:
    result, peer, said = fly(tmp_path, {"command": np.full(6, 0.8)})
    assert result.outcome == "finished" and result.exit_code == 0, result
    assert peer.refusals == [] and peer.armed
    assert peer.waited == 0
    steps = np.diff(peer.times[BOOT_SAMPLES:])
    assert set(steps) == {4000}  # 250 Hz, none left out
    # 500 samples: poses at the rate of the world's motion capture, the truth at 200 Hz or more
    assert peer.messages["HIL_SENSOR"] == pytest.approx(500, abs=2)
    assert peer.messages["ODOMETRY"] == pytest.approx(198, abs=8)
    assert peer.messages["HIL_STATE_QUATERNION"] > 450
    assert "HIL_GPS" not in peer.messages
    assert any("in lockstep" in line for line in said) and any("is armed" in s for s in said)
    samples = read_recording(result.directory / "recording.mcap").samples
    armed = samples["autopilot_armed"] > 0.5
    np.testing.assert_allclose(samples["autopilot_command"][armed][5:], 0.8)
    assert samples["p_WB"][-1, 2] > samples["p_WB"][0, 2] + 0.5  # 0.8 is above hover: it climbed
    found = json.loads((result.directory / "metrics.json").read_text())
    assert found["backend"] == "px4" and found["outcome"] == "finished"
    assert found["metrics"]["autopilot.armed_s"] == pytest.approx(armed.sum() * 0.01, abs=0.02)


def test_disarmed_motors_stand_still_whatever_is_commanded(tmp_path: Path) -> None:
    result, _, _ = fly(tmp_path, {"command": np.full(6, 1.0)}, arm_after=10**9, duration=0.6)
    samples = read_recording(result.directory / "recording.mcap").samples
    assert np.all(samples["rotor_speed"] == 0.0)
    assert result.metrics["autopilot.armed_s"] == 0.0


@pytest.mark.parametrize("axis", range(3))
def test_a_step_in_each_axis_turns_the_robot_that_way(axis: int) -> None:
    """Rotor order and directions: PX4's torque about an axis of FRD by its own geometry."""
    from skywright.links.px4.parameters import list_parameters
    from test_px4_parameters import rebuild

    for robot in ("hexarotor", "othex"):
        d = describe(robot)
        values = {p.name: float(p.value) for p in list_parameters(d.robot, d.world)}
        plant, B = SitlPlant(d), rebuild(values)
        airframe = build_airframe(d.robot, d.world)
        wrench = np.array([0, 0, 0, 0, 0, -1.15 * airframe.mass * 9.81])
        for _ in range(60):  # up, off the ground
            plant.step(to_share(plant, B, wrench))
        saved, turned = plant.vehicle.save(), []
        for share in (0.0, 0.1):  # without and with the step: the plant is no perfect robot
            plant.vehicle.restore(saved)
            wrench[axis] = share * airframe.inertia[axis] * 10.0
            for _ in range(40):
                reading = plant.step(to_share(plant, B, wrench))
            turned.append(FRD_FROM_FLU @ reading.gyro)
        by_step = turned[1] - turned[0]
        others = np.abs(np.delete(by_step, axis)).max()
        assert by_step[axis] > 0.05, (robot, by_step)
        assert others < 0.25 * by_step[axis], (robot, by_step)


def to_share(plant: SitlPlant, B: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Return the commands that make a wrench (torque, force) in FRD by PX4's quadratic curve."""
    thrust = np.linalg.pinv(B) @ wrench
    return np.sqrt(np.clip(thrust / plant.setup.rotors.thrust_max, 0.0, 1.0))


def test_the_sensors_agree_with_the_truth_in_px4s_frames() -> None:
    d = describe("hexarotor", **{"mission.start_yaw_deg": 30.0})
    plant = SitlPlant(d)
    sensors = Px4Sensors(common, d.robot, d.world, 1, plant.period)
    found: dict[str, list[Any]] = {}
    for _ in range(250):
        for m in sensors.build(plant.step(np.zeros(6))):
            found.setdefault(m.get_type(), []).append(m)
    specific = np.mean([[m.xacc, m.yacc, m.zacc] for m in found["HIL_SENSOR"][50:]], axis=0)
    np.testing.assert_allclose(specific, [0, 0, -9.81], atol=0.35)  # down is +z: it is pushed up
    slow = [m for m in found["HIL_SENSOR"] if m.fields_updated & 0x1C0]
    assert len(slow) == 50  # 50 Hz
    assert len({m.xmag for m in slow}) > 40 and len({m.abs_pressure for m in slow}) > 40
    # heading: W's x is east; 30 deg to the left of it is 60 deg from north
    mag = np.mean([[m.xmag, m.ymag] for m in slow], axis=0)
    heading = math.degrees(math.atan2(-mag[1], mag[0]))
    assert heading == pytest.approx(60.0 - 3.6, abs=1.0)  # less the declination of 3.6 deg
    truth = found["HIL_STATE_QUATERNION"][-1]
    R = rot_from_quat(np.array(truth.attitude_quaternion))
    assert math.degrees(math.atan2(R[1, 0], R[0, 0])) == pytest.approx(60.0, abs=0.1)
    assert truth.zacc == pytest.approx(-1000, abs=60)  # mG
    pose = found["ODOMETRY"][-1]
    np.testing.assert_allclose([pose.x, pose.y, -pose.z], plant.vehicle.sim.qpos[[1, 0, 2]],
                               atol=0.002)  # fmt: skip
    # poses come late, by the latency of motion capture, and say so
    assert compute_time_us(plant.t) - pose.time_usec >= 8000


def test_satellites_come_late_with_the_speed_of_then() -> None:
    d = describe("hexarotor", **{"world.localisation": "gnss"})
    plant = SitlPlant(d)
    sensors = Px4Sensors(common, d.robot, d.world, 1, plant.period)
    fixes, speeds = [], {}
    for k in range(400):
        reading = plant.step(np.full(6, 0.75 if k > 50 else 0.0))
        speeds[compute_time_us(reading.t)] = reading.v_WB[2]
        fixes += [(reading.t, m) for m in sensors.build(reading) if m.get_type() == "HIL_GPS"]
    assert len(fixes) == pytest.approx(15, abs=2)  # 10 Hz, the first after the latency
    assert all(1e6 * t + 1e6 - m.time_usec >= 109_000 for t, m in fixes)
    last = fixes[-1][1]
    then = min(speeds, key=lambda us: abs(us - last.time_usec))
    assert -0.01 * last.vd == pytest.approx(speeds[then], abs=0.2) and speeds[then] > 0.5
    assert (last.lat / 1e7, last.lon / 1e7) == (
        pytest.approx(47.397742, abs=3e-5), pytest.approx(8.545594, abs=3e-5),
    )  # fmt: skip


def test_satellites_state_the_speed_of_the_antenna() -> None:
    """PX4 subtracts w x r (EKF2_GPS_POS_*) from it; a turn about B moves an antenna on a mast."""
    sets = {"world.localisation": "gnss", "robot.sensors.antenna_x_m": 0.3}
    d = describe("hexarotor", **sets)
    sensors = Px4Sensors(common, d.robot, d.world, 1, 0.004)
    R_WB = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # 90 deg to the left
    w_WB_B, v_WB, sent = np.array([0.0, 2.0, 3.0]), np.array([0.5, 0.0, 0.0]), []
    for k in range(400):
        t = 0.004 * k
        fix = Placed(t, np.zeros(3), None)
        reading = Reading(t, w_WB_B, np.zeros(3), None, fix, np.zeros(3), R_WB, v_WB, w_WB_B)
        (gps,) = [m for m in sensors.build(reading) if m.get_type() == "HIL_GPS"]
        sent.append([0.01 * gps.vn, 0.01 * gps.ve, 0.01 * gps.vd])
    # in B: w x (0.3, 0, 0.1) = (0.2, 0.9, -0.6); B's x is north, its y is west
    np.testing.assert_allclose(np.mean(sent, axis=0), [0.2, 0.5 - 0.9, 0.6], atol=0.01)


# --- what goes wrong --------------------------------------------------------------------------


def test_answers_that_come_twice_or_late_change_nothing(tmp_path: Path) -> None:
    wrong = Misbehaviour(twice={150, 151, 200}, late={170, 220}, junk={180}, nan={190})
    result, peer, _ = fly(tmp_path, {"wrong": wrong, "command": np.full(6, 0.3)}, duration=1.2)
    assert result.outcome == "finished" and peer.waited == 0
    refused = "\n".join(result.refused)
    assert "5 refused: an answer that came before" in refused
    assert "1 refused: actuators that are not finite" in refused
    assert "bytes that belong to no packet" in refused or "checksum" in refused
    samples = read_recording(result.directory / "recording.mcap").samples
    assert np.all(np.isfinite(samples["rotor_speed"]))


def test_time_stands_still_while_px4_is_silent_and_goes_on_after(tmp_path: Path) -> None:
    wrong = Misbehaviour(stall={150: 2.6})
    result, peer, said = fly(tmp_path, {"wrong": wrong}, duration=0.8)
    assert result.outcome == "finished" and peer.waited == 0
    assert any("does not answer; time stands still" in line for line in said)
    assert set(np.diff(peer.times[BOOT_SAMPLES:])) == {4000}


def test_a_px4_that_hangs_ends_the_run_with_the_reason(tmp_path: Path) -> None:
    wrong = Misbehaviour(drop={150})
    result, _, _ = fly(tmp_path, {"wrong": wrong}, duration=2.0, patience=1.0)
    assert (result.outcome, result.exit_code) == ("aborted", 3)
    assert "did not answer for 1 s" in result.reason
    assert result.directory.name == "run.partial"
    assert read_recording(result.directory / "recording.mcap").samples["t"][-1] > 0.4


def test_rotors_stop_when_px4_vanishes_and_it_may_come_back(tmp_path: Path) -> None:
    port, said = free_port(), list[str]()
    first = Px4Peer(port, Misbehaviour(vanish=200), np.full(6, 0.75))
    take = first._take_sample

    def arm_then_take(s: Any, m: Any) -> bool:
        if first.seen == 100:
            first.arm()
        return take(s, m)

    first._take_sample = arm_then_take  # type: ignore[method-assign]
    second = Px4Peer(port)

    def hear(text: str) -> None:
        said.append(text)
        if "has gone" in text:
            second.start()

    first.start()
    options = Options(
        port=port, telemetry=0, speed=math.inf, wait_s=5.0, duration_s=2.5, out=tmp_path / "run"
    )
    result = fly_px4(describe(), options, hear)
    second.stop()
    assert result.outcome == "finished", result
    assert [line for line in said if "is connected" in line] == ["PX4 is connected"] * 2
    samples = read_recording(result.directory / "recording.mcap").samples
    gone = samples["t"] > 1.3  # vanished at sample 200: 0.8 s
    assert np.all(samples["autopilot_command"][gone] == 0.0)
    assert np.all(samples["rotor_speed"][gone] < 5.0)
    assert second.messages["HIL_SENSOR"] > 10
    assert second.times[0] > 1_800_000  # the clock of the plant goes on
    events = json.loads((result.directory / "metrics.json").read_text())["result"]["events"]
    assert any("has gone" in text for _, text in events)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (Misbehaviour(version_1=True), "speaks MAVLink 1; set MAV_PROTO_VER"),
        (Misbehaviour(lockstep=False), "built without lockstep"),
        (Misbehaviour(jump_us={150: 5_000_000}), "time is not that of the samples"),
        (Misbehaviour(jump_us={150: -900_000}), "time is not that of the samples"),
    ],
)
def test_what_is_no_px4_in_lockstep_ends_with_its_reason(
    tmp_path: Path, wrong: Misbehaviour, says: str
) -> None:
    result, _, _ = fly(tmp_path, {"wrong": wrong}, duration=3.0, patience=2.0)
    assert result.exit_code == 3
    assert says in result.reason or "did not answer" in result.reason
    assert says in result.reason + "\n".join(result.refused)


def test_nobody_connects() -> None:
    port = free_port()
    with pytest.raises(InputError, match=f"no PX4 connected to 127.0.0.1:{port} within 0.1 s"):
        fly_px4(describe(), Options(port=port, telemetry=0, wait_s=0.1))


def test_a_port_that_is_taken_and_a_second_autopilot() -> None:
    said: list[str] = []
    server = Px4Server(6, "127.0.0.1", 0, patience_s=1.0, say=said.append)
    with pytest.raises(InputError, match="another simulator listens there"):
        Px4Server(6, "127.0.0.1", server.port, patience_s=1.0, say=said.append)
    one = socket.create_connection(("127.0.0.1", server.port))
    assert server.wait_for_connection(2.0)
    two = socket.create_connection(("127.0.0.1", server.port))
    for _ in range(100):
        server.exchange(0.004, [])
        if len(said) > 1:
            break
    assert "a second autopilot at 127.0.0.1 was refused" in said[-1]
    assert two.recv(10) == b"" and server.connected
    one.close()
    two.close()
    server.close()


def test_a_wrong_robot_or_rate_is_told_before_anything_starts() -> None:
    result = CliRunner().invoke(main, ["sitl", "hexarotor", "--speed", "0"])
    assert result.exit_code == 2 and "valid: 0.01 to 1000, or max" in result.output
    result = CliRunner().invoke(
        main, ["sitl", "hexarotor", "--set", "robot.control.rate_hz=125", "--wait", "0"]
    )
    assert result.exit_code == 2 and "takes 200 to 250 Hz" in result.output


# --- without sockets ----------------------------------------------------------------------------


def answer(us: int, controls: Any = (), mode: int = 129, flags: int = 1) -> Any:
    full = np.zeros(16)
    full[: len(controls)] = controls
    return common.MAVLink_hil_actuator_controls_message(us, full, mode, flags)


def test_the_rules_of_lockstep() -> None:
    rules = Lockstep(4)
    rules.connect()
    rules.send(0.004)
    assert not rules.is_waiting  # it boots: nothing is waited for
    rules.take(answer(compute_time_us(0.004), [0.1, 0.2, 0.3, 7.0]))
    np.testing.assert_allclose(rules.command, [0.1, 0.2, 0.3, 1.0])
    rules.send(0.008)
    assert rules.is_waiting
    rules.take(answer(compute_time_us(0.004)))
    assert rules.is_waiting and rules.counts["duplicate"] == 1
    rules.take(answer(compute_time_us(0.008), [math.nan]))
    assert not rules.is_waiting and rules.counts["numbers"] == 1
    np.testing.assert_allclose(rules.command, [0.1, 0.2, 0.3, 1.0])  # the last one holds
    rules.send(0.012)
    rules.take(answer(compute_time_us(0.012), [0.5] * 4, mode=1))
    assert not rules.armed and np.all(rules.command == 0.0)
    rules.send(0.016)
    rules.take(answer(compute_time_us(0.016), [0.5] * 4))
    rules.send(0.020)
    rules.take(answer(compute_time_us(0.020), [math.nan] * 4, mode=1))  # disarmed: no numbers
    assert not rules.armed and np.all(rules.command == 0.0)
    rules.counts["duplicate"] += 1000  # others were refused before, not in a row
    for _ in range(REFUSALS_MAX):
        rules.take(answer(10**9))
    assert "time is not that of the samples" in rules.trouble
    rules.disconnect()
    assert rules.state == "absent" and not rules.trouble


def test_the_pace_is_that_of_the_clock_and_long_delays_are_given_up() -> None:
    now, slept = [0.0], list[float]()

    def sleep(s: float) -> None:
        slept.append(s)
        now[0] += s

    pace = Pace(lambda: now[0], sleep)
    for k in range(1, 101):
        pace.wait(0.01 * k, 2.0)
    assert now[0] == pytest.approx(0.495)
    now[0] += 10.0  # a debugger
    before = now[0]
    for k in range(101, 201):
        pace.wait(0.01 * k, 2.0)
    assert now[0] - before == pytest.approx(0.495, abs=0.02)  # not caught up
    pace.wait(99.0, math.inf)
    assert now[0] - before < 0.6


def test_frames_are_those_of_the_papers_of_px4() -> None:
    np.testing.assert_array_equal(NED_FROM_ENU @ [1, 0, 0], [0, 1, 0])  # east
    np.testing.assert_array_equal(NED_FROM_ENU @ [0, 0, 1], [0, 0, -1])  # up
    assert np.linalg.det(NED_FROM_ENU) == pytest.approx(1.0)


def test_a_stream_of_mavlink_without_pymavlink_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    with pytest.raises(InputError, match=r"pip install 'skywright\[mavlink\]'"):
        MavlinkStream()
    assert issubclass(SimulationError, Exception)
