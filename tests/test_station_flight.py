"""A flight that the ground station shows: the same with and without it, paced, ordered, ended."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from short_mission import HOP
from skywright.description.loader import load_description
from skywright.ground.disturb import list_repeats, list_sets
from skywright.ground.feed import Feed
from skywright.ground.link import HEADER, is_frame
from skywright.links.pair import build_pair, prepare, receive, say
from skywright.reports.report import render_report
from skywright.run.result import RunResult
from skywright.run.run import run_mission
from waiting import Clock, wait_for


def _fly(feed: Feed | None, out: Path, *sets: str) -> RunResult:
    description = load_description("waypoints", sets=(*HOP, *sets))
    return run_mission(description, out=out, observers=() if feed is None else (feed,))


class FakeStation:
    """The station's end of the pair: says that so many watch, and keeps what comes."""

    def __init__(self, end: socket.socket, watchers: int) -> None:
        self.end, self.watchers = end, watchers
        self.frames: list[bytes] = []
        self.status: dict[str, Any] = {}
        self.on_status: Callable[[dict[str, Any]], None] = lambda status: None
        self._going = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._going.wait(0.02):
            say(self.end, "watch", n=self.watchers)
            self._read()
        self._read()

    def _read(self) -> None:
        for data in receive(self.end):
            if is_frame(data):
                self.frames.append(data)
            else:
                self.status = json.loads(data)
                self.on_status(self.status)

    def close(self) -> None:
        self._going.set()
        self._thread.join()
        self.end.close()


@contextmanager
def station(tmp_path: Path, watchers: int = 1, **more: float) -> Iterator[tuple[Feed, FakeStation]]:
    ours, theirs = build_pair()
    prepare(theirs)
    tmp_path.mkdir(parents=True, exist_ok=True)
    feed = Feed(ours, tmp_path, **more)
    say(theirs, "watch", n=watchers)
    say(theirs, "speed", x=0)
    fake = FakeStation(theirs, watchers)
    yield feed, fake
    fake.close()
    ours.close()


def test_a_run_is_the_same_watched_unwatched_and_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skywright.ground.feed.FRAME_PERIOD", 0.0)  # a frame every tick
    with station(tmp_path / "w1") as (feed, fake):
        watched = _fly(feed, tmp_path / "a")
    assert len(fake.frames) > 3 and fake.status["over"]
    scene = json.loads((tmp_path / "w1" / "scene.json").read_text())
    assert {len(f) for f in fake.frames} == {HEADER.size + 4 * scene["layout"]["size"]}
    t = [HEADER.unpack_from(f)[2] for f in fake.frames]
    assert t == sorted(t)
    shown = np.array([np.frombuffer(f[36:], "<f4")[:3] for f in fake.frames])
    rows = watched.samples
    then = rows["p_WB"][np.maximum(np.searchsorted(rows["t"], t) - 1, 0)]
    assert np.linalg.norm(then - shown, axis=1).max() < 0.02  # at 1 m/s, a sample apart
    assert scene["layout"]["channels"][-1]["name"] == "battery used"
    used = np.array([np.frombuffer(f[36:], "<f4")[-1] for f in fake.frames])
    assert np.all(np.diff(used) >= 0.0)
    wh = watched.description.robot.battery.energy_wh
    assert used[-1] == pytest.approx(100.0 * watched.metrics["flight.energy_wh"] / wh, rel=0.1)
    with station(tmp_path / "w0", watchers=0) as (feed, fake):
        unwatched = _fly(feed, tmp_path / "b")
    assert not fake.frames  # nobody watches: none is built
    alone = _fly(None, tmp_path / "c")
    assert watched.samples.tobytes() == alone.samples.tobytes() == unwatched.samples.tobytes()
    assert [p["name"] if isinstance(p, dict) else p[0] for p in fake.status["phases"]] == [
        p.name for p in alone.phases
    ]


def test_a_station_that_dies_or_talks_nonsense_does_not_stop_the_flight(tmp_path: Path) -> None:
    ours, theirs = build_pair()
    feed = Feed(ours, tmp_path)
    junk = [b"", b"{", b"[1]", b"\xff" * 100, b'{"k":"watch","n":1e999}', b'{"k":"speed","x":-1}',
            b'{"k":"stick","s":1,"at":1,"v":[NaN,0,0]}', b'{"k":"order","what":"x"}']  # fmt: skip
    for data in junk[1:]:
        theirs.send(data)
    say(theirs, "watch", n=1)
    tick, count = feed.on_tick, 0

    def on_tick(t: float, phase: str, vehicle: Any) -> None:
        nonlocal count
        count += 1
        if count == 60:
            theirs.close()  # killed, while it is watched in real time
        tick(t, phase, vehicle)

    feed.on_tick = on_tick  # type: ignore[method-assign]
    result = _fly(feed, tmp_path / "a")
    assert result.outcome in ("succeeded", "failed") and feed.dropped == len(junk) - 1
    ours.close()


