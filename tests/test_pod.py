"""Probability of detection: published results, independent fits, coverage of the bounds, files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import expit

from skywright.analysis.pod.a_hat import LEFT, OBSERVED, RIGHT, _differentiate, fit_a_hat
from skywright.analysis.pod.groups import compare_groups
from skywright.analysis.pod.hit_miss import bound_share, fit_hit_miss
from skywright.analysis.pod.links import LINKS, LOGIT
from skywright.analysis.pod.method import Method
from skywright.analysis.pod.pod import compute_pod
from skywright.analysis.pod.table import Inspections, load_inspections
from skywright.cli import main
from skywright.errors import InputError

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT.parent / "shared" / "data" / "pod"
EXAMPLES = ROOT / "examples" / "pod"


def build_table(size: np.ndarray, **columns: np.ndarray) -> Inspections:
    return Inspections(
        np.asarray(size, float), "mm", columns.get("hit"), columns.get("signal"),
        columns.get("contact"), None, {},
    )  # fmt: skip


def draw_hits(seed: int, n: int, middle: float, slope: float, ceiling: float = 1.0) -> Inspections:
    r = np.random.default_rng(seed)
    a = r.uniform(0.05, 1.0, n)
    hit = (r.random(n) < ceiling * expit(slope * (a - middle))).astype(float)
    return build_table(a, hit=hit)


if DATA.is_dir():  # beside the checkout, where it is: the data are not ours to publish

    def test_hit_miss_agrees_with_the_published_result() -> None:
        table = load_inspections(DATA / "hitmiss_afrl_good1.csv")
        c = compute_pod(table, Method(size_axis="linear")).curve
        assert c.coefficients["b0"] == pytest.approx(-11.83265105, rel=1e-6)
        assert c.coefficients["b1"] == pytest.approx(45.30678376, rel=1e-6)
        assert c.aic == pytest.approx(28.45673969, rel=1e-6)
        assert c.a90 == pytest.approx(0.309663906, rel=1e-6)
        assert c.a90_95 == pytest.approx(0.381497, rel=1e-4)
        assert c.a90_95 == pytest.approx(0.381546911, abs=1e-4)  # theirs interpolates
        c = compute_pod(table, Method(size_axis="linear", bounds="likelihood")).curve
        assert c.a90_95 == pytest.approx(0.356454, rel=1e-4)

    @pytest.mark.parametrize(
        ("left", "axis", "expected"),
        [
            (50.0, "log", (8.0331, 14.4410, 16.1674)),
            (None, "log", (None, 14.1130, 15.7336)),
            (50.0, "linear", (8.7774, 12.6322, 13.6101)),
        ],
    )
    def test_a_hat_agrees_with_the_oracle(
        left: float | None, axis: str, expected: tuple[float | None, ...]
    ) -> None:
        table = load_inspections(DATA / "ahat_mh1823_ex1.csv")
        method = Method(decision=200.0, left=left, size_axis="log", signal_axis=axis)
        c = compute_pod(table, method).curve
        for value, target in zip((c.a50, c.a90, c.a90_95), expected, strict=True):
            assert target is None or value == pytest.approx(target, rel=1e-4)


@pytest.mark.parametrize("name", list(LINKS))
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_hit_miss_agrees_with_statsmodels(name: str, seed: int) -> None:
    """Coefficients, expected information and likelihood, against an independent package."""
    import statsmodels.api as sm

    table = draw_hits(seed, 90, 0.4, 14.0)
    assert table.hit is not None
    link = {"logit": sm.families.links.Logit(), "probit": sm.families.links.Probit()}[name]
    theirs = sm.GLM(table.hit, sm.add_constant(table.size), family=sm.families.Binomial(link)).fit(
        tol=1e-12
    )
    ours = fit_hit_miss(table.size, table.hit, LINKS[name])
    assert [ours.b0, ours.b1] == pytest.approx(theirs.params, rel=1e-5)
    assert ours.log_likelihood == pytest.approx(theirs.llf, rel=1e-8)
    assert ours.covariance == pytest.approx(theirs.cov_params(), rel=1e-4)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_hat_agrees_with_statsmodels_and_with_differences(seed: int) -> None:
    import statsmodels.api as sm

    r = np.random.default_rng(seed)
    x = r.uniform(0.0, 2.0, 50)
    y = 1.0 + 2.0 * x + 0.4 * r.normal(size=50)
    side = np.zeros(50, int)
    ours = fit_a_hat(x, y, side, 3.0)
    theirs = sm.OLS(y, sm.add_constant(x)).fit()
    assert [ours.b0, ours.b1] == pytest.approx(theirs.params, rel=1e-8)
    assert ours.s == pytest.approx(np.sqrt(theirs.ssr / 50), rel=1e-7)
    assert ours.log_likelihood == pytest.approx(theirs.llf, rel=1e-9)
    # with censoring: gradient and Hessian against central differences of the likelihood
    side = np.where(y < 2.0, LEFT, np.where(y > 4.0, RIGHT, OBSERVED))
    y = np.clip(y, 2.0, 4.0)
    theta, h = np.array([0.8, 2.2, -0.7]), 1e-5
    _, gradient, hessian = _differentiate(theta, x, y, side)
    for i, e in enumerate(np.eye(3) * h):
        up, down = (_differentiate(theta + q, x, y, side) for q in (e, -e))
        assert gradient[i] == pytest.approx((up[0] - down[0]) / (2 * h), rel=1e-6, abs=1e-6)
        assert hessian[i] == pytest.approx((up[1] - down[1]) / (2 * h), rel=1e-5, abs=1e-5)
    # censoring moves the line little, where ignoring it would
    censored = fit_a_hat(x, y, side, 3.0)
    assert censored.b1 == pytest.approx(ours.b1, abs=0.25)
    assert fit_a_hat(x, y, 0 * side, 3.0).b1 < censored.b1 - 0.15


@pytest.mark.parametrize("bounds", ["wald", "likelihood"])
def test_the_bound_holds_in_95_of_100_tables(bounds: str) -> None:
    """Truth a90 = 0.4 + ln 9 / 12; binomial limits of 4 standard deviations."""
    truth, n, held = 0.4 + np.log(9.0) / 12.0, 150, 0
    for seed in range(n):
        table = draw_hits(seed, 150, 0.4, 12.0)
        assert table.hit is not None
        bound = fit_hit_miss(table.size, table.hit, LOGIT).find_bound(0.9, bounds)
        held += bound is None or bound >= truth
    assert held / n == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / n))


def test_the_signal_bound_holds_in_95_of_100_tables() -> None:
    held, n = 0, 200
    truth = (2.0 - 1.0 + 1.2816 * 0.4) / 2.0
    for seed in range(n):
        r = np.random.default_rng(seed)
        x = r.uniform(0.0, 1.5, 60)
        y = 1.0 + 2.0 * x + 0.4 * r.normal(size=60)
        fit = fit_a_hat(x, np.maximum(y, 1.2), np.where(y < 1.2, LEFT, 0), 2.0)
        held += (fit.find_bound(0.9, "wald") or np.inf) >= truth
    assert held / n == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / n))


def test_lost_contact_is_a_ceiling() -> None:
    """With 15 % of the contacts lost no a90 exists; two parameters report one all the same."""
    table = draw_hits(4, 600, 0.3, 25.0, ceiling=0.85)
    plain = compute_pod(table, Method(size_axis="linear"))
    assert plain.curve.a90 is not None
    assert any("ceiling" in w and "misleads" in w for w in plain.warnings)
    fitted = compute_pod(table, Method(size_axis="linear", ceiling="fit")).curve
    assert fitted.ceiling is not None and fitted.conditional is not None
    assert fitted.ceiling.value == pytest.approx(0.85, abs=0.04)
    assert fitted.ceiling.lower < 0.85 < 0.9 and fitted.a90 is None and fitted.a90_95 is None
    assert fitted.conditional["a90"] == pytest.approx(0.3 + np.log(9.0) / 25.0, abs=0.06)
    assert np.max(fitted.pod) < 0.9
    # the same from records of contact
    r = np.random.default_rng(7)
    a = r.uniform(0.05, 1.0, 600)
    contact = (r.random(600) < 0.85).astype(float)
    hit = contact * (r.random(600) < expit(25.0 * (a - 0.3)))
    known = compute_pod(build_table(a, hit=hit, contact=contact), Method(size_axis="linear")).curve
    assert known.ceiling is not None and known.ceiling.source == "contact"
    assert known.ceiling.lower == pytest.approx(bound_share(int(contact.sum()), 600)[0])
    assert known.a90 is None and known.conditional is not None
    assert known.conditional["a90"] == pytest.approx(0.3 + np.log(9.0) / 25.0, abs=0.06)
    assert np.max(known.pod) == pytest.approx(contact.mean(), abs=0.01)


def test_bounds_below_a_given_ceiling_agree_on_many_flaws() -> None:
    """Where contact was held, the POD is F alone: a90 = 0.3 + ln 9 / 25, whatever the ceiling."""
    table = draw_hits(4, 4000, 0.3, 25.0, ceiling=0.95)
    truth, margins = 0.3 + np.log(9.0) / 25.0, []
    for bounds in ("wald", "likelihood"):
        method = Method(size_axis="linear", ceiling=0.95, bounds=bounds)
        sizes = compute_pod(table, method).curve.conditional
        assert sizes is not None and sizes["a90"] is not None and sizes["a90_95"] is not None
        assert sizes["a90"] == pytest.approx(truth, abs=0.01)
        margins.append(sizes["a90_95"] - sizes["a90"])
    assert 0.008 < margins[0] < 0.016 and margins[1] == pytest.approx(margins[0], rel=0.1)


def test_a_ceiling_at_its_boundary_is_not_certain() -> None:
    table = draw_hits(1, 80, 0.4, 12.0)
    assert table.hit is not None
    fit = fit_hit_miss(table.size, table.hit, LOGIT, None)
    lower = fit.compute_ceiling_lower()
    assert fit.ceiling == 1.0 and 0.7 < lower < 0.999
    fixed = fit_hit_miss(table.size, table.hit, LOGIT)
    assert fit.find_bound(0.8, "likelihood") >= fixed.find_bound(0.8, "likelihood")  # type: ignore[operator]


@settings(deadline=None, max_examples=10)
@given(
    factor=st.floats(1e-3, 1e3), seed=st.integers(0, 1000),
    axis=st.sampled_from(["linear", "log"]), link=st.sampled_from(["logit", "probit"]),
)  # fmt: skip
def test_units_and_order_do_not_matter(factor: float, seed: int, axis: str, link: str) -> None:
    table = draw_hits(seed, 120, 0.4, 10.0)
    order = np.random.default_rng(seed).permutation(120)
    assert table.hit is not None
    method = Method(size_axis=axis, link=link)
    one = compute_pod(table, method).curve
    other = compute_pod(build_table(factor * table.size[order], hit=table.hit[order]), method).curve
    for name in ("a50", "a90", "a90_95"):
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None)
        assert a is None or b == pytest.approx(factor * a, rel=1e-5)


@pytest.mark.parametrize(("found", "of", "lower"), [(29, 29, 0.9), (45, 46, 0.9), (59, 61, 0.9)])
def test_known_samples_show_ninety_per_cent(found: int, of: int, lower: float) -> None:
    assert bound_share(found, of)[0] == pytest.approx(lower, abs=0.003)
    assert bound_share(found, of)[0] >= lower


def test_false_calls_have_an_upper_bound() -> None:
    """No call at 300 sites bounds the rate at 1 % (the rule of three)."""
    table = draw_hits(2, 80, 0.4, 12.0)
    size = np.concatenate([table.size, np.zeros(300)])
    hit = np.concatenate([table.hit, np.zeros(300)])  # type: ignore[list-item]
    calls = compute_pod(build_table(size, hit=hit)).false_calls
    assert calls is not None and calls.calls == 0
    assert calls.upper_95 == pytest.approx(1 - 0.05 ** (1 / 300), rel=1e-9)
    assert 0.009 < calls.upper_95 < 0.01


def test_passes_over_one_flaw_are_one_datum() -> None:
    """Repeating every row with its name changes nothing; without names the bound shrinks."""
    table = draw_hits(3, 80, 0.4, 10.0)
    names = tuple(f"f{i}" for i in range(80))
    assert table.hit is not None
    once = compute_pod(table).curve
    three = build_table(np.tile(table.size, 3), hit=np.tile(table.hit, 3))
    named = compute_pod(three._replace(flaw=names * 3))
    assert named.curve.a90_95 == once.a90_95 and named.counted.passes_merged == 160
    blind = compute_pod(three).curve
    assert blind.a90 == pytest.approx(once.a90, rel=1e-6)
    assert blind.a90_95 < once.a90_95  # type: ignore[operator]
    with pytest.raises(InputError, match="flaw 'f0' has the sizes"):
        sizes = three.size.copy()
        sizes[0] += 1.0
        compute_pod(three._replace(size=sizes, flaw=names * 3))


def test_groups_are_compared() -> None:
    same, other = draw_hits(1, 150, 0.4, 12.0), draw_hits(2, 150, 0.6, 12.0)
    for second, differs in ((draw_hits(3, 150, 0.4, 12.0), False), (other, True)):
        size = np.concatenate([same.size, second.size])
        hit = np.concatenate([same.hit, second.hit])  # type: ignore[list-item]
        table = build_table(size, hit=hit)._replace(others={"law": ("p",) * 150 + ("q",) * 150})
        found = compare_groups(table, "law")
        assert (found.p_same < 0.01) == differs
        assert set(found.groups) == {"p", "q"}
    with pytest.raises(InputError, match="valid: law"):
        compare_groups(table, "wind")


def test_residuals_are_judged() -> None:
    r = np.random.default_rng(3)
    x = np.sort(r.uniform(0.1, 3.0, 80))
    for signal, word in (
        (np.exp(x) + 1.0 + 0.2 * r.normal(size=80), "bend"),
        (2.0 + x + 0.4 * x**2 * r.standard_t(5, 80), "grow or shrink"),
    ):
        method = Method(decision=3.0, size_axis="linear", signal_axis="linear")
        found = compute_pod(build_table(x, signal=signal), method)
        assert any(word in w for w in found.warnings)
    line = build_table(x, signal=3.0 + 2.0 * x + 0.3 * r.normal(size=80))
    assert not [w for w in compute_pod(line, method).warnings if "residuals" in w]


def call(*args: object) -> tuple[int, str]:
    done = CliRunner().invoke(main, ["pod", *map(str, args)])
    return done.exit_code, done.output


LINEAR = ("--size-axis", "linear", "--signal-axis", "linear")
HEAD = "depth_mm,hit\n"
PAIRS = "".join(f"{0.1 * k:.1f},{int(k > 5 or k == 3)}\n" for k in range(1, 12))


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        ("", (), "the file is empty"),
        (HEAD, (), "no rows"),
        ("x,y\n1,2\n", (), "no column gives the size; found: x, y"),
        ("a,b\n1,2\n", (), "no column gives the hit or signal"),
        (HEAD + "0.5,1\n" * 3 + "0.5,0\n", (), "all 4 flaws have one size"),
        (HEAD + "".join(f"{k},1\n" for k in range(1, 30)), (), "all 29 flaws were found"),
        (HEAD + "".join(f"{k},1\n" for k in range(1, 30)), (), "at least 0.902"),
        (HEAD + "1,0\n2,0\n3,0\n", (), "all 3 flaws were missed"),
        (HEAD + "1,0\n2,0\n3,1\n4,1\n", (), "separated by size"),
        (HEAD + "1,1\n2,1\n3,0\n4,1\n5,0\n6,0\n", (), "does not grow with size"),
        (HEAD + PAIRS + "nan,1\n", (), "row 13: depth_mm is 'nan'"),
        (HEAD + PAIRS + "0.5,\n", (), "row 13: hit is ''"),
        (HEAD + PAIRS + "0.5,0.7\n", (), "hit is '0.7'"),
        (HEAD + PAIRS + "0.5\n", (), "row 13 has 1 cells; the header has 2"),
        (HEAD + PAIRS + "-0.5,1\n", (), "size -0.5; valid: above 0"),
        (HEAD + "0,1\n0,0\n", (), "every size is 0"),
        (HEAD + PAIRS, ("--decision", 3), "valid for a-hat data only"),
        (HEAD + PAIRS, ("--model", "a-hat"), "no column of signals"),
        (HEAD + PAIRS, ("--ceiling", "contact"), "no column contact"),
        (HEAD + PAIRS, ("--ceiling", "1.5"), "--ceiling 1.5"),
        (HEAD + PAIRS, ("--ceiling", "nan"), "--ceiling nan"),
        (HEAD + PAIRS, ("--group", "wind"), "--group 'wind': no such column"),
        (HEAD + PAIRS, ("--columns", "hit=Found"), "no column 'found'"),
        (HEAD + PAIRS, ("--columns", "width=x"), "valid: QUANTITY=NAME"),
        (HEAD + PAIRS, ("--columns", "size=depth_mm[mm],size=hit[mm]"), "size is given twice"),
        (HEAD + PAIRS, ("--columns", "hit=hit[mm]"), "valid units: none"),
        (HEAD + PAIRS, ("--columns", "size=depth_mm[um]"), "states mm, but um is given"),
        ("depth_ft,hit\n1,1\n", ("--columns", "size=depth_ft[mm]"), "'depth_ft' states ft; valid"),
        ("depth_cm,hit\n1,1\n", ("--columns", "size=depth_cm"), "'depth_cm' states cm; valid"),
        ("Depth (Zoll),hit\n1,1\n", ("--columns", "size=Depth (Zoll)"), "states no unit that is"),
        ("a,a,hit\n1,2,1\n", ("--columns", "size=a"), "several columns 'a'"),
        ("a;hit\n0,5;1\n1.5;1\n", (), "both , and . (such as 0,5 and 1.5)"),
        ("a,ahat\n1,2\n2,3\n", (), "require --decision"),
        ("a,ahat\n1,2\n2,3\n", ("--decision", "nan"), "require --decision"),
        ("a,ahat\n1,2\n2,4\n3,6\n", ("--decision", 3, *LINEAR), "without any scatter"),
        ("a,ahat\n1,5\n2,4.2\n3,3\n", ("--decision", 3), "signal does not grow"),
        ("a,ahat\n1,2\n1,3\n1,4\n", ("--decision", 3), "one size"),
        ("a,ahat\n1,2\n2,3\n3,5\n", ("--decision", 3, "--left", 4), "lies outside"),
        ("a,ahat\n1,-2\n2,3\n3,5\n", ("--decision", 3, "--signal-axis", "log"), "--signal-axis"),
    ],
)  # fmt: skip
def test_bad_data_is_told_in_one_line(
    tmp_path: Path, text: str, options: tuple[object, ...], says: str
) -> None:
    path = tmp_path / "d.csv"
    path.write_text(text)
    code, out = call(path, *options, "--out", tmp_path / "p.png")
    assert code == 2 and says in out, out
    assert len(out.strip().splitlines()) == 1 and "internal" not in out


def test_the_command_prints_draws_and_reads_other_headers(tmp_path: Path) -> None:
    code, out = call(EXAMPLES / "hit_miss.csv", "--group", "operator", "--json")
    found = json.loads(out)
    assert code == 0 and found["ceiling"]["source"] == "contact"
    assert found["passes_merged"] == 72 and set(found["groups"]["curves"]) == {"A", "B"}
    assert found["false_calls"]["sites"] == 240
    picture = tmp_path / "p.svg"
    code, out = call(EXAMPLES / "a_hat.csv", "--decision", 30, "--right", 150, "--out", picture)
    assert code == 0 and "a-hat, censored line" in out and b"<svg" in picture.read_bytes()
    table = tmp_path / "t.csv"
    table.write_text("Tiefe;Gefunden\n" + PAIRS.replace(",", ";"))
    code, out = call(table, "--columns", "size=Tiefe[mm],hit=Gefunden", "--json")
    assert code == 0 and json.loads(out)["unit"] == "mm"
    commas = "Depth [mm];hit;wind;day;site\n0,25;1;3,5;1.3.26;1,2\n0,5;0;;2.3.26;A\n"
    table.write_text(commas)
    for spec in (None, "size=Depth[mm]", "size=depth"):
        read = load_inspections(table, spec)
        assert read.size.tolist() == [0.25, 0.5] and read.unit == "mm"
        assert read.others["wind"] == ("3.5", "")
        assert read.others["day"] == ("1.3.26", "2.3.26") and read.others["site"] == ("1,2", "A")
        assert read.notes == ("decimal commas read as decimal points",)
    table.write_text("Depth [mm];hit;height\n0.25;1;3,500\n")  # here , may separate thousands
    assert load_inspections(table).others == {"height": ("3,500",)}
    table.write_text("Depth_microns,hit\n10,1\n")
    assert load_inspections(table, "size=Depth_microns").unit == "um"
    table.write_text("depth_mils,hit\n10,1\n")
    for spec in (None, "size=depth_mils", "size=depth_mils[mil]"):
        assert load_inspections(table, spec).unit == "mil"


def test_a_scale_of_standard_errors_follows_the_sample() -> None:
    """Ten copies of a table: standard errors fall with the root of ten, estimates stay."""
    table = draw_hits(5, 80, 0.4, 10.0)
    assert table.hit is not None
    one = fit_hit_miss(table.size, table.hit, LOGIT)
    ten = fit_hit_miss(np.tile(table.size, 10), np.tile(table.hit, 10), LOGIT)
    assert ten.b1 == pytest.approx(one.b1, rel=1e-6)
    assert ten.covariance == pytest.approx(one.covariance / 10, rel=1e-5)
    z = stats.norm.ppf(0.95)
    x = np.array([0.45])
    eta = one.b0 + one.b1 * x
    se = np.sqrt(one.covariance[0, 0] + 2 * x * one.covariance[0, 1] + x**2 * one.covariance[1, 1])
    assert one.compute_lower(x, "wald") == pytest.approx(expit(eta - z * se))
