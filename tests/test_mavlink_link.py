"""The companion's link: whose messages it processes, commands, wires, long texts, set-points."""

from __future__ import annotations

import errno
import math
import os
import socket
import types
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from mavlink_pair import Cable, Ends, PairClock
from skywright.description.world.origin import Origin
from skywright.links.mavlink import modes
from skywright.links.mavlink.endpoint import Endpoint, SerialWire, TcpWire, Url
from skywright.links.mavlink.heard import Heard
from skywright.links.mavlink.link import COMMAND_S, Target, VehicleLink
from skywright.links.mavlink.orders import land_and_disarm
from skywright.links.mavlink.server import LONGEST, TEXT, Server
from skywright.links.mavlink.setpoints import SetPoint, read_global
from skywright.links.mavlink.stream import MavlinkStream
from skywright.vehicle.geodesy import Geodetic, to_local

SET_MODE, ARM = 176, 400
OFFBOARD = (1.0, 6.0, 0.0)
PX4, ARDUPILOT, GENERIC = 12, 3, 0  # MAV_AUTOPILOT
IN_PROGRESS = 5


class Autopilot:
    """A scripted vehicle at the other end of a link, on the link's clock."""

    def __init__(self, component: int = 1) -> None:
        self.clock = PairClock()
        self.up, self.down = Cable(self.clock), Cable(self.clock)
        self.link = VehicleLink(
            Endpoint(Url("udpout", "127.0.0.1", 1), 1, 191, Ends(self.up, self.down)), self.clock
        )
        self.stream, self._heard = MavlinkStream(1, component), MavlinkStream()
        self.armed, self.mode, self.lands = False, modes.HOLD, True
        self.refuses: Callable[[Any], int] = lambda m: 0
        self.answers = True
        self.commands: list[Any] = []
        self.points: list[Any] = []
        self._beat = 0.0
        self.clock.step = self._step
        self.clock.sleep(1.5)  # the first heartbeat

    def say(self, message: Any) -> None:
        self.down.put(self.stream.pack(message))

    def acknowledge(self, command: int, result: int, to: tuple[int, int] = (1, 191)) -> None:
        self.say(common.MAVLink_command_ack_message(command, result, 0, 0, *to))

    def _step(self) -> None:
        while (data := self.up.get()) is not None:
            for m in self._heard.feed(data):
                if m.get_type() == "COMMAND_LONG" and m.command in (SET_MODE, ARM):
                    self.commands.append(m)
                    self._do(m)
                elif m.get_type().startswith("SET_POSITION"):
                    self.points.append(m)
        if self.clock.t - self._beat >= 1.0:
            self._beat = self.clock.t
            base = 1 | (128 if self.armed else 0)
            self.say(common.MAVLink_heartbeat_message(2, PX4, base, self.mode.custom, 4, 3))
        self.link.step()

    def _do(self, m: Any) -> None:
        result = self.refuses(m)
        if self.answers:
            self.acknowledge(m.command, result)
        if result != 0:
            return
        if m.command == ARM:
            self.armed = m.param1 == 1.0
        else:
            self.mode = modes.Mode(int(m.param2), int(m.param3))
            self.armed = self.armed and not (self.mode == modes.LAND and self.lands)


# --- whose messages ----------------------------------------------------------------------------


def give(heard: Heard, sender: tuple[int, int], message: Any, now: float = 1.0) -> None:
    for m in MavlinkStream().feed(MavlinkStream(*sender).pack(message)):
        heard.take(m, now)


def beat(autopilot: int, base: int = 0, mode: int = 0) -> Any:
    return common.MAVLink_heartbeat_message(2, autopilot, base, mode, 4, 3)


def test_a_gimbal_with_the_same_system_id_changes_nothing() -> None:
    heard = Heard()
    give(heard, (1, 154), beat(GENERIC))  # also if it is heard first
    give(heard, (1, 1), beat(PX4, 129, modes.OFFBOARD.custom))
    give(heard, (1, 154), beat(GENERIC), 9.0)
    give(heard, (1, 154), common.MAVLink_extended_sys_state_message(0, 1), 9.0)
    assert (heard.system, heard.component) == (1, 1)
    assert heard.armed and heard.mode == modes.OFFBOARD and heard.landed == 0
    assert heard.beat == heard.message == 1.0


