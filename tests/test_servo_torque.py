"""Servos without torque, disturbed packets, and how a start or a flight with servos ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import skywright
import skywright.links.servo_bus.bus as wire
import skywright.links.servo_bus.worker as work
from skywright.errors import InputError
from skywright.links.servo_bus import arms as arms_module
from skywright.links.servo_bus.arms import ServoFlight, ServosFailed, build_emulator, open_servos
from skywright.links.servo_bus.bus import ServoBus, open_bus
from skywright.links.servo_bus.emulator import Emulator
from skywright.links.servo_bus.protocol import (
    BROADCAST,
    POSITION,
    STATUS,
    TORQUE,
    PacketParser,
    pack_read,
    pack_write,
)
from skywright.links.servo_bus.worker import ServoWorker
from skywright.run.run import run_mission
from waiting import wait_for

NAMES = {1: "shoulder", 2: "elbow"}
GOALS = {1: 0.2, 2: 0.2}


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a loaded machine the emulator's thread answers late."""
    monkeypatch.setattr(wire, "ANSWER_S", 0.25)
    monkeypatch.setattr(arms_module, "LOST_S", 30.0)


@pytest.fixture
def pair(patient: None) -> Iterator[tuple[Emulator, ServoBus, ServoWorker]]:
    emulator = Emulator([1, 2])
    emulator.start()
    bus = open_bus(f"serial:{emulator.path}:666666")
    worker = ServoWorker(bus, [1, 2])
    yield emulator, bus, worker
    worker.stop()
    emulator.stop()


@pytest.fixture
def arms(patient: None) -> Iterator[tuple[Emulator, ServoFlight]]:
    robot = skywright.load_robot("bimanual")
    emulator = build_emulator(robot)
    emulator.start()
    real = open_servos(f"serial:{emulator.path}:666666", robot)
    yield emulator, real
    real.close()
    emulator.stop()


def lose_torque_writes(
    bus: ServoBus, monkeypatch: pytest.MonkeyPatch, is_lost: Callable[[int, int], bool]
) -> None:
    """Switch torque of servos 1 and 2 separately, without the writes that are lost.

    `is_lost(servo, k)` decides for the k-th write to a servo.
    """
    send, count = bus.set_torque, {1: 0, 2: 0}

    def write(on: bool, servo: int = BROADCAST) -> None:
        for each in (1, 2) if servo == BROADCAST else (servo,):
            lost = is_lost(each, count[each])
            count[each] += 1
            if not lost:
                send(on, each)

    monkeypatch.setattr(bus, "set_torque", write)


# --- the start ----------------------------------------------------------------------------------


def test_a_lost_torque_packet_is_repeated(
    pair: tuple[Emulator, ServoBus, ServoWorker], monkeypatch: pytest.MonkeyPatch
) -> None:
    emulator, bus, worker = pair
    lose_torque_writes(bus, monkeypatch, lambda servo, k: servo == 1 and k == 0)
    worker.start_up(GOALS, NAMES)
    assert all(s.on for s in emulator.servos.values())
    assert worker.read()[1].status.torque
    assert emulator.read_angle(1) == pytest.approx(0.2, abs=0.01)


def test_a_servo_that_gets_no_torque_is_refused_and_the_others_are_released(
    pair: tuple[Emulator, ServoBus, ServoWorker], monkeypatch: pytest.MonkeyPatch
) -> None:
    emulator, bus, worker = pair
    lose_torque_writes(bus, monkeypatch, lambda servo, k: servo == 2)
    with pytest.raises(InputError, match=r"servo 2 \(elbow\): its torque is off after 3 requests"):
        worker.start_up(GOALS, NAMES)
    wait_for(lambda: not emulator.servos[1].on)
    assert emulator.read_angle(1) == 0.0 and not worker.is_alive()  # nothing has moved


def test_a_supply_that_dips_in_the_motion_to_the_start_is_refused(
    pair: tuple[Emulator, ServoBus, ServoWorker], monkeypatch: pytest.MonkeyPatch
) -> None:
    emulator, _, worker = pair

    def dip(seconds: float) -> None:
        with emulator.lock:
            emulator.servos[2].reboot()

    monkeypatch.setattr(work, "time", SimpleNamespace(sleep=dip))
    with pytest.raises(InputError, match=r"servo 2 \(elbow\): its torque is off: it has restarted"):
        worker.start_up(GOALS, NAMES)