def test_a_paused_flight_stands_until_it_goes_on_or_everyone_leaves(tmp_path: Path) -> None:
    with station(tmp_path / "w") as (feed, fake):
        times: list[float] = []
        tick = feed.on_tick

        def on_tick(t: float, phase: str, vehicle: Any) -> None:
            times.append(t)
            tick(t, phase, vehicle)

        feed.on_tick = on_tick  # type: ignore[method-assign]
        results: list[RunResult] = []
        thread = threading.Thread(target=lambda: results.append(_fly(feed, tmp_path / "a")))
        say(fake.end, "speed", x=1)
        thread.start()
        wait_for(lambda: len(times) > 30)
        say(fake.end, "pause", on=True)
        wait_for(lambda: fake.status.get("paused") is True)
        count = len(times)
        time.sleep(0.3)
        assert len(times) == count
        say(fake.end, "pause", on=False)
        wait_for(lambda: len(times) > count + 20)
        say(fake.end, "pause", on=True)
        wait_for(lambda: fake.status.get("paused") is True)
        fake.watchers = 0  # the last page is closed
        thread.join(timeout=300)
        assert not thread.is_alive() and results[0].outcome in ("succeeded", "failed")


@pytest.mark.parametrize("speed", [0.25, 1.0, 5.0])
def test_a_watched_run_keeps_its_pace(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, speed: float
) -> None:
    """The wall clock leads; a computer that is too slow, or a pause, is not made up for."""
    clock = Clock()
    ours, theirs = build_pair()
    feed = Feed(ours, tmp_path)
    monkeypatch.setattr("skywright.ground.feed.time", clock)
    monkeypatch.setattr(Feed, "watched", True)
    feed.speed = speed

    def fly(ticks: range, cost: float) -> float:
        """Ticks of 20 ms that take `cost` (s) to compute; returns how long they took."""
        began = clock.t
        for k in ticks:
            clock.t += cost
            feed._pace(0.02 * k)
        return clock.t - began

    assert fly(range(501), 0.002) == pytest.approx(10.0 / speed, abs=0.01)
    assert fly(range(501, 1001), 1.0) == pytest.approx(500.0, abs=0.5)
    assert feed._late > 0.0  # and it is told
    assert fly(range(1001, 1502), 0.002) == pytest.approx(10.0 / speed, abs=0.1)
    ours.close()
    theirs.close()


@pytest.mark.parametrize(
    ("order", "rule"), [("abort", "operator_abort"), ("land", "operator_land")]
)
def test_an_order_goes_through_the_rules(tmp_path: Path, order: str, rule: str) -> None:
    with station(tmp_path / "w") as (feed, fake):

        def command(status: dict[str, Any]) -> None:
            if status["t"] > 9.0:  # on its way
                say(fake.end, "order", what=order)

        fake.on_status = command
        say(fake.end, "speed", x=5)
        far = "mission.task.points=[{ x_m = 3.0, y_m = 0.0, z_m = 1.0, hold_s = 20.0 }]"
        result = _fly(feed, tmp_path / "a", far)
    assert result.outcome == "aborted" and "the operator ordered" in result.reason
    assert [a.rule for a in result.acted] == [rule]
    assert [a["rule"] for a in fake.status["alarms"]] == [rule]  # the page says so in words
    end = result.samples["p_WB"][-1]
    assert end[2] < 0.3  # it stands
    home = np.hypot(end[0], end[1]) < 0.1
    assert home == (order == "abort")


def test_an_order_on_the_ground_ends_the_run_there(tmp_path: Path) -> None:
    with station(tmp_path / "w") as (feed, fake):
        say(fake.end, "order", what="abort")
        result = _fly(feed, tmp_path / "a")
    assert result.outcome == "interrupted" and result.samples["p_WB"][-1, 2] < 0.3


