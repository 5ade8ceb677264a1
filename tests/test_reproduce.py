"""Claims: verdicts follow from values, flights are cached by content, the reduced model holds."""

from __future__ import annotations

import errno
import json
import math

import click
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from page_checks import check_page
from skywright.errors import InputError, SimulationError
from skywright.evidence.command import Command
from skywright.evidence.reproduce import cache as cache_module
from skywright.evidence.reproduce import elastic, runner
from skywright.evidence.reproduce.cache import Cache, Record
from skywright.evidence.reproduce.flights import build_description, describe_content
from skywright.evidence.reproduce.load import DATA, list_papers, load_claims
from skywright.evidence.reproduce.measures import MEASURES
from skywright.evidence.reproduce.series import band_rms, ring_growth, ring_remaining, smooth
from skywright.evidence.reproduce.spec import Case, Claim
from skywright.evidence.reproduce.spec import judge as judge_claim

PAPER = """
[paper]
id = "{name}"
short = "Someone 2020"
title = "T"
reference = "R"
[cases.one]
[cases.two]
sets = {{ "world.mocap.rate_hz" = 30 }}
needs = "a second camera"
"""

CLAIM = """
[[claims]]
id = "{name}"
where = "I"
statement = "S"
judged_by = "flight"
measure = "probe_tilt"
cases = {{ scan = "{case}" }}
tests = [{{ quantity = "tilt_max_deg", unit = "deg", sense = "<=", paper_value = {value} }}]
[claims.why]
reproduced = "{{tilt_max_deg:.1f}} deg"
contradicted = "as much as {{tilt_max_deg:.1f}} deg"
"""


PLATFORM = np.array([[1.23, 0.0, 1.34]])
"""m, mean place of the platform in the scan that the fans blow at."""


def scan_record(tilt_deg: float) -> Record:
    """What a scan of one second with a constant tilt leaves."""
    n = 100
    arrays = {"t": np.arange(n) / 100.0, "phase": np.zeros(n, int)}
    arrays["tilt"] = np.full(n, math.radians(tilt_deg))
    info = {
        "outcome": "succeeded",
        "reason": "",
        "metrics": {"contact.tilt_max_deg": tilt_deg},
        "phases": [{"name": "scan", "start_s": 0.0, "end_s": 1.0, "outcome": "done"}],
    }
    return Record(info, arrays)


@pytest.fixture
def paper(tmp_path):
    path = tmp_path / "own.toml"
    text = PAPER.format(name="own") + CLAIM.format(name="level", case="one", value=10.0)
    path.write_text(text + CLAIM.format(name="steep", case="two", value=1.0))
    return path


# --- the reduced model -------------------------------------------------------------------------

masses = st.floats(0.1, 5.0)
stiffnesses = st.floats(20.0, 2000.0)
gains = st.floats(0.05, 20.0)


@given(masses, masses, stiffnesses, gains, st.floats(0.01, 3.0), st.booleans())
def test_characteristic_polynomial_is_the_state_matrix_s(m1, m2, k, kd, fraction, displaced):
    model = elastic.build_damped(m1, m2, k, 0.05)
    expected = np.poly(elastic.state_matrix(model, fraction * k, kd, displaced)) * m1 * m2
    found = elastic.characteristic(model, fraction * k, kd, displaced)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.max(np.abs(expected)))


@given(masses, masses, stiffnesses, gains, st.floats(0.01, 3.0))
def test_feedback_of_the_tip_alone_is_unstable_for_every_gain(m1, m2, k, kd, fraction):
    """De Luca and Book 2008, ch. 13: no term in s^3, so the poles' sum is zero."""
    model = elastic.Elastic(m1, m2, k)
    assert not elastic.is_stable_by_routh(elastic.characteristic(model, fraction * k, kd, False))
    poles = np.linalg.eigvals(elastic.state_matrix(model, fraction * k, kd, False))
    assert abs(poles.sum().real) < 1e-6 * np.max(np.abs(poles))
    assert poles.real.max() > 0.0


@pytest.mark.parametrize("kd", [0.5, 10.0, 60.0])
def test_displaced_feedback_is_stable_exactly_below_the_stiffness(kd):
    model = elastic.Elastic(1.8, 0.45, 300.0)
    assert elastic.find_stability_limit(model, kd, True, 3000.0) == pytest.approx(300.0, rel=1e-4)
    assert elastic.is_stable_by_routh(elastic.characteristic(model, 299.0, kd, True))
    assert not elastic.is_stable_by_routh(elastic.characteristic(model, 301.0, kd, True))
    assert elastic.find_stability_limit(model, kd, False, 3000.0) == 0.0


