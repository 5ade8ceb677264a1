"""The live view: watched, paused or left alone, a run comes out the same and ends properly."""

from __future__ import annotations

import socket
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np
import pytest
from websockets.sync.client import connect

from chromium_page import open_page
from skywright.description.loader import load_description
from skywright.ground.live import LiveView, build_numbers
from skywright.run.run import RunResult, run_mission
from waiting import Clock, wait_for

QUICK = (
    "mission.task.points=[{ x_m = 0.3, y_m = 0.0, z_m = 1.0, hold_s = 0.2 }]",
    "mission.hover_height_m=0.8",
)


def _fly(view: LiveView | None, out: Path, *sets: str) -> RunResult:
    description = load_description("waypoints", sets=(*QUICK, *sets))
    return run_mission(description, out=out, observers=() if view is None else (view,))


@contextmanager
def _browser(view: LiveView) -> Iterator[None]:
    """Connect as a browser does: viser's web socket with its version, then where the camera is."""
    import viser

    port = view.server.get_port()
    protocol = f"viser-v{viser.__version__}"
    with connect(
        f"ws://127.0.0.1:{port}",
        subprotocols=[protocol],
        max_size=None,
        open_timeout=120.0,
        ping_interval=None,
    ) as ws:
        zero = [0.0, 0.0, 0.0]
        camera = {
            "type": "ViewerCameraMessage", "wxyz": [1.0, *zero], "position": zero, "fov": 1.0,
            "near": 0.1, "far": 100.0, "image_height": 600, "image_width": 900, "look_at": zero,
            "up_direction": [0.0, 0.0, 1.0],
        }  # fmt: skip
        ws.send(msgspec.msgpack.encode(camera))
        stop = threading.Event()

        def read() -> None:
            while not stop.is_set():
                try:
                    ws.recv(timeout=0.1)
                except TimeoutError:
                    continue
                except Exception:
                    return

        thread = threading.Thread(target=read, daemon=True)
        thread.start()
        yield
        stop.set()


def test_a_run_is_the_same_with_and_without_the_view(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    view = LiveView(open_browser=False, wait_s=0.0)
    with_view = _fly(view, tmp_path / "a")
    without = _fly(None, tmp_path / "b")
    assert with_view.samples.tobytes() == without.samples.tobytes()
    assert view.server is None  # stopped
    captured = capsys.readouterr()
    assert "live view: http://localhost:" in captured.err
    assert captured.out == ""  # standard output belongs to --json


def test_view_listens_on_this_computer_only(tmp_path: Path) -> None:
    view = LiveView(open_browser=False, wait_s=0.0)
    description = load_description("waypoints", sets=QUICK)
    from skywright.run.planning import plan_mission

    view.on_plan(plan_mission(description), description)
    try:
        port = view.server.get_port()
        page = urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5).read()
        assert b"<html" in page
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect(("192.0.2.1", 9))  # sends nothing: asks for our own address
                own = probe.getsockname()[0]
            except OSError:
                own = "127.0.0.1"
        if not own.startswith("127."):
            with pytest.raises(OSError), socket.create_connection((own, port), timeout=1):
                pass
        assert view.server.request_share_url() is None  # no tunnel to the outside
    finally:
        view.close()
    with pytest.raises(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
        pass


def test_watched_run_waits_is_paused_and_ends_when_the_browser_closes(tmp_path: Path) -> None:
    view = LiveView(open_browser=False, wait_s=300.0, stay_s=0.0)
    results: list[RunResult] = []
    times: list[float] = []
    tick = view.on_tick

    def on_tick(t: float, phase: str, vehicle: object) -> None:
        times.append(t)
        tick(t, phase, vehicle)  # type: ignore[arg-type]

    view.on_tick = on_tick  # type: ignore[method-assign]
    thread = threading.Thread(target=lambda: results.append(_fly(view, tmp_path / "a")))
    thread.start()
    wait_for(lambda: view.server is not None)
    time.sleep(0.2)
    assert not times  # the run waits for the first browser
    with _browser(view):
        wait_for(lambda: len(times) > 50)
        view.paused = True
        count = len(times)
        time.sleep(0.3)
        assert len(times) <= count + 2  # what was under way
        view.paused = False
        start = len(times)
        wait_for(lambda: len(times) > start + 60)
        view.paused = True
        time.sleep(0.2)
    thread.join(timeout=300)  # closed while paused: the run goes on at full speed
    assert not thread.is_alive()
    assert results[0].outcome in ("succeeded", "failed") and view.server is None


@pytest.mark.parametrize("speed", [0.25, 1.0, 5.0])
def test_a_watched_run_keeps_its_pace(monkeypatch: pytest.MonkeyPatch, speed: float) -> None:
    """The wall clock leads; a computer that is too slow, or a pause, is not made up for."""
    clock = Clock()
    monkeypatch.setattr("skywright.ground.live.time", clock)
    view = LiveView(open_browser=False, wait_s=0.0)
    monkeypatch.setattr(view, "watched", lambda: True)
    view.speed = speed

    def fly(ticks: range, cost: float) -> float:
        """Ticks of 20 ms that take `cost` (s) to compute; returns how long they took."""
        began = clock.t
        for k in ticks:
            clock.t += cost
            view._pace(0.02 * k, "fly", None)  # type: ignore[arg-type]
        return clock.t - began

    assert fly(range(501), 0.002) == pytest.approx(10.0 / speed, abs=0.01)
    assert fly(range(501, 1001), 1.0) == pytest.approx(500.0, abs=0.5)
    assert fly(range(1001, 1502), 0.002) == pytest.approx(10.0 / speed, abs=0.1)


def test_numbers_of_a_scan(tmp_path: Path) -> None:
    from skywright.run.run import build_vehicle

    vehicle = build_vehicle(load_description("pipe-weld-scan"))
    vehicle.tick()
    row = vehicle.last_sample[0].copy()
    row["gap"], row["f_normal"], row["tilt"] = 0.0004, 1.25, np.radians(4.0)
    text = build_numbers(row, vehicle)
    assert "| push | 1.25 N |" in text and "| air gap | 0.40 mm |" in text
    assert "| probe tilt | 4.0° |" in text and "**no contact**" in text
    row["gap"] = 0.5
    assert "| air gap | – |" in build_numbers(row, vehicle)


@pytest.mark.browser
def test_browser_shows_the_run(chromium: str, tmp_path: Path) -> None:
    """Chromium connects, draws the panel, and the run ends after it is closed."""
    view = LiveView(open_browser=False, wait_s=300.0, stay_s=0.0)
    results: list[RunResult] = []
    thread = threading.Thread(target=lambda: results.append(_fly(view, tmp_path / "a")))
    thread.start()
    wait_for(lambda: view.server is not None and hasattr(view, "_status"))
    with open_page(chromium, view.url, tmp_path / "profile") as evaluate:
        wait_for(view.watched)

        def text() -> str:
            return str(evaluate("document.body.innerText"))

        wait_for(lambda: "busiest rotor" in text() and "pause" in text())
        assert "waypoints: hexarotor in open" in text()
    thread.join(timeout=300)
    assert not thread.is_alive() and results[0].outcome in ("succeeded", "failed")
