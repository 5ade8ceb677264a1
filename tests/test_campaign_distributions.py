"""What `--vary` accepts, what it draws, and what it refuses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from skywright.analysis.campaign.distributions import (
    draw,
    draw_seed,
    parse_variation,
    parse_variations,
)
from skywright.analysis.campaign.spec import (
    build_campaign,
    check_variations,
    draw_run,
    load_run,
    write_command,
    write_value,
)
from skywright.core.toml_files import parse_value
from skywright.errors import InputError

SIZE = 2000


def _draws(text: str, seed: int = 1) -> np.ndarray:
    variation = parse_variation(f"world.x={text}")
    return np.array([draw(variation, seed, i) for i in range(SIZE)])


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("uniform(0.3, 0.6)", stats.uniform(0.3, 0.3)),
        ("normal(-1, 2.5)", stats.norm(-1, 2.5)),
        ("loguniform(1e-3,10)", stats.loguniform(1e-3, 10)),
    ],
)
def test_draws_follow_the_distribution(text: str, law: stats.rv_continuous) -> None:
    assert stats.kstest(_draws(text), law.cdf).pvalue > 0.01


def test_choice_draws_every_value_equally_often() -> None:
    found, counts = np.unique(_draws("choice(2, 3, 5)"), return_counts=True)
    assert found.tolist() == [2, 3, 5]
    assert stats.chisquare(counts).pvalue > 0.01


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("choice(othex, f550-bridge)", ("othex", "f550-bridge")),
        ('choice("a,b", "c")', ("a,b", "c")),
        ("choice(true, false)", (True, False)),
        ("choice(1)", (1,)),
        (" uniform( -1 , 1.5 ) ", (-1, 1.5)),
    ],
)
def test_values_are_read_as_toml_or_bare_words(text: str, values: tuple[object, ...]) -> None:
    assert parse_variation(f"k={text}").values == values


def test_draws_of_a_key_depend_on_seed_run_and_key_only() -> None:
    a = parse_variations(["k.a=uniform(0,1)", "k.b=uniform(0,1)"])
    b = parse_variations(["k.b=uniform(0,1)"])
    assert draw(a[1], 7, 3) == draw(b[0], 7, 3)
    values = {draw(v, seed, run) for v in a for seed in (1, 2) for run in (0, 1)}
    assert len(values) == 8
    pairs = np.array([[draw(v, 1, i) for v in a] for i in range(SIZE)])
    assert abs(stats.spearmanr(pairs).statistic) < 0.06  # independent


def test_seeds_are_spawned_distinct_and_exact_in_a_spreadsheet() -> None:
    seeds = [draw_seed(s, i) for s in (0, 1) for i in range(5000)]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) >= 0 and max(seeds) < 2**48 < 1e15


@given(
    st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**53), 2**53) | st.booleans()
)
def test_a_written_value_reads_back_exactly(value: float | int | bool) -> None:
    again = parse_value(write_value(value))
    assert again == value and type(again) is type(value)


@given(st.text(max_size=40))
def test_any_text_is_parsed_or_refused_in_one_line(text: str) -> None:
    for given_text in (text, f"world.x={text}", f"world.x=uniform({text})", f"k=choice({text})"):
        try:
            parse_variation(given_text)
        except InputError as error:
            assert str(error)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("world.x", "expected KEY=DIST"),
        ("=uniform(0,1)", "expected KEY=DIST"),
        ("world.x=0.3", "--set world.x=0.3"),
        (
            "world.x=unifrom(0,1)",
            "unknown distribution 'unifrom'; valid: uniform(a,b), normal(m,s)",
        ),
        ("world.x=uniform(1)", "two numbers, found 1"),
        ("world.x=uniform(1,1)", "must be smaller"),
        ("world.x=uniform(2,1)", "must be smaller"),
        ("world.x=uniform(0,nan)", "finite"),
        (f"world.x=uniform(0,{'9' * 400})", "two finite numbers, found 9999"),
        (f"world.x=choice(1,{'9' * 400})", "choice contains 9999"),
        ("world.x=uniform(a,b)", "the text 'a'"),
        ("world.x=normal(0,0)", "must be > 0"),
        ("world.x=normal(0,-1)", "must be > 0"),
        ("world.x=loguniform(0,1)", "must be > 0"),
        ("world.x=choice()", "empty"),
        ("world.x=choice(1,)", ""),
        ("world.x=choice([1],2)", "a list"),
        ("world.x=csv(none.csv)", "cannot be read"),
    ],
)
def test_a_wrong_distribution_is_refused(text: str, words: str) -> None:
    if not words:
        parse_variation(text)
        return
    with pytest.raises(InputError) as caught:
        parse_variation(text)
    assert words in str(caught.value)


# -- CSV ----------------------------------------------------------------------------------------


def test_columns_of_a_csv_stay_together(tmp_path: Path) -> None:
    file = tmp_path / "wind.csv"
    file.write_text("\ufeffworld.wind.mean_mps,dir\n1.5,90\n2,180\n\n", encoding="utf-8")
    speed, toward = parse_variations(
        [f"world.wind.mean_mps=csv({file})", f"world.wind.toward_deg=csv({file},dir)"]
    )
    drawn = [(draw(speed, 1, i), draw(toward, 1, i)) for i in range(3)]
    assert drawn == [(1.5, 90), (2, 180), (1.5, 90)]


def test_a_csv_alone_varies_all_its_columns(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("world.wind.mean_mps,world.wind.kind\n1.5,steady\n")
    assert {v.key: v.values for v in parse_variations([str(file)])} == {
        "world.wind.mean_mps": (1.5,),
        "world.wind.kind": ("steady",),
    }


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "no data"),
        ("a,b\n", "no data"),
        ("a,a\n1,2\n", "repeated name"),
        ("a,\n1,2\n", "empty or a repeated"),
        ("a,b\n1\n", "line 2: 1 cells"),
        ("a,b\n1,2\n3,\n", "line 3: column 'b' has no value"),
        ("a,b\n1,2\n3,{x=1}\n", "line 3: column 'b' has no value"),
        ("a,b\n1,nan\n", "line 2: b is nan"),
        ("a,c\n1,2\n", "no column 'b'; valid: a, c"),
    ],
)
def test_a_bad_csv_is_refused_with_its_line(tmp_path: Path, content: str, words: str) -> None:
    file = tmp_path / "t.csv"
    file.write_text(content)
    with pytest.raises(InputError, match=r"t\.csv") as caught:
        parse_variations([f"b=csv({file})"])
    assert words in str(caught.value)


# -- against the description --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vary", "sets", "words"),
    [
        (["world.pipe.diametr_m=uniform(0.3,0.6)"], [], "): unknown key world.pipe.diametr_m; "),
        (["wrld.pipe.diameter_m=uniform(0.3,0.6)"], [], "): unknown root 'wrld'"),
        (["world.pipe.diameter=uniform(0.3,0.6)"], [], "diameter_m"),
        (["world.pipe.diameter_m=uniform(-0.1,0.6)"], [], "the draw -0.1 is refused"),
        (["world.pipe.friction=normal(0.05,0.2)"], [], "is refused"),
        (["mission.task.passes=uniform(2,5)"], [], "is refused"),
        (["world.wind.kind=choice(none,stead)"], [], "'stead'"),
        (["world.pipe.friction=uniform(0,1)"] * 2, [], "varies twice"),
        (["world.pipe.friction=uniform(0,1)"], ["world.pipe.friction=0.1"], "choose one"),
        (["mission.seed=choice(1,2)"], [], "--seed"),
        ([], ["mission.seed=4"], "--seed"),
        ([], ["world.pipe.frction=0.1"], "friction"),
    ],
)
def test_what_the_mission_cannot_take_is_told_before_flying(
    vary: list[str], sets: list[str], words: str
) -> None:
    with pytest.raises(InputError) as caught:
        check_variations(build_campaign("pipe-weld-scan", vary, sets=sets), 50)
    assert words in str(caught.value)


def test_a_choice_that_no_run_draws_is_told_too() -> None:
    campaign = build_campaign("waypoints", ["mission.robot=choice(hexarotor,hexa)"], seed=1)
    assert draw_run(campaign, 0).varied == {"mission.robot": "hexarotor"}
    with pytest.raises(InputError, match="unknown robot 'hexa'"):
        check_variations(campaign, 1)


def test_a_value_that_needs_its_company_is_accepted() -> None:
    vary = ["world.wind.kind=choice(steady,dryden)", "world.wind.mean_mps=uniform(0.1,4)"]
    check_variations(build_campaign("pipe-weld-scan", vary), 20)


def test_the_command_of_a_run_loads_the_same_description() -> None:
    import shlex

    import skywright

    campaign = build_campaign(
        "pipe-weld-scan",
        ["world.pipe.diameter_m=uniform(0.3,0.6)", "world.wind.kind=choice(steady)",
         "mission.task.passes=choice(3,4)"],
        sets=["world.wind.mean_mps=2"], seed=5,
    )  # fmt: skip
    one = draw_run(campaign, 11)
    words = shlex.split(write_command(campaign, one))
    assert words[:3] == ["skywright", "run", "pipe-weld-scan"]
    sets = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
    seed = int(words[words.index("--seed") + 1])
    again = skywright.load(words[2], sets=sets, seed=seed)
    mine = load_run(campaign, one)
    assert again[:4] == mine[:4]
    assert mine.mission.seed == one.seed == seed
    assert math.isclose(mine.world.pipe.diameter_m, one.varied["world.pipe.diameter_m"], rel_tol=0)  # type: ignore[union-attr, arg-type]


def test_a_cell_may_be_a_list(tmp_path):
    """It is written into the run's command as it stands and read as a list when the run flies."""
    path = tmp_path / "forces.csv"
    path.write_text('mission.task.forces_n\n"[1.5, 2.5]"\n"[3]"\n', encoding="utf-8")
    campaign = build_campaign("bridge-contact", [str(path)])
    forces = [load_run(campaign, draw_run(campaign, i)).mission.task.forces_n for i in (0, 1)]
    assert forces == [[1.5, 2.5], [3.0]]
    assert draw_run(campaign, 0).varied["mission.task.forces_n"] == "[1.5, 2.5]"


