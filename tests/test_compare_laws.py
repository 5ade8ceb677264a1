"""Control laws on the same flights: pairs, tests, cases, refusals, the page."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from playwright.sync_api import Page

from page_checks import check_page
from skywright.analysis.campaign import local
from skywright.analysis.campaign.campaign import CampaignResult
from skywright.analysis.campaign.spec import Campaign
from skywright.analysis.compare_laws import compare as compare_module
from skywright.analysis.compare_laws.cases import (
    Case,
    LeftOut,
    check_varied,
    choose_cases,
    list_cases,
    list_law_sets,
)
from skywright.analysis.compare_laws.check import check_law
from skywright.analysis.compare_laws.compare import (
    Flown,
    LawComparison,
    choose_reference,
    compare_flown,
    compare_laws,
)
from skywright.analysis.compare_laws.cost import measure_cost
from skywright.analysis.compare_laws.figures import draw_medians
from skywright.analysis.compare_laws.paired import (
    FEWEST,
    Difference,
    compare_metric,
    find_significant,
    pair_rows,
)
from skywright.analysis.compare_laws.report import tell_difference, write_laws_page
from skywright.cli import main
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.run.rows import Row
from skywright.run.verdict import build_verdict


def build_row(run: int, **metrics: float) -> Row:
    return Row(run, run, "succeeded", "", (), "", {}, metrics, {}, 1, "")


def test_only_runs_that_both_measured_are_paired() -> None:
    a = [build_row(0, x=1.0), build_row(1, x=math.nan), build_row(2, x=3.0), build_row(4, x=9.0)]
    b = [build_row(2, x=5.0), build_row(1, x=7.0), build_row(0, x=2.0), build_row(3, x=8.0)]
    one, other = pair_rows(a, b, "x")
    assert sorted(zip(one, other, strict=True)) == [(1.0, 2.0), (3.0, 5.0)]
    assert [len(v) for v in pair_rows(a, b, "y")] == [0, 0]
    early = [a[0]._replace(outcome="aborted"), *a[1:]]
    assert [list(v) for v in pair_rows(early, b, "x")] == [[3.0], [5.0]]
    landed = [[r._replace(metrics={"response.x": r.metrics["x"]}) for r in rows]
              for rows in (early, b)]  # fmt: skip
    assert sorted(pair_rows(*landed, "response.x")[0]) == [1.0, 3.0]  # the aborted run too


def test_a_difference_within_runs_is_found_where_the_runs_differ_more() -> None:
    """The spread between runs is a hundred times the difference; its pairs show it."""
    rng = np.random.default_rng(3)
    before = rng.normal(10.0, 5.0, 8)
    d = compare_metric("b", "nominal", "x", before, before + 0.05 + rng.normal(0.0, 0.005, 8))
    assert d is not None and d.pairs == 8
    assert 0.04 < d.low < d.median < d.high < 0.06
    assert d.p == pytest.approx(2.0 / 2**8)  # exact: all eight have the same sign
    noise = [
        compare_metric("b", "nominal", str(i), before, before + rng.normal(0.0, 1.0, 8))
        for i in range(20)
    ]
    found = find_significant([d, *(n for n in noise if n is not None)])
    assert ("b", "nominal", "x") not in find_significant([n for n in noise if n is not None])
    assert len(found) <= 2


def test_equal_laws_and_few_runs_are_no_finding() -> None:
    same = compare_metric("b", "c", "x", np.ones(8), np.ones(8))
    assert same is not None and (same.median, same.low, same.high, same.p) == (0.0, 0.0, 0.0, 1.0)
    few = compare_metric("b", "c", "x", np.zeros(5), np.ones(5))
    assert few is not None and few.median == 1.0 and math.isnan(few.p)
    assert not find_significant([same, few])
    assert compare_metric("b", "c", "x", np.zeros(0), np.zeros(0)) is None


def test_a_difference_in_few_runs_is_tested() -> None:
    """8 of 40 runs differ: median and interval are zero, and the test decides."""
    before = np.zeros(40)
    d = compare_metric("b", "nominal", "x", before, before + (np.arange(40) < 8))
    assert d is not None and (d.median, d.low, d.high) == (0.0, 0.0, 0.0)
    assert d.p < 0.01 and not d.is_zero
    same = compare_metric("b", "nominal", "y", before, before)
    assert same is not None and same.is_zero
    assert find_significant([d, same]) == {("b", "nominal", "x")}


def test_below_six_pairs_there_is_no_interval(tmp_path: Path) -> None:
    """Neither in the JSON object nor on the page, and recorded results have none."""
    d = compare_metric("b", "nominal", "x", np.array([1.0, 2.0, 3.0]), np.array([2.0, 3.5, 3.9]))
    assert d is not None and math.isnan(d.low) and math.isnan(d.high) and d.median == 1.0
    assert tell_difference(d) == "+1"
    found = build_comparison(["a", "b"], differences=[d])
    (told,) = json.loads(json.dumps(found.to_json(), allow_nan=False))["differences"]
    assert told["interval"] is None and told["p"] is None and told["median"] == 1.0
    write_laws_page(found, tmp_path / "laws.html")
    assert "nan" not in (tmp_path / "laws.html").read_text().lower().split("<h2")[-2]
    enough = compare_metric("b", "nominal", "x", np.zeros(6), np.arange(6.0))
    assert enough is not None
    (told,) = build_comparison(["a", "b"], differences=[enough]).to_json()["differences"]
    assert told["interval"] == [enough.low, enough.high] and enough.low < enough.high
    kept = Path(__file__).parents[1] / "benchmarks" / "laws"
    for file in kept.glob("*.json"):
        for one in json.loads(file.read_text())["differences"]:
            assert (one["interval"] is None) == (one["pairs"] < FEWEST), file


def build_comparison(
    laws: list[str],
    rows: list[Row] | None = None,
    differences: list[Difference] | None = None,
    left_out: tuple[LeftOut, ...] = (),
) -> LawComparison:
    """A comparison in the nominal case in which the metric `x` differs from law to law."""
    flown = [
        Flown(law, "nominal", rows or [build_row(0, x=1.0 + k)], "") for k, law in enumerate(laws)
    ]
    return LawComparison(
        "m", "r", "w", 1, 1, laws, [Case("nominal", ())], {}, ["x"], {}, flown, differences or [],
        set(), dict.fromkeys(laws, math.nan), left_out,
    )  # fmt: skip


def test_many_laws_are_drawn_and_told_apart() -> None:
    laws = [f"law {k}" for k in range(30)]
    figure = draw_medians(build_comparison(laws))
    assert figure is not None
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == laws
    drawn = {(line.get_color(), str(line.get_marker())) for line in legend.get_lines()}
    assert len(drawn) == len(laws)
    dots = {(line.get_markeredgecolor(), line.get_marker()) for line in figure.axes[0].lines}
    assert dots == drawn


def test_aborted_flights_are_hollow_dots_and_count_in_the_median(tmp_path: Path) -> None:
    """As the caption of the figure states."""
    cut = build_row(1, x=0.2)._replace(outcome="aborted")
    found = build_comparison(["a", "b"], [build_row(0, x=1.0), cut, build_row(2)])
    figure = draw_medians(found)
    assert figure is not None
    whole, hollow = figure.axes[0].lines[:2]
    assert list(whole.get_ydata()) == [1.0] and whole.get_markerfacecolor() != "none"
    assert list(hollow.get_ydata()) == [0.2] and hollow.get_markerfacecolor() == "none"
    assert found.flown[0].compute_median("x") == 0.6
    write_laws_page(found, tmp_path / "laws.html")
    text = (tmp_path / "laws.html").read_text()
    assert "did not reach their end; the median includes them" in text
    assert "Incomplete flights" not in text


def test_differences_are_to_the_first_law_that_succeeds(tmp_path: Path) -> None:
    good = [build_row(k, x=1.0 + k) for k in range(3)]
    bad = [row._replace(outcome="failed") for row in good]
    cut = [row._replace(outcome="aborted") for row in good]
    flown = [
        Flown("a", "nominal", [], "no force sensor"), Flown("b", "nominal", cut, ""),
        Flown("c", "nominal", bad, ""), Flown("d", "nominal", good, ""),
        Flown("e", "nominal", [row._replace(metrics={"x": 0.5}) for row in good], ""),
    ]  # fmt: skip
    for count, reference in ((5, "d"), (3, "c"), (2, "b"), (1, "a")):
        laws = [f.law for f in flown[:count]]
        assert choose_reference(laws, flown[:count]) == reference
    found = compare_flown("d", ["x"], flown)
    assert [(d.law, d.pairs, d.median) for d in found] == [("c", 3, 0.0), ("e", 3, -1.5)]
    comparison = build_comparison(["a", "b", "c", "d", "e"], differences=found)
    comparison = comparison._replace(flown=flown)
    assert comparison.to_json()["reference"] == "d"
    write_laws_page(comparison, tmp_path / "laws.html")
    text = (tmp_path / "laws.html").read_text()
    assert "The differences are to d: no nominal flight of a met every requirement." in text
    assert "e minus d" in text and "d minus d" not in text
    none = comparison._replace(flown=flown[:2], laws=["a", "b"], differences=[])
    write_laws_page(none, tmp_path / "laws.html")
    assert "flown to its end by two laws" in (tmp_path / "laws.html").read_text()


def test_nothing_of_the_page_is_cut_off(
    tmp_path: Path, show_page: Callable[..., Page], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With many laws, cases and metrics of long names, and a long command."""
    monkeypatch.setattr(sys, "argv", ["skywright", "compare", "laws", "a_long_law_name," * 20])
    laws = [f"law_of_a_long_name_{k}" for k in range(5)]
    cases = [Case(f"case {k}", (f"robot.some.long.key_{k}=0.123456",)) for k in range(3)]
    metrics = [f"requirements.of_a_long_name.metric_{k}_mm" for k in range(4)]
    rows = [build_row(k, **dict.fromkeys(metrics, 1.0 + k)) for k in range(8)]
    differences = [
        compare_metric(law, case.name, metric, np.ones(8), np.arange(8.0))
        for law in laws[1:] for case in cases for metric in metrics
    ]  # fmt: skip
    found = LawComparison(
        "pipe-weld-scan", "othex", "pipe", 1, 8, laws, cases, {}, metrics, {},
        [Flown(law, case.name, rows, "") for law in laws for case in cases],
        [d for d in differences if d is not None], set(), dict.fromkeys(laws, 1e-6), (),
    )  # fmt: skip
    write_laws_page(found, tmp_path / "laws.html")
    page = check_page(show_page, tmp_path / "laws.html", has_plots=False)
    assert page.locator("pre").inner_text().startswith("skywright compare laws a_long_law_name,")


