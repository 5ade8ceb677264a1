"""Rules for the whole suite: no display, reproducible hypothesis, skips that CI does not allow.

`pytest --quick` leaves out the tests that tests/slow.txt lists; `pytest --measure FILE` appends the
processor time (s) of every test and of the fixtures that tests share to FILE, from which
`scripts/list_slow_tests.py` makes that list.
"""

from __future__ import annotations

import gc
import os
import shutil
import signal
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("MPLBACKEND", "Agg")
# Threads of a BLAS wait for each other in loops: with two workers on two cores they took most of
# the time of some tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

from command_server import CommandServer

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

# A shell without job control starts background jobs with SIGINT ignored, and programs that tests
# interrupt would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

threadpool_limits(1, "blas")  # one that a plugin of pytest has loaded before
gc.disable()  # until all is imported: pytest_collection_finish

NO_SKIP = os.environ.get("SKYWRIGHT_NO_SKIP", "") not in ("", "0")

# Compiled code makes first calls slow: no deadline. CI draws the same examples every time.
settings.register_profile("default", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if NO_SKIP or os.environ.get("CI") else "default")


SLOW = Path(__file__).with_name("slow.txt")
PATIENCE_MS = 300_000.0
"""Time that a page may take to show something: a loaded machine is slow, not wrong."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help=f"leave out the tests of {SLOW.name}")
    parser.addoption("--measure", metavar="FILE", help="append each test's processor time (s)")


def find_left_out(config: pytest.Config) -> dict[str, str]:
    """Return the marks whose tests do not run here, and what would run them.

    These are no skips: nobody is asked to have an autopilot. CONTRIBUTING.md has the commands.
    """
    out = {}
    if not os.environ.get("SKYWRIGHT_PX4"):
        out["px4"] = "SKYWRIGHT_PX4"
    if not os.environ.get("SKYWRIGHT_CUDA"):
        out["cuda"] = "make cuda"
    if find_spec("stable_baselines3") is None:
        out["learn"] = "make learn"
    asked = config.getoption("markexpr")
    return out | {mark: f"-m {mark}" for mark in ("betaflight", "docs") if mark not in asked}


def pytest_report_header(config: pytest.Config) -> str:
    told = ", ".join(f"{mark} ({how})" for mark, how in find_left_out(config).items())
    return f"marks left out: {told or 'none'}; see CONTRIBUTING.md"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    listed = SLOW.read_text(encoding="utf-8").splitlines()
    slow = set(listed if config.getoption("--quick") else [])
    without = find_left_out(config)
    left_out = [
        i for i in items
        if i.nodeid.partition("[")[0] in slow or any(i.get_closest_marker(m) for m in without)
    ]  # fmt: skip
    config.hook.pytest_deselected(items=left_out)
    files = list(dict.fromkeys(name.partition("::")[0] for name in listed))
    rank = {name: at for at, name in enumerate(files)}  # the longest first
    gone = set(left_out)
    items[:] = sorted(
        (i for i in items if i not in gone),
        key=lambda i: rank.get(i.nodeid.partition("::")[0], len(rank)),
    )


def pytest_collection_finish() -> None:
    """Collect garbage from here on, but not among what is imported: that took a tenth of all."""
    gc.freeze()
    gc.enable()


def _read_processor_time() -> float:
    """Processor time (s) of this process, of all that it started, and of those that have ended.

    A process that has ended counts where somebody has waited for it, as the kernel has it.
    """
    parents, spent = dict[str, str](), dict[str, int]()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended meanwhile
        parents[folder.name], spent[folder.name] = words[1], sum(map(int, words[11:15]))
    ours, tree = {str(os.getpid())}, set[str]()
    while ours:
        tree |= ours
        ours = {pid for pid, parent in parents.items() if parent in ours}
    return sum(spent.get(pid, 0) for pid in tree) / os.sysconf("SC_CLK_TCK")


SET_UP: list[tuple[str, float]] = []
"""Shared fixtures that the running test has set up, with their processor time (s)."""


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(
    fixturedef: pytest.FixtureDef[object], request: pytest.FixtureRequest
) -> Generator[None, object, object]:
    if fixturedef.scope == "function" or not request.config.getoption("--measure"):
        return (yield)
    before = _read_processor_time()
    try:
        return (yield)
    finally:
        SET_UP.append((_name(fixturedef), _read_processor_time() - before))


def _name(fixture: pytest.FixtureDef[object]) -> str:
    return f"{fixture.baseid}::{fixture.argname}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, bool, bool]:
    if not (name := item.config.getoption("--measure")):
        return (yield)
    file = item.config.rootpath / name  # tests change the working directory
    SET_UP.clear()
    before = _read_processor_time()
    ran = yield
    own = _read_processor_time() - before - sum(seconds for _, seconds in SET_UP)
    own = max(own, 0.0)  # a child of an earlier test that ended without wait() no longer counts
    known = getattr(item, "_fixtureinfo", None)
    several = known.name2fixturedefs.values() if known else ()
    shared = sorted({_name(f) for fs in several for f in fs if f.scope != "function"})
    with open(file, "a", encoding="utf-8") as out:
        out.write("\t".join([f"{own:.2f}", item.nodeid, *shared]) + "\n")
        out.writelines(f"{seconds:.2f}\tfixture {name}\n" for name, seconds in SET_UP)
    return ran


def _refuse_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure when SKYWRIGHT_NO_SKIP is set; expected failures stay."""
    if NO_SKIP and report.skipped and not hasattr(report, "wasxfail"):
        where = report.longrepr
        reason = where[2] if isinstance(where, tuple) else str(where)
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid} may not be skipped here (SKYWRIGHT_NO_SKIP): {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    _refuse_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    _refuse_skip(report)
    return report


@pytest.fixture(scope="session")
def repository() -> Path:
    """Folder of the checkout."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def commands(pytestconfig: pytest.Config) -> Iterator[CommandServer]:
    """Runs commands as processes of their own, without the seconds that an interpreter needs."""
    flown = ("pipe-weld-scan", "sensor-install", "bridge-contact")  # by pages, not by other tests
    with CommandServer(flown if "docs" in pytestconfig.getoption("markexpr") else ()) as server:
        yield server


@pytest.fixture(scope="session")
def chromium() -> str:
    """Path of an installed Chromium for tests that open a page."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name)
        if path is not None:
            return path
    pytest.skip("no Chromium on PATH (apt-get install chromium)")


FEWER_PICTURES = """{ const draw = window.requestAnimationFrame;
    window.requestAnimationFrame = (f) => setTimeout(() => draw(f), 250);
    window.cancelAnimationFrame = clearTimeout; }"""
"""Four pictures a second: without a graphics card one takes a processor for longer than a frame."""


@pytest.fixture(scope="module")
def browser(chromium: str) -> Iterator[Browser]:
    """Headless Chromium with WebGL in software, driven by Playwright.

    It ends with the module: while it is open, no other event loop can run in this thread.
    """
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, timeout=PATIENCE_MS,
            args=[
                "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
                "--disable-gpu-compositing",  # in software, it costs twice what the canvas does
            ],
            ignore_default_args=["--hide-scrollbars"],  # they take width, as a user's do
        )  # fmt: skip
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Opens pages, each with cookies of its own; fails a test in which one raised an error.

    The arguments are those of Playwright's `new_context`.
    """
    from playwright.sync_api import Error as PlaywrightError

    contexts, errors = [], []

    def open_one(width: int = 700, height: int = 450, **options: Any) -> Page:
        size = {"width": width, "height": height}
        context = browser.new_context(viewport=size, **options)
        contexts.append(context)
        context.set_default_timeout(PATIENCE_MS)
        context.add_init_script(FEWER_PICTURES)
        context.on("weberror", lambda error: errors.append(str(error.error)))
        return context.new_page()

    yield open_one
    for context in contexts:
        for page in context.pages:  # pytest shows it where a test failed
            with suppress(PlaywrightError):
                print(page.url, page.locator("body").inner_text(timeout=5000.0), sep="\n")
        context.close()
    assert errors == []


@pytest.fixture
def show_page(open_page: Callable[..., Page]) -> Iterator[Callable[..., Page]]:
    """Opens a page without a network; it has nothing to say to the console.

    Where a replay is drawn in software, the browser itself warns.
    """
    from playwright.sync_api import expect

    from page_checks import NOTE_TEXTS

    said: list[str] = []

    def open_one(path: Path, width: int = 1280) -> Page:
        page = open_page(width, 900, offline=True)
        if path.name != "replay.html":
            page.on("console", lambda message: said.append(message.text))
        page.add_init_script(NOTE_TEXTS)
        page.goto(path.as_uri())
        if page.locator("figure > script").count():
            expect(page.locator("html[data-plots=ready]")).to_be_attached()
        if path.name == "replay.html":
            expect(page.locator("html[data-ready=yes]")).to_be_attached()
        return page

    yield open_one
    assert said == []
