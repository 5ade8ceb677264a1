"""Orders of an operator in a mission that flies: next, retry, retract; and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import skywright
from exact_map import EXACT
from skywright.ground.operator_model import ModelOperator
from skywright.recordings.recording import read_recording
from skywright.run import orders
from skywright.run.directory import _phases_of
from skywright.run.flight import Flight
from skywright.run.operator import FILE, load_recording
from skywright.run.orders import WAITING
from skywright.run.result import RunResult
from skywright.run.run import run_mission

HOLDS = (
    "mission.task.points=[{ x_m = 0.8, y_m = 0.0, z_m = 1.2, hold_s = 40.0 },"
    "{ x_m = 0.0, y_m = 0.4, z_m = 1.0, hold_s = 2.0 }]",
    "mission.hover_height_m=0.8",
)
PRESS = (
    *EXACT,
    "mission.task.forces_n=[2.0]",
    "mission.task.hold_s=6.0",
    "mission.task.slide_m=0.1",
)
INSTALL = (
    "mission.task.hover_s=0",
    "mission.task.swing_deg=0",
    "mission.task.survey=false",
    "mission.task.hold_s=6",
    "mission.timestep_ms=2",
    "mission.record_raw=false",
)
TOOL = (
    "mission.task.hover_s=0", "mission.task.wait_s=1", "mission.timestep_ms=2",
    "mission.record_raw=false",
)  # fmt: skip
SCAN = (
    "mission.task.passes=2", "mission.task.pass_length_m=0.1", "mission.task.arc_deg=20",
    "mission.timestep_ms=2", "mission.record_raw=false",
)  # fmt: skip


class Operator:
    """Gives orders: each a phase's beginning, a time after its start (s), and the order."""

    def __init__(self, *orders: tuple[str, float, str]) -> None:
        self.orders, self.results = list(orders), []
        self.phases: list[tuple[str, float]] = []

    def on_plan(self, plan, description):
        pass

    def on_supervisor(self, supervisor):
        self.s = supervisor

    def on_tick(self, t, phase, vehicle):
        if phase not in [p for p, _ in self.phases[-1:]]:
            self.phases.append((phase, t))
        if self.orders:
            name, after, what = self.orders[0]
            if phase.startswith(name) and t >= self.phases[-1][1] + after:
                self.orders.pop(0)
                self.results.append(self.s.order(what))

    def close(self):
        pass


def fly(
    folder: Path, mission: str, operator: Operator, *sets: str, backend="physics", stick=None
) -> RunResult:
    result = run_mission(
        skywright.load(mission, sets=sets), out=folder / "run", observers=[operator],
        backend=backend, operator=stick,
    )  # fmt: skip
    assert not operator.orders, (operator.orders, [p.name for p in result.phases])
    return result


def name_phases(result: RunResult) -> list[str]:
    return [p.name for p in result.phases]


def test_next_ends_a_hold_and_orders_that_make_no_sense_are_refused_with_the_reason(tmp_path):
    operator = Operator(
        ("start", 0.2, "next"), ("take_off", 0.5, "next"), ("take_off", 0.6, "retract"),
        ("hold 1", 1.0, "retry"), ("hold 1", 3.0, "next"),
    )  # fmt: skip
    result = fly(tmp_path, "waypoints", operator, *HOLDS, backend="kinematic")
    assert result.outcome == "succeeded", result.reason
    (held,) = [p for p in result.phases if p.name == "hold 1"]
    assert 2.9 < held.end_s - held.start_s < 3.2
    s = result.samples
    assert np.linalg.norm(np.diff(s["ref_p_WB"], axis=0), axis=1).max() < 0.03  # nothing jumps
    assert [r.reason for r in operator.results] == [
        "next refused: the robot does not fly",
        "next refused: take_off cannot be ended early; valid: a hold, or a contact after retract",
        "retract refused: take_off has no contact that this mission can repeat",
        "retry refused: hold 1 has no contact that this mission can repeat",
        "",
    ]


def test_a_word_that_is_no_order_is_refused(tmp_path):
    operator = Operator(("take_off", 0.1, "explode"), ("hold 1", 1.0, "next"))
    result = fly(tmp_path, "waypoints", operator, *HOLDS, backend="kinematic")
    assert operator.results[0].reason == "order 'explode' refused: valid: next, retry, retract"
    assert result.outcome == "succeeded", result.reason