def test_cases_are_named_or_defined_and_the_nominal_one_is_always_there() -> None:
    base = load_description("pipe-weld-scan")
    assert [c.name for c in list_cases(base)] == [
        "nominal", "mass", "delay", "wind", "gusts", "friction",
    ]  # fmt: skip
    assert list_cases(base)[-1].sets == ("world.pipe.friction=0.3",)
    assert "friction" not in [c.name for c in list_cases(load_description("waypoints"))]
    own = choose_cases(base, ["mass", "fan:world.wind.kind=fan", "fan:world.wind.mean_mps=4"])
    assert [c.name for c in own] == ["nominal", "mass", "fan"]
    assert own[2].sets == ("world.wind.kind=fan", "world.wind.mean_mps=4")
    with pytest.raises(InputError, match=r"--case masses: no such case; valid: nominal, mass"):
        choose_cases(base, ["masses"])
    with pytest.raises(InputError, match="a name other than"):
        choose_cases(base, [":world.wind.mean_mps=1"])


def test_a_built_in_case_and_its_assignments_merge_in_any_order() -> None:
    base = load_description("pipe-weld-scan")
    texts = ["mass", "mass:plant.rotor_gain_error=0.02"]
    sets = ("plant.mass_error=0.1", "plant.rotor_gain_error=0.02")
    for given in (texts, texts[::-1], [*texts, "mass"]):
        assert choose_cases(base, given)[1:] == [Case("mass", sets)]
    alone = choose_cases(base, texts[1:])
    assert alone[1:] == [Case("mass", ("plant.rotor_gain_error=0.02",))]


