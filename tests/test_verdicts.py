"""Missions are judged by what was asked; the oracle agrees, and sees what was not done."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.description.world.surface import level_axes
from skywright.missions.bridge_contact.metrics import compute_bench_metrics
from skywright.missions.sensor_install.metrics import find_place
from skywright.run.flight import PhaseRecord
from skywright.run.kind import load_kind
from skywright.run.metrics import compute_common_metrics, compute_tracking
from skywright.run.run import run_mission
from skywright.run.setup import Setup

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import oracle


def build_holds(off: list[float], yaw_off: list[float]) -> Any:
    """Three way-points that are held, each as far off as is said (m, rad)."""
    n = 100
    fields = [("t", float), ("phase", int), ("p_WB", float, 3), ("ref_p_WB", float, 3),
              ("q_WB", float, 4), ("ref_q_WB", float, 4)]  # fmt: skip
    s = np.zeros(3 * n, fields)
    s["t"], s["phase"] = np.arange(3 * n) * 0.01, np.repeat([0, 1, 2], n)
    s["p_WB"][:, 1] = np.repeat(off, n)
    yaw = np.repeat(yaw_off, n)
    s["q_WB"][:, 0], s["q_WB"][:, 3] = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    s["ref_q_WB"][:, 0] = 1.0
    phases = [PhaseRecord(f"hold {i + 1}", i * 1.0, i + 1.0, "done") for i in range(3)]
    return SimpleNamespace(samples=s, phases=phases, plan=SimpleNamespace(segments={}))


def test_each_way_point_counts_not_only_the_last() -> None:
    m = compute_tracking(build_holds([0.0, 0.3, 0.0], [0.0, 0.0, math.radians(5.0)]))
    assert m["position.hold_error_m"] == pytest.approx(0.3)
    assert m["heading.hold_error_deg"] == pytest.approx(5.0)
    assert m["position.final_error_m"] == pytest.approx(0.0)  # what was judged before


def test_a_hold_that_a_pilot_interrupts_is_judged_as_one() -> None:
    """The robot still comes in as it begins: taken over then, this is not the whole hold."""
    run = build_holds([0.06, 0.3, 0.0], [0.0, 0.0, 0.0])
    run.phases[0] = PhaseRecord("hold 1", 0.0, 1.0, "taken over")
    run.phases[1] = PhaseRecord("manual", 1.0, 2.0, "done")
    run.phases[2] = PhaseRecord("hold 1", 2.0, 3.0, "done")
    assert compute_tracking(run)["position.hold_error_m"] == pytest.approx(0.03)
    assert compute_tracking(run)["position.final_error_m"] == pytest.approx(0.03)
    run.phases[2] = PhaseRecord("hold 2", 2.0, 3.0, "done")  # never gone on with
    assert compute_tracking(run)["position.hold_error_m"] == pytest.approx(0.06)
    run.phases[1] = PhaseRecord("rejoin", 1.0, 2.0, "failed")  # a rule ended it
    run.phases[2] = PhaseRecord("hold 1", 2.0, 3.0, "done")
    assert compute_tracking(run)["position.hold_error_m"] == pytest.approx(0.06)
    run.phases[0] = PhaseRecord("hold 1", 0.0, 1.0, "done")  # nobody took over: two holds
    run.phases[1] = PhaseRecord("manual", 1.0, 2.0, "done")
    assert compute_tracking(run)["position.hold_error_m"] == pytest.approx(0.06)


def test_a_way_point_that_is_passed_counts_where_the_platform_comes_closest() -> None:
    run = build_holds([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    s = run.samples
    s["ref_p_WB"][:100, 0] = np.linspace(-1.0, 0.0, 100)  # 1 m/s, then on to the next
    s["ref_p_WB"][100:200, 0] = np.linspace(0.0, 1.0, 100)
    s["p_WB"][8:200] = s["ref_p_WB"][:192]  # 80 ms late
    s["p_WB"][:200, 1] = 0.02
    s["ref_p_WB"][200:], s["p_WB"][200:] = 0.0, 0.0
    run.phases[0], run.phases[1] = (
        PhaseRecord(f"waypoint {i + 1}", i * 1.0, i + 1.0, "done") for i in range(2)
    )
    run.plan.segments = {"waypoint 1": None, "waypoint 2": None}
    assert compute_tracking(run)["position.hold_error_m"] == pytest.approx(0.02)
    run.samples["p_WB"][:200, 1] = 0.07
    assert compute_tracking(run)["position.hold_error_m"] == pytest.approx(0.07)


def test_contacts_of_hanging_arms_on_the_ground_are_no_collisions() -> None:
    names = ("take_off", "waypoint 1", "land")
    phases = [PhaseRecord(name, i * 1.0, i + 1.0, "done") for i, name in enumerate(names)]
    fields = [("t", float), ("phase", int), ("rotor_thrust", float, 4), ("f_collision", float),
              ("power", float), ("saturated", float), ("est_p_WB", float, 3), ("p_WB", float, 3),
              ("est_q_WB", float, 4), ("q_WB", float, 4)]  # fmt: skip
    s = np.zeros(300, fields)
    s["t"], s["phase"] = np.arange(300) * 0.01, np.repeat([0, 1, 2], 100)
    s["f_collision"][[10, 250]] = 5.0
    for hanging, hits in ((False, 2), (True, 0)):
        assert compute_common_metrics(s, phases, hanging)["contact.collisions"] == hits
    s["f_collision"][150] = 5.0
    assert compute_common_metrics(s, phases, hanging=True)["contact.collisions"] == 1


def test_one_bad_hold_of_many_is_not_averaged_away() -> None:
    n = 100
    s = np.zeros(10 * n, [("phase", int), ("q_WT", float, 4), ("f_contact", float, 3),
                          ("ref_force", float), ("force_meas", float)])  # fmt: skip
    s["phase"], s["q_WT"][:, 0], s["ref_force"] = np.repeat(np.arange(10), n), 1.0, 4.0
    s["f_contact"][:, 2] = -4.0
    s["f_contact"][s["phase"] == 3, 2] = -3.5
    phases = [PhaseRecord("hold 4 N", i * 1.0, i + 1.0, "done") for i in range(10)]
    m = compute_bench_metrics(SimpleNamespace(samples=s, phases=phases))  # type: ignore[arg-type]
    assert m["force.rms_error_n"] == pytest.approx(0.5)


def test_a_sensor_has_a_place() -> None:
    sets = ["world.pipe.yaw_deg=40", "world.pipe.inclination_deg=5"]
    pipe = Setup(load_description("sensor-install", sets=sets)).true.cylinder
    assert pipe is not None
    aside = math.radians(20.0)
    local = pipe.radius * np.array([[math.sin(aside), 0.0, -math.cos(aside)]]) + [0.0, 0.07, 0.0]
    R = level_axes(pipe.R_WP)  # below is where gravity has it
    around, along = find_place(pipe.p_WP + local @ R.T, pipe)
    assert around == pytest.approx(pipe.radius * aside) and along == pytest.approx(0.07)
    slips = np.vstack([local, local * [0.0, 1.0, 1.0] - [0.0, 0.01, 0.0]])
    assert find_place(pipe.p_WP + slips @ R.T, pipe) == pytest.approx((around, along))


@pytest.mark.parametrize(
    ("mission", "sets", "gone", "kept"),
    [
        ("sensor-install", ["mission.task.hover_s=0"], "tip.hover_rms_mm", "swing.decay_s"),
        ("sensor-install", ["mission.task.swing_deg=0"], "swing.decay_s", "tip.hover_rms_mm"),
        ("tool-install", ["mission.task.hover_s=0"], "tip.hover_rms_mm", "tool.returned"),
        ("wall-contact", ["mission.task.slide_m=0"], "slide.no_force_max_s", "contact.collisions"),
        ("bimanual-bench", ["mission.task.drift_m=0"], "bench.drift_off", "bench.box_slip_mm"),
    ],
)
def test_what_is_left_out_is_not_required(
    mission: str, sets: list[str], gone: str, kept: str
) -> None:
    d = load_description(mission, sets=sets)
    asked = load_kind(d.mission.kind).requirements(Setup(d), None)
    assert gone not in asked and kept in asked
    whole = load_description(mission)
    assert gone in load_kind(whole.mission.kind).requirements(Setup(whole), None)


def test_the_idle_hand_makes_way_for_a_pipe_that_slopes() -> None:
    sets = ["world.pipe.inclination_deg=-9", "world.pipe.diameter_m=0.28"]
    d = load_description("sensor-install", sets=sets)
    plan = load_kind("sensor-install").plan(Setup(d))
    assert plan.feasible, plan.blocked_by


def test_the_oracle_agrees_and_sees_another_request(tmp_path: Path) -> None:
    """Flown as asked, then held against a request with one more way-point."""
    result = run_mission(load_description("waypoints"), out=tmp_path / "run")
    assert result.outcome == "succeeded"
    assert oracle.judge(tmp_path / "run").met
    file = tmp_path / "run" / "mission.toml"
    text = file.read_text(encoding="utf-8")
    assert text.count("x_m = 1.5") >= 1
    file.write_text(text.replace("x_m = 1.5", "x_m = 1.8", 1), encoding="utf-8")
    seen = oracle.judge(tmp_path / "run")
    assert not seen.met and not seen.right and "way-point 1" in seen.why