def test_structural_damping_relaxes_both_statements():
    damped = elastic.build_damped(1.8, 0.45, 300.0, 0.05)
    assert elastic.find_stability_limit(damped, 10.0, True, 3000.0) > 310.0
    assert elastic.compute_growth(damped, 20.0, 1.0, displaced=False) < 0.0


def test_routh_on_known_polynomials():
    assert elastic.is_stable_by_routh(np.poly([-1.0, -2.0, -3.0 + 1j, -3.0 - 1j]).real)
    assert not elastic.is_stable_by_routh(np.poly([-1.0, -2.0, 0.5 + 3j, 0.5 - 3j]).real)


# --- signals -----------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [-2.0, -0.5, 0.6])
def test_growth_of_a_ringing_tip(rate):
    t = np.arange(300) / 100.0
    tip = 1e-3 * np.exp(rate * t)[:, None] * np.sin(2 * np.pi * 8.0 * t)[:, None] * [1.0, 0.0, 0.5]
    assert ring_growth(tip + [0.3, 0.0, 0.1], 4.0, 20.0) == pytest.approx(rate, abs=0.1)
    tip[200:] = np.nan
    assert ring_growth(tip, 4.0, 20.0) == math.inf


@pytest.mark.parametrize("rate", [-0.7, 0.0, 0.3])
def test_share_of_a_ringing_that_remains(rate):
    """The rms over the last 0.5 s and the first."""
    t = np.arange(600) / 100.0
    tip = 1e-3 * np.exp(rate * t)[:, None] * np.sin(2 * np.pi * 28.0 * t)[:, None] * [1.0, 0.0, 0.5]
    apart = (600 - 5 - 20 - 50) / 100.0
    found = ring_remaining(tip + [0.3, 0.0, 0.1], 4.0, 45.0)
    assert found == pytest.approx(math.exp(rate * apart), rel=0.03)
    tip[200:] = np.nan
    assert ring_remaining(tip, 4.0, 45.0) == math.inf


def test_band_and_moving_mean():
    t = np.arange(4096) / 100.0
    wave = 2e-3 * np.sin(2 * np.pi * 8.0 * t)[:, None] * [1.0, 0.0, 0.0]
    assert band_rms(wave, 4.0, 20.0) == pytest.approx(2e-3 / math.sqrt(2), rel=0.02)
    assert band_rms(wave, 20.0, 40.0) < 1e-5
    assert smooth(np.ones(50), 0.2) == pytest.approx(np.ones(50))


# --- claims files and verdicts -----------------------------------------------------------------


@pytest.mark.parametrize("paper", list_papers())
def test_the_built_in_claims_are_complete(paper):
    file = load_claims(paper)
    assert {c.measure for c in file.claims} <= set(MEASURES)
    used = {case for c in file.claims for case in c.cases.values()}
    assert set(file.cases) - used <= {"exact"}
    for claim in file.claims:
        first = claim.tests[0]
        for test in claim.tests:
            assert test.paper_value is not None or test.reading or test.limit is None, claim.id
        if first.limit is None:
            assert claim.why.not_comparable
        else:
            assert claim.why.reproduced and claim.why.contradicted


def make_claim(**test) -> Claim:
    return Claim(
        id="x", where="I", statement="S", judged_by="flight", measure="contact",
        tests=[{"quantity": "a", **test}, {"quantity": "b", "sense": ">", "bound": 1.0}],
    )  # fmt: skip


def test_verdicts_follow_from_the_values():
    claim = make_claim(sense="<=", paper_value=10.0, tolerance=1.0)
    assert judge_claim(claim, {"a": 10.9, "b": 2.0}).name == "reproduced"
    assert judge_claim(claim, {"a": 11.1, "b": 2.0}).name == "contradicted"
    assert judge_claim(claim, {"a": 5.0, "b": 1.0}).passed == [True, False]
    assert judge_claim(claim, {"a": 5.0, "b": math.nan}).name == "contradicted"
    assert judge_claim(claim, {"a": 5.0}).name == "contradicted"
    assert judge_claim(claim, {}).name == "not_comparable"
    assert judge_claim(make_claim(sense="=="), {"a": 5.0, "b": 2.0}).name == "not_comparable"
    told = make_claim(sense="<=", bound=1.0)
    told = told.model_copy(update={"tests": [told.tests[0], told.tests[1].model_copy(
        update={"bound": None})]})  # fmt: skip
    assert judge_claim(told, {"a": 0.5, "b": 2.0}) == ("reproduced", [True, None])
    exact = make_claim(sense="==", paper_value=4.0, tolerance=0.0)
    assert judge_claim(exact, {"a": 4.0, "b": 2.0}).name == "reproduced"
    assert judge_claim(exact, {"a": 3.0, "b": 2.0}).name == "contradicted"


