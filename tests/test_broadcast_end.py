"""A flight whose publishing process ends: it continues, and this is printed once."""

from __future__ import annotations

import socket
import time

import pytest

import skywright


def test_a_flight_continues_without_its_publishing_process(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = int(s.getsockname()[1])
    vehicle = skywright.fly("hexarotor", backend="kinematic", live=skywright.Live(foxglove=port))
    link = vehicle.closing[0].__self__  # type: ignore[attr-defined]
    link.watched = True
    link._process.kill()
    link._process.wait()
    ends = time.monotonic() + 60.0
    while link.watched and time.monotonic() < ends:
        vehicle.tick()
    t = vehicle.t
    for _ in range(50):
        link._next_check = 0.0
        vehicle.tick()
    vehicle.close()
    assert not link.watched and vehicle.t > t
    told = capfd.readouterr().err
    assert told.count("the process that publishes the flight has ended (exit status -9)") == 1