def test_a_press_is_drawn_back_held_and_tried_again(tmp_path):
    """Retract draws back along the normal and holds; retry begins the contact anew."""
    operator = Operator(
        ("free hold 2 N", 2.0, "retract"), (WAITING, 1.0, "retract"), (WAITING, 2.0, "retry")
    )
    result = fly(tmp_path, "wall-contact", operator, *PRESS)
    assert [r.reason for r in operator.results] == [
        "", "retract refused: the robot has already retreated: order retry or next", "",
    ]  # fmt: skip
    names = name_phases(result)
    at = names.index("draw back")
    assert names[at - 1 : at + 4] == [
        "free hold 2 N", "draw back", WAITING, "rejoin", "free near",
    ]  # fmt: skip
    assert result.phases[at - 1].outcome == "drawn back"
    assert names.count("free hold 2 N") > 1
    stored = _phases_of(read_recording(tmp_path / "run" / "recording.mcap").events, 0.0)
    assert [p.outcome for p in stored[:-1]] == [p.outcome for p in result.phases[:-1]]
    s, waits = result.samples, result.phases[at + 1]
    inside = (s["t"] > waits.start_s + 0.5) & (s["t"] < waits.end_s)
    before = s["p_WB"][np.searchsorted(s["t"], result.phases[at - 1].end_s) - 1]
    back = s["p_WB"][inside].mean(axis=0) - before
    assert np.linalg.norm(back) == pytest.approx(0.25, abs=0.05)
    assert np.max(np.linalg.norm(s["v_WB"][inside], axis=1)) < 0.1  # it holds
    assert np.max(np.abs(s["f_contact"][inside])) < 0.05  # and touches nothing
    assert result.outcome == "succeeded", result.reason


def test_a_contact_that_is_left_out_is_no_success(tmp_path):
    operator = Operator(("free hold 2 N", 1.0, "retract"), (WAITING, 0.5, "next"))
    result = fly(tmp_path, "wall-contact", operator, *PRESS)
    assert result.outcome == "aborted"
    assert result.reason.startswith("left out by the operator's order: ")
    names = name_phases(result)
    assert "free near" not in names[names.index(WAITING) :]  # it was the only place
    assert result.samples["p_WB"][-1, 2] < 0.4  # it came home


def test_a_scan_is_touched_again_where_it_was_left(tmp_path):
    operator = Operator(("scan", 4.0, "retry"))
    result = fly(tmp_path, "pipe-weld-scan", operator, *SCAN)
    assert [r.ok for r in operator.results] == [True]
    names = name_phases(result)
    at = names.index("draw back")
    assert names[at - 1 : at + 5] == ["scan", "draw back", "rejoin", "trim", "touch", "settle"]
    scans = [p for p in result.phases if p.name == "scan"]
    assert [p.outcome for p in scans] == ["drawn back", "done"]
    assert scans[1].end_s - scans[1].start_s == pytest.approx(
        result.plan.segments["scan"]["t"][-1] - 4.0, abs=0.2
    )


def test_the_sensor_is_pressed_again_after_a_retract(tmp_path):
    operator = Operator(("force", 2.0, "retract"), (WAITING, 1.0, "retry"), ("force", 3.0, "next"))
    result = fly(tmp_path, "sensor-install", operator, *INSTALL)
    assert [r.reason for r in operator.results] == ["", "", ""]
    names = name_phases(result)
    at = names.index("draw back")
    assert names[at - 1 : at + 5] == ["force", "draw back", WAITING, "rejoin", "touch", "press"]
    held = [p for p in result.phases if p.name == "force"][-1]
    assert 2.9 < held.end_s - held.start_s < 3.2
    assert result.outcome in ("succeeded", "failed")
    assert "contact was lost" not in result.reason and "no surface" not in result.reason


def test_the_sensor_is_pressed_again_by_hand_and_its_input_goes_on(tmp_path):
    operator = Operator(("force", 0.5, "retract"), (WAITING, 1.0, "retry"))
    result = fly(
        tmp_path, "sensor-install", operator, *INSTALL, stick=ModelOperator("careful", 1, 0.03)
    )
    assert [r.reason for r in operator.results] == ["", ""]
    names = name_phases(result)
    at = names.index("draw back")
    assert names[at - 1 : at + 5] == ["force", "draw back", WAITING, "rejoin", "touch", "press"]
    assert names[names.index("retract") - 1] == "force"
    assert "pressed on" not in result.reason and result.outcome in ("succeeded", "failed")
    s, waits = result.samples, result.phases[at + 1]
    inside = (s["t"] > waits.start_s + 0.2) & (s["t"] < waits.end_s)
    assert np.max(np.abs(s["left_f_W"][inside])) < 0.1
    kept = load_recording(tmp_path / "run" / FILE)  # its times grow over both stretches
    assert kept.t[-1] > 0.9 * result.metrics["operator.time_s"] / 2.0


