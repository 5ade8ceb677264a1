"""Where a metric is measured: stated for all, and the samples of other phases do not move it."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.lines import Line2D

from constructed import build_flown, build_samples
from skywright.core.find import list_kinds
from skywright.description.loader import list_missions, load_description
from skywright.description.mission.spec import Requirement
from skywright.missions.flight_modes.metrics import compute_metrics as judge_modes
from skywright.missions.impact.metrics import RECOIL_S
from skywright.missions.scan import metrics as scan_metrics
from skywright.reports.figures.style import draw_limit, draw_requirement, house_style, new_figure
from skywright.run.flight import Flown, PhaseRecord
from skywright.run.kind import load_kind
from skywright.run.metrics import compute_tracking
from skywright.run.names import COMMON
from skywright.run.requirements import judge
from skywright.run.where import Where, find_where


def test_every_requirement_and_metric_says_where() -> None:
    for entry in list_missions():
        mission = load_description(entry.name).mission
        kind = load_kind(mission.kind)
        for verdict in judge(mission.requirements, {}, kind.where):
            assert verdict.where, f"{entry.name}: {verdict.name}"
    for name in list_kinds("kind"):
        kind = load_kind(name)
        for metric in kind.measures:
            assert find_where(metric, kind.where).text, f"{name}: {metric}"
    alone = {n for n in COMMON if not find_where(n, {}).text}
    kinds = [load_kind(name).where for name in list_kinds("kind")]
    assert {n for n in alone if not any(find_where(n, own).text for own in kinds)} == set()


PHASES = [
    PhaseRecord(name, float(i), float(i + 1), "done")
    for i, name in enumerate(("start", "hold 1 N", "hold 2 N", "leg", "land", "hold"))
]


def test_interrupted_phases_are_omitted_where_the_work_must_be_whole() -> None:
    ends = ("done", "taken over", "drawn back", "retry", "interrupted")
    phases = [PhaseRecord("hold", float(i), i + 1.0, end) for i, end in enumerate(ends)]
    assert Where(("hold",)).find(phases) == [0, 1, 2, 3, 4]
    assert Where(("hold",), whole=True).find(phases) == [0, 3]


@pytest.mark.parametrize(
    ("where", "found", "text"),
    [
        (Where(("hold",)), [5], "phase hold"),
        (Where(("hold *",)), [1, 2], "phases hold …"),
        (Where(("start", "land"), others=True), [1, 2, 3, 5], "all phases except start, land"),
        (Where(("hold*",), planned=True), [1, 2, 3, 5], "planned segments, phases hold…"),
        (Where(("*",), "aloft"), [0, 1, 2, 3, 4, 5], "whole run, aloft"),
        (Where(note="the plan"), [], "the plan"),
        (Where(), [], ""),
    ],
)  # fmt: skip
def test_phases_are_found_and_told(where: Where, found: list[int], text: str) -> None:
    assert where.find(PHASES, {"leg": None}) == found
    assert where.text == text
    s, phases = build_samples([(p.name, 0.1) for p in PHASES])
    assert set(s["phase"][where.select(s, phases, {"leg"})]) == set(found)


def test_the_longest_name_decides() -> None:
    assert find_where("estimate.outage_s", {}).note == "during outages of the localisation"
    assert find_where("contact.gap", {"contact.": Where(("scan",))}).phases == ("scan",)
    assert find_where("contact.collisions", {"contact.": Where(("scan",))}).phases == ("*",)
    assert find_where("unknown", {}) == Where()
    note = find_where("impact.recoil_deg", load_kind("impact").where).note
    assert note == f"within {RECOIL_S:g} s after contact"


def _shake(run: Flown[Any, Any], at: np.ndarray, columns: tuple[str, ...]) -> Flown[Any, Any]:
    """Return the flight with large changes of these columns in some samples."""
    rng, s = np.random.default_rng(3), run.samples.copy()
    for name in columns:
        noise = rng.normal(5.0, 1.0, s[name][at].shape)
        s[name][at] = noise / np.linalg.norm(noise, axis=1)[:, None] if name == "q_WB" else noise
    return Flown(run.setup, run.plan, s, run.phases)


def _check(
    run: Flown[Any, Any], judge: Callable[[Flown[Any, Any]], dict[str, float]],
    columns: tuple[str, ...], names: set[str],
) -> None:  # fmt: skip
    kind = load_kind(run.setup.description.mission.kind)
    before = judge(run)
    assert names <= set(before)
    for name in names:
        inside = find_where(name, kind.where).select(run.samples, run.phases, run.plan.segments)
        assert inside.any() and not inside.all()
        assert judge(_shake(run, ~inside, columns))[name] == before[name], name
        assert judge(_shake(run, inside, columns))[name] != before[name], name


LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def test_modes_of_flight_are_judged_each_in_its_phase() -> None:
    spans = [(n, 1.0) for n in ("take_off", "standard stabilisation", "command position",
                                "command angle", "hold angle", "land")]  # fmt: skip
    q = np.tile(LEVEL, (600, 1))
    q[:, 1] = 0.01
    s, phases = build_samples(spans, q_WB=q, p_WB=np.zeros(3), ref_p_WB=np.zeros(3))
    run = build_flown("flight-modes", s, phases, {"due": 0.1, "limit": 0.2})
    _check(run, judge_modes, ("q_WB", "p_WB"), {
        "modes.tilt_deg", "modes.tilt_held", "modes.position_error_mm", "modes.angle_coupling",
        "modes.translate_tilt_deg", "modes.track_error_mm", "modes.standard_coupling",
        "modes.standard_drift_m",
    })  # fmt: skip


def test_tracking_is_judged_on_segments_and_holds() -> None:
    s, phases = build_samples(
        [("take_off", 1.0), ("waypoint 1", 1.0), ("hold 1", 1.0), ("land", 1.0)],
        p_WB=np.zeros(3), ref_p_WB=np.zeros(3), q_WB=LEVEL, ref_q_WB=LEVEL,
    )  # fmt: skip
    run = build_flown("waypoints", s, phases, segments={"waypoint 1": None})
    names = {"position.rms_m", "position.max_m", "platform.tilt_max_deg", "position.final_error_m"}
    _check(run, compute_tracking, ("p_WB", "q_WB"), names)


def test_contact_is_judged_while_scanning(monkeypatch: pytest.MonkeyPatch) -> None:
    s, phases = build_samples(
        [("touch", 1.0), ("scan", 2.0), ("leave", 1.0)],
        gap_max=0.0, tilt=0.0, f_normal=1.0, ref_normal_W=(0.0, -1.0, 0.0), p_WT=np.zeros(3),
        ref_p_WT=np.zeros(3), q_WB=LEVEL, ref_q_WB=LEVEL, p_WB=np.zeros(3), ref_p_WB=np.zeros(3),
        rotor_thrust=np.full(6, 2.0), ec=np.zeros(2), off_s=0.0,
    )  # fmt: skip
    for name in ("find_survey", "find_coverage", "process_weld", "calibrate_on_touch"):
        monkeypatch.setattr(scan_metrics, name, lambda run: None)
    monkeypatch.setattr(scan_metrics, "measure_lift_off", lambda z, c: np.zeros(len(z)))
    _check(
        build_flown("pipe-weld-scan", s, phases), scan_metrics.compute_metrics,
        ("gap_max", "tilt", "f_normal", "p_WT", "q_WB", "p_WB", "rotor_thrust", "off_s"),
        {"contact.gap_max_mm", "contact.tilt_max_deg", "contact.no_force_max_s", "force.mean_n",
         "force.min_n", "force.max_n", "tip.tangential_rms_mm", "platform.offset_rms_mm",
         "platform.attitude_error_max_deg", "touch.attitude_error_max_deg",
         "rotors.thrust_max_fraction"},
    )  # fmt: skip


def test_a_limit_is_drawn_over_its_phases_only() -> None:
    with house_style():
        ax = new_figure().add_subplot()
        ax.set_xlim(10.0, 20.0)
        draw_limit(
            ax, 3.0, "limit 3 m: phase scan", spans=[(5.0, 12.0), (15.0, 16.0), (21.0, 30.0)]
        )
        line = ax.lines[-1]
        assert isinstance(line, Line2D)
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert x[np.isfinite(y)].tolist() == [5.0, 12.0, 15.0, 16.0, 21.0, 30.0]
        assert np.isnan(y[2::3]).all() and set(y[np.isfinite(y)]) == {3.0}
        assert ax.texts[-1].get_text() == "limit 3 m: phase scan"


def test_a_required_share_is_drawn_in_the_unit_of_its_panel() -> None:
    verdict = judge({"impact.torque_share": Requirement(limit=0.5)}, {}, {})[0]
    phases = [PhaseRecord("impact", 1.0, 2.0, "done"), PhaseRecord("land", 2.0, 3.0, "done")]
    kind = SimpleNamespace(mission=SimpleNamespace(kind="impact"))
    result: Any = SimpleNamespace(
        requirements=[verdict], phases=phases, plan=SimpleNamespace(segments={}), description=kind
    )
    with house_style():
        ax = new_figure().add_subplot()
        name, label = "impact.torque_share", "limit {:g} N m"
        assert draw_requirement(ax, result, name, label, origin=1.0, scale=12.0) == 6.0
        assert ax.texts[-1].get_text() == "limit 6 N m: phases impact, retreat, from contact on"
        x, y = np.asarray(ax.lines[-1].get_data())
        assert x[np.isfinite(y)].tolist() == [0.0, 1.0]
        assert draw_requirement(ax, result, name, label, scale=np.nan) is None
        assert draw_requirement(ax, result, "impact.yaw_deg", label) is None and len(ax.lines) == 1