def test_only_px4_is_a_vehicle() -> None:
    """DO_SET_MODE (1, 6, 0) is Offboard for PX4 and RTL for ArduPilot."""
    heard = Heard()
    give(heard, (7, 1), beat(ARDUPILOT, 81))
    give(heard, (255, 190), beat(8))  # a ground station
    assert not heard.system and heard.others == {(7, 1): ARDUPILOT}
    give(heard, (2, 3), beat(PX4))
    assert (heard.system, heard.component) == (2, 3)


@pytest.mark.parametrize(
    ("target", "taken"),
    [((0, 0), True), ((1, 191), True), ((1, 0), True), ((255, 190), False), ((1, 190), False)],
)
def test_an_answer_to_another_sender_is_none(target: tuple[int, int], taken: bool) -> None:
    heard = Heard((1, 191))
    give(heard, (1, 1), beat(PX4))
    give(heard, (1, 1), common.MAVLink_command_ack_message(SET_MODE, 2, 0, 0, *target))
    assert bool(heard.acks) is taken


def test_commands_and_set_points_are_addressed_to_the_vehicles_component() -> None:
    vehicle = Autopilot(component=3)
    assert vehicle.link.command(ARM, 1.0) == ""
    vehicle.link.lead(Target(np.zeros(3), np.zeros(3), np.zeros(3), np.eye(3), 0.0))
    vehicle.clock.sleep(0.1)
    for message in (*vehicle.commands, *vehicle.points):
        assert (message.target_system, message.target_component) == (1, 3)
    assert vehicle.points


# --- commands ----------------------------------------------------------------------------------


def test_a_command_that_stays_in_progress_is_sent_again_and_ends() -> None:
    """One report of progress prolongs the wait once."""
    vehicle = Autopilot()
    vehicle.refuses = lambda m: IN_PROGRESS if m.confirmation == 0 else 99
    vehicle.answers = False
    once = [False]

    def report(t: float) -> bool:
        if vehicle.commands and not once[0]:
            once[0] = True
            vehicle.acknowledge(ARM, IN_PROGRESS)
        return False

    vehicle.up.lost = report
    start = vehicle.clock.t
    assert "in progress" in vehicle.link.command(ARM, 1.0)
    assert vehicle.clock.t - start < 3.0
    assert [m.confirmation for m in vehicle.commands] == [0, 1, 2]


def test_reports_of_progress_prolong_the_wait_until_the_result_or_the_limit() -> None:
    vehicle = Autopilot()
    vehicle.refuses = lambda m: IN_PROGRESS
    began, step = vehicle.clock.t, vehicle.clock.step
    results = {5.0: 0}  # s -> result

    def work() -> None:
        step()
        t = vehicle.clock.t - began
        if round(t / 0.02) % 25 == 0:
            vehicle.acknowledge(ARM, next((r for at, r in results.items() if t >= at), IN_PROGRESS))

    vehicle.clock.step = work
    assert vehicle.link.command(ARM, 1.0) == ""
    assert 5.0 <= vehicle.clock.t - began < 5.7 and len(vehicle.commands) == 1
    results.clear()
    start = vehicle.clock.t
    assert "in progress" in vehicle.link.command(ARM, 1.0)
    assert vehicle.clock.t - start == pytest.approx(COMMAND_S, abs=0.1)


# --- a vehicle that a mission leaves on the ground ---------------------------------------------


def test_motors_that_are_off_need_no_command() -> None:
    vehicle = Autopilot()
    assert land_and_disarm(vehicle.link) == "" and not vehicle.commands


