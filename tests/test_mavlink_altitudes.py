"""Altitudes of a simulated robot that speaks MAVLink, and the capabilities that it reports."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

import skywright
from mavlink_talk import Talk, begin, local
from skywright.links.mavlink.frames import to_ned_quaternion
from skywright.links.sitl.earth import HOME
from skywright.vehicle.commands import State

ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
TAKE_OFF, REPOSITION, SET_HOME, REQUEST, TERMINATE, ARM = 22, 192, 179, 512, 185, 400
RELATIVE, UNKNOWN, NAN = 6, 2**31 - 1, math.nan
AMSL = 0
PREFIX = "MAV_PROTOCOL_CAPABILITY_"


@pytest.fixture(scope="module")
def built() -> Any:
    description = skywright.load(
        "waypoints", robot="hexarotor", sets=["mission.timestep_ms=2", "mission.hover_height_m=1"]
    )
    assert description.world.origin is None  # it lies at PX4's default home
    backend = skywright.build_vehicle(description)
    return description, backend, backend.save()


@pytest.fixture
def talk(built: Any) -> Talk:
    return begin(built)


def order(talk: Talk, number: int, frame: int, altitude: float, result: int = ACCEPTED) -> None:
    """Send a COMMAND_INT with an altitude, without a place."""
    talk.messages = []
    talk.send(
        common.MAVLink_command_int_message(
            1, 1, frame, number, 0, 0, -1, 1, 0, NAN, UNKNOWN, UNKNOWN, altitude
        )
    )
    talk.tick()
    assert talk.last("COMMAND_ACK").result == result


def rise(talk: Talk, frame: int = RELATIVE, altitude: float = 1.5) -> None:
    assert talk.command(ARM, 1.0) == ACCEPTED
    order(talk, TAKE_OFF, frame, altitude)
    talk.until(lambda: talk.vehicle.state == State.FLYING_AUTO)
    talk.tick(4.0)


def above_home(talk: Talk) -> float:
    """Return the altitude (m) above home that the robot reports."""
    talk.tick(0.2)
    return 1e-3 * float(talk.last("GLOBAL_POSITION_INT").relative_alt)


# --- altitudes ---------------------------------------------------------------------------------


def test_altitudes_above_the_terrain_are_refused(talk: Talk) -> None:
    rise(talk)
    for frame in (10, 11, 1):  # above the terrain, and local
        order(talk, REPOSITION, frame, 10.0, DENIED)
        order(talk, TAKE_OFF, frame, 10.0, DENIED)
    talk.tick(1.0)
    assert above_home(talk) == pytest.approx(1.5, abs=0.1)


def test_home_is_the_place_on_the_ground(talk: Talk) -> None:
    talk.tick(2.1)
    assert above_home(talk) == pytest.approx(0.0, abs=0.02)
    home = talk.last("HOME_POSITION")
    assert -home.z == pytest.approx(float(talk.estimate["p_WB"][2]), abs=0.02)


def test_a_robot_that_a_stream_lifts_reports_its_height_above_the_ground(talk: Talk) -> None:
    ground = np.array(talk.estimate["p_WB"])
    talk.stream_of = lambda: local(ground + [0.0, 0.0, 1.0])
    talk.tick(0.1)
    assert talk.command(176, 1.0, 6.0) == ACCEPTED
    assert talk.command(ARM, 1.0) == ACCEPTED
    talk.tick(5.0)
    assert above_home(talk) == pytest.approx(1.0, abs=0.15)


def test_commands_in_relative_frames_are_above_home(talk: Talk) -> None:
    rise(talk)
    assert above_home(talk) == pytest.approx(1.5, abs=0.08)
    order(talk, REPOSITION, RELATIVE, 2.5)
    talk.tick(5.0)
    assert above_home(talk) == pytest.approx(2.5, abs=0.08)
    assert talk.command(SET_HOME, 1.0) == ACCEPTED
    order(talk, REPOSITION, RELATIVE, 0.5)
    talk.tick(4.0)
    assert above_home(talk) == pytest.approx(0.5, abs=0.08)
    assert talk.estimate["p_WB"][2] > 2.7


def test_commands_in_other_frames_are_above_sea_level(talk: Talk) -> None:
    rise(talk, AMSL, HOME.altitude_m + 1.4)
    talk.tick(0.2)
    assert 1e-3 * talk.last("GLOBAL_POSITION_INT").alt == pytest.approx(489.4, abs=0.08)


def test_set_points_in_relative_frames_are_above_home(talk: Talk) -> None:
    """An altitude alone, with a velocity to the north."""
    rise(talk)
    start = np.array(talk.estimate["p_WB"])
    mask = 0x1 | 0x2 | 0x20 | 0x1C0 | 0xC00
    talk.stream_of = lambda: common.MAVLink_set_position_target_global_int_message(
        0, 1, 1, RELATIVE, mask, 0, 0, 2.0, 0.3, 0, 0, 0, 0, 0, 0, 0
    )
    talk.tick(0.1)
    assert talk.command(176, 1.0, 6.0) == ACCEPTED
    talk.tick(5.0)
    assert above_home(talk) == pytest.approx(2.0, abs=0.08)
    moved = talk.estimate["p_WB"] - start
    assert moved[1] > 1.0 and abs(moved[0]) < 0.2


# --- capabilities ------------------------------------------------------------------------------


def global_point() -> Any:
    here = (round(1e7 * HOME.latitude_deg), round(1e7 * HOME.longitude_deg))
    return common.MAVLink_set_position_target_global_int_message(
        0, 1, 1, RELATIVE, 0xDF8, *here, 1.0, 0, 0, 0, 0, 0, 0, 0, 0
    )


def attitude() -> Any:
    q = to_ned_quaternion(np.eye(3))
    return common.MAVLink_set_attitude_target_message(0, 1, 1, 0x7, q, 0, 0, 0, 0.5)


def is_accepted(talk: Talk, point: Any) -> bool:
    talk.service.robot.point = None
    talk.send(point)
    talk.tick()
    return talk.service.robot.point is not None


def read_parameter(talk: Talk, name: bytes) -> Any:
    talk.messages = []
    talk.send(common.MAVLink_param_request_read_message(1, 1, name, -1))
    talk.tick()
    return talk.last("PARAM_VALUE")


def is_bytewise(talk: Talk) -> bool:
    value = read_parameter(talk, b"CA_ROTOR_COUNT").param_value
    return int(np.float32(value).view(np.int32)) == 6


def is_known(talk: Talk, number: int, *p: float) -> bool:
    return talk.command(number, *p) != UNSUPPORTED


def takes_command_int(talk: Talk) -> bool:
    talk.messages = []
    talk.send(common.MAVLink_command_int_message(1, 1, 0, REQUEST, 0, 0, 148, 0, 0, 0, 0, 0, 0))
    talk.tick()
    return talk.last("COMMAND_ACK").result == ACCEPTED


def takes_missions(talk: Talk) -> bool:
    talk.messages = []
    talk.send(common.MAVLink_mission_count_message(1, 1, 1, 0))
    talk.tick()
    return talk.last("MISSION_ACK").type == 0 or bool(talk.take("MISSION_REQUEST_INT"))


def serves_files(talk: Talk) -> bool:
    talk.messages = []
    talk.send(common.MAVLink_file_transfer_protocol_message(0, 1, 1, [7, 0, 0, 4] + [0] * 247))
    talk.tick()
    return bool(talk.last("FILE_TRANSFER_PROTOCOL").payload[3] == 128)


BEHAVIOUR: dict[str, Callable[[Talk], bool]] = {
    "PARAM_FLOAT": lambda t: read_parameter(t, b"MIS_TAKEOFF_ALT").param_value == 1.5,
    "PARAM_ENCODE_BYTEWISE": is_bytewise,
    "PARAM_ENCODE_C_CAST": lambda t: not is_bytewise(t),
    "COMMAND_INT": takes_command_int,
    "SET_ATTITUDE_TARGET": lambda t: is_accepted(t, attitude()),
    "SET_POSITION_TARGET_LOCAL_NED": lambda t: is_accepted(t, local([0.0, 0.0, 1.0])),
    "SET_POSITION_TARGET_GLOBAL_INT": lambda t: is_accepted(t, global_point()),
    "FLIGHT_TERMINATION": lambda t: is_known(t, TERMINATE, 0.0),
    "MAVLINK2": lambda t: t.last("HEARTBEAT").get_msgbuf()[0] == 0xFD,
    "MISSION_INT": takes_missions,
    "MISSION_FLOAT": takes_missions,
    "FTP": serves_files,
}
"""Capability -> whether the robot has it, found by messages."""


def test_it_reports_the_capabilities_that_it_has_by_pymavlinks_names(talk: Talk) -> None:
    talk.tick(1.1)
    found = {name: has(talk) for name, has in BEHAVIOUR.items() if name != "MAVLINK2"}
    talk.tick(1.1)
    found["MAVLINK2"] = BEHAVIOUR["MAVLINK2"](talk)
    assert talk.command(REQUEST, 148) == ACCEPTED
    reported = talk.last("AUTOPILOT_VERSION").capabilities
    bits = {
        name.removeprefix(PREFIX): value for name, value in vars(common).items()
        if name.startswith(PREFIX) and not name.endswith("ENUM_END")
    }  # fmt: skip
    assert {name for name, bit in bits.items() if reported & bit} == {
        name for name, has in found.items() if has
    }
