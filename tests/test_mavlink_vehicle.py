"""A simulated robot that speaks MAVLink by itself: its answers, modes, set-points and reports."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from pymavlink.dialects.v20 import common

from mavlink_talk import ME, MemoryWire, Talk, begin, build, fly, local
from skywright.cli import main
from skywright.core.rotations import rot_z
from skywright.errors import InputError
from skywright.links.mavlink.attitude_target import AttitudeTarget
from skywright.links.mavlink.endpoint import Endpoint, Url, parse_url
from skywright.links.mavlink.frames import (
    from_ned_quaternion,
    swap_heading,
    to_ned_quaternion,
)
from skywright.links.mavlink.parameters import INT32
from skywright.links.mavlink.stream import MavlinkStream
from skywright.vehicle.bus import Body
from skywright.vehicle.commands import State
from skywright.vehicle.drives import tilt_heading

ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
OFFBOARD = (1.0, 6.0, 0.0)  # parameters of MAV_CMD_DO_SET_MODE


@pytest.fixture(scope="module")
def hexarotor() -> Any:
    return build("hexarotor")


@pytest.fixture
def talk(hexarotor: Any) -> Talk:
    return begin(hexarotor)


# --- the ground --------------------------------------------------------------------------------


def test_qgroundcontrols_opening_questions_are_answered_within_a_second(talk: Talk) -> None:
    """What QGroundControl asks on a new vehicle: version, parameters, missions, cameras, files."""
    talk.messages = []
    ask = common.MAVLink_command_long_message
    talk.send(ask(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0))  # AUTOPILOT_VERSION
    talk.send(ask(1, 1, 512, 0, 300, 0, 0, 0, 0, 0, 0))  # PROTOCOL_VERSION: not in the dialect
    talk.send(ask(1, 1, 512, 0, 259, 0, 0, 0, 0, 0, 0))  # CAMERA_INFORMATION: none
    talk.send(ask(1, 1, 512, 0, 397, 0, 0, 0, 0, 0, 0))  # COMPONENT_METADATA: none
    talk.send(common.MAVLink_param_request_list_message(1, 1))
    for kind in range(3):
        talk.send(common.MAVLink_mission_request_list_message(1, 1, kind))
    talk.send(
        common.MAVLink_file_transfer_protocol_message(0, 1, 1, [7, 0, 0, 4] + [0] * 247)
    )  # open a file
    talk.tick(0.96)
    acks = [(m.command, m.result) for m in talk.messages if m.get_type() == "COMMAND_ACK"]
    assert acks == [(512, ACCEPTED), (512, UNSUPPORTED), (512, UNSUPPORTED), (512, UNSUPPORTED)]
    version = talk.last("AUTOPILOT_VERSION")
    assert version.capabilities & 8192 and bytes(version.flight_custom_version) == b"skywrigt"
    values = [m for m in talk.messages if m.get_type() == "PARAM_VALUE"]
    assert len(values) == values[0].param_count > 60
    assert sorted(m.param_index for m in values) == list(range(len(values)))
    counts = [m for m in talk.messages if m.get_type() == "MISSION_COUNT"]
    assert [(m.mission_type, m.count) for m in counts] == [(0, 0), (1, 0), (2, 0)]
    answer = talk.last("FILE_TRANSFER_PROTOCOL").payload
    assert answer[3] == 129 and answer[5] == 4 and answer[0] == 8
    heard = {m.get_type() for m in talk.messages}
    assert heard >= {
        "HEARTBEAT", "SYS_STATUS", "EXTENDED_SYS_STATE", "ESTIMATOR_STATUS", "ATTITUDE",
        "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "BATTERY_STATUS", "GPS_RAW_INT", "ODOMETRY",
        "ACTUATOR_OUTPUT_STATUS", "VFR_HUD",
    }  # fmt: skip


def test_parameters_are_read_set_within_limits_and_refused(talk: Talk) -> None:
    name = b"MIS_TAKEOFF_ALT"
    talk.send(common.MAVLink_param_set_message(1, 1, name, 2.5, 9))
    talk.tick()
    assert talk.take("PARAM_VALUE")[0].param_value == 2.5
    for value in (1e6, math.nan):
        talk.send(common.MAVLink_param_set_message(1, 1, name, value, 9))
        talk.tick()
        assert talk.take("PARAM_VALUE")[0].param_value == 2.5
    talk.send(common.MAVLink_param_request_read_message(1, 1, b"CA_ROTOR_COUNT", -1))
    talk.tick()
    (count,) = talk.take("PARAM_VALUE")
    assert count.param_type == INT32
    assert np.float32(count.param_value).view(np.int32) == 6
    talk.send(common.MAVLink_param_set_message(1, 1, b"CA_ROTOR_COUNT", 8.0, 9))
    talk.tick()
    assert np.float32(talk.take("PARAM_VALUE")[0].param_value).view(np.int32) == 6
    talk.send(common.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    talk.tick()
    assert [m.get_type() for m in talk.messages if m.get_type().startswith("PARAM")] in (
        ["PARAM_ERROR"], [],
    )  # fmt: skip


def test_a_mission_is_refused_and_said_so(talk: Talk) -> None:
    talk.send(common.MAVLink_mission_count_message(1, 1, 3, 0))
    talk.tick()
    assert talk.last("MISSION_ACK").type == common.MAV_MISSION_UNSUPPORTED
    assert "skywright run" in talk.text()
    assert talk.command(300) == REJECTED
    assert talk.command(176, 1.0, 4.0, 4.0) == REJECTED


def test_every_command_is_acknowledged_at_once(talk: Talk) -> None:
    assert talk.command(31999) == UNSUPPORTED
    assert talk.command(246, 1.0) == DENIED
    assert talk.command(400, 0.5) == DENIED
    assert talk.command(185, 2.0) == talk.command(185, math.nan) == DENIED
    assert talk.command(185, 0.0) == ACCEPTED
    assert talk.command(22) == REJECTED  # not armed
    assert "motors are off" in talk.text()
    assert talk.command(511, 32, 1e5) == ACCEPTED
    talk.tick(0.1)
    talk.messages = []
    talk.tick(1.0)
    assert 9 <= len(talk.take("LOCAL_POSITION_NED")) <= 11
    assert talk.command(511, 9999, 1e5) == UNSUPPORTED
    assert talk.command(511, math.nan, 1e5) == DENIED
    assert talk.command(511, 32, 1e30) == ACCEPTED and talk.command(510, 32) == ACCEPTED
    assert talk.last("MESSAGE_INTERVAL").interval_us == 60_000_000  # once a minute


def test_an_interval_is_of_one_connection(talk: Talk) -> None:
    """Two ground stations do not change each other's rates."""
    other = ("127.0.0.1", 14999)
    heartbeat = common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    talk.wire.inbox.append((MavlinkStream(254, 190).pack(heartbeat), other))
    assert talk.command(511, 32, 1e6) == ACCEPTED
    talk.tick(0.1)
    talk.wire.sent.clear()
    count, streams = Counter[Any](), defaultdict[Any, MavlinkStream](MavlinkStream)
    for _ in range(100):
        talk.service.tick()
        while talk.wire.sent:
            data, address = talk.wire.sent.popleft()
            count.update((address, m.get_type()) for m in streams[address].feed(data))
    assert 1 <= count[ME, "LOCAL_POSITION_NED"] <= 3
    assert 95 <= count[other, "LOCAL_POSITION_NED"] <= 101
    assert count[ME, "ATTITUDE"] == pytest.approx(count[other, "ATTITUDE"], abs=1)


