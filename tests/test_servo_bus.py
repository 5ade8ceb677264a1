"""The servo bus: published packets, any bytes, an emulated bus, arms in a flight."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import skywright
import skywright.links.servo_bus.bus as wire
from skywright.cli import main
from skywright.errors import InputError
from skywright.links.servo_bus import arms as arms_module
from skywright.links.servo_bus.arms import (
    ServoFlight,
    ServosFailed,
    build_emulator,
    list_driven,
    open_servos,
)
from skywright.links.servo_bus.bus import ServoBus, ServoSilent, open_bus
from skywright.links.servo_bus.emulator import SPEED_COUNTS, EmulatedServo, Emulator
from skywright.links.servo_bus.protocol import (
    BROADCAST,
    CENTRE,
    HIGHEST,
    I_JOG,
    LOWEST,
    POSITION,
    RAM_READ,
    TORQUE,
    Jog,
    Packet,
    PacketParser,
    pack,
    pack_i_jog,
    pack_read,
    pack_s_jog,
    pack_write,
    to_angle,
    to_counts,
    to_ticks,
)
from skywright.run.run import run_mission
from waiting import wait_for

PRINTED = {
    "FF FF 07 FD 09 F2 0C": Packet(0xFD, 9, b""),
    "FF FF 0A FD 03 A0 5E 34 01 60": Packet(0xFD, 3, b"\x34\x01\x60"),
    "FF FF 0C FD 05 20 DE 1E 02 08 FD 3C": Packet(0xFD, I_JOG, b"\x1e\x02\x08\xfd\x3c"),
    "FF FF 09 FD 04 C8 36 3A 02": Packet(0xFD, RAM_READ, b"\x3a\x02"),
    "FF FF 0D FD 44 B2 4C 3A 02 1F 62 00 42": Packet(0xFD, 0x44, b"\x3a\x02\x1f\x62\x00\x42"),
    "FF FF 0D FD 44 BE 40 3A 02 13 63 00 42": Packet(0xFD, 0x44, b"\x3a\x02\x13\x63\x00\x42"),
}
"""Packets that robot-mitya/herkulex-servo prints from real servos."""


@pytest.mark.parametrize("text", PRINTED)
def test_packets_of_real_servos(text: str) -> None:
    data, parser = bytes.fromhex(text), PacketParser()
    assert pack(PRINTED[text]) == data
    assert parser.feed(data) == [PRINTED[text]]


def test_positions_of_real_servos_in_degrees() -> None:
    for data, says in ((b"\x1f\x62", 10.0), (b"\x13\x63", 90.0)):
        counts = (data[0] | data[1] << 8) & 0x3FF
        assert math.degrees(to_angle(counts)) == pytest.approx(says, abs=1.0)


@settings(max_examples=80)
@given(st.integers(0, 253), st.integers(0, 255), st.binary(max_size=216), st.integers(1, 50))
def test_packets_are_found_in_any_stream(servo: int, command: int, data: bytes, cut: int) -> None:
    parser, packet = PacketParser(), Packet(servo, command, data)
    stream = b"\x01\x02" + pack(packet) + b"\x03" + pack(packet)
    found = [p for k in range(0, len(stream), cut) for p in parser.feed(stream[k : k + cut])]
    assert found == [packet, packet] and parser.counts["garbage"] == 3


@settings(max_examples=150)
@given(st.lists(st.one_of(st.binary(max_size=60), st.just(b"\xff\xff"), st.just(b"\xff"))))
def test_any_bytes_are_survived_and_little_is_kept(chunks: list[bytes]) -> None:
    parser = PacketParser()
    for chunk in chunks:
        parser.feed(chunk)
        assert len(parser._rest) < 223
    parser.reset()
    assert parser.feed(pack(Packet(1, 7, b""))) == [Packet(1, 7, b"")]


@settings(max_examples=100)
@given(st.binary(min_size=0, max_size=20), st.integers(0, 10**6), st.integers(1, 127))
def test_a_changed_byte_is_noticed(data: bytes, at: int, change: int) -> None:
    """All but the lowest bit: the checksums leave that out."""
    good = pack(Packet(5, 4, data))
    place = 3 + at % (len(good) - 3)
    bad = bytearray(good)
    bad[place] ^= change << 1 & 0xFE or 2
    parser = PacketParser()
    assert parser.feed(bytes(bad)) == []
    assert parser.counts["checksum"] + parser.counts["size"] >= 1


@settings(max_examples=60)
@given(st.floats(-10.0, 10.0))
def test_angles_and_counts(angle: float) -> None:
    counts = to_counts(angle)
    assert LOWEST <= counts <= HIGHEST
    if abs(angle) < math.radians(159.0):
        assert to_angle(counts) == pytest.approx(angle, abs=math.radians(0.163))


# --- one servo, by its bytes -------------------------------------------------------------------


class Clock:
    """A clock that is turned by hand."""

    def __init__(self) -> None:
        self.t = 0.0

    def __call__(self) -> float:
        return self.t


@pytest.fixture
def clocked() -> Iterator[tuple[Emulator, Clock]]:
    clock = Clock()
    emulator = Emulator([1, 2], clock)
    yield emulator, clock
    emulator.stop()


def read(emulator: Emulator, servo: int = 1) -> tuple[int, int, int]:
    """Position, status error and detail by a request."""
    (answer,) = emulator.feed(pack_read(servo, POSITION, 2))
    (packet,) = PacketParser().feed(answer)
    assert packet.command == 0x44 and packet.data[:2] == bytes([POSITION, 2])
    return (packet.data[2] | packet.data[3] << 8) & 0x3FF, packet.data[4], packet.data[5]


def test_a_servo_moves_in_its_play_time_and_only_with_torque(
    clocked: tuple[Emulator, Clock],
) -> None:
    emulator, clock = clocked
    emulator.feed(pack_s_jog(to_ticks(0.5), [Jog(1, 600), Jog(2, 400)]))
    clock.t = 1.0
    assert read(emulator)[0] == CENTRE  # torque is off after the start
    assert emulator.feed(pack_write(BROADCAST, TORQUE, b"\x60")) == []  # nobody answers a broadcast
    emulator.feed(pack_s_jog(to_ticks(0.5), [Jog(1, 600), Jog(2, 400)]))
    clock.t += 0.25
    assert read(emulator)[0] == pytest.approx(CENTRE + 44, abs=2)
    assert read(emulator)[2] & 0x41 == 0x41  # moving, motor on
    clock.t += 0.4
    assert read(emulator)[0] == 600 and read(emulator, 2)[0] == 400
    assert read(emulator)[2] & 0x03 == 0x02  # in position
    emulator.feed(pack_i_jog([Jog(1, 512, 1), Jog(2, 1002, 200)]))
    clock.t += 0.03
    assert 600 - read(emulator)[0] == pytest.approx(0.03 * SPEED_COUNTS, abs=2)  # its own speed


def test_what_a_servo_does_not_understand_it_says(clocked: tuple[Emulator, Clock]) -> None:
    emulator, _ = clocked
    (answer,) = emulator.feed(pack_read(1, 70, 40))
    (packet,) = PacketParser().feed(answer)
    assert packet.data[-2] == 0x08 and packet.data[-1] & 0x10  # invalid packet: out of range
    emulator.feed(pack_write(1, 0x30, b"\x00\x00"))
    assert read(emulator)[1] == 0
    emulator.feed(pack_write(1, POSITION, b"\x00\x00"))  # a register that is read only
    assert read(emulator)[1] == 0x08
    assert emulator.feed(pack_write(1, TORQUE, b"\x60")) == []  # policy: reads only
    emulator.feed(pack_write(1, 0x01, b"\x02"))
    assert len(emulator.feed(pack_write(1, TORQUE, b"\x60"))) == 1  # policy: all
    emulator.feed(pack_write(1, 0x01, b"\x00"))
    assert emulator.feed(pack_read(1, POSITION, 2)) == []  # policy: none


def test_an_overload_switches_torque_off_until_it_is_cleared() -> None:
    servo = EmulatedServo(1, stuck=True)
    servo.answer(Packet(1, 3, bytes([TORQUE, 1, 0x60])))
    servo.jog(600, 10)
    servo.advance(0.1)
    assert servo.ram[0x30] == 0x10 and not servo.on
    servo.stuck = False
    servo.answer(Packet(1, 3, bytes([0x30, 2, 0, 0])))
    servo.answer(Packet(1, 3, bytes([TORQUE, 1, 0x60])))
    servo.jog(600, 10)
    servo.advance(1.0)
    assert servo.now == 600


# --- the bus over a pseudo-terminal ------------------------------------------------------------


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a loaded machine the emulator's thread answers late."""
    monkeypatch.setattr(wire, "ANSWER_S", 0.25)
    monkeypatch.setattr(arms_module, "LOST_S", 30.0)