def test_what_was_put_in_is_not_counted_as_reproduced(paper, tmp_path):
    from skywright.evidence.reproduce.present import count_verdicts, write_verdict

    flag = 'judged_by = "flight"\nfitted = "Chosen from the figure."'
    paper.write_text(paper.read_text().replace('judged_by = "flight"', flag))
    report = runner.reproduce(str(paper), cache=tmp_path, fly=lambda *_: scan_record(3.0))
    met, missed = report.claims
    assert (met.verdict, missed.verdict) == ("not_comparable", "contradicted")
    assert met.explanation == "Chosen from the figure. 3.0 deg" and met.tests[0].passed
    assert write_verdict(met) == "not comparable (fitted)"
    assert count_verdicts(report).startswith("0 of 2 claims reproduced, 1 contradicted, 1 not")
    entry = met.to_json()
    assert (entry["fitted"], entry["by_construction"], entry["judged_by"]) == (
        True, False, "flight",
    )  # fmt: skip
    assert entry["tests"][0]["bound_by"] == "paper"


@pytest.mark.parametrize("paper", list_papers())
def test_claims_say_how_they_are_judged_as_their_cases_do(paper):
    """A claim without a case flies nothing; a clamped platform does not fly either."""
    file = load_claims(paper)
    for claim in file.claims:
        cases = [file.cases[c] for c in claim.cases.values()]
        held = [c.kind in ("press", "lean") or c.mission.endswith("-bench") for c in cases]
        how = "computation" if not cases else "bench" if all(held) else "flight"
        assert claim.judged_by == how, claim.id