def test_an_armed_vehicle_in_offboard_is_landed() -> None:
    vehicle = Autopilot()
    vehicle.armed, vehicle.mode = True, modes.OFFBOARD
    assert land_and_disarm(vehicle.link) == "its motors were stopped"
    assert not vehicle.armed and [m.command for m in vehicle.commands] == [SET_MODE]


def test_an_autopilot_that_does_not_disarm_after_landing_is_disarmed() -> None:
    vehicle = Autopilot()
    vehicle.armed, vehicle.mode, vehicle.lands = True, modes.OFFBOARD, False
    assert land_and_disarm(vehicle.link) == "its motors were stopped"
    assert [(m.command, m.param1) for m in vehicle.commands] == [(SET_MODE, 1.0), (ARM, 0.0)]


def test_a_vehicle_that_refuses_to_stop_is_named_as_armed() -> None:
    vehicle = Autopilot()
    vehicle.armed, vehicle.mode, vehicle.refuses = True, modes.OFFBOARD, lambda m: 2
    assert "still armed (denied)" in land_and_disarm(vehicle.link)
    assert vehicle.armed


def test_a_vehicle_that_a_pilot_flies_is_left_to_the_pilot() -> None:
    vehicle = Autopilot()
    vehicle.armed, vehicle.mode = True, modes.POSITION
    assert "its mode is Position" in land_and_disarm(vehicle.link)
    assert not vehicle.commands


def test_a_vehicle_that_left_offboard_by_its_own_rule_is_only_disarmed() -> None:
    vehicle = Autopilot()
    vehicle.armed, vehicle.mode = True, modes.HOLD
    assert land_and_disarm(vehicle.link) == "its motors were stopped"
    assert [(m.command, m.param1) for m in vehicle.commands] == [(ARM, 0.0)]


def test_without_a_heartbeat_the_state_is_unknown() -> None:
    vehicle = Autopilot()
    vehicle.armed, vehicle.mode = True, modes.OFFBOARD
    vehicle.down.lost = lambda t: True
    assert "its heartbeat is missing" in land_and_disarm(vehicle.link)
    assert not vehicle.armed  # the commands arrive


# --- wires -------------------------------------------------------------------------------------


def packets(n: int) -> list[bytes]:
    stream = MavlinkStream(1, 191)
    return [
        stream.pack(common.MAVLink_statustext_message(6, f"{k:050d}".encode())) for k in range(n)
    ]


def read_numbers(data: bytes) -> list[int]:
    """Return the numbers of whole packets; no byte may belong to a cut one."""
    stream = MavlinkStream()
    found = [int(m.text) for m in stream.feed(data)]
    assert set(stream.counts) <= {"accepted"}, stream.counts
    return found


class Narrow:
    """A port that takes 7 bytes, 60 bytes or nothing."""

    def __init__(self) -> None:
        self.taken, self._calls = b"", 0

    def send(self, data: bytes) -> int:
        self._calls += 1
        room = (7, 0, 60, 0, 13)[self._calls % 5]
        if room == 0:
            raise BlockingIOError(errno.EAGAIN, "no room")
        self.taken += bytes(data[:room])
        return len(data[:room])

    def close(self) -> None:
        return


def check_wire(wire: Any, port: Narrow) -> None:
    for packet in packets(200):
        wire.send(packet, None)
    while wire._rest:
        wire.send(packets(1)[0], None)
    got = read_numbers(port.taken)
    assert len(got) > 20 and got == sorted(got[:-1]) + got[-1:]