def test_a_page_takes_the_robot_over_flies_it_and_gives_it_back(tmp_path: Path) -> None:
    """By the stick's messages; the orders' refusals are told as they change."""
    hold = "mission.task.points=[{ x_m = 0.6, y_m = 0.0, z_m = 1.2, hold_s = 60.0 }]"
    told: list[dict[str, Any]] = []
    with station(tmp_path / "w") as (feed, fake):
        sent = {"over": 0.0, "back": 0.0, "next": 0.0}
        seq = 0

        def command(status: dict[str, Any]) -> None:
            nonlocal seq
            told.append(status)
            t, phase = status["t"], status["phases"][-1][0] if status["phases"] else ""
            pilot = status["pilot"] or {}
            if phase == "hold 1" and not sent["over"]:
                sent["over"] = t
                say(fake.end, "order", what="give_back")  # before it was taken: refused
                say(fake.end, "order", what="take_over")
            elif pilot.get("flies") and not sent["back"]:
                seq += 1
                ahead = [0.0, 1.0 if t < sent["over"] + 3.0 else 0.0, 0.0, 0.0]
                say(fake.end, "stick", s=seq, at=time.monotonic(), v=[0, 0, 0], f=ahead, d=True,
                    b=False)  # fmt: skip
                if t > sent["over"] + 5.0:
                    sent["back"] = t
                    say(fake.end, "order", what="give_back")
            elif sent["back"] and phase == "hold 1" and not sent["next"]:
                sent["next"] = t
                say(fake.end, "order", what="next")

        fake.on_status = command
        say(fake.end, "speed", x=2)
        result = _fly(feed, tmp_path / "a", hold, "mission.task.settle_s=8")
    scene = json.loads((tmp_path / "w" / "scene.json").read_text())
    assert [m["name"] for m in scene["modes"]] == ["position", "attitude"]  # no angle: parallel
    assert scene["checklist"] == [c["name"] for c in fake.status["checklist"]]
    assert all(c["passed"] for c in fake.status["checklist"]) and scene["video"] is None
    assert result.outcome == "succeeded", result.reason
    names = [p.name for p in result.phases]
    assert names[names.index("manual") - 1 : names.index("manual") + 3] == [
        "hold 1", "manual", "rejoin", "hold 1",
    ]  # fmt: skip
    held = sum(p.end_s - p.start_s for p in result.phases if p.name == "hold 1")
    assert sent["next"] and held < 40.0, [s["said"] for s in told]  # next ended the hold
    flown = [s["pilot"]["flown"] for s in told if s["pilot"] and s["pilot"]["flies"]]
    assert "position" in flown
    (manual,) = [p for p in result.phases if p.name == "manual"]
    s = result.samples
    by_hand = s[(s["t"] > manual.start_s) & (s["t"] < manual.end_s)]
    assert np.max(np.linalg.norm(by_hand["p_WB"] - by_hand["p_WB"][0], axis=1)) > 0.2
    assert any(s["refusals"].get("next") == "" for s in told)
    assert any("a pilot flies the robot" in s["refusals"].get("next", "") for s in told)


def test_a_check_that_fails_keeps_it_on_the_ground_and_is_told(tmp_path: Path) -> None:
    with station(tmp_path / "w") as (feed, fake):
        result = _fly(feed, tmp_path / "a", "mission.checklist.tilt_max_deg=0.001")
    failed = [c for c in fake.status["checklist"] if not c["passed"]]
    assert [c["name"] for c in failed] == ["tilt"] and "tilt" in result.reason
    assert result.samples["p_WB"][-1, 2] < 0.3
    page = render_report(result)
    assert "Pre-flight checklist" in page and failed[0]["says"] in page


def test_a_disturbance_comes_when_it_is_asked_for_and_repeats(tmp_path: Path) -> None:
    with station(tmp_path / "w") as (feed, fake):

        def command(status: dict[str, Any]) -> None:
            if status["t"] > 5.0:
                say(fake.end, "disturb", what="station_push")

        fake.on_status = command
        say(fake.end, "speed", x=5)
        pushed = _fly(feed, tmp_path / "a", *list_sets())
    start = feed.steering.starts["station_push"]
    assert fake.status["repeats"] == list_repeats({"station_push": start})
    calm = _fly(None, tmp_path / "b", *list_sets())
    assert calm.samples.tobytes() == _fly(None, tmp_path / "c").samples.tobytes()  # never began
    before = calm.samples["t"] < start
    np.testing.assert_array_equal(
        pushed.samples["p_WB"][: np.count_nonzero(before)], calm.samples["p_WB"][before]
    )
    again = _fly(None, tmp_path / "d", *fake.status["repeats"])
    assert again.samples.tobytes() == pushed.samples.tobytes()
    n = min(len(pushed.samples), len(calm.samples))
    off = np.abs(pushed.samples["p_WB"][:n, 1] - calm.samples["p_WB"][:n, 1])
    assert off.max() > 0.02  # 8 N sideways for 0.5 s