@pytest.fixture
def served(patient: None) -> Iterator[tuple[Emulator, ServoBus]]:
    emulator = Emulator([1, 2, 7])
    emulator.start()
    bus = open_bus(f"serial:{emulator.path}:666666")
    yield emulator, bus
    bus.close()
    emulator.stop()


def test_requests_over_a_terminal(served: tuple[Emulator, ServoBus]) -> None:
    emulator, bus = served
    assert bus.find_servos(range(9)) == [1, 2, 7]
    assert bus.read_position(7)[0] == CENTRE
    assert bus.read_supply(7)[0] == pytest.approx(7.4)
    bus.set_torque(True)
    assert bus.read_status(1).torque
    bus.jog_together(1, [Jog(1, 530)])
    wait_for(lambda: bus.read_position(1)[0] == 530)
    emulator.servos[2].ram[0x30] = 0x14
    assert bus.read_status(2).says == "too hot, overload"
    bus.clear_errors(2)
    bus.reboot(1)
    assert bus.read_status(2).error == 0 and not bus.read_status(1).torque


def test_a_wrong_checksum_is_asked_again_and_silence_is_told(
    served: tuple[Emulator, ServoBus],
) -> None:
    emulator, bus = served
    emulator.servos[1].corrupt = 1
    assert bus.read_position(1)[0] == CENTRE
    emulator.servos[2].silent = True
    with pytest.raises(ServoSilent, match="servo 2 does not answer"):
        bus.read_position(2)
    says = "\n".join(bus.describe_refused())
    assert "1: a packet whose checksum is wrong" in says and "without an answer in time" in says