def test_a_tcp_connection_sends_whole_packets(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        wire = TcpWire(Url("tcp", *listener.getsockname()))
        wire._socket.close()  # type: ignore[union-attr]
        port = Narrow()
        wire._socket = port  # type: ignore[assignment]
        check_wire(wire, port)


def test_a_tcp_connection_whose_reader_pauses_loses_whole_packets() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        wire = TcpWire(Url("tcp", *listener.getsockname()))
        reader, _ = listener.accept()
        assert wire._socket is not None
        wire._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        reader.settimeout(5.0)
        data, sent = b"", packets(2000)
        for packet in sent:
            wire.send(packet, None)
        for packet in sent:
            if len(data) < 100 * len(packet):
                data += reader.recv(65536)
            wire.send(packet, None)
        wire.close()
        reader.close()
    whole = len(data) // len(sent[0]) * len(sent[0])
    assert 20 < len(read_numbers(data[:whole])) < 4000


def test_a_serial_port_that_nobody_reads_does_not_hold_its_sender() -> None:
    pytest.importorskip("serial")
    ours, theirs = os.openpty()
    os.set_blocking(ours, False)
    wire = SerialWire(Url("serial", os.ttyname(theirs), 57600))
    for packet in packets(20_000):  # more than the buffer holds
        wire.send(packet, None)
    data = b""
    while wire._rest or not data:
        data += os.read(ours, 65536)
        wire.send(packets(1)[0], None)
    got = read_numbers(data)
    assert 20 < len(got) < 20_000 and got[:20] == list(range(got[0], got[0] + 20))
    wire.close()
    os.close(ours)
    os.close(theirs)


# --- texts -------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [0, 1, 49, 50, 51, 99, 100, 150, 200, 249, 250, 400])
def test_the_last_of_several_chunks_contains_a_nul(n: int) -> None:
    """common.xml, STATUSTEXT.chunk_seq: a null in the text means that this was the last chunk."""
    sent: list[Any] = []
    text = ("0123456789" * 40)[:n]
    Server.say(types.SimpleNamespace(_told={}, d=common, _send=sent.append), text)  # type: ignore[arg-type]
    chunks = [m.text for m in sent]
    assert "".join(chunks) == text[:LONGEST]
    if n <= TEXT:
        assert len(sent) == 1 and sent[0].id == 0  # complete: processed at once
        return
    assert len({m.id for m in sent}) == 1 and sent[0].id != 0
    assert [m.chunk_seq for m in sent] == list(range(len(sent)))
    assert all(len(c) == TEXT for c in chunks[:-1]) and len(chunks[-1]) < TEXT
    heard = Heard()
    give(heard, (1, 1), beat(PX4))
    for m in sent:
        give(heard, (1, 1), m)
    assert [t for _, t in heard.texts] == [text[:LONGEST]]


# --- global set-points -------------------------------------------------------------------------

ORIGIN = Origin(latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0)
REST = 0x1C0 | 0x400 | 0x800  # accelerations, yaw, its rate: not given


def read(mask: int, frame: int, alt: float, v: tuple[float, float, float] = (0.5, 0.0, 0.0)) -> Any:
    message = common.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask | REST, 470001000, 80001000, alt, *v, 0, 0, 0, 0, 0
    )
    return read_global(message, ORIGIN, 0.3)


def test_an_altitude_alone_is_kept() -> None:
    point = read(0x1 | 0x2 | 0x20, 6, 5.0)
    assert isinstance(point, SetPoint)
    assert np.isnan(point.p[:2]).all() and point.p[2] == pytest.approx(5.3)
    assert point.v[1] == 0.5 and math.isnan(point.v[2])
    assert read(0x1 | 0x2, 0, 405.0).p[2] == pytest.approx(5.0)


def test_a_place_without_altitude_has_no_height() -> None:
    place = to_local(ORIGIN, Geodetic(47.0001, 8.0001, 400.0))
    point = read(0x4, 6, 5.0)
    assert point.p[:2] == pytest.approx(place[:2], abs=1e-3) and math.isnan(point.p[2])


@pytest.mark.parametrize("mask", [0x1, 0x2])
def test_a_latitude_without_a_longitude_is_refused(mask: int) -> None:
    assert "give both" in read(mask, 6, 5.0)


@pytest.mark.parametrize(
    ("frame", "alt", "z"), [(0, 405.0, 5.0), (5, 405.0, 5.0), (3, 5.0, 5.3), (6, 5.0, 5.3)]
)
def test_altitudes_are_above_sea_level_or_above_home(frame: int, alt: float, z: float) -> None:
    assert read(0, frame, alt).p[2] == pytest.approx(z, abs=1e-3)