def test_arming_runs_the_checklist(talk: Talk) -> None:
    talk.vehicle.checklist = talk.vehicle.checklist.model_copy(
        update={"battery_min_fraction": 1.01}
    )
    assert talk.command(400, 1.0) == REJECTED
    assert "battery" in talk.text()
    talk.tick(1.0)
    assert not talk.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000


def test_a_takeoff_at_once_after_arming_does_not_skip_the_spin_check(talk: Talk) -> None:
    v = talk.vehicle
    v._fly.checklist = v.checklist.model_copy(update={"spin": True})
    fly(talk)
    assert v.checked[-1].name == "spin" and v.checked[-1].passed


def test_it_disarms_when_nobody_takes_off(talk: Talk) -> None:
    assert talk.command(400, 1.0) == ACCEPTED
    talk.tick(9.5)
    assert talk.service.robot.armed
    talk.tick(1.0)
    assert not talk.service.robot.armed


# --- modes -------------------------------------------------------------------------------------


def test_take_off_hold_return_and_land_by_mode(talk: Talk) -> None:
    fly(talk)
    assert talk.mode() == (4, 3)
    assert talk.last("EXTENDED_SYS_STATE").landed_state == 2
    lat, lon = talk.last("GLOBAL_POSITION_INT").lat, talk.last("GLOBAL_POSITION_INT").lon
    assert talk.command(400, 0.0) == REJECTED  # in the air
    talk.send(
        common.MAVLink_command_int_message(
            1, 1, 6, 192, 0, 0, -1, 0, 0, math.nan, lat + 180, lon, 1.5
        )
    )  # 2 m to the north
    talk.tick()
    assert talk.last("COMMAND_ACK").result == ACCEPTED
    talk.until(lambda: talk.estimate["p_WB"][1] > 1.9)
    assert talk.command(20) == ACCEPTED
    assert talk.mode() == (4, 5)
    talk.until(lambda: talk.vehicle.state == State.LANDED_DISARMED, 40.0)
    assert np.linalg.norm(talk.estimate["p_WB"][:2]) < 0.3
    assert talk.mode() == (4, 3)