def test_a_shaft_that_does_not_reach_the_start_is_refused(
    pair: tuple[Emulator, ServoBus, ServoWorker], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The packet of the motion is lost: 0.4 rad remain, within the 30 deg before the motion."""
    _, bus, worker = pair
    monkeypatch.setattr(bus, "jog_together", lambda ticks, jogs: None)
    with pytest.raises(InputError, match=r"servo 1 .* -23 deg from its goal .*: within 10 deg"):
        worker.start_up({1: 0.4, 2: 0.0}, NAMES)


def test_an_interrupted_start_leaves_torque_as_it_was(
    pair: tuple[Emulator, ServoBus, ServoWorker], monkeypatch: pytest.MonkeyPatch
) -> None:
    emulator, bus, worker = pair
    bus.set_torque(True, 1)  # an earlier flight has left it on
    wait_for(lambda: emulator.servos[1].on)

    def interrupt(seconds: float) -> None:
        assert bus.read_status(2).torque
        raise KeyboardInterrupt

    monkeypatch.setattr(work, "time", SimpleNamespace(sleep=interrupt))
    with pytest.raises(KeyboardInterrupt):
        worker.start_up(GOALS, NAMES)
    wait_for(lambda: not emulator.servos[2].on)
    assert emulator.servos[1].on and not worker.is_alive()


# --- in flight ----------------------------------------------------------------------------------


def tick_until(uav: Any, reached: Callable[[], object]) -> None:
    end = time.monotonic() + 60.0
    while not reached():
        assert time.monotonic() < end, "not reached"
        uav.tick()


def test_a_servo_that_restarts_ends_the_flight_and_the_others_hold(
    arms: tuple[Emulator, ServoFlight], capsys: pytest.CaptureFixture[str]
) -> None:
    emulator, real = arms
    uav = skywright.fly("bimanual", world="open", seed=1, parts=real.parts, checklist=False)
    with emulator.lock:
        emulator.servos[3].reboot()
    with pytest.raises(ServosFailed, match=r"servo 3 \(.*\): its torque is off: it has restarted"):
        tick_until(uav, lambda: False)
    real.close()
    real.close()
    assert capsys.readouterr().err.count("torque is off at servo 3 and stays on elsewhere") == 1
    assert [i for i, s in emulator.servos.items() if not s.on] == [3]


def test_noise_on_the_wire_is_counted_and_cleared(arms: tuple[Emulator, ServoFlight]) -> None:
    emulator, real = arms
    uav = skywright.fly("bimanual", world="open", seed=1, parts=real.parts, checklist=False)
    emulator.feed(b"\x00")  # one byte that belongs to no packet: every servo hears it
    tick_until(uav, lambda: not any(s.ram[STATUS] for s in emulator.servos.values()))
    assert any("a packet it did not understand" in line for line in real.describe())
    assert all(s.on for s in emulator.servos.values())
    with emulator.lock:
        emulator.servos[2].ram[STATUS] |= 0x0C  # noise does not hide another error
    with pytest.raises(ServosFailed, match=r"servo 2 \(.*\): too hot$"):
        tick_until(uav, lambda: False)


def test_an_interrupted_flight_is_recorded_and_the_servos_hold(
    arms: tuple[Emulator, ServoFlight], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    emulator, real = arms
    pace = real._pace

    def interrupt(t: float) -> None:
        if t > 0.5:
            raise KeyboardInterrupt
        pace(t)

    monkeypatch.setattr(real, "_pace", interrupt)
    description = skywright.load("waypoints", robot="bimanual")
    result = run_mission(description, out=tmp_path / "run", observers=[real])
    assert result.outcome == "interrupted" and not real._worker.is_alive()
    assert all(s.on for s in emulator.servos.values())


def test_an_emulated_servo_reports_noise_until_it_is_cleared() -> None:
    emulator = Emulator([1])
    try:
        bad = bytearray(pack_write(1, TORQUE, b"\x60"))
        bad[-1] ^= 0x10
        details = []
        for data in (b"\x00", bytes(bad)):
            emulator.feed(data)
            emulator.feed(pack_read(1, POSITION, 2))
            (answer,) = emulator.feed(pack_read(1, POSITION, 2))
            (packet,) = PacketParser().feed(answer)
            assert packet.data[-2] == 0x08
            details.append(packet.data[-1])
            emulator.feed(pack_write(1, STATUS, b"\x00\x00"))
            assert emulator.servos[1].ram[STATUS] == 0
        assert details[0] & 0x20 and details[1] & 0x04  # garbage, wrong checksum
        assert not emulator.servos[1].on
    finally:
        emulator.stop()
