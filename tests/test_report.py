"""The report of a run: complete, honest, self-contained, safe against hostile text."""

from __future__ import annotations

import base64
import io
import json
import math
import re
import shutil
import time
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from matplotlib.backends.backend_agg import FigureCanvasAgg
from rich.console import Console

from exact_map import EXACT
from skywright.cli import main
from skywright.description.loader import load_description
from skywright.description.parts import Part
from skywright.errors import InputError
from skywright.evidence.pictures import COMPARED, PICTURES, ROBOTS
from skywright.reports import page
from skywright.reports.explain import format_value, list_assumptions
from skywright.reports.figures import series
from skywright.reports.figures.interactive import build_plot
from skywright.reports.figures.paths import join_angles
from skywright.reports.figures.style import (
    Span,
    clip_phases,
    draw_line,
    draw_panels,
    draw_requirement,
    house_style,
    thin,
    write_png,
)
from skywright.reports.page import add_contents
from skywright.reports.phases import explain_phase
from skywright.reports.progress import Progress, announce_planning
from skywright.reports.report import (
    FILES,
    list_figures,
    render_report,
    write_figures,
    write_report,
)
from skywright.run.flight import PhaseRecord
from skywright.run.names import list_all_measures
from skywright.run.requirements import judge
from skywright.run.result import RunResult
from skywright.run.run import run_mission

SHORT = (
    *EXACT,
    "mission.task.passes=2", "mission.task.pass_length_m=0.04", "mission.task.arc_deg=10",
    "mission.task.speed_mps=0.02", "mission.timestep_ms=2",
)  # fmt: skip


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A short scan that crosses the weld twice, with its report written."""
    out = tmp_path_factory.mktemp("scan") / "run"
    return run_mission(load_description("pipe-weld-scan", sets=SHORT), out=out,
                       write_report=write_report)  # fmt: skip


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    out = tmp_path_factory.mktemp("flight") / "run"
    return run_mission(load_description("waypoints"), out=out, write_report=write_report)


@pytest.fixture
def text_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn but not written as SVG, which is most of a report's time."""
    monkeypatch.setattr(page, "render_svg", lambda figure: b"<svg/>")