def test_the_fans_blow_at_the_paper_s_speed_on_the_robot():
    from skywright.description.world.wind import compute_mean_wind

    cases = load_claims("tognon-2018").cases
    names = [n for n in cases if n.startswith(("fan", "steady"))]
    assert len(names) == 6
    for name in names:
        air = compute_mean_wind(build_description(cases[name], 1).world.wind, PLATFORM)
        assert np.linalg.norm(air) == pytest.approx(6.0, rel=0.1), name


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("probe_tilt", "probe_tlit", "unknown measure 'probe_tlit'; valid: .*probe_tilt"),
        ('scan = "one"', 'scan = "onne"', "names the case 'onne'; valid: .*one"),
        ("[cases.one]", '[cases.one]\nkind = "hover"', "'hover' needs winds_mps"),
        ("[cases.one]", '[cases.one]\nkind = "lean"', "'lean' needs forces_n"),
        ('sense = "<="', 'sense = "~"', r"tests\.0\.sense"),
        ('where = "I"', 'were = "I"', r"claims\.0\.(where|were)"),
        ('id = "steep"', 'id = "level"', "two claims are called 'level'"),
        ("{tilt_max_deg:.1f} deg", "{} deg", r"why\.reproduced: \{\}: the name of a measured"),
        ("{tilt_max_deg:.1f} deg", "{tilt_max_deg:d}", r"why\.reproduced: Unknown format code"),
        ("{tilt_max_deg:.1f} deg", "{tilt_max_deg", r"why\.reproduced: expected '}'"),
        ('sense = "<="', 'sense = "<=", bound = nan', r"tests\.0\.bound: .* finite"),
        ('sense = "<="', 'sense = "<=", tolerance = -1.0', r"tests\.0\.tolerance"),
    ],
)
def test_a_wrong_claims_file_is_told(paper, old, new, message):
    paper.write_text(paper.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        load_claims(str(paper))


def test_unknown_papers_and_claims_are_told(paper):
    with pytest.raises(InputError, match=r"unknown paper 'tognon'; valid: .*tognon-2018"):
        load_claims("tognon")
    with pytest.raises(InputError, match=r"unknown claim 'levle' of own; valid: level, steep"):
        runner.reproduce(str(paper), cache=None, only=["levle"])


def test_claims_are_found_in_all_papers():
    assert runner.check_papers(None) == {name: [] for name in list_papers()}
    found = runner.check_papers(None, ["touch-down", "sanchez-cuevas-2020/payload"])
    assert found == {"sanchez-cuevas-2020": ["payload"], "tognon-2018": ["touch-down"]}
    with pytest.raises(InputError, match=r"unknown claim 'touch-dwon'; valid: .*touch-down"):
        runner.check_papers(None, ["touch-dwon"])
    with pytest.raises(InputError, match=r"unknown paper 'tognon'; valid: .*tognon-2018"):
        runner.check_papers(None, ["tognon/touch-down"])


@pytest.mark.parametrize("words", [["nobody-2018"], ["tognon-2018", "--claim", "nothing"]])
def test_a_name_that_does_not_exist_leaves_no_page(words, tmp_path, monkeypatch):
    from skywright.cli import main

    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as caught:
        main(["reproduce", *words])
    assert caught.value.code == 2 and not list(tmp_path.iterdir())


def test_a_page_is_written_where_there_was_none(tmp_path, monkeypatch, capsys):
    """With the default name, and again over the page that is there then."""
    from skywright.cli import main

    monkeypatch.chdir(tmp_path)
    words = ["reproduce", "sanchez-cuevas-2020", "--claim", "lateral-force-x"]
    for _ in range(2):
        with pytest.raises(SystemExit) as caught:
            main([*words, "--cache", "kept", "--json"])
        assert caught.value.code == 0
        (claim,) = json.loads(capsys.readouterr().out)["claims"]
        assert claim["verdict"] == "not_comparable" and claim["fitted"]
        assert "lateral-force-x" in (tmp_path / "claims.html").read_text()


# --- the runner and its cache ------------------------------------------------------------------


def test_flights_are_shared_kept_and_flown_again_when_their_content_changes(
    paper, tmp_path, monkeypatch
):
    flown = []

    def fly(case, description):
        flown.append(description.world.mocap.rate_hz)
        return scan_record(3.0)

    folder = tmp_path / "kept"
    report = runner.reproduce(str(paper), cache=folder, fly=fly)
    assert [c.verdict for c in report.claims] == ["reproduced", "contradicted"]
    assert [c.explanation for c in report.claims] == ["3.0 deg", "as much as 3.0 deg"]
    assert report.exit_code == 0  # a contradiction is a result
    assert flown == [100.0, 30.0] and (report.flown, report.cached) == (2, 0)
    again = runner.reproduce(str(paper), cache=folder, fly=fly)
    assert len(flown) == 2 and (again.flown, again.cached) == (0, 2)
    assert again.to_json() == report.to_json()
    runner.reproduce(str(paper), cache=folder, only=["level"], fly=fly)
    paper.write_text(paper.read_text().replace('rate_hz" = 30', 'rate_hz" = 40'))
    runner.reproduce(str(paper), cache=folder, fly=fly)
    assert flown == [100.0, 30.0, 40.0]
    monkeypatch.setattr(cache_module, "hash_source", lambda: "another version ")
    runner.reproduce(str(paper), cache=folder, only=["level"], fly=fly)
    assert len(flown) == 4


def test_a_flight_that_fails_costs_only_its_claims(paper, tmp_path):
    def fly(case, description):
        if description.world.mocap.rate_hz < 50:
            raise SimulationError("it diverged")
        return scan_record(3.0)

    report = runner.reproduce(str(paper), cache=tmp_path, fly=fly)
    good, bad = report.claims
    assert good.verdict == "reproduced"
    assert bad.verdict == "not_comparable" and "it diverged" in bad.explanation
    assert report.exit_code == 1
    entry = bad.to_json()
    assert entry["value"] is None and json.dumps(entry, allow_nan=False)
    assert set(entry) >= {
        "id", "paper", "statement", "paper_value", "value", "unit", "tolerance", "verdict",
        "explanation",
    }  # fmt: skip
    paper.write_text(paper.read_text().replace("rate_hz", "rate_hertz"))
    report = runner.reproduce(str(paper), cache=tmp_path, fly=fly)
    assert "it needs a second camera" in report.claims[1].explanation
    assert "rate_hz" in report.claims[1].explanation  # its neighbours


def test_a_flight_cut_short_is_told_whatever_the_verdict(paper, tmp_path):
    def fly(case, description):
        record = scan_record(3.0)
        if description.world.mocap.rate_hz < 50:
            record.info.update(outcome="diverged", reason="NaN at t = 9 s")
        return record

    whole, part = runner.reproduce(str(paper), cache=tmp_path, fly=fly).claims
    assert "part" not in whole.explanation and part.verdict == "contradicted"
    assert "on a part of the flight: 'two' diverged (NaN at t = 9 s)." in part.explanation


def test_a_case_that_the_measure_does_not_ask_for_is_told(paper, tmp_path):
    paper.write_text(paper.read_text().replace("cases = { scan =", "cases = { flight ="))
    report = runner.reproduce(str(paper), cache=tmp_path, fly=lambda *_: scan_record(3.0))
    assert "requires the case 'scan'; the claim gives: flight" in report.claims[0].explanation
    assert report.exit_code == 1


def test_a_fault_of_the_program_costs_only_its_claims(paper, tmp_path):
    def fly(case, description):
        if description.world.mocap.rate_hz < 50:
            raise ZeroDivisionError("division by zero")
        return scan_record(3.0)

    good, bad = runner.reproduce(str(paper), cache=tmp_path, fly=fly).claims
    assert good.verdict == "reproduced" and bad.verdict == "not_comparable"
    assert "ZeroDivisionError: division by zero (test_reproduce.py:" in bad.explanation


LAW = """
from skywright.core.record import Record
from skywright.vehicle.bus import WrenchCommand
from skywright.vehicle.component import Law, Out


class Mine(Law):
    class Me(Record):
        none: float

    @staticmethod
    def step(me: Me, cmd: Out[WrenchCommand]) -> None:
        {}
"""


def test_another_law_behind_the_same_name_is_flown_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    law = tmp_path / "law.py"
    case = Case(sets={"mission.law": "law.py:Mine"})
    contents = set()
    for text in ("pass", "return"):
        law.write_text(LAW.format(text))
        contents.add(describe_content(case, build_description(case, 1)))
    assert len(contents) == 2


def test_a_damaged_or_unwritable_cache_costs_nothing_but_time(tmp_path):
    kept = Cache(tmp_path)
    kept.store("x", scan_record(1.0))
    assert kept.load("x").info["metrics"] == {"contact.tilt_max_deg": 1.0}
    path = kept.path("x")
    path.write_bytes(path.read_bytes()[:100])
    assert kept.load("x") is None
    blocked = tmp_path / "a file"
    blocked.write_text("")
    other = Cache(blocked / "below")
    other.store("x", scan_record(1.0))
    assert "not kept" in other.trouble and other.load("x") is None


def test_old_versions_are_pruned(tmp_path):
    for i in range(6):
        (tmp_path / f"{i:016d}").mkdir()
    (tmp_path / "mine").mkdir()
    Cache(tmp_path).prune()
    assert len(list(tmp_path.iterdir())) == cache_module.KEEP + 1


# --- the real thing ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Claims that need two flights and no flight, flown for real, and their page."""
    from skywright.evidence.reproduce.present import write_claims_page

    folder = tmp_path_factory.mktemp("claims")
    only = ["touch-down", "tip-only-reduced", "displaced-reduced"]
    text = (DATA / "tognon-2018.toml").read_text(encoding="utf-8")
    text = text.replace("seeds = [1, 2, 3]", "seeds = [1]")
    short = '[sets]\n"mission.task.passes" = 1\n"mission.timestep_ms" = 2\n'
    (folder / "one.toml").write_text(text.replace("[sets]\n", short, 1))
    report = runner.reproduce(str(folder / "one.toml"), cache=folder, only=only)
    write_claims_page([report], folder / "claims.html")
    return report, folder / "claims.html"


def test_real_flights_give_verdicts(measured):
    report, _ = measured
    by_id = {c.claim.id: c for c in report.claims}
    verdicts = {c.claim.id: c.verdict for c in report.claims}
    assert verdicts.pop("touch-down") == "not_comparable"  # fitted
    assert set(verdicts.values()) == {"reproduced"}
    assert 0.5 < by_id["touch-down"].values["fade_s"] < 5.0
    assert by_id["touch-down"].values["left_without"] > 0.8
    assert by_id["displaced-reduced"].values["limit"] == pytest.approx(1.0, abs=1e-3)


def test_nothing_of_the_page_is_cut_off(measured, show_page):
    check_page(show_page, measured[1], has_plots=True)  # touch-down: over time


def test_the_page_is_complete_in_itself(measured):
    report, path = measured
    page = path.read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == len(report.claims)
    assert 'src="http' not in page and "?" not in report.claims[0].explanation
    for claim in report.claims:
        assert claim.claim.statement in page


def test_a_command_reports_a_full_disk_in_one_line() -> None:
    """Such an error has no file name."""

    @click.command("table", cls=Command)
    def write() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    found = CliRunner().invoke(write)
    assert found.exit_code == 2
    assert found.stderr == "table: an output file: No space left on device\n"
