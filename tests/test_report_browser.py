"""A report in a browser, offline: nothing is cut off, contents lead on, plots zoom together."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from playwright.sync_api import Page, expect

import skywright
from exact_map import EXACT
from page_checks import check_badges, check_nothing_is_cut, list_cut, widen
from pdf_text import read_pdf_text
from skywright.analysis.campaign.report import Facts, write_campaign_page
from skywright.analysis.compare_runs.overlay import compare_runs
from skywright.analysis.compare_runs.report import write_overlay_page
from skywright.reports.figures.interactive import LEVELS, build_plot
from skywright.reports.figures.style import draw_limit, draw_line, draw_panels, house_style
from skywright.reports.page import build_picture, render_page, write_page
from skywright.reports.pdf import write_pdf
from skywright.run.flight import PhaseRecord
from skywright.run.results import open_run
from skywright.run.verdict import build_verdict
from test_campaign_statistics import KEYS, REQUIREMENTS, build_rows
from waiting import wait_for

SHORT = (
    *EXACT,
    "mission.task.passes=2", "mission.task.pass_length_m=0.04", "mission.task.arc_deg=10",
    "mission.task.speed_mps=0.02", "mission.timestep_ms=2",
)  # fmt: skip
LIMITS = {0.5: 32, 0.52: 31, -0.5: 4}
"""Values and phases; two close to each other, where their names have no room to the right."""
RUN_FILES = {"report.html", "replay.html", "recording.mcap", "mission.toml", "metrics.json"}

PLOTS = "Object.values(skywrightPlots)[0].plots"
"""Those with a common clock, as JavaScript."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The pages of two runs, of their comparison, and of a campaign."""
    folder = tmp_path_factory.mktemp("runs")
    for mission, sets in (("waypoints", ()), ("pipe-weld-scan", SHORT)):
        skywright.run(skywright.load(mission, sets=sets), out=folder / mission)
    flight, scan = folder / "waypoints", folder / "pipe-weld-scan"
    write_overlay_page(compare_runs(open_run(flight), open_run(scan)), folder / "compared.html")
    rows = build_rows(60, gap_at_full_wind=1.3)
    facts = Facts(
        "pipe-weld-scan", "", "othex", "pipe", 1, 60, {key: "uniform(0,1)" for key in KEYS}, (),
        60, 1.0, {"code": "0"},
    )  # fmt: skip
    verdict = build_verdict(rows, KEYS, REQUIREMENTS, 0.9)
    write_campaign_page(folder / "campaign.html", rows, verdict, facts)
    return {
        "flight": flight / "report.html", "scan": scan / "report.html",
        "replay": scan / "replay.html", "runs": folder / "compared.html",
        "campaign": folder / "campaign.html",
    }  # fmt: skip


@pytest.fixture(scope="module")
def report(pages: dict[str, Path]) -> Path:
    return pages["flight"]


@pytest.fixture
def page(show_page: Callable[..., Page], report: Path) -> Page:
    return show_page(report)


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
    check_nothing_is_cut(page, has_plots=True)  # loaded in a wide window
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


@pytest.mark.parametrize("name", ["flight", "scan", "replay", "runs", "campaign"])
def test_nothing_is_cut_off_and_every_link_leads_somewhere(
    show_page: Callable[..., Page], pages: dict[str, Path], name: str
) -> None:
    """Loaded at 800 px, then widened to 1280 px.

    Report, replay and recording lead to each other, a comparison to both reports.
    """
    path, page = pages[name], show_page(pages[name], 800)
    check_nothing_is_cut(page, has_plots=name != "campaign")
    links = [urlsplit(x) for x in page.locator("a").evaluate_all("all => all.map(a => a.href)")]
    assert {link.scheme for link in links} == {"file"}
    targets = {Path(unquote(link.path)) for link in links} - {path}
    assert all(target.is_file() for target in targets)
    ours = {path.parent / file for file in RUN_FILES} - {path}
    assert targets == {
        "flight": ours, "scan": ours, "campaign": set(), "runs": {pages["flight"], pages["scan"]},
        "replay": {path.with_name("report.html"), path.with_name("recording.mcap")},
    }[name]  # fmt: skip
    inside = page.locator("nav a")
    assert inside.count() > 2 or name == "replay"
    assert inside.evaluate_all("all => all.every(a => document.querySelector(a.hash) !== null)")
    widen(page, has_plots=name != "campaign")