class _Page(HTMLParser):
    """Collects what a page loads, its scripts and its text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.frames, self.code = 0, False
        self.words: list[str] = []
        self.feed(text.replace("<wbr>", ""))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.frames += tag in ("iframe", "object", "embed")
        self.code = tag in ("script", "style")
        self.loads += [v or "" for k, v in attrs if k in ("src", "href", "srcset", "action")]

    def handle_endtag(self, tag: str) -> None:
        self.code = False

    def handle_data(self, data: str) -> None:
        if not self.code:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def _figures(page: str) -> list[ElementTree.Element]:
    found = re.findall(r'src="data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)"', page)
    return [ElementTree.fromstring(base64.b64decode(x)) for x in found]


def _figure_text(page: str) -> str:
    return " ".join(t for f in _figures(page) for e in f.iter() if (t := e.text) and t.strip())


def _check_self_contained(page: str) -> None:
    parsed = _Page(page)
    assert parsed.frames == 0 and "default-src 'none'; img-src data:" in page  # no network
    loads = [x for x in parsed.loads if x not in FILES and not x.startswith("#")]
    assert loads and all(x.startswith("data:") for x in loads)
    inside = [x[1:] for x in parsed.loads if x.startswith("#")]
    assert inside and all(page.count(f' id="{x}"') == 1 for x in inside)
    assert "@import" not in page and not re.search(r"url\((?!#)", page)
    for figure in _figures(page):
        for element in figure.iter():
            for key, value in element.attrib.items():
                if key.endswith("href"):
                    assert value.startswith(("#", "data:")), value


def test_report_of_a_scan_is_complete(scan: RunResult) -> None:
    page = (scan.directory / "report.html").read_text(encoding="utf-8")
    assert len(page) < 3e6
    _check_self_contained(page)
    text = _Page(page).text
    for r in scan.requirements:
        assert r.name in text and r.source in text
    assert text.count(" met ") >= sum(r.passed for r in scan.requirements)
    for heading in ("Verdict", "Weld map", "Contact quality", "Signal of the instrument",
                    "Tip path", "Flight path", "Signals during contact",
                    "The whole flight", "Plan and timing", "Phases",
                    "Assumed numbers"):  # fmt: skip
        assert heading in text
    assert "Clearance and rotor margin of the plan" in text
    for name in scan.metrics:
        assert name in text
    for phase in scan.phases:
        assert phase.name.replace("_", " ") in text
    drawn = _figure_text(page)
    for word in ("true weld line", "estimated line", "limit 10 deg", "limit 1 mm", "limit on the",
                 "rotor's limit", "touch", "settle", "planned push", "error (mm)", "force (N)",
                 "time since the start of the run (s)"):  # fmt: skip
        assert word in drawn, word


def test_report_leads_to_everything_of_the_run(flight: RunResult, text_only: None) -> None:
    """Contents, date, files, seed, and the commands that started and repeat it."""
    told = flight._replace(command="skywright run waypoints --seed 1")
    page = render_report(told)
    text = _Page(page).text
    links = re.findall(r"<nav .*?</nav>", page, re.DOTALL)[0]
    for name in ("verdict", "motion", "the-whole-flight", "phases", "all-metrics"):
        assert f'href="#{name}"' in links and f'id="{name}"' in page
    year = time.gmtime(told.timing["started_unix_s"]).tm_year
    assert f"flown on {year}-" in text and "UTC" in text
    assert abs(told.timing["started_unix_s"] - time.time()) < 3600
    for name in ("recording.mcap", "mission.toml", "metrics.json"):
        assert f'href="{name}"' in page
    assert '<a href="replay.html"' not in page  # this run has none
    assert "skywright run waypoints --seed 1" in text
    assert "skywright run ./run --out run-again" in text and "seed (1)" in text
    assert "skywright report ./run --figures run-figures" in text


def test_figures_are_written_for_a_paper(flight: RunResult, tmp_path: Path) -> None:
    written = write_figures(flight, tmp_path / "figures")
    drawn = {name for name, draw in list_figures("waypoints").items() if draw(flight)}
    assert {p.stem for p in written} == drawn and len(written) == 2 * len(drawn)
    for path in written:
        start = path.read_bytes()[:5]
        assert start == (b"%PDF-" if path.suffix == ".pdf" else b"<?xml")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write into"):
        write_figures(flight, tmp_path / "file")


def test_report_command_writes_the_page_again(flight: RunResult, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(flight.directory, copy)
    (copy / "report.html").unlink()
    called = CliRunner().invoke(main, ["report", str(copy), "--json"])
    assert called.exit_code == 0, called.output
    assert json.loads(called.stdout)["files"] == [str(copy / "report.html")]
    pages = [_Page((d / "report.html").read_text("utf-8")).text for d in (copy, flight.directory)]
    verdicts = [x[x.index("verdict source") : x.index("Robot and world to")] for x in pages]
    assert verdicts[0] == verdicts[1] and "position.hold_error_m" in verdicts[0]
    assert re.findall("flown on [^.]*", pages[0]) == re.findall("flown on [^.]*", pages[1]) != []


def test_headings_that_look_alike_have_links_of_their_own() -> None:
    page = add_contents('<nav></nav><h2>A &amp; b</h2><h3>x</h3><h2 id="k">A</h2><h3>a B</h3>')
    assert re.findall(r'id="([^"]*)"', page) == ["a-b", "x", "k", "a-b-2"]
    assert re.findall(r'href="#([^"]*)"', page) == ["a-b", "x", "k", "a-b-2"]


@pytest.mark.parametrize("count", [3, 40])
def test_every_phase_can_be_read_in_a_plot(count: int) -> None:
    """Names where they all fit, else a number for each and a key; nothing over each other."""
    lengths = [5.0 if i % 4 == 3 else 0.1 for i in range(count)] if count > 3 else [5.0] * 3
    ends = np.cumsum(lengths)
    phases = [
        PhaseRecord(f"phase_{'abcd'[i % 4]}", float(e - d), float(e), "done")
        for i, (e, d) in enumerate(zip(ends, lengths, strict=True))
    ]
    with house_style():
        figure, axes = draw_panels(3.0, phases, np.array([0.0, ends[-1]]), ("title", "label"))
        strip = next(ax for ax in figure.axes if ax not in axes)
        FigureCanvasAgg(figure).draw()
        boxes = [t.get_window_extent() for t in strip.texts]
    said = [t.get_text() for t in strip.texts]
    if count == 3:
        assert said == ["phase a", "phase b", "phase c"] and not figure.texts
    else:
        numbers = [x for x in said if x.isdigit()]
        assert numbers == [str(i) for i in range(1, 41)]
        assert said.count("phase d") == 10
        key = figure.texts[0].get_text().replace("\u00a0", " ").replace("\n", " ")
        assert "1, 5, 9, 13, 17, 21, 25, 29, 33, 37 phase a ·" in key and "40 phase d" in key
    width = figure.bbox.width
    for i, a in enumerate(boxes):
        assert a.x0 > 0 and a.x1 < width
        assert not any(a.overlaps(b) for b in boxes[i + 1 :])


def test_a_limit_states_where_it_applies(scan: RunResult) -> None:
    """Its line covers those phases only, and its name lists them; one of the whole run does not."""
    phase = next(p for p in scan.phases if p.name == "scan")
    wanted = {"limit 10 deg: phase scan", "limit 1 mm: phase scan"}
    with house_style():
        drawn = [draw(scan) for draw in list_figures("scan").values()]
        levels = [
            level
            for figure in drawn
            if figure is not None and (plot := build_plot(figure))
            for panel in json.loads(plot)["panels"]
            for level in panel["levels"]
        ]
        figure, axes = draw_panels(3.0, scan.phases, scan.samples["t"], ("title", "label"))
        draw_line(axes[0], scan.samples["t"], scan.samples["gap"])
        draw_requirement(axes[0], scan, "contact.collisions", "limit {:g}")
    assert wanted <= {level["label"] for level in levels}
    for level in levels:
        if level["label"] in wanted:
            assert level["spans"] == [[phase.start_s, phase.end_s]]
    assert [t.get_text() for t in axes[0].texts] == ["limit 0"]
    (level,) = json.loads(build_plot(figure))["panels"][0]["levels"]
    assert level["spans"] == [[p.start_s, p.end_s] for p in scan.phases]


def test_what_a_run_assumed_is_listed_with_its_range(scan: RunResult, text_only: None) -> None:
    rows = {r.name: r for r in list_assumptions(scan)}
    expected = {k for k, s in scan.description.sources.items() if s.kind == "assumed"}
    assert expected and set(rows) == expected
    friction = rows["world.pipe.friction"]
    assert friction.value == "0.2" and "0.1 to 0.3" in friction.note
    text = _Page(render_report(scan)).text
    assert "plant.mass_error" in text and "world.pipe.friction" in text
    assert "push_and_slide" in text
    assert "Changed for this run" in text and "mission.task.passes" in text


def test_report_of_waypoints(flight: RunResult) -> None:
    page = (flight.directory / "report.html").read_text(encoding="utf-8")
    _check_self_contained(page)
    text = _Page(page).text
    assert "position.rms_m" in text and "4 way-points" in text
    assert "Weld map" not in text and "Inspection" not in text
    assert "limit 0.1 m" in _figure_text(page)


def test_every_metric_has_a_meaning(scan: RunResult, flight: RunResult) -> None:
    assert {*scan.metrics, *flight.metrics} <= set(list_all_measures())


def test_the_same_run_gives_the_same_report(flight: RunResult) -> None:
    written = (flight.directory / "report.html").read_text(encoding="utf-8")
    assert render_report(flight) == written


def test_failed_requirement_is_named_in_the_first_sentence(
    scan: RunResult, text_only: None
) -> None:
    worse = {**scan.metrics, "contact.tilt_max_deg": 12.0}
    failed = scan._replace(
        metrics=worse,
        requirements=judge(scan.description.mission.requirements, worse),
        outcome="failed",
    )
    text = _Page(render_report(failed)).text
    assert "requirements failed: contact.tilt_max_deg" in text
    assert "FAILED" in text and "12 deg" in text


def test_hostile_names_are_text(scan: RunResult) -> None:
    evil = "<script>alert(1)</script> $x_{y$ & \"'"
    d = scan.description
    hostile = scan._replace(
        description=d._replace(
            robot=d.robot.model_copy(update={"name": evil}),
            world=d.world.model_copy(update={"name": evil}),
            mission=d.mission.model_copy(update={"name": evil, "description": evil}),
        ),
        requirements=[r._replace(source=evil, name=evil) for r in scan.requirements],
        phases=[p._replace(name=evil if p.name == "leave" else p.name) for p in scan.phases],
        outcome="aborted",
        reason=evil,
    )
    page = render_report(hostile)
    _check_self_contained(page)
    assert _Page(page).text.count("<script>alert(1)</script>") > 5
    assert "<script>alert" not in page
    assert "<script>alert(1)</script>" in _figure_text(page)


def _cut(result: RunResult, phase: str) -> RunResult:
    """The run as if it had been given up in the middle of a phase."""
    i = next(k for k, p in enumerate(result.phases) if p.name == phase)
    p = result.phases[i]
    end = 0.5 * (p.start_s + p.end_s)
    phases = [*result.phases[:i], p._replace(end_s=end, outcome="retry")]
    samples = result.samples[result.samples["t"] <= end]
    return result._replace(
        samples=samples, phases=phases, details=None, metrics={}, outcome="aborted",
        reason="no lasting contact at the first touch", timing={},
        requirements=judge(result.description.mission.requirements, {}),
    )  # fmt: skip


@pytest.mark.parametrize("phase", ["take_off", "touch", "scan"])
def test_aborted_run_says_so_and_why(scan: RunResult, phase: str, text_only: None) -> None:
    page = render_report(_cut(scan, phase))
    _check_self_contained(page)
    text = _Page(page).text
    assert "This run was not completed" in text
    assert "no lasting contact at the first touch" in text
    assert "not measured" in text and " met " not in text
    if phase != "scan":
        assert "the run did not reach the scan" in text


def test_run_without_samples(scan: RunResult) -> None:
    empty = _cut(scan, "take_off")._replace(
        samples=scan.samples[:0], outcome="interrupted", reason="interrupted by the user"
    )
    text = _Page(render_report(empty)).text
    assert "The run recorded no samples" in text and "interrupted by the user" in text


def test_no_weld_found(scan: RunResult, text_only: None) -> None:
    assert scan.details is not None
    weld = scan.details._replace(lines=(), crossings=())
    text = _Page(render_report(scan._replace(details=weld))).text
    assert "No weld was found." in text and "Expected crossings: 2" in text
    d = scan.description
    bare = d._replace(world=d.world.model_copy(update={"weld": None}))
    none = scan.metrics | {"weld.expected": 0.0}
    found = scan._replace(details=weld, description=bare, metrics=none)
    text = _Page(render_report(found)).text
    assert "The pipe has none" in text


def test_contact_lost_is_drawn(scan: RunResult) -> None:
    samples = scan.samples.copy()
    scanning = [i for i, p in enumerate(scan.phases) if p.name == "scan"]
    lost = np.flatnonzero(np.isin(samples["phase"], scanning))[100:200]
    samples["f_normal"][lost] = 0.0
    samples["gap_max"][lost] = samples["gap"][lost] = 0.002
    figure = list_figures("scan")["tip_path"](scan._replace(samples=samples))
    assert figure is not None
    legends = [ax.get_legend() for ax in figure.axes if ax.get_legend() is not None]
    assert "no contact force" in [t.get_text() for legend in legends for t in legend.get_texts()]


def test_truth_as_estimator_is_admitted(flight: RunResult, text_only: None) -> None:
    assert "received the true state" not in _Page(render_report(flight)).text
    d = flight.description
    mission = d.mission.model_copy(update={"estimator": Part(kind="truth")})
    text = _Page(render_report(flight._replace(description=d._replace(mission=mission)))).text
    assert "received the true state of the plant" in text


def test_unwritable_directory_is_one_line(flight: RunResult, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot write .*report\.html"):
        write_report(flight._replace(directory=tmp_path / "missing"))


def test_figure_that_a_run_cannot_have(flight: RunResult, tmp_path: Path) -> None:
    figures = {**list_figures("scan"), **list_figures("waypoints")}
    assert figures["weld_map"](flight) is None
    with pytest.raises(InputError, match="nothing to draw"):
        write_png(figures["weld_map"], flight, tmp_path / "map.png")
    write_png(figures["flight_path"], flight, tmp_path / "path.png")
    assert (tmp_path / "path.png").read_bytes().startswith(b"\x89PNG")


def test_tip_errors_split_along_and_across_the_surface(scan: RunResult) -> None:
    along, out = series.compute_tip_errors(scan.samples)
    known = np.isfinite(along)
    error = scan.samples["p_WT"] - scan.samples["ref_p_WT"]
    size = np.linalg.norm(error, axis=1)
    assert np.allclose(np.hypot(along, out)[known], size[known])
    scanning = [i for i, p in enumerate(scan.phases) if p.name == "scan"]
    on = np.isin(scan.samples["phase"], scanning)
    rms = 1e3 * math.sqrt(float(np.mean(along[on] ** 2)))
    assert rms == pytest.approx(scan.metrics["tip.tangential_rms_mm"], rel=1e-9)
    assert np.median(out[on]) == pytest.approx(scan.plan.way.depth_m, rel=0.1)


@given(
    hnp.arrays(
        np.float64, st.integers(0, 3000), elements=st.floats(-1e6, 1e6) | st.just(float("nan"))
    ),
    st.integers(1, 50),
)
def test_thinned_line_keeps_every_extreme(y: np.ndarray, columns: int) -> None:
    t = np.arange(len(y), dtype=float)
    t_thin, y_thin = thin(t, y, columns)
    assert np.all(np.diff(t_thin) > 0)
    assert np.array_equal(y_thin, y[t_thin.astype(int)], equal_nan=True)
    if np.isfinite(y).any():
        assert np.nanmax(y_thin) == np.nanmax(y) and np.nanmin(y_thin) == np.nanmin(y)
    assert np.isnan(y_thin).any() == np.isnan(y).any()
    assert len(y_thin) <= max(4 * columns, 3 * columns + len(y) // columns + 1)


@given(st.floats(-math.pi, math.pi), st.floats(0.01, 1.5))
def test_joined_angles_have_no_jump_and_mean_the_same(middle: float, half: float) -> None:
    phi = np.linspace(middle - half, middle + half, 101)
    joined = join_angles(np.arctan2(np.sin(phi), np.cos(phi)))
    assert np.allclose(np.diff(joined), np.diff(phi), atol=1e-9)
    assert np.allclose(np.exp(1j * joined), np.exp(1j * phi), atol=1e-9)


def test_phases_are_clipped_to_the_window(scan: RunResult) -> None:
    spans = clip_phases(scan.phases, 2.0, 4.0)
    assert spans[0].start == 2.0 and spans[-1].end == 4.0
    assert clip_phases(scan.phases, 1e4, 2e4) == []
    assert isinstance(spans[0], Span)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (4.0, "4"), (0.06447, "0.0645"), (12345.6, "12346"), (None, "–"),
     (math.nan, "–"), ("observer", "observer"), (True, "True")],
)  # fmt: skip
def test_numbers_are_short(value: object, text: str) -> None:
    assert format_value(value) == text


@pytest.mark.parametrize(
    "kind, name, words",
    [
        ("waypoints", "hold 12", "at the way-point"),
        ("bridge-contact", "hold 4 N", "one measurement"),
        ("bridge-contact", "free press to 3 N", "in flight"),
        ("bridge-contact", "free press", "operator's stick"),
        ("scan", "take_off", "climbs"),
        ("scan", "no such phase", ""),
    ],
)
def test_a_phase_is_explained_by_its_name_or_by_how_its_name_begins(kind, name, words):
    said = explain_phase(kind, name)
    assert (words in said) if words else not said


def test_pictures_of_the_docs_are_made_by_the_command(repository: Path) -> None:
    pages = [repository / "README.md", *(repository / "docs").rglob("*.md")]
    text = "".join(p.read_text(encoding="utf-8") for p in pages)
    for name in (*PICTURES, *ROBOTS, *COMPARED):
        assert f"images/{name}" in text, f"{name} is made but nowhere shown"
        assert (repository / "docs/images" / name).is_file()
    assert {figure for _, figure in PICTURES.values()} <= set(list_figures("scan"))


# --- progress ----------------------------------------------------------------------------------


def _watch(progress: Progress, flight: RunResult) -> None:
    progress.on_plan(flight.plan, flight.description)
    for t in np.arange(0.0, 5.0, 0.02):
        progress.on_tick(float(t), "start" if t < 1 else "take_off", None)  # type: ignore[arg-type]
    progress.close()


def test_progress_without_a_terminal_is_one_line_a_phase(flight: RunResult) -> None:
    buffer = io.StringIO()
    _watch(Progress(console=Console(file=buffer, width=80)), flight)
    lines = buffer.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("planned in") and lines[2].split() == ["1.0", "s", "take", "off"]


def test_progress_prints_no_line_between_two_phases(flight: RunResult) -> None:
    buffer = io.StringIO()
    progress = Progress(console=Console(file=buffer, width=80))
    progress.on_plan(flight.plan, flight.description)
    for t, phase in ((1.0, "take_off"), (3.1, ""), (3.2, "land")):
        progress.on_tick(t, phase, None)  # type: ignore[arg-type]
    lines = [line.split() for line in buffer.getvalue().splitlines()[1:]]
    assert lines == [["1.0", "s", "take", "off"], ["3.2", "s", "land"]]


def test_progress_on_a_terminal_tells_phase_and_factor(flight: RunResult) -> None:
    buffer = io.StringIO()
    _watch(Progress(console=Console(file=buffer, width=100, force_terminal=True)), flight)
    assert "x real time" in buffer.getvalue() and "start" in buffer.getvalue()
    buffer = io.StringIO()
    _watch(Progress(quiet=True, console=Console(file=buffer, force_terminal=True)), flight)
    assert buffer.getvalue() == ""


def test_progress_states_the_time_that_is_left(
    flight: RunResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("skywright.reports.progress.time.perf_counter", lambda: now[0])
    buffer = io.StringIO()
    progress = Progress(console=Console(file=buffer, width=100, force_terminal=True))
    plan = flight.plan._replace(flight_s=100.0)
    progress.on_plan(plan, flight.description)
    now[0] = 2.0
    progress.on_tick(20.0, "take_off", None)  # type: ignore[arg-type]
    assert "10 x real time, about 8 s left" in buffer.getvalue()
    now[0] = 11.0
    progress.on_tick(110.0, "land", None)  # type: ignore[arg-type]
    progress.close()
    assert "110 of 110 s  10 x real time, longer than estimated" in buffer.getvalue()


def test_planning_is_announced_on_a_terminal_only() -> None:
    for terminal, told in ((True, "planning ..."), (False, "")):
        buffer = io.StringIO()
        announce_planning(Console(file=buffer, width=100, force_terminal=terminal))
        assert buffer.getvalue().strip() == told