@pytest.mark.parametrize("text", ["serial:", "udp:3", "serial:/dev/x:123", "serial:/no/such/port"])
def test_wrong_ports_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="--servos"):
        open_bus(text)


def test_the_command_lists_servos(patient: None) -> None:
    emulator = build_emulator(skywright.load_robot("bimanual"))
    emulator.start()
    try:
        out = CliRunner().invoke(main, ["servos", f"serial:{emulator.path}", "--last", "9"])
    finally:
        emulator.stop()
    assert out.exit_code == 0, out.output
    assert out.output.count("7.4 V, torque off") == len(emulator.servos)
    assert CliRunner().invoke(main, ["servos"]).exit_code == 2


# --- arms of a flight ---------------------------------------------------------------------------


def test_a_robot_without_position_servos_is_refused() -> None:
    with pytest.raises(InputError, match="no arms with position servos"):
        list_driven(skywright.load_robot("hexarotor"))


@pytest.fixture
def arms(patient: None) -> Iterator[tuple[Emulator, ServoFlight]]:
    robot = skywright.load_robot("bimanual")
    emulator = build_emulator(robot)
    emulator.start()
    real = open_servos(f"serial:{emulator.path}:666666", robot)
    yield emulator, real
    real.close()
    emulator.stop()


def tick_until(uav: Any, reached: Callable[[], bool], most_s: float = 20.0) -> None:
    """Tick until `reached`: worker and emulator share this process, and lag on a busy machine."""
    end = time.monotonic() + most_s
    while not reached():
        assert time.monotonic() < end, "not reached"
        uav.tick()