def test_built_in_cases_make_way_for_keys_that_vary() -> None:
    cases = list_cases(load_description("pipe-weld-scan"))
    varied = ["plant.mass_error", "world.wind.kind", "world.wind.mean_mps", "world.weld.angle_deg"]
    laws = ["push_and_slide", "push_and_slide:moment_feed_forward=friction"]
    flown, left_out = check_varied(cases, laws, varied, given=False)
    assert [c.name for c in flown] == ["nominal", "delay", "friction"]
    assert [(x.case.name, x.keys) for x in left_out] == [
        ("mass", ("plant.mass_error",)),
        ("wind", ("world.wind.kind", "world.wind.mean_mps")),
        ("gusts", ("world.wind.kind", "world.wind.mean_mps")),
    ]
    assert check_varied(cases, laws, ["mission.law.start_up_s"], given=False) == (cases, [])
    with pytest.raises(InputError, match=r"--case mass sets plant.mass_error, which --vary draws"):
        check_varied(cases[:2], laws, varied, given=True)
    for key in ("mission.law", "mission.law.moment_feed_forward"):
        with pytest.raises(InputError, match=f"--vary {key}: not valid here, because the law push"):
            check_varied(cases, laws, [key], given=False)


def test_varied_keys_of_built_in_cases_are_told_and_fly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The documented command: the table varies a key of each built-in case."""
    flown = []

    def fly(campaign: Campaign, runs: int, *, out: Path, **_: object) -> CampaignResult:
        flown.append(out.parts[-2:])
        rows = [build_row(i, **{"tip.tangential_rms_mm": 1.0 + i}) for i in range(runs)]
        verdict = build_verdict(rows, [], {}, 0.9)
        return CampaignResult(rows, verdict, out, 0.0, interrupted=False)

    monkeypatch.setattr(compare_module, "run_campaign", fly)
    monkeypatch.setattr(compare_module, "_measure", lambda *_: math.nan)
    monkeypatch.chdir(tmp_path)
    table = Path(__file__).parents[1] / "benchmarks" / "weld-scan-conditions.csv"
    words = ["compare", "laws", "push_and_slide,direct_force", "--mission", "pipe-weld-scan",
             "--robot", "othex-force", "--runs", "2", "--vary", str(table)]  # fmt: skip
    found = CliRunner().invoke(main, words, prog_name="skywright")
    assert found.exit_code == 0, found.output
    assert flown == [("push_and_slide", "nominal"), ("direct_force", "nominal")]
    assert found.stderr.count("left out") == 1
    page = Path("compare.html").read_text()
    for told in (found.stderr, page):
        assert (
            "eft out, because --vary draws a key that the built-in case sets: mass (plant." in told
        )
        assert "friction (world.pipe.friction)" in told
    left_out = json.loads(CliRunner().invoke(main, [*words, "--json"]).stdout)["left_out"]
    assert list(left_out) == ["mass", "delay", "wind", "gusts", "friction"]
    assert left_out["delay"] == ["world.link.delay_s"]
    found = CliRunner().invoke(main, [*words, "--case", "own:plant.mass_error=0"])
    assert found.exit_code == 2 and "--case own sets plant.mass_error, which --vary" in found.stderr
    assert "--set" not in found.stderr and len(flown) == 4


def test_a_law_may_have_options() -> None:
    assert list_law_sets("cascade") == ["mission.law=cascade"]
    assert list_law_sets("a/b.py:Mine:q=2e4:r.x=1") == [
        "mission.law=a/b.py:Mine", "mission.law.q=2e4", "mission.law.r.x=1",
    ]  # fmt: skip
    fed = list_law_sets("push_and_slide:moment_feed_forward=friction")
    law = load_description("pipe-weld-scan", sets=fed).law
    assert law is not None and law.kind == "push_and_slide"
    assert law.model_dump()["moment_feed_forward"] == "friction"


def test_laws_fly_the_same_seeds_and_a_law_that_cannot_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three laws, one of which needs a fully actuated robot; a second call flies nothing anew."""
    started = []
    monkeypatch.setattr(
        local,
        "_start_worker",
        lambda start=local._start_worker: started.append(start()) or started[-1],
    )
    laws, out = ["thrust_vectoring", "cascade", "backstepping"], tmp_path / "flights"

    def compare() -> LawComparison:
        return compare_laws(
            laws, "waypoints", robot="hexarotor", cases=["mass"], runs=2, seed=4, workers=1,
            sets=["mission.timestep_ms=2"], out=out,
        )  # fmt: skip

    found = compare()
    assert (
        len(started) == 1 and started[0].process.wait(10.0) <= 0
    )  # for all; it ended, or was killed
    for case in ("nominal", "mass"):
        pair = [found.find(law, case) for law in laws]
        assert [r.seed for r in pair[0].rows] == [r.seed for r in pair[1].rows]
        assert [len(f.rows) for f in pair] == [2, 2, 2]
        assert "fully actuated" in pair[2].refused and pair[2].succeeded == 0
    assert [found.find(law, "nominal").succeeded for law in laws] == [2, 2, 0]
    heavier = found.find("cascade", "mass").compute_median("flight.energy_wh")
    assert heavier > 1.05 * found.find("cascade", "nominal").compute_median("flight.energy_wh")
    d = found.find_difference("cascade", "nominal", "position.rms_m")
    assert d is not None and d.pairs == 2
    by_hand = [
        b.metrics["position.rms_m"] - a.metrics["position.rms_m"]
        for a, b in zip(
            found.find(laws[0], "nominal").rows, found.find(laws[1], "nominal").rows, strict=True
        )
    ]
    assert d.median == pytest.approx(np.median(by_hand)) and d.median != 0.0
    assert found.find_difference("backstepping", "nominal", "position.rms_m") is None
    assert 0.0 < found.cost_s["cascade"] < 1e-3 and math.isnan(found.cost_s["backstepping"])
    journals = {p: p.stat().st_mtime_ns for p in out.rglob("runs.jsonl")}
    assert json.dumps(compare().to_json()["flown"]) == json.dumps(found.to_json()["flown"])
    assert journals == {p: p.stat().st_mtime_ns for p in out.rglob("runs.jsonl")}
    page = tmp_path / "laws.html"
    write_laws_page(found, page)
    text = page.read_text()
    assert "2 of 2" in text and "refused" in text and "cascade minus thrust_vectoring" in text
    assert "nan" not in text.lower().split("<h2")[1]


