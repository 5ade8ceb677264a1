"""A report in a browser, offline: nothing is cut off, contents lead on, plots zoom together."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from skywright.description.loader import load_description
from skywright.reports.figures.interactive import LEVELS, build_plot
from skywright.reports.figures.style import draw_limit, draw_line, draw_panels, house_style
from skywright.reports.report import write_report
from skywright.run.flight import PhaseRecord
from skywright.run.run import run_mission
from waiting import wait_for

PLOTS = "Object.values(skywrightPlots)[0].plots"
"""Those with a common clock, as JavaScript."""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("flight") / "run"
    result = run_mission(load_description("waypoints"), out=out, write_report=write_report)
    (out / "replay.html").write_text("<p>replay</p>")
    write_report(result._replace(directory=out))  # links to the replay that is there now
    return out / "report.html"


@pytest.fixture
def page(open_page: Callable[..., Page], report: Path) -> Iterator[Page]:
    """The report, opened without a network; it has nothing to say to the console."""
    page = open_page(1280, 900, offline=True)
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.goto(report.as_uri())
    expect(page.locator("html[data-plots=ready]")).to_be_attached()
    yield page
    assert said == []


def _read_ranges(page: Page) -> np.ndarray:
    return np.array(
        page.evaluate("""Object.values(skywrightPlots).flatMap(c => c.plots)
        .map(({u}) => [u.scales.x.min, u.scales.x.max])""")
    )


def _find(page: Page, plot: int, t: float) -> tuple[float, float]:
    """Bring a plot into view; returns the place of a time (s) in it, pixels of the window."""
    page.locator(".u-over").nth(plot).scroll_into_view_if_needed()
    left, top = page.evaluate(f"""(() => {{ const {{u}} = {PLOTS}[{plot}];
        const box = u.over.getBoundingClientRect();
        return [box.left + u.valToPos({t}, "x"), box.top + 30]; }})()""")
    return left, top


def test_plots_zoom_together_and_share_a_cursor(page: Page) -> None:
    whole = _read_ranges(page)
    assert len(whole) == 6  # distance, attitude, tilt, estimate, rotors, power
    page.mouse.move(*_find(page, 2, 20.0))
    page.mouse.down()
    page.mouse.move(*_find(page, 2, 25.0))
    page.mouse.move(*_find(page, 2, 30.0))
    page.mouse.up()
    assert np.allclose(_read_ranges(page), [[20.0, 30.0]] * 6, atol=0.2)
    for button in page.locator(".bar button").all():
        expect(button).to_be_visible()
    page.mouse.move(*_find(page, 0, 25.0))
    expect(page.locator(".bar a").first).to_have_attribute("href", re.compile("#t=25.0$"))
    times = page.evaluate(f"{PLOTS}.map(({{u}}) => u.data[0][u.cursor.idx])")
    assert times == pytest.approx([25.0] * 6, abs=0.05)
    legend = page.locator(".u-legend").first.text_content() or ""
    assert re.search(r"time2[45]\.\d\d s, phase \d+ waypoint 3value[0-9.]+ m$", legend)
    page.mouse.dblclick(*_find(page, 0, 25.0))
    assert np.allclose(_read_ranges(page), whole)
    left, top = _find(page, 0, 10.0)
    right, _ = _find(page, 0, 15.0)
    finger = page.context.new_cdp_session(page)
    for kind, x in (("touchStart", left), ("touchMove", right), ("touchEnd", None)):
        points = [] if x is None else [{"x": x, "y": top}]
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert np.allclose(_read_ranges(page), [[10.0, 15.0]] * 6, atol=0.2)


@pytest.mark.parametrize("width", [1280, 800])
def test_nothing_is_cut_off_and_links_resolve(page: Page, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    wait_for(lambda: page.evaluate("document.documentElement.scrollWidth <= innerWidth"))
    wide = page.locator("main *").evaluate_all("""all => all.filter(e => !e.closest(".uplot")
        && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX !== "visible")
        .map(e => e.outerHTML.slice(0, 200))""")
    assert wide == []
    contents = page.locator("nav a")
    assert contents.count() > 10
    every = "all => all.every(a => document.querySelector(a.hash) !== null)"
    assert contents.evaluate_all(every)
    assert page.locator("a").evaluate_all("all => all.every(a => a.protocol === 'file:')")
    for picture in page.locator("figure.live img").all():
        expect(picture).to_be_hidden()


def test_a_figure_is_read_back_as_it_was_drawn() -> None:
    """What the page gets: whole lines, limits with their times, phases, one clock."""
    rng = np.random.default_rng(2)
    t = np.arange(5000) * 0.01
    y = rng.normal(0.0, 2.0, 5000)
    y[1000:1200] = np.nan
    phases = [PhaseRecord("a_b", 0.0, 20.0, "done"), PhaseRecord("c", 20.0, 50.0, "done")]
    with house_style():
        figure, axes = draw_panels(4.0, phases, t, ("One <b>", "force (N)"), ("Two", "way (mm)"))
        draw_line(axes[0], t, y, color="#0072B2", label="measured")
        draw_limit(axes[0], 3.0, "limit 3 N: phase c", spans=[(20.0, 50.0)])
        axes[1].axhspan(-1.0, 0.0, color="#e8f3ee")
        draw_line(axes[1], t[::3], y[::3], color="#222222", ls="--")
        text = build_plot(figure)
    assert "<" not in text
    plot = json.loads(text)
    one, two = plot["panels"]
    assert one["title"] == "One <b>" and (one["unit"], two["unit"]) == ("N", "mm")
    assert one["clock"] == two["clock"] == "time since the start of the run (s)"
    assert plot["phases"] == [["a b", 0.0, 20.0, 1], ["c", 20.0, pytest.approx(49.99), 2]]
    assert [level["spans"] for level in one["levels"]] == [[[20.0, 50.0]]]
    assert one["levels"][0]["label"] == "limit 3 N: phase c" and two["areas"][0]["y"] == [-1.0, 0.0]
    assert two["lines"][0]["dash"] == [6, 4] and two["lines"][0]["label"] == ""
    times, values = (_decode(one["lines"][0][name], plot["data"]) for name in "ty")
    assert np.allclose(times, t, atol=50.0 / LEVELS)
    assert np.array_equal(np.isnan(values), np.isnan(y))
    assert np.nanmax(np.abs(values - y)) <= np.ptp(y[np.isfinite(y)]) / LEVELS


def _decode(column: dict[str, Any], data: str) -> np.ndarray:
    raw = np.frombuffer(zlib.decompress(base64.b64decode(data)), np.uint8).astype(np.uint16)
    at, n = column["at"], column["n"]
    steps = np.cumsum(raw[at : at + n] + 256 * raw[at + n : at + 2 * n], dtype=np.uint16)
    return np.where(steps > LEVELS, np.nan, column["low"] + steps * column["step"])