def test_the_badge_of_every_outcome_can_be_read(page: Page) -> None:
    for outcome in ("succeeded", "failed", "aborted", "interrupted", "diverged", "met"):
        page.locator(".badge").evaluate("(e, word) => { e.className = `badge ${word}`; }", outcome)
        check_badges(page)


def test_names_of_levels_stand_clear_of_the_data(
    show_page: Callable[..., Page], tmp_path: Path
) -> None:
    """The mean of a noisy line has its name elsewhere, after a sample of its line."""
    t = np.linspace(0.0, 60.0, 3000)
    phases = [PhaseRecord("all", 0.0, 60.0, "done")]
    with house_style():
        figure, (ax,) = draw_panels(2.4, phases, t, ("Error", "error (mm)"))
        draw_line(ax, t, 1.4 + 0.4 * np.random.default_rng(1).standard_normal(3000))
        ax.axhline(1.4, color="#009E73", ls=":", label="mean of the noise")
        draw_limit(ax, 4.0, "limit 4 mm")
        ax.set_ylim(0.0, 7.0)
        picture = build_picture("Over time", figure, "")
    run = SimpleNamespace(outcome="succeeded", reason="")
    found = SimpleNamespace(a=run, b=run, settings=[], metrics=[])
    write_page(tmp_path / "page.html", render_page(
        "compare_runs.html.j2", found=found, names=("a", "b"), reports=("", ""), picture=picture,
        number=str,
    ))  # fmt: skip
    page = show_page(tmp_path / "page.html")
    ((_, _, texts),) = page.evaluate("readTexts()")
    points = np.array(
        page.evaluate(f"""{PLOTS}.flatMap(({{u}}) => u.data[0].map((t, i) =>
        [u.valToPos(t, "x", true), u.valToPos(u.data[1][i], "y", true)]))""")
    )
    boxes = {name: box for name, *box in texts}
    for name in ("mean of the noise", "limit 4 mm"):
        x0, x1, y0, y1 = boxes[name]
        y = points[(points[:, 0] > x0) & (points[:, 0] < x1), 1]
        assert not np.any((y > y0) & (y < y1)), name


def test_captions_name_every_kind_of_dashed_line(
    show_page: Callable[..., Page], pages: dict[str, Path]
) -> None:
    page = show_page(pages["scan"])
    captions = page.locator("figure", has=page.locator(".panels", has_text="Thrust of each rotor"))
    assert captions.count() == 2
    for figure in captions.all():
        expect(figure.locator("figcaption")).to_contain_text("dashed orange line")


def test_a_report_prints_with_its_figures(page: Page, report: Path, tmp_path: Path) -> None:
    """On paper, pictures stand where the screen has plots; they remain lines and text."""
    titles = page.locator("figure img").evaluate_all("all => all.map(x => x.alt)")
    assert titles == ["Flight path", "The whole flight"]
    page.emulate_media(media="print")
    for picture in page.locator("figure img").all():
        expect(picture).to_be_visible()
    expect(page.locator(".panels").first).to_be_hidden()
    write_pdf(report, tmp_path / "report.pdf")
    data = (tmp_path / "report.pdf").read_bytes()
    assert [x.decode() for x in re.findall(rb"/Alt \((.*?)\)", data)] == titles
    assert b"/Subtype /Image" not in data
    text = read_pdf_text(data)
    assert text.startswith("waypoints succeeded")
    for drawn in ("Seen from above", "Platform: distance from its reference", "distance (m)",
                  "time since the start of the run (s)",
                  "limit 0.1 m on the rms: planned segments, phases hold"):  # fmt: skip
        assert text.count(drawn) == 1, drawn
    assert "Drag to zoom" not in text