def test_offboard_needs_a_stream_and_is_left_without_one(talk: Talk) -> None:
    fly(talk)
    assert talk.command(176, *OFFBOARD) == REJECTED
    assert "no stream" in talk.text()
    goal = np.array([0.6, -0.4, 1.8])
    talk.stream_of = lambda: local(goal, yaw=0.5)
    talk.tick(0.1)
    assert talk.command(176, *OFFBOARD) == ACCEPTED
    talk.tick(6.0)
    assert talk.mode() == (6, 0)
    assert np.linalg.norm(talk.estimate["p_WB"] - goal) < 0.1
    R = talk.estimate["R_WB"]
    assert abs(math.atan2(R[1, 0], R[0, 0]) - 0.5) < 0.05
    talk.stream_of = None
    talk.tick(0.4)
    assert talk.service.robot.mode.main == 6
    talk.tick(0.2)
    assert talk.service.robot.mode == (4, 3)
    assert any("no set-point" in s for s in talk.said)


def test_offboard_velocity_in_the_world_and_along_the_heading(talk: Talk) -> None:
    fly(talk)
    talk.stream_of = lambda: local(v=[0.4, 0.0, 0.0])
    talk.tick(0.1)
    assert talk.command(176, *OFFBOARD) == ACCEPTED
    talk.tick(3.0)
    assert np.allclose(talk.estimate["v_WB"], [0.4, 0.0, 0.0], atol=0.06)
    # forward, with the heading turned to the north: along y of W
    talk.stream_of = lambda: local(v=[0.0, 0.0, 0.0], yaw=0.5 * math.pi)
    talk.tick(8.0)
    mask = 0x7 | 0x1C0 | 0xC00
    talk.stream_of = lambda: common.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 8, mask, 0, 0, 0, 0.4, 0, 0, 0, 0, 0, 0, 0
    )
    talk.tick(3.0)
    assert np.allclose(talk.estimate["v_WB"], [0.0, 0.4, 0.0], atol=0.06)