def test_the_arms_of_a_flight_are_the_servos(arms: tuple[Emulator, ServoFlight]) -> None:
    emulator, real = arms
    uav = skywright.fly("bimanual", world="open", seed=1, parts=real.parts, checklist=False)
    driven = real.driven
    goal = np.array(uav.joints.q)
    moved = next(d for d in driven if "elbow" in d.name)
    start, by = emulator.read_angle(moved.servo), math.radians(15.0)
    goal[moved.joint] += by
    uav.arms.plain.move_to(goal)  # on the ground, without the vehicle's checks

    def is_there() -> bool:
        shaft = emulator.read_angle(moved.servo) - start
        # the spring's deflection under the forearm stays between shaft and link
        link = uav.joints.q[moved.joint] - goal[moved.joint]
        return abs(shaft - by) < math.radians(2.0) and abs(link) < math.radians(4.0)

    tick_until(uav, is_there)
    # a servo that is turned by a hand, against its torque, turns the simulated link
    with emulator.lock:
        emulator.servos[moved.servo].now += 40.0  # 13 deg
        emulator.servos[moved.servo].advance = lambda dt: None  # type: ignore[method-assign]
    tick_until(uav, lambda: uav.joints.q[moved.joint] - goal[moved.joint] > math.radians(8.0))
    assert any("round of readings" in line for line in real.describe())
    emulator.servos[moved.servo].ram[0x30] = 0x20
    with pytest.raises(ServosFailed, match=rf"servo {moved.servo} .*driver fault"):
        tick_until(uav, lambda: False)


def test_a_servo_that_is_lost_ends_the_flight(
    arms: tuple[Emulator, ServoFlight], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arms_module, "LOST_S", 3.0)
    emulator, real = arms
    uav = skywright.fly("bimanual", world="open", seed=1, parts=real.parts, checklist=False)
    emulator.servos[3].silent = True
    with pytest.raises(ServosFailed, match=r"servo 3 \(.*\) has not answered for \d"):
        tick_until(uav, lambda: False)
    assert real.stale > 0


def test_an_absent_servo_is_told_before_the_flight(arms: tuple[Emulator, ServoFlight]) -> None:
    emulator, real = arms
    emulator.servos[5].silent = True
    with pytest.raises(InputError, match=r"servo 5 \(.*\) does not answer; those that do: 1, 2"):
        skywright.fly("bimanual", world="open", seed=1, parts=real.parts, checklist=False)


def test_a_run_with_an_absent_servo_is_refused_before_anything_is_written(
    arms: tuple[Emulator, ServoFlight], tmp_path: Path
) -> None:
    emulator, real = arms
    emulator.servos[5].silent = True
    description = skywright.load("waypoints", robot="bimanual")
    with pytest.raises(InputError, match=r"servo \d \(.*\) does not answer; those that do: "):
        run_mission(description, out=tmp_path / "run", observers=[real])
    assert not list(tmp_path.iterdir())
    assert not any(s.ram[TORQUE] for s in emulator.servos.values())  # nothing moved


def test_a_servo_far_from_the_start_is_told_before_the_flight(
    arms: tuple[Emulator, ServoFlight],
) -> None:
    emulator, real = arms
    emulator.servos[1].now += 150
    with pytest.raises(InputError, match=r"servo 1 \(.*\) stands \+[45]\d deg"):
        skywright.fly("bimanual", world="open", seed=1, parts=real.parts, checklist=False)
