"""A report in a browser, offline: nothing is cut off, contents lead on, plots zoom together."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from chromium_page import open_page
from skywright.description.loader import load_description
from skywright.reports.figures.interactive import LEVELS, build_plot
from skywright.reports.figures.style import draw_limit, draw_line, draw_panels, house_style
from skywright.reports.report import write_report
from skywright.run.flight import PhaseRecord
from skywright.run.run import run_mission
from waiting import wait_for

READY = """location.protocol === "file:" && !!document.documentElement
    && document.documentElement.dataset.plots === "ready" """
RANGES = """Object.values(skywrightPlots).flatMap(c => c.plots)
    .map(({u}) => [u.scales.x.min, u.scales.x.max])"""
DRAG = """(() => {
    const {u} = Object.values(skywrightPlots)[0].plots[%d];
    const box = u.over.getBoundingClientRect();
    const at = (t, y) => ({clientX: box.left + u.valToPos(t, "x"), clientY: box.top + y,
        movementX: 5, bubbles: true});
    const send = (kind, to, where) => to.dispatchEvent(new MouseEvent(kind, where));
    send("mousemove", u.over, at(%f, 40)); send("mousedown", u.over, at(%f, 40));
    send("mousemove", u.over, at(%f, 40)); send("mouseup", document, at(%f, 40));
    return true; })()"""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("flight") / "run"
    result = run_mission(load_description("waypoints"), out=out, write_report=write_report)
    (out / "replay.html").write_text("<p>replay</p>")
    write_report(result._replace(directory=out))  # links to the replay that is there now
    return out / "report.html"


def _open(chromium: str, page: Path, profile: Path, width: int, *options: str) -> Any:
    return open_page(
        chromium, page.as_uri(), profile, f"--window-size={width},900", "--proxy-server=0.0.0.0:1",
        *options,
    )  # fmt: skip


def _read(evaluate: Callable[[str], object], expression: str) -> Any:
    return json.loads(str(evaluate(f"JSON.stringify({expression})")))


def test_plots_zoom_together_and_share_a_cursor(
    chromium: str, report: Path, tmp_path: Path
) -> None:
    with _open(chromium, report, tmp_path / "profile", 1280) as evaluate:
        wait_for(lambda: evaluate(READY) is True)
        whole = _read(evaluate, RANGES)
        assert len(whole) == 6  # distance, attitude, tilt, estimate, rotors, power
        evaluate(DRAG % (2, 20.0, 20.0, 30.0, 30.0))
        for low, high in _read(evaluate, RANGES):
            assert low == pytest.approx(20.0, abs=0.2) and high == pytest.approx(30.0, abs=0.2)
        plots = "Object.values(skywrightPlots)[0].plots"
        assert evaluate("[...document.querySelectorAll('.bar button')].every(b => !b.hidden)")
        over = f"{plots}[0].u.over"
        evaluate(f"""{over}.dispatchEvent(new MouseEvent("mousemove", {{bubbles: true,
            clientX: {over}.getBoundingClientRect().left + {plots}[0].u.valToPos(25, "x"),
            clientY: {over}.getBoundingClientRect().top + 30}}))""")
        wait_for(lambda: evaluate("document.querySelector('.bar a').hash !== ''") is True)
        assert evaluate("document.querySelector('.bar a').hash") == "#t=25.0"
        times = _read(evaluate, f"{plots}.map(({{u}}) => u.data[0][u.cursor.idx])")
        assert times == pytest.approx([25.0] * 6, abs=0.05)
        legend = str(evaluate(f"{plots}[0].u.root.querySelector('.u-legend').textContent"))
        assert re.search(r"time2[45]\.\d\d s, phase \d+ waypoint 3value[0-9.]+ m$", legend)
        evaluate(f"{over}.dispatchEvent(new MouseEvent('dblclick', {{bubbles: true}}))")
        assert np.allclose(_read(evaluate, RANGES), whole)
        evaluate(f"""(() => {{ const o = {over}, b = o.getBoundingClientRect(), u = {plots}[0].u;
            const send = (kind, t) => o.dispatchEvent(new PointerEvent(kind, {{pointerType: "touch",
                clientX: b.left + u.valToPos(t, "x"), clientY: b.top + 30, bubbles: true}}));
            send("pointerdown", 10); send("pointermove", 15); send("pointerup", 15); }})()""")
        assert np.allclose(_read(evaluate, RANGES), [[10.0, 15.0]] * 6, atol=0.2)


@pytest.mark.parametrize("width", [1280, 800])
def test_nothing_is_cut_off_and_links_resolve(
    chromium: str, report: Path, tmp_path: Path, width: int
) -> None:
    page = tmp_path / "page.html"
    note = "<script>window.faults = []; addEventListener('error', e => faults.push(e.message));"
    text = report.read_text("utf-8").replace("<title>", note + "console.error = console.warn = "
        "(...x) => faults.push(String(x));</script><title>", 1)  # fmt: skip
    page.write_text(text, "utf-8")
    with _open(chromium, page, tmp_path / "profile", width) as evaluate:
        wait_for(lambda: evaluate(READY) is True)
        assert _read(evaluate, "faults") == []
        assert _read(evaluate, "document.documentElement.scrollWidth") <= width
        wide = """[...document.querySelectorAll("main *")].filter(e => !e.closest(".uplot")
            && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX !== "visible")
            .map(e => e.tagName)"""
        assert _read(evaluate, wide) == []
        links = "[...document.querySelectorAll('nav a')]"
        assert _read(evaluate, f"{links}.length") > 10
        assert evaluate(f"{links}.every(a => document.querySelector(a.hash) !== null)") is True
        assert evaluate("[...document.querySelectorAll('a')].every(a => a.protocol === 'file:')")
        shown = "getComputedStyle(document.querySelector('figure.live img')).display"
        assert evaluate(shown) == "none"


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