def test_an_offboard_stream_lifts_the_robot_off_the_ground(talk: Talk) -> None:
    ground = np.array(talk.estimate["p_WB"])
    talk.stream_of = lambda: local(ground)
    talk.tick(0.1)
    assert talk.command(176, *OFFBOARD) == ACCEPTED
    assert talk.command(400, 1.0) == ACCEPTED
    talk.tick(1.0)
    assert talk.vehicle.state == State.LANDED_ARMED
    talk.stream_of = lambda: local(ground + [0.0, 0.0, 1.0])
    talk.tick(5.0)
    assert talk.vehicle.state == State.FLYING_AUTO
    assert abs(talk.estimate["p_WB"][2] - ground[2] - 1.0) < 0.2


def test_a_global_set_point_is_where_it_says(talk: Talk) -> None:
    fly(talk)
    here = talk.last("GLOBAL_POSITION_INT")
    p0 = np.array(talk.estimate["p_WB"])
    point = common.MAVLink_set_position_target_global_int_message(
        0, 1, 1, 6, 0xDF8, here.lat + 90, here.lon, 1.5, 0, 0, 0, 0, 0, 0, 0, 0
    )
    talk.stream_of = lambda: point
    talk.tick(0.1)
    assert talk.command(176, *OFFBOARD) == ACCEPTED
    talk.tick(6.0)
    moved = talk.estimate["p_WB"] - p0
    assert abs(moved[1] - 90e-7 * math.radians(1.0) * 6.3675e6) < 0.1 and abs(moved[0]) < 0.1


def test_an_attitude_tilts_it_and_thrust_is_that_of_the_weight(talk: Talk) -> None:
    """A tilt of 4 deg gives g tan(4 deg) along the heading, whichever way it points."""
    fly(talk, 4.0)  # no loop holds the height: it sinks while it turns
    hover = float(talk.service.parameters["MPC_THR_HOVER"])
    R = tilt_heading(1.0, 0.0, math.radians(4.0))
    q = to_ned_quaternion(R)
    talk.stream_of = lambda: common.MAVLink_set_attitude_target_message(
        0, 1, 1, 0x7, q, 0, 0, 0, hover / math.cos(math.radians(4.0))
    )
    talk.tick(0.1)
    assert talk.command(176, *OFFBOARD) == ACCEPTED
    talk.tick(1.2)  # the heading turns first
    v0 = np.array(talk.estimate["v_WB"])
    talk.tick(0.5)
    a = (talk.estimate["v_WB"] - v0) / 0.52
    expected = 9.81 * math.tan(math.radians(4.0))
    assert np.linalg.norm(a[:2]) == pytest.approx(expected, rel=0.25)
    ahead = rot_z(1.0)[:2, 0]
    assert a[:2] @ ahead / np.linalg.norm(a[:2]) > 0.97
    assert abs(a[2]) < 0.3


def test_refused_set_points_are_said_and_counted(talk: Talk) -> None:
    fly(talk)
    q = [1.0, 0.0, 0.0, 0.0]
    bad = [
        local(),  # nothing is given
        common.MAVLink_set_attitude_target_message(0, 1, 1, 0x80, q, 0, 0, 0, 0.5),
        common.MAVLink_set_attitude_target_message(0, 1, 1, 0x7, [0.0] * 4, 0, 0, 0, 0.5),
        common.MAVLink_set_attitude_target_message(0, 1, 1, 0x7, q, 0, 0, 0, math.nan),
        AttitudeTarget(0, 0x27, (1.0, 0.0, 0.0, 0.0), thrust_body=(0.1, 0.0, -0.4)),
    ]
    for message in bad:
        talk.send(message)
    talk.tick()
    assert talk.service.server.counts["set-points"] == len(bad)
    assert talk.service.robot.point is None
    assert "do not push sideways" in talk.text()


