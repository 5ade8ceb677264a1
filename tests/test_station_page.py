"""The ground station in Chromium: start, watch, pause, abort, take over, replay; and the bundle."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from chromium_page import open_page
from waiting import wait_for

Evaluate = Callable[[str], object]
LONG = "mission.task.points=[{ x_m = 1.0, y_m = 0.0, z_m = 1.0, hold_s = 300.0 }]"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[str]:
    """Run `skywright serve`; gives its one-time address."""
    log = tmp_path / "log"
    with log.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "skywright", "serve", "waypoints", "--no-open"],
            cwd=tmp_path, stderr=file, stdout=file, env={**os.environ},
        )  # fmt: skip
    wait_for(lambda: "http://" in log.read_text() or process.poll() is not None)
    address = re.search(r"http://\S+", log.read_text())
    assert address is not None, log.read_text()
    yield address[0]
    process.terminate()
    process.wait(60)
    assert "Traceback" not in log.read_text()


def _text(evaluate: Evaluate, name: str) -> str:
    return str(evaluate(f"(document.getElementById({name!r}) || {{}}).innerText"))


def _click(evaluate: Evaluate, name: str) -> None:
    wait_for(lambda: evaluate(f"document.getElementById({name!r})?.disabled === false"))
    evaluate(f"document.getElementById({name!r}).click()")


def _control(evaluate: Evaluate) -> bool:
    """Take control where this page does not have it; returns whether it had it.

    A loaded machine draws a page so slowly that its lease ends at any time: tests ask again.
    """
    if evaluate("window.skywright?.player.state?.mine === true"):
        return True
    evaluate("document.getElementById('take')?.click()")
    return False


def _order(evaluate: Evaluate, name: str, done: Callable[[], object]) -> None:
    """Press a button of whoever controls until `done`: an order without the lease is dropped."""

    def ordered() -> bool:
        pressed = _control(evaluate) and evaluate(f"""(() => {{
            const b = document.getElementById({name!r});
            if (!b || b.disabled) return false; b.click(); return true; }})()""")
        try:
            wait_for(done, 20.0 if pressed else 0.0)
        except AssertionError:
            return False
        return True

    wait_for(ordered)


def _choose_speed(evaluate: Evaluate, speed: float) -> None:
    def done() -> object:
        return _control(evaluate) and evaluate(f"""(() => {{
            const s = document.getElementById('speed'); if (s.disabled) return false;
            s.value = {speed}; s.dispatchEvent(new Event('change')); return true; }})()""")

    wait_for(done)


def _clock(evaluate: Evaluate) -> float:
    return float(_text(evaluate, "clock").split(" ")[0])


def _key(kind: str, code: str) -> str:
    pressed = f"new KeyboardEvent({kind!r}, {{ code: {code!r}, bubbles: true }})"
    return f"document.activeElement.dispatchEvent({pressed})"


def test_a_flight_is_started_watched_paused_taken_over_and_aborted(
    served: str, chromium: str, tmp_path: Path
) -> None:
    with open_page(chromium, served, tmp_path / "p1") as one:
        wait_for(lambda: one("document.documentElement?.dataset.ready") == "yes")
        assert one("document.querySelector('#setup select').value") == "waypoints"
        assert one("document.getElementById('start').disabled") is True  # not in control yet
        _click(one, "take")
        one(f"document.querySelector('#setup textarea').value = {LONG!r}")
        _order(one, "start", lambda: one("window.skywright.player.count > 30"))
        # a page that is drawn slowly may see the robot later than in its take-off
        wait_for(lambda: _text(one, "phase") in ("take off", "waypoint 1", "hold 1"))
        # a second page watches, with an address of its own
        one("document.querySelector('#station').open = true")
        one("[...document.querySelectorAll('#station button')][0].click()")
        wait_for(lambda: "http" in _text(one, "invitation"))
        invited = re.search(r"http://\S+", _text(one, "invitation"))
        assert invited is not None
        with open_page(chromium, invited[0], tmp_path / "p2") as two:
            wait_for(lambda: two("window.skywright?.player.count > 10"))
            wait_for(lambda: _control(one) and "page 1 controls" in _text(two, "who"))
            assert two("document.getElementById('abort').disabled") is True
            _order(one, "pause", lambda: "paused" in _text(two, "clock"))
            at = _text(two, "clock").split(" ")[0]
            wait_for(lambda: _text(one, "clock").startswith(f"{at} s"))
            wait_for(lambda: _control(two) and "page 2 controls" in _text(one, "who"))
            _order(two, "pause", lambda: _clock(two) > float(at) + 0.5)
            _choose_speed(two, 5)
            wait_for(lambda: _clock(two) > 12.0)
            _choose_speed(two, 1)
            _order(two, "abort", lambda: "You ordered: abort" in _text(two, "alarms"))
            wait_for(lambda: "the operator ordered an abort" in _text(one, "alarms"))
            wait_for(lambda: two("window.skywright.player.state?.flying === false"))
            assert "aborted" in _text(two, "told")
        wait_for(lambda: "waypoints: aborted" in _text(one, "logbook"))
        links = one("[...document.querySelectorAll('#logbook a')].map((a) => a.textContent).join()")
        assert links == "report,replay"
        wait_for(lambda: "Nobody controls" in _text(one, "who"))  # page 2 has gone
        # the run's own page opens inside a sandbox
        one("location.href = document.querySelectorAll('#logbook a')[1].href; true")
        wait_for(lambda: one("window.skywright?.player?.frames?.n > 50"))
        assert one("(() => { try { return document.cookie } catch { return 'none' } })()") == "none"
    run = tmp_path / "runs" / "waypoints-1"
    assert (run / "report.html").is_file() and (run / "replay.html").is_file()


def test_the_robot_is_taken_over_flown_by_keys_and_given_back(
    served: str, chromium: str, tmp_path: Path
) -> None:
    """By its buttons; a press on Next then ends the hold, and the mission goes on."""

    with open_page(chromium, served, tmp_path / "p") as page:
        wait_for(lambda: page("document.documentElement?.dataset.ready") == "yes")
        _click(page, "take")
        page(f"document.querySelector('#setup textarea').value = {LONG!r}")
        checks = "document.getElementById('checks')?.textContent"
        _order(page, "start", lambda: "passed" in str(page(checks)))
        rows = page("document.querySelectorAll('#checks tr').length")
        assert rows == 5
        assert page("document.getElementById('next').disabled") is True
        _choose_speed(page, 0)  # on the way there
        wait_for(lambda: _text(page, "phase") == "hold 1")
        _choose_speed(page, 1)
        assert page("document.getElementById('retry').title").endswith(
            "hold 1 has no contact that this mission can repeat."
        )
        _order(page, "fly", lambda: "fly the robot in position mode" in _text(page, "alarms"))
        where = "window.skywright.view.parts[0].position"
        began = float(str(page(f"{where}.x")))
        page(_key("keydown", "Space"))
        page(_key("keydown", "KeyW"))
        wait_for(lambda: _control(page) and float(str(page(f"{where}.x"))) > began + 0.3)
        page(_key("keyup", "KeyW"))
        page(_key("keyup", "Space"))
        assert page("document.getElementById('fly').textContent") == "Give the robot back"
        _order(page, "fly", lambda: _text(page, "phase") == "hold 1")
        assert abs(float(str(page(f"{where}.x"))) - began) < 0.1  # it came back
        _order(page, "next", lambda: "waypoints: succeeded" in _text(page, "logbook"))


def test_a_hand_is_moved_by_keys_and_let_go(served: str, chromium: str, tmp_path: Path) -> None:
    """Up to the pipe by `R`; with the dead-man released it stays; then the work is aborted."""
    with open_page(chromium, served, tmp_path / "p") as page:
        wait_for(lambda: page("document.documentElement?.dataset.ready") == "yes")
        _click(page, "take")
        page("""(() => { const [mission] = document.querySelectorAll('#setup select');
            mission.value = 'sensor-install'; mission.dispatchEvent(new Event('change'));
            document.getElementById('byhand').checked = true; return true; })()""")
        sets = "mission.task.hover_s=0\nmission.task.swing_deg=0\nmission.task.survey=false"
        page(f"document.querySelector('#setup textarea').value = {sets!r}")
        _order(page, "start", lambda: page("window.skywright.player.count > 0"))
        _choose_speed(page, 0)  # up to where the mission asks
        wait_for(lambda: "The mission asks for the operator" in _text(page, "alarms"))
        _choose_speed(page, 1)

        def read_way() -> float:
            _control(page)  # a loaded machine may have let the lease run out
            told = re.search(r"(-?\d+) mm to go", _text(page, "sightwords"))
            return float(told[1]) if told else math.nan

        wait_for(lambda: read_way() > 0.0)
        began = read_way()
        # the list that was used last has the focus, and does not keep the keys
        page("document.getElementById('speed').focus()")
        page(_key("keydown", "KeyR"))  # without the dead-man it does not count
        wait_for(lambda: "Let go" in _text(page, "sticktext"))
        assert read_way() > began - 8.0
        page(_key("keydown", "Space"))
        wait_for(lambda: "The stick counts" in _text(page, "sticktext"))
        wait_for(lambda: read_way() < began - 15.0)
        page(_key("keyup", "Space"))
        wait_for(lambda: "Let go" in _text(page, "sticktext"))
        stood, at = read_way(), _clock(page)
        wait_for(lambda: _clock(page) > at + 1.5)
        assert read_way() > max(stood - 10.0, 5.0)  # `R` alone would be 22 mm
        page(_key("keyup", "KeyR"))
        _choose_speed(page, 0)
        _order(page, "abort", lambda: "sensor-install: aborted" in _text(page, "logbook"))


def test_wrong_values_are_told_and_the_station_goes_on(
    served: str, chromium: str, tmp_path: Path
) -> None:
    with open_page(chromium, served, tmp_path / "p") as page:
        wait_for(lambda: page("document.documentElement?.dataset.ready") == "yes")
        _click(page, "take")
        for wrong, says in (
            ("mission.nonsense=1", "nonsense"),
            ("mission.law.kind=evil.py:Law", "Python file"),
            ("world.wind.mean_mps=NaN", "mean_mps"),
        ):
            page(f"document.querySelector('#setup textarea').value = {wrong!r}")
            _order(page, "start", lambda says=says: says in _text(page, "told"))
        assert page("window.skywright.player.state.flying") is False


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (800, 600), (500, 800)])
def test_nothing_is_cut_off(
    served: str, chromium: str, tmp_path: Path, width: int, height: int
) -> None:
    """500 is the least width of a window of Chromium; the page is laid out alike below 700."""
    size = f"--window-size={width},{height}"
    with open_page(chromium, served, tmp_path / "p", size) as page:
        wait_for(lambda: page("document.documentElement?.dataset.ready") == "yes")
        assert page("document.documentElement.scrollWidth <= innerWidth") is True
        cut = page("""[...document.querySelectorAll('button, select, input, textarea, summary')]
            .filter((e) => e.checkVisibility()).map((e) => [e, e.getBoundingClientRect()])
            .filter(([e, b]) => b.left < 0 || b.right > innerWidth + 1)
            .map(([e]) => e.outerHTML).join()""")
        assert cut == ""
        view = page("JSON.stringify(document.getElementById('view').getBoundingClientRect())")
        box = json.loads(str(view))
        assert box["width"] >= 0.6 * width and box["height"] >= 250  # there is something to see


def test_everything_can_be_reached_by_keyboard(served: str, chromium: str, tmp_path: Path) -> None:
    with open_page(chromium, served, tmp_path / "p") as page:
        wait_for(lambda: page("document.documentElement?.dataset.ready") == "yes")
        unnamed = page("""[...document.querySelectorAll('button, select, input, textarea, canvas')]
            .filter((e) => !(e.textContent.trim() || e.getAttribute('aria-label') ||
                e.closest('label')?.textContent.trim())).map((e) => e.outerHTML).join()""")
        assert unnamed == ""
        assert page("[...document.querySelectorAll('*')].every((e) => e.tabIndex <= 0)") is True


def test_the_bundle_is_what_the_source_builds(repository: Path, tmp_path: Path) -> None:
    node = shutil.which("npm")
    if node is None:
        pytest.skip("no npm on PATH (Node.js builds the page)")
    folder = tmp_path / "page"
    shutil.copytree(repository / "page", folder, ignore=shutil.ignore_patterns("node_modules"))
    subprocess.run([node, "ci", "--ignore-scripts", "--silent"], cwd=folder, check=True)
    subprocess.run(["node", "build.mjs", str(tmp_path / "out")], cwd=folder, check=True)
    committed = repository / "src" / "skywright" / "reports" / "station"
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == sorted(p.name for p in committed.iterdir())
    for name in names:
        assert (tmp_path / "out" / name).read_bytes() == (committed / name).read_bytes(), (
            f"{name} differs: run `make page` and commit it"
        )
