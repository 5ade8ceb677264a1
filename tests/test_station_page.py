"""The ground station in Chromium: start, watch, pause, abort, take over, replay; and the bundle."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect
from playwright.sync_api import TimeoutError as NoAnswer

import waiting

wait_for = partial(waiting.wait_for, every=0.2)  # a question costs a browser milliseconds
OpenPage = Callable[..., Page]
Press = Callable[[Locator], None]
ONE_POINT = """mission.task.points=[{{ x_m = 1.0, y_m = 0.0, z_m = 1.0, hold_s = {hold_s} }}]
robot.battery.energy_wh=5000"""
LONG = ONE_POINT.format(hold_s=3000.0)
"""A flight that outlasts a test on an overloaded machine."""
TRY_MS = 20_000.0
"""Time of one try of an order: longer than any answer of a machine that is not overloaded."""


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


def _click(wanted: Locator) -> None:
    wanted.click(timeout=TRY_MS)


WAY = """wanted => { const now = document.activeElement;
    if (now === wanted) return 'here';
    if (wanted.disabled) return 'disabled';
    const after = now.compareDocumentPosition(wanted) & Node.DOCUMENT_POSITION_FOLLOWING;
    return after ? 'Tab' : 'Shift+Tab'; }"""
"""The key that brings the focus nearer to an element."""


def _go_to(wanted: Locator) -> None:
    """Give `wanted` the focus by the keyboard."""
    for _ in range(100):
        key = wanted.evaluate(WAY, timeout=TRY_MS)
        if key == "here":
            return
        assert key != "disabled", wanted  # control was lost meanwhile
        wanted.page.keyboard.press(key)
    raise AssertionError(f"{wanted} cannot be reached by Tab")


def _press_enter(wanted: Locator) -> None:
    expect(wanted).to_be_enabled(timeout=TRY_MS)
    _go_to(wanted)
    wanted.page.keyboard.press("Enter")


def _button(page: Page, name: str | re.Pattern[str]) -> Locator:
    return page.get_by_role("button", name=name, exact=True)


def _control(page: Page, press: Press = _click) -> None:
    """Take control where this page does not have it."""
    who = page.locator("#who")
    if who.inner_text() != "You control.":
        press(_button(page, re.compile("^Take (over )?control$")))
        expect(who).to_have_text("You control.", timeout=TRY_MS)


def _until(done: Callable[[], object], act: Callable[[], object]) -> None:
    """Do `act` until `done` raises no more, again where a try of it came to nothing.

    A loaded machine may draw a page so slowly that its lease ends at any time, also between
    taking control and an order, which is then dropped.
    """

    def tried() -> bool:
        with suppress(NoAnswer, AssertionError):
            act()
        with suppress(AssertionError):
            done()
            return True
        return False

    wait_for(tried, 600.0)


def _shows(where: Locator, text: str | re.Pattern[str]) -> Callable[[], object]:
    return lambda: expect(where).to_contain_text(text, timeout=TRY_MS)


def _order(page: Page, name: str, done: Callable[[], object], press: Press = _click) -> None:
    """Press the button `name` of whoever controls until `done` raises no more."""

    def act() -> None:
        _control(page, press)
        press(_button(page, name))

    _until(done, act)


def _choose_speed(page: Page, name: str) -> None:
    def act() -> None:
        _control(page)
        page.get_by_role("combobox", name="Speed").select_option(name, timeout=TRY_MS)

    _until(_flies_at(page, name), act)


def _flies_at(page: Page, name: str) -> Callable[[], object]:
    """The page shows a choice before it is followed: ask what the flight says."""
    speed = {"fastest": 0, "real time": 1, "× 5": 5}[name]
    told = "window.skywright.player.state?.status.speed"
    return lambda: wait_for(lambda: page.evaluate(told) == speed, TRY_MS / 1000.0)


def _clock(page: Page) -> float:
    return float(page.locator("#clock").inner_text().split(" ")[0])


def _check_sizes(page: Page) -> None:
    """Nothing is cut off or covered, on a laptop, an old screen and a phone."""
    for width, height in ((1280, 720), (800, 600), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        unreachable = page.evaluate("""
            [...document.querySelectorAll('button, select, input, textarea, summary')]
            .filter((e) => e.checkVisibility()).filter((e) => {
                e.scrollIntoView({ block: 'center' });
                const b = e.getBoundingClientRect();
                const hit = document.elementFromPoint(b.x + b.width / 2, b.y + b.height / 2);
                return b.left < 0 || b.right > innerWidth + 1 || !(hit && e.contains(hit));
            }).map((e) => e.outerHTML)""")
        assert unreachable == []
        box = page.locator("#view").bounding_box()
        assert box is not None and box["width"] >= 0.6 * width and box["height"] >= 250


def test_a_flight_is_started_watched_paused_taken_over_aborted_and_replayed(
    served: str, open_page: OpenPage, tmp_path: Path
) -> None:
    one = open_page()
    one.goto(served)
    expect(one.get_by_role("combobox", name="Mission", exact=True)).to_have_value("waypoints")
    expect(_button(one, "Start the flight (take control first)")).to_be_disabled()
    one.get_by_label("Other values").fill(LONG)
    _order(one, "Start the flight", _shows(one.locator("#clock"), "ms late"))
    # a page that is drawn slowly may see the robot later than in its take-off
    expect(one.locator("#phase")).to_have_text(re.compile("^(take off|waypoint 1|hold 1)$"))
    # a second page watches, with an address and cookies of its own
    one.get_by_text("Station", exact=True).click()
    invitation = one.locator("#invitation")
    _order(one, "Invite another browser", _shows(invitation, "http"))
    invited = re.search(r"http://\S+", invitation.inner_text())
    assert invited is not None
    two = open_page()
    two.goto(invited[0])
    expect(two.locator("#clock")).to_contain_text("ms late")
    _until(_shows(two.locator("#who"), "page 1 controls"), lambda: _control(one))
    expect(_button(two, "Abort")).to_be_disabled()
    _order(one, "❚❚ pause", _shows(two.locator("#clock"), "paused"))
    at = _clock(two)
    expect(one.locator("#clock")).to_contain_text(f"{at:.1f} s")
    _until(_shows(one.locator("#who"), "page 2 controls"), lambda: _control(two))
    lost = re.compile("page 2 took control from this page|You lost control")  # at times before
    expect(one.locator("#alarms")).to_contain_text(lost)
    _order(two, "▶ go on", _shows(two.locator("#clock"), re.compile("s, [0-9]")))
    _choose_speed(two, "× 5")
    wait_for(lambda: _clock(two) > max(9.0, at + 0.5))
    _choose_speed(two, "real time")
    _order(two, "Abort", _shows(two.locator("#alarms"), "You ordered: abort"))
    with suppress(NoAnswer):  # it may have landed meanwhile
        two.get_by_role("combobox", name="Speed").select_option("fastest", timeout=TRY_MS)
    expect(one.locator("#alarms")).to_contain_text("the operator ordered an abort")
    expect(two.locator("#told")).to_contain_text("aborted")
    expect(one.locator("#logbook")).to_contain_text("waypoints: aborted")
    expect(one.locator("#logbook").get_by_role("link")).to_have_text(["report", "replay"])
    two.close()
    expect(one.locator("#who")).to_contain_text("Nobody controls")
    # the run's own page opens inside a sandbox
    with one.expect_popup() as opened:
        one.get_by_role("link", name="replay").click()
    replay = opened.value
    expect(replay.locator("#clock")).to_have_text(re.compile(r"^0\.0 / [0-9]{2}"))
    assert replay.evaluate("(() => { try { return document.cookie } catch { return 0 } })()") == 0
    _button(replay, "▶ play").click()
    wait_for(lambda: _clock(replay) > 0.2)
    run = tmp_path / "runs" / "waypoints-1"
    assert (run / "report.html").is_file() and (run / "replay.html").is_file()


def test_a_flight_is_set_up_taken_over_flown_and_given_back_by_keyboard_alone(
    served: str, open_page: OpenPage
) -> None:
    """Wrong values are told first; a press on Next ends the hold, and the mission goes on."""
    page = open_page()
    page.goto(served)
    keys = page.keyboard
    controls = page.locator("button, select, input, textarea, canvas")
    expect(page.locator("#start")).to_be_visible()
    unnamed = controls.evaluate_all("""all => all.filter((e) => !(e.textContent.trim() ||
        e.ariaLabel || e.closest('label')?.textContent.trim())).map((e) => e.outerHTML)""")
    assert unnamed == []
    # a page on a computer that is too slow loses control, tells it and takes it again
    stall = "(() => { const end = performance.now() + 3000; while (performance.now() < end); })()"
    _until(
        _shows(page.locator("#alarms"), "You lost control"),
        lambda: (_control(page, _press_enter), page.evaluate(stall)),
    )
    expect(page.locator("#who")).to_contain_text("You lost control")
    _until(_shows(page.locator("#who"), "You control"), lambda: _control(page, _press_enter))
    values = page.get_by_label("Other values")
    for wrong, says in (
        ("mission.nonsense=1", "nonsense"),
        ("mission.law.kind=evil.py:Law", "Python file"),
    ):
        _go_to(values)
        keys.press("Control+a")
        keys.insert_text(wrong)
        _order(page, "Start the flight", _shows(page.locator("#told"), says), _press_enter)
    expect(page.locator("#phase")).to_have_text("no flight")
    _go_to(values)
    keys.press("Control+a")
    keys.insert_text(LONG)
    _order(page, "Start the flight", _shows(page.locator("#checks"), "passed"), _press_enter)
    expect(page.locator("#checks tr")).to_have_count(5)
    expect(_button(page, "Next")).to_be_disabled()

    def read_x() -> float:
        newest = "window.skywright.player.step(), window.skywright.view.parts[0].position.x"
        return float(page.evaluate(newest))  # whether it has been drawn or not

    def read_flown() -> float:
        with suppress(NoAnswer, AssertionError):
            _control(page, _press_enter)  # a loaded machine may have let the lease run out
        return read_x()

    wait_for(lambda: read_x() > 0.98)  # it stands at the way-point
    stands = re.compile("^(waypoint|hold) 1$")
    expect(page.locator("#phase")).to_have_text(stands)
    expect(_button(page, "Retry")).to_have_attribute(
        "title", re.compile("1 has no contact that this mission can repeat.$")
    )
    flies = "fly the robot in position mode"
    _order(page, "Take over the robot", _shows(page.locator("#alarms"), flies), _press_enter)
    began = read_x()
    keys.down("Space")
    keys.down("w")
    wait_for(lambda: read_flown() > began + 0.3)
    keys.up("w")
    keys.up("Space")
    _order(page, "Give the robot back", _shows(page.locator("#phase"), stands), _press_enter)
    assert abs(read_x() - began) < 0.1  # it came back

    def hurry() -> None:
        _control(page, _press_enter)
        _go_to(page.get_by_role("combobox", name="Speed"))
        keys.press("End")  # so that the next key changes it at a second try as well
        keys.press("ArrowUp")

    _until(_flies_at(page, "× 5"), hurry)
    # the rms error of a flight whose hold was short may miss its limit
    flown = re.compile(r"waypoints: (succeeded|failed.*not met: position\.rms_m)")
    _order(page, "Next", _shows(page.locator("#logbook"), flown), _press_enter)
    nobody = _shows(page.locator("#who"), "Nobody controls")
    _order(page, "Give control back", nobody, _press_enter)


def test_a_hand_is_moved_by_keys_and_let_go_and_nothing_is_cut_off(
    served: str, open_page: OpenPage
) -> None:
    """Up to the pipe by `R`; with the dead-man released it stays; then the work is aborted."""
    page = open_page()
    page.goto(served)
    expect(page.locator("#start")).to_be_visible()
    _check_sizes(page)
    page.set_viewport_size({"width": 700, "height": 450})
    page.get_by_role("combobox", name="Mission", exact=True).select_option("sensor-install")
    page.get_by_label("I do the work by hand").check()
    page.get_by_label("Other values").fill(
        "mission.task.hover_s=0\nmission.task.swing_deg=0\nmission.task.survey=false\n"
        "mission.timestep_ms=2"
    )
    _order(page, "Start the flight", _shows(page.locator("#clock"), "ms late"))
    _choose_speed(page, "fastest")  # up to where the mission asks
    expect(page.locator("#alarms")).to_contain_text("The mission asks for the operator")
    _choose_speed(page, "real time")
    _check_sizes(page)
    page.set_viewport_size({"width": 700, "height": 450})

    def read_way() -> float:
        with suppress(NoAnswer, AssertionError):
            _control(page)  # a loaded machine may have let the lease run out
        told = re.search(r"(-?\d+) mm to go", page.locator("#sightwords").inner_text())
        return float(told[1]) if told else float("nan")

    stick = page.locator("#sticktext")
    wait_for(lambda: read_way() > 0.0)
    began = read_way()
    # the list that was used last has the focus, and does not keep the keys
    page.get_by_role("combobox", name="Speed").focus()
    page.keyboard.down("r")  # without the dead-man it does not count
    expect(stick).to_contain_text("Let go")
    assert read_way() > began - 8.0
    page.keyboard.down("Space")
    _until(_shows(stick, "The stick counts"), lambda: _control(page))
    wait_for(lambda: read_way() < began - 15.0)
    page.keyboard.up("Space")
    expect(stick).to_contain_text("Let go")
    stood, at = read_way(), _clock(page)
    wait_for(lambda: _clock(page) > at + 1.5)
    assert read_way() > max(stood - 10.0, 5.0)  # `R` alone would be 22 mm
    page.keyboard.up("r")
    _choose_speed(page, "fastest")
    _order(page, "Abort", _shows(page.locator("#logbook"), "sensor-install: aborted"))


def test_a_back_end_is_chosen_flown_and_refused_with_the_reason(
    served: str, open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page()
    page.goto(served)
    backend, why = page.get_by_role("combobox", name="Back end"), page.locator("#refused")
    _until(_shows(why, "Not mavlink: a page names no addresses"), lambda: _control(page))
    backend.select_option("kinematic")
    expect(page.get_by_text("kinematic: references are followed exactly")).to_be_visible()
    mission = page.get_by_role("combobox", name="Mission", exact=True)

    def choose(name: str, says: str) -> None:
        def act() -> None:
            _control(page)
            mission.select_option(name, timeout=TRY_MS)

        _until(_shows(why, says), act)

    page.get_by_label("Other values").fill(ONE_POINT.format(hold_s=30.0))
    _order(page, "Start the flight", _shows(page.locator("#title"), "kinematic"))
    _choose_speed(page, "fastest")
    logbook = page.locator("#logbook")
    expect(logbook).to_contain_text("waypoints: succeeded")
    expect(logbook).to_contain_text("kinematic")
    metrics = json.loads((tmp_path / "runs" / "waypoints-1" / "metrics.json").read_text())
    assert metrics["backend"] == "kinematic"
    page.get_by_label("Other values").fill("")
    choose("sensor-install", "requires hands")
    expect(why).to_contain_text("kinematic does not fly this; another back end is chosen")
    expect(backend).to_have_value("physics")
    expect(backend.locator("option[value=kinematic]")).to_have_attribute("disabled", "")
    choose("bar-transport", "held by a clamp")


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