def test_a_pilot_takes_over_by_mode_and_stick_and_gives_back(talk: Talk) -> None:
    fly(talk)
    talk.stream_of = lambda: common.MAVLink_manual_control_message(1, 500, 0, 500, 0, 0)
    assert talk.command(176, 1.0, 2.0) == ACCEPTED  # Altitude
    talk.tick(1.0)
    assert talk.vehicle.state == State.FLYING_MANUAL
    assert talk.estimate["v_WB"][0] > 0.5  # ahead, along x
    talk.stream_of = None
    assert talk.command(176, 1.0, 4.0, 3.0) == ACCEPTED  # Hold
    talk.until(lambda: talk.vehicle.state == State.FLYING_AUTO)
    talk.tick(5.0)
    assert np.linalg.norm(talk.estimate["v_WB"]) < 0.1
    assert talk.command(176, 1.0, 3.0) == ACCEPTED  # Position
    talk.stream_of = lambda: common.MAVLink_manual_control_message(1, 0, 1000, 500, 0, 0)
    talk.tick(2.0)
    assert talk.estimate["v_WB"][1] < -0.3  # to the right
    talk.stream_of = None
    talk.tick(3.0)
    assert np.linalg.norm(talk.estimate["v_WB"]) < 0.15


def test_stopping_the_motors_in_the_air_needs_the_number_of_px4(talk: Talk) -> None:
    fly(talk)
    assert talk.command(400, 0.0, 1.0) == REJECTED
    assert talk.command(400, 0.0, 21196.0) == ACCEPTED
    assert not talk.service.robot.armed


# --- reports, frames, addresses ----------------------------------------------------------------


def test_reports_agree_with_the_estimate_in_their_own_frames(talk: Talk) -> None:
    fly(talk)
    assert talk.command(176, 1.0, 4.0, 3.0) == ACCEPTED
    talk.tick(0.1)
    est = talk.estimate
    m = talk.last("LOCAL_POSITION_NED")
    assert np.allclose([m.y, m.x, -m.z], est["p_WB"], atol=0.02)
    m = talk.last("ATTITUDE_QUATERNION")
    R = from_ned_quaternion(np.array([m.q1, m.q2, m.q3, m.q4]))
    assert R is not None and np.allclose(R, est["R_WB"], atol=0.02)
    m = talk.last("ODOMETRY")
    assert np.allclose([m.y, m.x, -m.z], est["p_WB"], atol=0.02)
    m = talk.last("GLOBAL_POSITION_INT")
    assert m.relative_alt == pytest.approx(1e3 * (est["p_WB"][2] - talk.vehicle.home[2]), abs=60)
    heading = math.degrees(swap_heading(math.atan2(est["R_WB"][1, 0], est["R_WB"][0, 0]))) % 360
    assert m.hdg == pytest.approx(100 * heading, abs=200)
    share = np.array(talk.last("ACTUATOR_OUTPUT_STATUS").actuator)
    hover = float(talk.service.parameters["MPC_THR_HOVER"])
    assert np.mean(share[:6]) == pytest.approx(math.sqrt(hover), rel=0.1) and not share[6:].any()


@pytest.mark.parametrize(("roll", "pitch"), [(0.2, 0.0), (0.0, 0.2)])
def test_euler_angles_are_those_of_an_aircraft(talk: Talk, roll: float, pitch: float) -> None:
    """Right side down is positive roll, nose up positive pitch."""
    est: Any = talk.vehicle.backend.look(
        __import__("skywright.vehicle.bus", fromlist=["x"]).Estimate
    )
    est["R_WB"] = tilt_heading(0.3, roll, -pitch)  # the stick's pitch is ahead: nose down
    m = talk.service.server.reports.build(30)
    assert m.roll == pytest.approx(roll, abs=1e-6) and m.pitch == pytest.approx(pitch, abs=1e-6)
    assert m.yaw == pytest.approx(0.5 * math.pi - 0.3, abs=1e-6)


