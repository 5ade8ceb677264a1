"""Probability of detection: groups that inspected the same flaws, ceilings, steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from skywright.analysis.pod.groups import compare_groups, divide
from skywright.analysis.pod.hit_miss import estimate_ceiling, fit_hit_miss
from skywright.analysis.pod.links import LINKS, LOGIT
from skywright.analysis.pod.method import Method
from skywright.analysis.pod.pod import Pod, compute_pod
from skywright.analysis.pod.table import Inspections, load_inspections
from skywright.errors import InputError


def build_table(size: np.ndarray, hit: np.ndarray) -> Inspections:
    return Inspections(np.asarray(size, float), "mm", np.asarray(hit, float), None, None, None, {})


def build_pair(middles: tuple[float, float], ceiling: float = 1.0, seed: int = 5) -> Inspections:
    """120 flaws, each inspected once by the operators A and B; POD one half at `middles`."""
    r = np.random.default_rng(seed)
    size = r.uniform(0.2, 3.0, 120)
    hits = [r.random(120) < ceiling * expit(6.0 * (size - middle)) for middle in middles]
    names = tuple(f"f{i}" for i in range(120))
    table = build_table(np.tile(size, 2), np.concatenate(hits))
    return table._replace(flaw=names * 2, others={"operator": ("A",) * 120 + ("B",) * 120})


def test_groups_that_inspected_the_same_flaws_differ_as_others_do() -> None:
    """The names of the flaws change nothing where a group inspected each flaw once."""
    method = Method(size_axis="linear")
    for middles, differ in (((0.8, 1.8), True), ((1.0, 1.0), False)):
        table = build_pair(middles)
        named = compare_groups(table, "operator", method)
        plain = compare_groups(table._replace(flaw=None), "operator", method)
        assert named.p_same == pytest.approx(plain.p_same, rel=1e-6)
        assert (named.p_same < 1e-9) == differ, named.p_same
    # passes within a group are merged: every inspection twice is the same table
    twice = table._replace(
        size=np.tile(table.size, 2), hit=np.tile(table.hit, 2),  # type: ignore[arg-type]
        flaw=table.flaw * 2, others={"operator": table.others["operator"] * 2},  # type: ignore[operator]
    )  # fmt: skip
    assert compare_groups(twice, "operator", method).p_same == pytest.approx(named.p_same, rel=1e-9)


@pytest.mark.parametrize(("ceiling", "parameters"), [(None, 2), ("fit", 3)])
def test_the_ratio_has_the_degrees_of_the_parameters(ceiling: str | None, parameters: int) -> None:
    table = build_pair((1.0, 1.1), ceiling=0.8)
    found = compare_groups(table, "operator", Method(size_axis="linear", ceiling=ceiling))
    given = None if ceiling else 1.0
    assert table.hit is not None
    parts = [slice(0, 120), slice(120, 240), slice(None)]
    a, b, both = (
        fit_hit_miss(table.size[at], table.hit[at], LOGIT, given).log_likelihood for at in parts
    )
    expected = stats.chi2.sf(2.0 * (a + b - both), parameters)
    assert found.p_same == pytest.approx(expected, rel=1e-6)


def test_names_of_ranges_stay_apart() -> None:
    years = divide(tuple(str(2015 + i % 8) for i in range(240)))
    assert set(years.tolist()) == {"2015 to 2017", "2017 to 2020", "2020 to 2022"}
    close = divide(tuple(repr(1.0 + 1e-9 * k) for k in range(9)))
    assert len(set(close.tolist())) == 3
    assert set(divide(tuple(str(k) for k in range(9))).tolist()) == {
        "0 to 2.67", "2.67 to 5.33", "5.33 to 8",
    }  # fmt: skip


@pytest.mark.parametrize("comma", [True, False])
def test_groups_of_numbers_with_decimal_commas_are_ranges(tmp_path: Path, comma: bool) -> None:
    """Nine winds from 0.5 to 4.5 m/s form three ranges, whatever the decimal sign."""
    r = np.random.default_rng(2)
    size, wind = r.uniform(0.2, 3.0, 360), 0.5 * (1 + np.arange(360) % 9)
    hit = r.random(360) < expit(6.0 * (size - 1.0))
    rows = [f"{a:.3f};{h:d};{w:.1f}" for a, h, w in zip(size, hit, wind, strict=True)]
    text = "\n".join(["a_mm;hit;wind", *rows])
    path = tmp_path / "inspections.csv"
    path.write_text(text.replace(".", ",") if comma else text)
    found = compare_groups(load_inspections(path), "wind", Method(size_axis="linear"))
    assert list(found.groups) == ["0.5 to 1.83", "1.83 to 3.17", "3.17 to 4.5"]


# -- a ceiling, and steps ------------------------------------------------------------------------

SIZES = np.arange(1, 41) * 0.25
STEP = ((SIZES > 3.0) & (SIZES != 8.0)).astype(float)
"""All flaws above 3 mm were found, except one of 8 mm."""


def test_one_large_miss_warns_and_does_not_refuse() -> None:
    import statsmodels.api as sm

    found = compute_pod(build_table(SIZES, STEP), Method(size_axis="linear"))
    theirs = sm.Logit(STEP, sm.add_constant(SIZES)).fit(disp=0).params
    assert list(found.curve.coefficients.values()) == pytest.approx(theirs, rel=1e-4)
    (warning,) = [w for w in found.warnings if "ceiling" in w]
    assert "a ceiling of 0.964 fits" in warning and "slope of the curve is not bounded" in warning


@pytest.mark.parametrize("ceiling", [0.97, "fit"])
def test_a_step_below_a_ceiling_has_no_slope(ceiling: float | str) -> None:
    with pytest.raises(InputError, match="slope of the curve is not bounded"):
        compute_pod(build_table(SIZES, STEP), Method(ceiling=ceiling))


@pytest.mark.parametrize("ceiling", [None, 0.97])
def test_random_tables_are_fitted_or_refused(ceiling: float | None) -> None:
    """5 % of the contacts are lost. Without a ceiling each table with a larger miss has a curve."""
    rng, refused, count = np.random.default_rng(0), 0, 0
    for _ in range(9):
        x = rng.uniform(0.2, 5.0, 30)
        hit = (rng.uniform(size=30) < 0.95 * expit(4.0 * (x - 2.0))).astype(float)
        if x[hit == 0].max() <= x[hit == 1].min():
            continue
        count += 1
        try:
            found = compute_pod(build_table(x, hit), Method(size_axis="linear", ceiling=ceiling))
        except InputError as error:
            assert "slope of the curve is not bounded" in str(error)
            refused += 1
            continue
        assert isinstance(found, Pod)
        assert np.all(np.isfinite(list(found.curve.standard_errors.values())))
    assert count > 5 and (refused == 0 if ceiling is None else 0 < refused < count)


def test_a_step_bounds_the_likelihood_of_steep_curves() -> None:
    """The most likely ceiling of a step is the share of hits above it: 27 of 28."""
    ceiling, log_likelihood = estimate_ceiling(SIZES, STEP, LINKS["probit"])
    assert ceiling == pytest.approx(27 / 28, abs=1e-3)
    assert log_likelihood == pytest.approx(27 * np.log(27 / 28) + np.log(1 / 28), abs=1e-3)