def test_all_that_is_wrong_with_vary_is_told_at_once() -> None:
    texts = ["world.wind.mean_mps=uniform(a,3)", "foo=what(1)", "world.pipe.friction=0.2"]
    with pytest.raises(InputError) as error:
        parse_variations(texts)
    assert len(str(error.value).splitlines()) == 3


def test_fixed_values_may_be_a_mapping():
    """They become the texts that the command of a run repeats, and give the same description."""
    sets = {
        "world.wind.mean_mps": np.float64(1.25), "mission.name": "two words",
        "mission.task.points": ({"x_m": 1, "y_m": 0.0, "z_m": 1.5},),
    }  # fmt: skip
    vary = ["plant.mass_error=normal(0, 0.02)"]
    campaign = build_campaign("waypoints", vary, sets=sets)
    assert campaign.sets == (
        "world.wind.mean_mps=1.25", "mission.name=two words",
        'mission.task.points=[{x_m = 1, y_m = 0.0, z_m = 1.5}]',
    )  # fmt: skip
    assert build_campaign("waypoints", vary, sets=campaign.sets).base == campaign.base
    assert len(campaign.base.mission.task.points) == 1
    with pytest.raises(InputError, match=r"mission\.name = None; valid: a number"):
        build_campaign("waypoints", vary, sets={"mission.name": None})