@pytest.mark.parametrize("width", [1280, 800])
def test_many_phases_and_limits_can_be_read(
    show_page: Callable[..., Page], tmp_path: Path, width: int
) -> None:
    """No text of a plot covers another or is cut; the key names all phases; also zoomed in."""
    ends = np.cumsum([5.0 if i % 4 == 3 else 0.3 for i in range(32)])
    starts = np.concatenate([[0.0], ends[:-1]])
    phases = [
        PhaseRecord(f"part_{i}", float(a), float(b), "done")
        for i, (a, b) in enumerate(zip(starts, ends, strict=True), 1)
    ]
    t = np.linspace(0.0, ends[-1], 2000)
    with house_style():
        figure, axes = draw_panels(4.0, phases, t, ("One", "force (N)"), ("Two", "way (mm)"))
        for ax in axes:
            draw_line(ax, t, np.sin(t), color="#0072B2")
            for value, part in LIMITS.items():
                span = (phases[part - 1].start_s, phases[part - 1].end_s)
                name = f"limit {value} N of the force: phase part {part}"
                draw_limit(ax, value, name, spans=[span])
            draw_limit(ax, -0.35, "limit of all phases")  # where the last name would be
        draw_limit(axes[1], 0.0, "a name that is too long for a window " * 5)
        picture = build_picture("Over time", figure, "")
    run = SimpleNamespace(outcome="succeeded", reason="")
    found = SimpleNamespace(a=run, b=run, settings=[], metrics=[])
    write_page(tmp_path / "page.html", render_page(
        "compare_runs.html.j2", found=found, names=("a", "b"), reports=("", ""), picture=picture,
        number=str,
    ))  # fmt: skip
    page = show_page(tmp_path / "page.html", width)
    key = page.locator(".panels p").inner_text().replace("\u00a0", " ")
    assert key.endswith("Phases: " + " · ".join(f"{i} part {i}" for i in range(1, 33)))

    def check() -> list[str]:
        assert list_cut(page) == []
        canvases = page.evaluate("readTexts()")
        levels = page.evaluate(f"""{PLOTS}.map(({{u, panel}}) =>
            panel.levels.map(level => u.valToPos(level.y, "y", true)))""")
        for (_, _, texts), lines in zip(canvases, levels, strict=True):
            for i, (one, a0, a1, b0, b1) in enumerate(texts):
                assert not one.startswith("limit") or not any(b0 < y < b1 for y in lines), one
                for other, c0, c1, d0, d1 in texts[i + 1 :]:
                    apart = a1 <= c0 or c1 <= a0 or b1 <= d0 or d1 <= b0
                    assert apart, (one, other)
        assert len(canvases) == 2
        return [text[0] for text in canvases[0][2]]

    said = check()
    assert {f"{i} part {i}" for i in range(4, 33, 4)} <= set(said)
    assert {f"limit {x} N of the force: phase part {i}" for x, i in LIMITS.items()} <= set(said)
    a, b = starts[20] - 0.0123, starts[20] + 0.0456  # numbers of many digits below
    page.evaluate(f"{PLOTS}.forEach(({{u}}) => u.setScale('x', {{min: {a}, max: {b}}}))")
    wait_for(lambda: page.evaluate(f"{PLOTS}.every(({{u}}) => u.scales.x.max === {b})"))
    assert {"20 part 20", "21 part 21"} <= set(check())
    # a name that has no place is left out; the later ones are drawn
    page.evaluate(f"""{PLOTS}.forEach(({{u, panel}}) => {{
        panel.levels.find(level => level.label === "limit of all phases").y = NaN;
        u.redraw(); }})""")
    wait_for(lambda: "limit of all phases" not in json.dumps(page.evaluate("readTexts()")))
    assert "a name that is too long" in json.dumps(page.evaluate("readTexts()")[1])


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