def test_a_tool_is_set_down_and_lifted_again_where_that_is_ordered(tmp_path, monkeypatch):
    """On the bench, over the pipe, and over the bench, where it cannot be left out.

    There no order comes at last, and it is put down before the robot comes home.
    """
    monkeypatch.setattr(orders, "PATIENCE_S", 4.0)
    operator = Operator(
        ("lift", 1.0, "retract"), (WAITING, 1.0, "retry"), ("install", 1.5, "retract"),
        (WAITING, 1.0, "next"), ("lower", 4.5, "retract"), (WAITING, 0.5, "next"),
    )  # fmt: skip
    result = fly(tmp_path, "tool-install", operator, *TOOL)
    must = "the contact cannot be left out: the tool would stay on the hooks; valid: retry"
    assert [r.reason for r in operator.results] == ["", "", "", "", "", f"next refused: {must}"]
    names = [n for n in name_phases(result) if n not in ("start", "take_off")]
    assert names == [
        "approach bench", "grasp", "lift", "draw back", "release", WAITING, "rejoin", "grasp",
        "lift", "carry", "approach pipe", "install", "draw back", WAITING, "rejoin", "carry back",
        "back to the bench", "lower", "draw back", WAITING, "rejoin", "lower", "release", "return",
        "lift arms", "land",
    ]  # fmt: skip
    assert result.outcome == "aborted" and result.reason == (
        "left out by the operator's order: the place of 'install'; it was not put down; it was "
        "carried back to the bench"
    )
    assert result.metrics["tool.returned"] == 1.0 and result.metrics["contact.collisions"] == 0.0
    s = result.samples
    for waits in [p for p in result.phases if p.name == WAITING]:
        inside = (s["t"] > waits.start_s + 0.5) & (s["t"] < waits.end_s)
        assert np.ptp(s["object0_p_WO"][inside], axis=0).max() < 0.02  # it stands, or hangs still


def test_a_tool_that_is_installed_and_retrieved_by_hand_goes_back_and_again(tmp_path):
    operator = Operator(
        ("install", 4.0, "retract"), (WAITING, 1.0, "retry"), ("lift off", 1.0, "retract"),
        (WAITING, 1.0, "retry"),
    )  # fmt: skip
    result = fly(tmp_path, "tool-install", operator, *TOOL, stick=ModelOperator("hasty", 1, 0.03))
    assert [r.reason for r in operator.results] == ["", "", "", ""]
    assert result.outcome == "succeeded", result.reason
    names = name_phases(result)
    assert names.count("install") == 2 and names.count("hook") == 2 == names.count("lift off")
    at = names.index(WAITING)
    s = result.samples
    first, again = (
        s["object0_p_WO"][np.searchsorted(s["t"], p.start_s)]
        for p in result.phases if p.name == "install"
    )  # fmt: skip
    assert np.linalg.norm(first - again) < 0.012  # it begins where it began
    waits = result.phases[at + 1 + names[at + 1 :].index(WAITING)]
    rows = s[(s["t"] > waits.start_s) & (s["t"] < waits.end_s)]
    assert np.max(np.abs(rows["left_f_W"])) == 0.0  # it stands on the pipe, the hooks below
    assert result.metrics["tool.seat_error_mm"] < 10.0
    assert load_recording(tmp_path / "run" / FILE).t[-1] > 25.0


def test_a_peg_is_drawn_out_and_inserted_again(tmp_path):
    operator = Operator(
        ("insert", 0.3, "retract"), (WAITING, 1.0, "retry"), ("set free", 0.2, "retract")
    )
    result = fly(tmp_path, "bar-insertion", operator, "mission.timestep_ms=2")
    assert [r.reason for r in operator.results] == [
        "", "", "retract refused: set free has no contact that this mission can repeat",
    ]  # fmt: skip
    names = name_phases(result)
    at = names.index("draw back")
    assert names[at - 1 : at + 6] == [
        "insert", "draw back", WAITING, "rejoin", "align", "lower", "insert"
    ]  # fmt: skip
    assert result.outcome == "succeeded", result.reason


def test_a_contact_that_nobody_ended_is_told_as_that():
    of = orders.Orders.__new__(orders.Orders)
    late = "no order came for 120 s after retract"
    of.left_out = {orders.BY_ORDER: ["a", "b"], late: ["c"]}
    judged = of.judge(Flight(True, "lost"))
    assert judged.reason == f"left out by the operator's order: a, b; {late}: c; lost"
    assert not judged.completed


def test_without_an_order_it_comes_home(tmp_path, monkeypatch):
    monkeypatch.setattr(orders, "PATIENCE_S", 10.0)
    operator = Operator(("free hold 2 N", 1.0, "retract"))
    result = fly(tmp_path, "wall-contact", operator, *PRESS)
    assert result.outcome == "aborted"
    assert result.reason == "no order came for 10 s after retract"
    assert "come home" in name_phases(result)
    assert result.samples["p_WB"][-1, 2] < 0.4