def test_a_refusal_counts_for_its_own_case(tmp_path: Path) -> None:
    """Nominally the wind is refused; in the calm case nothing is, and both laws fly."""
    found = compare_laws(
        ["backstepping", "backstepping_torque"], "wall-contact",
        sets=["world.wind.kind=steady", "world.wind.mean_mps=14", "mission.task.forces_n=[2.0]",
              "mission.task.slide_m=0"],
        cases=["calm:world.wind.mean_mps=0"], runs=1, out=tmp_path / "laws", workers=1,
    )  # fmt: skip
    told = {(f.law, f.case): f for f in found.flown}
    assert "wind of 14" in told["backstepping", "nominal"].refused
    assert not told["backstepping", "calm"].refused
    assert "14" not in told["backstepping_torque", "calm"].refused


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["cascade"], "two or more"),
        (["cascade,cascade"], "two or more different laws, A,B; found: cascade, cascade"),
        ([","], "found: none"),
        (["cascade,cascade:nosuch=1"], "mission.law.nosuch"),
        (["cascade,nosuch"], "control law 'nosuch' is unknown"),
        (["cascade,thrust_vectoring", "--set", "mission.law=cascade"], "leave it out"),
        (["cascade,thrust_vectoring", "--case", "x:mission.law=cascade"], "leave it out"),
        (["cascade,thrust_vectoring", "--case", "../x:plant.mass_error=0.1"], "a name of letters"),
        (["cascade,thrust_vectoring", "--workers", "0"], "at least 1"),
        (["cascade,thrust_vectoring", "--runs", "0"], "at least 1"),
        (["cascade,thrust_vectoring", "--case", "storm"], "no such case"),
        (["cascade,thrust_vectoring", "--case", "x:robot.nothing=1"], "robot.nothing"),
        (["cascade,thrust_vectoring", "--out", "laws.txt"], "unknown format"),
        (["cascade,thrust_vectoring", "--out", "."], "unknown format"),
    ],
)
def test_wrong_input_is_one_line_and_leaves_no_page(
    words: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(
        main, ["compare", "laws", *words, "--mission", "waypoints"], prog_name="skywright"
    )
    assert found.exit_code == 2, found.output
    assert says in found.stderr and found.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


LAW = """
from skywright.core.record import Record
from skywright.errors import InputError
from skywright.vehicle.bus import Reference, WrenchCommand
from skywright.vehicle.component import Law, Out


class Mine(Law):
    compiled = False

    class Me(Record):
        x: float

    def build(self, me, table, context):
        {build}

    @staticmethod
    def {step}(me: Me, ref: Reference, cmd: Out[WrenchCommand]) -> None:
        {body}
"""


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"build": "raise RuntimeError('boom')"}, "RuntimeError: boom (line 15 of mine.py)"),
        ({"step": "walk"}, "has no static method 'step'"),
        ({"body": "cmd.f_B[0] = 'a' + 1", "compiled": "True"}, "does not compile"),
    ],
)
def test_a_wrong_file_is_told_before_anything_flies(
    parts: dict[str, str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither a folder nor a page is left, and the law before it has not flown."""
    monkeypatch.chdir(tmp_path)
    text = LAW.format(**{"build": "pass", "step": "step", "body": "pass"} | parts)
    if "compiled" in parts:
        text = text.replace("compiled = False", "compiled = True")
    Path("mine.py").write_text(text)
    found = CliRunner().invoke(
        main, ["compare", "laws", "cascade,mine.py:Mine", "--mission", "waypoints", "--runs", "1"],
        prog_name="skywright",
    )  # fmt: skip
    assert found.exit_code == 2, found.output
    assert says in found.stderr and "mine.py" in found.stderr and found.stderr.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir() if p.name != "__pycache__"] == ["mine.py"]


def test_what_a_law_itself_refuses_is_no_wrong_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(LAW.format(build="raise InputError('no')", step="step", body="pass"))
    check_law(load_description("waypoints", sets=[f"mission.law={file}:Mine"]))


def test_the_most_frequent_reason_of_lost_runs_is_told() -> None:
    """Reasons that differ in their times alone count as one."""

    def lose(reason: str, requirement: str = "aborted") -> Row:
        outcome = "aborted" if reason else "failed"
        return build_row(0)._replace(outcome=outcome, reason=reason, requirement=requirement)

    rows = [
        build_row(0), lose("", "position.rms_m"), lose("raised at t = 3.1 s"),
        lose("raised at t = 4.27 s"),
    ]  # fmt: skip
    assert Flown("a", "nominal", rows, "").reason == "2 of 4: raised at t = 3.1 s"
    assert Flown("a", "nominal", rows[:2], "").reason == "1 of 2: position.rms_m not met"
    assert Flown("a", "nominal", rows[:1], "").reason == ""


def test_that_no_law_can_fly_is_told_for_each(tmp_path: Path) -> None:
    out = tmp_path / "laws"
    with pytest.raises(InputError, match=r"backstepping: .*lateral.*; whole_body_qp: .*lateral"):
        compare_laws(
            ["backstepping", "whole_body_qp"], "waypoints", robot="hexarotor",
            cases=["nominal"], runs=1, out=out, workers=1,
        )  # fmt: skip
    assert not out.exists()


def test_the_cost_of_a_law_in_python_is_that_of_the_interpreter(tmp_path: Path) -> None:
    compiled = measure_cost(load_description("waypoints", sets=["mission.law=cascade"]))
    assert 1e-8 < compiled < 1e-4