def test_a_robot_with_tilted_rotors_is_pushed_sideways_while_it_stays_level() -> None:
    """thrust_body is in shares of all rotors' thrust: a lateral share of 0.02 accelerates it."""
    description, backend, _ = build("othex")
    talk = Talk(description, backend)
    talk.until(lambda: talk.service.settled)
    fly(talk)
    scale = talk.service.server.scale
    mass = float(backend.look(Body).mass)
    weight = mass * 9.81 / scale.unit
    R = np.array(talk.estimate["R_WB"])
    heading = math.atan2(R[1, 0], R[0, 0])
    q = tuple(to_ned_quaternion(rot_z(heading)))
    talk.stream_of = lambda: AttitudeTarget(0, 0x27, q, thrust_body=(0.0, 0.02, -weight))
    talk.tick(0.1)
    assert talk.command(176, *OFFBOARD) == ACCEPTED
    talk.tick(0.3)
    v0 = np.array(talk.estimate["v_WB"])
    talk.tick(0.5)
    a = (talk.estimate["v_WB"] - v0) / 0.52
    right = -rot_z(heading)[:, 1]
    assert a @ right == pytest.approx(0.02 * scale.unit / mass, rel=0.3)
    assert talk.estimate["R_WB"][2, 2] > math.cos(math.radians(2.0))


@pytest.mark.parametrize(
    "text", ["udp:14550", "udpin:", "udpin:0", "udpin:99999", "tcp", "serial:", "", "udpin:1.5"]
)
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="valid: udpin"):
        parse_url(text)


def test_addresses_stay_on_this_computer_unless_asked() -> None:
    assert parse_url("udpin:14550") == ("udpin", "127.0.0.1", 14550)
    assert parse_url("udpout://10.0.0.2:14550").is_local is False
    assert parse_url("serial:/dev/ttyUSB0:921600") == ("serial", "/dev/ttyUSB0", 921600)
    assert parse_url("serial:/dev/ttyUSB0").port == 57600


def test_the_command_says_what_it_needs() -> None:
    found = CliRunner().invoke(main, ["serve", "--mavlink", "udpin:14550"])
    assert found.exit_code == 2 and "requires a ROBOT" in found.output
    found = CliRunner().invoke(main, ["serve", "hexarotor", "--seed", "3"])
    assert found.exit_code == 2 and "--seed requires --mavlink" in found.output


@pytest.mark.parametrize("text", ["serial:/dev/x:0", "serial:/dev/x:99999999999999999999"])
def test_a_baud_rate_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="baud"):
        parse_url(text)


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp"])
@pytest.mark.parametrize("host", ["..", "a..b", "::1"])
def test_a_host_without_an_address_is_told_as_such(kind: str, host: str) -> None:
    """A name is looked up once: `udpout` would otherwise lose each packet and say nothing."""
    with pytest.raises(InputError, match="has no address"):
        Endpoint(parse_url(f"{kind}:{host}:14550"), 1, 1)


def test_a_robot_without_mavlink_is_told_what_to_add() -> None:
    done = CliRunner().invoke(main, ["serve", "hexarotor"])
    assert done.exit_code == 2 and "serve hexarotor --mavlink URL" in done.output


def test_junk_neither_becomes_a_peer_nor_moves_one() -> None:
    """Datagrams without a message: eight senders fill no place, and none redirects the stream."""
    wire = MemoryWire()
    listening = Endpoint(Url("udpin", "127.0.0.1", 14550), 1, 1, wire)
    for port in range(20):
        wire.inbox.append((b"junk", ("127.0.0.1", port)))
    assert list(listening.poll()) == [] and not listening.peers
    heartbeat = common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    packed, me = MavlinkStream(255, 190).pack(heartbeat), ("127.0.0.1", 99)
    wire.inbox.append((packed, me))
    assert len(list(listening.poll())) == 1 and list(listening.peers) == [me]
    calling = Endpoint(Url("udpout", "127.0.0.1", 14550), 1, 1, wire)
    wire.inbox.append((b"junk", ("127.0.0.1", 7)))
    assert list(calling.poll()) == []
    calling.send(heartbeat)
    assert wire.sent.pop()[1] == ("127.0.0.1", 14550)
    wire.inbox.append((packed, me))  # its answer comes from another port
    assert len(list(calling.poll())) == 1
    calling.send(heartbeat)
    assert wire.sent.pop()[1] == me
