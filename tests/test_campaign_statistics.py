"""What a campaign concludes: interval, verdict, failures and sensitivities, and its page."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skywright.analysis.campaign import figures
from skywright.analysis.campaign.report import Facts, write_campaign_page
from skywright.description.mission.spec import Requirement
from skywright.reports.figures.style import house_style
from skywright.run.rows import (
    Row,
    compute_headroom,
    compute_interval,
    compute_sensitivities,
    group_failures,
)
from skywright.run.verdict import (
    GO,
    LIMIT_USE,
    NO_GO,
    NOT_YET,
    add_limit_use,
    build_scale,
    build_verdict,
)

REQUIREMENTS = {
    "contact.gap_max_mm": Requirement(limit=1.0, sense="<", unit="mm"),
    "coverage.fraction": Requirement(limit=0.9, sense=">="),
    "weld.crossings": Requirement(limit=4.0, sense="=="),
}
KEYS = ("world.wind.mean_mps", "world.wind.toward_deg", "world.pipe.friction", "world.wind.kind")


def build_rows(count: int, seed: int = 0, gap_at_full_wind: float = 0.8) -> list[Row]:
    """Runs in which wind makes the gap grow, its direction acts periodically, friction nothing."""
    rng = np.random.default_rng(seed)
    rows = []
    for run in range(count):
        wind, toward = rng.uniform(0, 6), rng.uniform(0, 360)
        kind = str(rng.choice(["steady", "none"]))
        gap = gap_at_full_wind * (wind / 6) ** 2 + 0.02 * rng.standard_normal()
        tilt = 3 + math.cos(math.radians(2 * toward)) + 0.1 * rng.standard_normal()
        force = 4 + (kind == "steady") + 0.1 * rng.standard_normal()
        metrics = {
            "contact.gap_max_mm": gap, "coverage.fraction": 0.99 + 0.001 * rng.standard_normal(),
            "weld.crossings": 4.0, "contact.tilt_max_deg": tilt, "force.mean_n": force,
        }  # fmt: skip
        failed = ("contact.gap_max_mm",) if gap >= 1.0 else ()
        rows.append(
            Row(
                run, 1000 + run, "failed" if failed else "succeeded", failed[0] if failed else "",
                failed, "", dict(zip(KEYS, (wind, toward, rng.uniform(), kind), strict=True)),
                metrics, {"wall_s": 2.0}, 1, f"skywright run x --seed {1000 + run}",
            )
        )  # fmt: skip
    return rows


# -- interval and verdict -------------------------------------------------------------------------


@given(st.integers(1, 5000), st.data())
def test_interval_is_wilsons(n: int, data: st.DataObject) -> None:
    k = data.draw(st.integers(0, n))
    z, p = 1.959963984540054, k / n
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    found = compute_interval(k, n)
    assert np.allclose(found, [centre - half, centre + half], atol=1e-9)
    assert found[0] - 1e-12 <= p <= found[1] + 1e-12


def test_interval_holds_the_true_rate_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    for rate in (0.5, 0.95):
        hits = rng.binomial(200, rate, 1500)
        held = [low <= rate <= high for low, high in (compute_interval(int(k), 200) for k in hits)]
        assert 0.93 < np.mean(held) < 0.98


def test_verdict_is_go_no_go_or_not_yet() -> None:
    def judge(rows: list[Row], target: float) -> tuple[str, int]:
        found = build_verdict(rows, KEYS, REQUIREMENTS, target)
        assert found.answer in (GO, NO_GO, NOT_YET)
        return found.answer, found.more_runs

    good, bad = build_rows(100), build_rows(100, gap_at_full_wind=4.0)
    assert judge(good, 0.9) == (GO, 0)
    assert judge(bad, 0.9) == (NO_GO, 0)
    answer, more = judge(good[:10], 0.9)
    assert answer == NOT_YET
    assert compute_interval(10 + more, 10 + more)[0] >= 0.9
    assert compute_interval(8 + more, 8 + more)[0] < 0.9


def test_an_undecided_verdict_states_the_runs_that_decide() -> None:
    """Also where more runs at the present rate give NO-GO, and where none decide."""
    good, bad = build_rows(1)[0], build_rows(1)[0]._replace(outcome="aborted", requirement="x")

    def judge(succeeded: int, runs: int, target: float = 0.9) -> tuple[int, str]:
        rows = [good] * succeeded + [bad] * (runs - succeeded)
        found = build_verdict(rows, (), {}, target)
        assert found.answer == NOT_YET
        return found.more_runs, found.headline

    more, told = judge(17, 20)
    assert told.endswith(
        f"for the required 90%: about {more} more runs at this rate would give NO-GO."
    )
    total = 20 + more
    assert compute_interval(math.ceil(0.85 * total), total)[1] < 0.9
    assert compute_interval(math.ceil(0.85 * 0.95 * total), int(0.95 * total))[1] >= 0.9
    more, told = judge(19, 20)
    assert more and told.endswith(f"about {more} more runs at this rate would give GO.")
    assert judge(18, 20)[0] == 0 and judge(18, 20)[1].endswith("no number of runs decides.")
    assert judge(9, 10, 0.9001) == (0, judge(9, 10, 0.9001)[1])
    assert judge(9, 10, 0.9001)[1].endswith("over 100000 runs at this rate would give NO-GO.")


def test_verdict_names_what_limits_it() -> None:
    failing = build_verdict(build_rows(200, gap_at_full_wind=1.2), KEYS, REQUIREMENTS, 0.5)
    assert "Limited by contact.gap_max_mm" in failing.limited_by
    assert "world.wind.mean_mps from" in failing.limited_by
    near = build_verdict(build_rows(200), KEYS, REQUIREMENTS, 0.9)
    assert near.limited_by.startswith("Nearest to its limit: contact.gap_max_mm")
    assert "driven most by world.wind.mean_mps" in near.limited_by


def test_refused_runs_count_as_not_succeeded_and_are_told_apart() -> None:
    rows = build_rows(40)
    rows = [
        r._replace(outcome="infeasible", requirement="infeasible", reason="too much wind")
        if r.run < 10
        else r
        for r in rows
    ]
    found = build_verdict(rows, KEYS, REQUIREMENTS, 0.9)
    assert (found.runs, found.succeeded, found.flown) == (40, 30, 30)
    assert "Limited by infeasible in 10 of 10 failed runs" in found.limited_by
    assert found.limited_by.endswith("; run 0: too much wind.")
    assert found.flown_interval == pytest.approx(tuple(compute_interval(30, 30)))


def test_runs_that_ended_on_the_ground_did_not_take_off() -> None:
    on_ground = {"outcome": "aborted", "reason": "no take-off: battery 12 V (mission.checklist)"}
    aloft = {"outcome": "aborted", "reason": "wind 9 m/s, limit 8 m/s in hold 1 at t = 8.0 s"}
    rows = build_rows(40)
    rows = [r._replace(**(on_ground if r.run < 10 else aloft if r.run < 15 else {})) for r in rows]
    found = build_verdict(rows, KEYS, REQUIREMENTS, 0.9)
    assert (found.runs, found.succeeded, found.flown) == (40, 25, 30)


@pytest.mark.parametrize(
    ("target", "says"),
    [
        (0.9, "lies between 96.3% and 100.0%, above the required 90%."),
        (0.995, "lies between 96.3% and 100.0%, which is inconclusive for the required 99.5%"),
        (0.9995, "between 96.30% and 100.00%, which is inconclusive for the required 99.95%"),
        (0.57, "above the required 57%."),
    ],
)
def test_a_target_is_stated_as_it_was_given(target: float, says: str) -> None:
    assert says in build_verdict(build_rows(100), KEYS, REQUIREMENTS, target).headline


# -- failures, room, sensitivities ----------------------------------------------------------------


def test_failures_are_grouped_and_located() -> None:
    rows = build_rows(200, gap_at_full_wind=1.2)
    (group,) = group_failures(rows, KEYS)
    assert group.requirement == "contact.gap_max_mm"
    assert set(group.runs) == {r.run for r in rows if not r.succeeded}
    assert group.key == "world.wind.mean_mps" and group.inside[0] > 5.0 and group.p < 1e-6


def test_failures_by_chance_are_not_located() -> None:
    found = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        rows = [
            r._replace(outcome="failed", requirement="x", failed=("x",))
            if rng.random() < 0.1
            else r
            for r in build_rows(60, seed)
        ]
        found += any(g.key for g in group_failures(rows, KEYS))
    assert found <= 6  # 5 % expected


def test_headroom_is_the_way_from_median_to_limit() -> None:
    rows = build_rows(101)
    first = compute_headroom(rows, REQUIREMENTS)[0]
    gaps = [r.metrics["contact.gap_max_mm"] for r in rows]
    assert first.name == "contact.gap_max_mm"
    assert first.used == pytest.approx((max(gaps) - np.median(gaps)) / (1 - np.median(gaps)))
    crossings = next(h for h in compute_headroom(rows, REQUIREMENTS) if h.name == "weld.crossings")
    assert crossings.used == 0.0 and crossings.worst == 4.0


def build_errors(
    values: list[float], sense: str = "<=", limit: float = 1.0
) -> tuple[list[Row], dict[str, Requirement]]:
    """Runs with the metric `err`, which grows with the condition `wind`, if the values do."""
    asked = Requirement.model_validate({"limit": limit, "sense": sense})
    met = {"<": float.__lt__, "<=": float.__le__, ">": float.__gt__, ">=": float.__ge__,
           "==": float.__eq__}[sense]  # fmt: skip
    rows = []
    for run, value in enumerate(values):
        failed = () if met(float(value), limit) else ("err",)
        row = Row(
            run, run, "failed" if failed else "succeeded", "err" if failed else "", failed, "",
            {"wind": float(run)}, {"err": float(value)}, {}, 1, "",
        )  # fmt: skip
        rows.append(row)
    return rows, {"err": asked}


def list_uses(rows: list[Row], asked: dict[str, Requirement]) -> list[float]:
    found = add_limit_use(rows, compute_headroom(rows, asked))
    return [row.metrics[LIMIT_USE] for row in found]


@pytest.mark.parametrize("failing", [0, 5, 24, 39, 40])
@pytest.mark.parametrize(("sign", "limit"), [(1.0, 1.0), (-1.0, 0.9), (1.0, 0.0), (-1.0, -2.0)])
def test_a_limit_is_used_more_the_worse_a_run_is(failing: int, sign: float, limit: float) -> None:
    """Whichever side of the limit the median run is on, for upper and lower limits."""
    steps = np.arange(40) - (39.5 - failing)  # negative: the limit is met
    sense = "<=" if sign > 0 else ">="
    rows, asked = build_errors([limit + sign * 0.03 * s for s in steps], sense, limit)
    assert sum(not r.succeeded for r in rows) == failing
    use = np.array(list_uses(rows, asked))
    assert np.all(np.diff(use) > 0.0)
    assert np.array_equal(use > 1.0, [not r.succeeded for r in rows])
    if failing < 40:
        assert np.median(use[use < 1.0]) == pytest.approx(0.0, abs=1e-12)
    verdict = build_verdict(rows, ["wind"], asked, 0.9)
    (s,) = [s for s in verdict.sensitivities if s.metric == LIMIT_USE]
    assert s.rho == pytest.approx(1.0) and s.significant
    figure = figures.draw_conditions(rows, ["wind"], verdict)
    assert figure is not None
    good, *bad = [np.ma.getdata(c.get_offsets()) for c in figure.axes[0].collections]
    assert len(good) == 40 - failing and np.all(good[:, 1] < 1.0)
    assert sum(map(len, bad)) == failing
    assert all(np.all((b[:, 1] > 1.0) & (b[:, 1] < figures.TOP)) for b in bad)
    figure = figures.draw_headroom(rows, verdict)
    assert figure is not None
    blue, red = (np.ma.getdata(c.get_offsets()) for c in figure.axes[0].collections)
    assert (len(blue), len(red)) == (40 - failing, failing)
    assert np.all(blue[:, 0] < 1.0) and np.all(red[:, 0] > 1.0)
    assert ("no run meets it" in figure.axes[0].texts[0].get_text()) == (failing == 40)


def test_a_limit_without_near_and_far_has_no_use() -> None:
    """Counts of which none is allowed, yes or no, ==, values that were not measured."""
    for values, sense, limit in (
        ([0, 0, 0, 2], "<=", 0.0),
        ([1, 1, 0, 1], ">=", 1.0),
        ([4, 3, 4, 4], "==", 4.0),
        ([math.nan] * 4, "<=", 1.0),
    ):
        rows, asked = build_errors([float(v) for v in values], sense, limit)
        assert all(map(math.isnan, list_uses(rows, asked))), (values, sense)
        verdict = build_verdict(rows, ["wind"], asked, 0.9)
        assert figures.draw_headroom(rows, verdict) is None
        figure = figures.draw_conditions(rows, ["wind"], verdict)
        assert figure is not None
        good, *bad = [np.ma.getdata(c.get_offsets())[:, 1] for c in figure.axes[0].collections]
        assert np.all(good == figures.BOTTOM)
        assert all(np.all(b == figures.TOP) for b in bad)
    none_landed = build_errors([0.0] * 4, ">=", 1.0)
    assert list_uses(*none_landed) == [2.0] * 4
    assert list_uses(*build_errors([0.5] * 4)) == [0.0] * 4


def test_use_of_a_limit_counts_what_failed() -> None:
    """A strict limit, a waived requirement, a missing value, an aborted run."""
    rows, asked = build_errors([0.5, 0.75, 1.0], "<")
    assert list_uses(rows, asked)[2] == 1.0 and not rows[2].succeeded
    rows, asked = build_errors([0.5, 0.7, 0.9, 2.0, math.nan])
    rows[3] = rows[3]._replace(outcome="succeeded", failed=())  # waived
    rows.append(rows[0]._replace(outcome="aborted", metrics={"err": 0.0}))  # cut short
    use = list_uses(rows, asked)
    assert use[:3] == pytest.approx([-2 / 3, 0.0, 2 / 3]) and all(map(math.isnan, use[3:]))
    only_aborted = [r._replace(outcome="aborted") for r in rows[:3]]
    (h,) = compute_headroom(only_aborted, asked)
    scale = build_scale(only_aborted, h)
    assert scale is not None and scale.compute_use(only_aborted[1]) == pytest.approx(0.0)


def test_sensitivities_find_monotone_periodic_and_categorical_effects_and_nothing_else() -> None:
    rows = build_rows(200)
    metrics = ["contact.gap_max_mm", "contact.tilt_max_deg", "force.mean_n", "weld.crossings"]
    found = {(s.metric, s.key): s for s in compute_sensitivities(rows, KEYS, metrics)}
    wind, toward, _, kind = KEYS
    assert {pair for pair, s in found.items() if s.significant} == {
        ("contact.gap_max_mm", wind), ("contact.tilt_max_deg", toward), ("force.mean_n", kind),
    }  # fmt: skip
    assert found["contact.gap_max_mm", wind].rho > 0.95
    periodic = found["contact.tilt_max_deg", toward]
    assert abs(periodic.rho) < 0.3 and periodic.share > 0.5
    assert math.isnan(found["force.mean_n", kind].rho) and found["force.mean_n", kind].share > 0.6
    assert not any(metric == "weld.crossings" for metric, _ in found)  # it never varies


def test_sensitivities_leave_out_what_was_not_measured() -> None:
    rows = build_rows(60)
    rows = [r._replace(metrics={}) if i % 3 == 0 else r for i, r in enumerate(rows)]
    found = compute_sensitivities(rows, KEYS[:1], ["contact.gap_max_mm"])
    assert found[0].rho > 0.95
    assert compute_sensitivities(rows[:12], KEYS[:1], ["contact.gap_max_mm"]) == []


# -- the page -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "keys"),
    [
        (build_rows(60, gap_at_full_wind=1.3), KEYS),
        (build_rows(1), KEYS),
        (build_rows(30), KEYS[:1]),
        (build_rows(3), ()),
        ([r._replace(outcome="crashed", requirement="crashed", metrics={}, timing={})
          for r in build_rows(12)], KEYS),
    ],
    ids=["failures", "one run", "one key", "seed only", "all crashed"],
)  # fmt: skip
def test_page_answers_in_its_first_line(
    tmp_path: Path, rows: list[Row], keys: tuple[str, ...]
) -> None:
    verdict = build_verdict(rows, keys, REQUIREMENTS, 0.9)
    facts = Facts(
        "scan", "", "othex", "pipe", 1, len(rows) + 1, {k: "uniform(0,1)" for k in keys}, (),
        len(rows), 1.0, {"code": "0"},
    )  # fmt: skip
    path = tmp_path / "campaign.html"
    write_campaign_page(path, rows, verdict, facts)
    page = path.read_text()
    body = page[page.index("<main>") :]
    assert body.index(f"<strong>{verdict.answer}</strong>") < body.index("<p")
    assert "http://" not in page.replace("http://www.w3.org", "") and "https://" not in page
    for row in rows:
        assert (f"--seed {row.seed}" in page) == (not row.succeeded or row is rows[0])
    assert ("Where it fails" in page) == bool(verdict.failures and keys)
    # wind alone acts on a limit, and only enough rows of several keys show it
    assert ("The most influential condition and another one" in page) == (len(rows) == 60)
    assert ("Only world.wind.mean_mps has a significant effect" in page) == (len(rows) == 60)
    assert ("No condition has a significant effect on the use of the limits" in page) == (
        len(keys) > 1 and len(rows) < 60
    )
    assert page.count("<figure>") >= (4 if len(rows) == 60 else 1)


def test_of_many_conditions_those_that_act_are_drawn() -> None:
    """A condition that decides is not left out of the picture because it was named last."""
    keys = [f"world.idle{i}" for i in range(figures.MAX_PANELS + 3)] + ["world.wind.mean_mps"]
    rng = np.random.default_rng(4)
    rows = []
    for i in range(60):
        varied = {key: float(rng.random()) for key in keys}
        error = varied["world.wind.mean_mps"]
        metrics = {"error": error}
        failed = ("error",) if error > 0.8 else ()
        outcome = "failed" if failed else "succeeded"
        rows.append(
            Row(i, i, outcome, "error" if failed else "", failed, "", varied, metrics, {}, 1, "")
        )
    requirements = {"error": Requirement(limit=0.8)}
    figure = figures.draw_conditions(rows, keys, build_verdict(rows, keys, requirements, 0.9))
    assert figure is not None and len(figure.axes) == figures.MAX_PANELS
    assert "world.wind.mean_mps" in [ax.get_xlabel() for ax in figure.axes]


def build_acting(count: int, acting: dict[str, str], keys: tuple[str, ...]) -> list[Row]:
    """Successful runs with small signed conditions; each metric of `acting` follows its key."""
    rng = np.random.default_rng(7)
    rows = []
    for i in range(count):
        varied = {key: float(rng.uniform(-0.05, 0.06)) for key in keys}
        metrics = {m: varied[k] if k else float(rng.random()) for m, k in acting.items()}
        rows.append(Row(i, i, "succeeded", "", (), "", dict(varied), metrics, {}, 1, ""))
    return rows


def test_only_an_effect_on_limits_makes_a_condition_influential() -> None:
    """A condition that acts on a metric without a limit is not called influential."""
    keys = ("plant.idle", "plant.free", "plant.asked", "plant.also")
    acting = {"asked": "plant.asked", "also": "plant.also", "free": "plant.free"}
    rows = build_acting(40, acting, keys)
    limits = {name: Requirement(limit=1.0) for name in ("asked", "also")}
    verdict = build_verdict(rows, keys, limits, 0.9)
    assert set(figures.list_influential(keys, verdict)) == {"plant.asked", "plant.also"}
    ranked = figures.rank_keys(keys, verdict)
    assert set(ranked[:2]) == {"plant.asked", "plant.also"} and ranked[2] == "plant.free"
    without = build_verdict(rows, keys, {}, 0.9)
    assert figures.list_influential(keys, without) == []


def test_every_limit_is_in_the_influence_picture_and_what_is_left_out_is_counted(
    tmp_path: Path,
) -> None:
    keys = ("plant.a", "plant.b")
    idle = {f"idle{i:02}": "" for i in range(20)}
    asked = {f"asked{i:02}": "" for i in range(16)}
    rows = build_acting(40, {**idle, **asked, "zz_acting": "plant.a"}, keys)
    verdict = build_verdict(rows, keys, {m: Requirement(limit=2.0) for m in asked}, 0.9)
    figure = figures.draw_sensitivities(keys, verdict)
    assert figure is not None
    drawn = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert drawn[:17] == [LIMIT_USE, *asked] and "zz_acting" in drawn
    left_out = 1 + 16 + 20 + 1 - len(drawn)
    facts = Facts("scan", "", "othex", "pipe", 1, 40, dict.fromkeys(keys, "uniform(0,1)"), (),
                  40, 1.0, {})  # fmt: skip
    write_campaign_page(tmp_path / "campaign.html", rows, verdict, facts)
    assert left_out > 10
    assert f"{left_out} other metrics" in (tmp_path / "campaign.html").read_text()


@pytest.mark.parametrize("count", [2, 3, 5])
def test_labels_of_ticks_do_not_overlap(count: int) -> None:
    keys = tuple(f"plant.error{i}" for i in range(count))
    numbers = build_acting(40, {"error": keys[0]}, keys)
    words = ["a-rather-long-name", "another-long-name", "a-third-long-name", "short"]
    named = [row._replace(varied=dict.fromkeys(keys, words[row.run % 4])) for row in numbers]
    for rows in (numbers, named):
        verdict = build_verdict(rows, keys, {"error": Requirement(limit=0.1)}, 0.9)
        for draw in (figures.draw_conditions, figures.draw_map):
            with house_style():
                figure = draw(rows, keys, verdict)
                assert figure is not None
                figure.draw_without_rendering()
            for ax in figure.axes:
                shown = [t for t in ax.get_xticklabels() if t.get_text() and t.get_visible()]
                low, high = sorted(ax.get_xlim())
                shown = [t for t in shown if low <= t.get_position()[0] <= high]
                lines: dict[int, list[Any]] = {}
                for t in shown:
                    lines.setdefault(t.get_text().count("\n"), []).append(t.get_window_extent())
                assert not shown or len(shown) >= 2
                for boxes in lines.values():
                    assert all(a.x1 + 3.0 < b.x0 for a, b in itertools.pairwise(boxes))
                assert not shown or ax.xaxis.label.get_window_extent().y0 > 0.0
