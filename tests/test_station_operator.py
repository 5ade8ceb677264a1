"""Operators at the ground station's socket: what they are told, and work done through a page."""

from __future__ import annotations

import asyncio
import importlib.util
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from skywright.ground.feed import Feed
from skywright.ground.operator_model import ModelOperator
from skywright.ground.station import Station
from skywright.links.pair import build_pair, parse, receive, say
from skywright.recordings.recording import read_recording
from skywright.run.operator import Sight

SIGHT = Sight(np.array([0.01, -0.02, -0.05]), False, (0.0, 0.0, 1.0), 1.25, 2.0, 5.0)
CHOICES = {
    "proposed": "", "missions": {"waypoints": "x"}, "robots": {}, "worlds": {},
    "backends": {"physics": "x", "kinematic": "x"},
}  # fmt: skip


def _load(repository: Path, name: str) -> ModuleType:
    path = repository / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def test_a_watched_flight_tells_what_its_operator_sees(tmp_path: Path) -> None:
    ours, theirs = build_pair()
    feed = Feed(theirs, tmp_path)
    feed.tell_sight(0.5, SIGHT)
    assert list(receive(ours)) == []  # nobody watches
    say(ours, "watch", n=1)
    feed.poll()
    feed.tell_sight(0.5, SIGHT)
    feed.tell_sight(0.52, SIGHT._replace(off=np.array([math.nan, 0.0, 0.0])))
    feed.tell_sight(0.54, SIGHT._replace(force=math.inf))
    told = [parse(data) for data in receive(ours)]
    assert told == [{
        "k": "sight", "t": 0.5, "off": [0.01, -0.02, -0.05], "done": False,
        "towards": [0.0, 0.0, 1.0], "force": 1.25, "asked": 2.0, "hold_s": 5.0,
    }]  # fmt: skip


def test_the_station_hands_it_on_to_every_page_the_newest_alone(tmp_path: Path) -> None:
    async def talk() -> list[Any]:
        station, (ours, theirs) = Station(tmp_path, CHOICES, {}), build_pair()
        station.host(ours, tmp_path)
        pages = [station.enter(), station.enter()]
        for t in (0.1, 0.2):
            say(theirs, "sight", t=t, off=[0.0, 0.0, 0.0])
        say(theirs, "gossip", t=1.0)
        while not station.counts["bad word of a flight"]:
            await asyncio.sleep(0.01)
        await station.close()
        theirs.close()
        return [page.words["sight"] for page in pages if page is not None]

    assert asyncio.run(talk()) == [{"k": "sight", "t": 0.2, "off": [0.0, 0.0, 0.0]}] * 2


@pytest.fixture
def station(repository: Path, tmp_path: Path) -> Iterator[tuple[Any, Any]]:
    """The client's module, and a page of a station that runs in `tmp_path`."""
    client = _load(repository, "station_client")
    process, address = client.start_station(tmp_path, "waypoints")
    page = client.Page(address)
    page.station = process
    page.send("take")
    yield client, page
    page.close()
    process.terminate()
    process.wait(60)
    assert "Traceback" not in (tmp_path / "station.log").read_text()


def _fly(page: Any, mission: str, **more: Any) -> None:
    page.send("start", mission=mission, **more)
    assert page.wait(lambda: page.status.get("over") is False, 300.0), page.state.get("note")


def test_a_scripted_operator_presses_the_sensor_through_the_pages_socket(
    station: tuple[Any, Any],
) -> None:
    """With 150 ms of delay; benchmarks/operate_station.py does so 20 times."""
    client, page = station
    sets = [
        "mission.task.hover_s=0", "mission.task.swing_deg=0", "mission.task.survey=false",
        "mission.timestep_ms=2",
    ]  # fmt: skip
    _fly(page, "sensor-install", sets=sets, operated=True)
    page.send("speed", x=0)
    assert page.wait(lambda: bool(page.status.get("asked")), 300.0)
    pilot, ends = (
        client.Pilot(page, ModelOperator("careful", 1, 0.03), 0.15),
        time.monotonic() + 240,
    )
    while page.status.get("asked") and time.monotonic() < ends:
        page.poll(0.02)
        pilot.step()
    assert page.wait(lambda: page.state.get("flying") is False, 300.0)
    entry = page.words["logbook"]["entries"][-1]
    assert entry["outcome"] == "succeeded", entry["reason"]
    assert entry["operated"] is True


def test_a_flight_that_is_killed_is_told_and_leaves_a_readable_recording(
    station: tuple[Any, Any], tmp_path: Path
) -> None:
    _, page = station
    hold = "mission.task.points=[{ x_m = 1.0, y_m = 0.0, z_m = 1.0, hold_s = 300.0 }]"
    _fly(page, "waypoints", sets=[hold])
    assert page.wait(lambda: page.status.get("t", 0.0) > 6.0, 300.0)
    listed = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(page.station.pid)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    (flight,) = listed.stdout.split()
    os.kill(int(flight), signal.SIGKILL)
    assert page.wait(lambda: page.state.get("flying") is False, 60.0)
    assert page.words["logbook"]["entries"][-1]["outcome"] == "killed"
    assert "killed" in page.state["note"]
    kept = read_recording(tmp_path / "runs" / "waypoints-1.partial" / "recording.mcap")
    assert float(kept.samples["t"][-1]) > 4.0
    page.send("start", mission="waypoints")  # the station goes on
    assert page.wait(lambda: page.state.get("flying") is True, 60.0)


def test_a_second_page_takes_over_and_the_first_ones_stick_is_not_followed(
    station: tuple[Any, Any],
) -> None:
    client, page = station
    page.send("invite")
    assert page.wait(lambda: "invited" in page.words, 30.0)
    other = client.Page(page.words["invited"]["address"])
    other.send("take")
    assert page.wait(lambda: page.state.get("controller") == "page 2", 30.0)
    page.send("order", what="abort")
    assert page.wait(
        lambda: "Take control first" in page.words.get("told", {}).get("text", ""), 30.0
    )
    other.close()
    assert page.wait(lambda: page.state.get("controller") == "", 30.0)  # gone with its page


def test_a_controller_who_falls_silent_loses_control_after_the_lease(
    station: tuple[Any, Any],
) -> None:
    _, page = station
    assert page.wait(lambda: page.state.get("mine") is True, 30.0)
    page._here = math.inf  # it says nothing more
    assert page.wait(lambda: page.state.get("mine") is False, 30.0)
    assert page.state["controller"] == ""
