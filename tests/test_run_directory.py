"""What a run leaves behind when it ends in other ways than it should."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import skywright
from constructed import build_flown, build_samples
from exact_map import EXACT
from short_mission import HOP
from skywright.core import interrupt
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.recordings.recording import Event
from skywright.recordings.writer import RecordingWriter
from skywright.reports import explain
from skywright.reports.terminal import print_result
from skywright.run.directory import _phases_of, load_run
from skywright.run.flight import Flight
from skywright.run.flight_recording import Pace
from skywright.run.inspected import Inspected, InspectedFlaw
from skywright.run.kind import load_kind
from skywright.run.requirements import Verdict, describe_outcome
from skywright.run.run import Observer, _evaluate, fly_and_evaluate, run_mission
from waiting import wait_for

SETS = [*EXACT, "mission.task.passes=1", "mission.task.pass_length_m=0.03"]


def start(tmp_path, *sets):
    command = [sys.executable, "-m", "skywright", "run", "pipe-weld-scan", "--out", "r", "--json"]
    for item in sets:
        command += ["--set", item]
    return subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def wait_for_recording(tmp_path, size):
    file = tmp_path / "r.partial" / "recording.mcap"
    wait_for(lambda: file.exists() and file.stat().st_size > size)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_is_complete_in_itself(tmp_path, number):
    process = start(tmp_path, "mission.mode=interactive")
    wait_for_recording(tmp_path, 500_000)
    process.send_signal(number)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 1, err
    assert json.loads(out)["outcome"] == "interrupted"
    assert "Traceback" not in err
    again = skywright.evaluate(tmp_path / "r.partial")
    assert again.outcome == "interrupted"
    assert len(again.samples) > 100


def test_a_killed_run_can_be_evaluated(tmp_path):
    process = start(tmp_path, "mission.mode=interactive")
    wait_for_recording(tmp_path, 500_000)
    process.kill()
    process.communicate(timeout=300)
    again = skywright.evaluate(tmp_path / "r.partial")
    assert again.outcome == "interrupted"
    assert [p.name for p in again.phases][:2] == ["start", "take_off"]
    assert again.phases[-1].outcome == "interrupted"


def test_a_failure_is_judged_again_and_states_its_new_reason(tmp_path):
    """Another limit in mission.toml: the reason is that of the new judgement, not the old one."""
    limits = ("position.rms_m.limit=1e-9", "position.hold_error_m.limit=1")
    sets = (*HOP, *(f"mission.requirements.{limit}" for limit in limits))
    d = skywright.load("waypoints", sets=sets)
    out = tmp_path / "run"
    run = run_mission(d, out=out)
    assert run.outcome == "failed" and "position.rms_m" in run.reason
    file = out / "mission.toml"
    text = file.read_text()
    assert text.count("1e-09") == 1
    file.write_text(text.replace("1e-09", "10.0"))
    again = skywright.evaluate(out)
    assert (again.outcome, again.reason) == ("succeeded", "")
    file.write_text(text.replace("1e-09", "2e-09"))
    again = skywright.evaluate(out)
    assert again.outcome == "failed" and again.reason != run.reason and "2e-09" in again.reason


def test_nothing_is_written_for_wrong_input(tmp_path):
    os.chdir(tmp_path)
    for sets, match in (
        (["mission.law=nosuch"], "unknown"),
        (["mission.requirements.foo.limit=3"], "is not a metric of kind 'scan'; valid: "),
        (
            ["mission.requirements.tip.tangential_rms_mm.unit=m"],
            "the unit of 'tip.tangential_rms_mm' is mm, not 'm': convert the limit ",
        ),
    ):
        with pytest.raises(InputError, match=match):
            run_mission(load_description("pipe-weld-scan", sets=sets))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["../../evil", "", "a/b", ".hidden"])
def test_names_that_would_leave_the_folder_are_refused(name):
    with pytest.raises(InputError, match=r"mission\.name"):
        load_description("pipe-weld-scan", sets={"mission.name": name})


@pytest.mark.parametrize("out", ["x" * 300, "a\0b", "run.partial"])
def test_impossible_run_directories_are_told(tmp_path, out):
    os.chdir(tmp_path)
    with pytest.raises(InputError):
        run_mission(load_description("waypoints"), out=tmp_path / out)


def test_a_report_that_cannot_be_written_leaves_the_run_partial(tmp_path):
    def fail(result):
        raise OSError(28, "No space left on device")

    result = run_mission(
        load_description("waypoints", sets=HOP), out=tmp_path / "r", write_report=fail
    )
    assert result.outcome == "interrupted"
    assert "No space left" in result.reason
    assert json.loads((tmp_path / "r.partial" / "metrics.json").read_text())["outcome"] == (
        "interrupted"
    )
    assert skywright.evaluate(tmp_path / "r.partial").outcome == "interrupted"


def test_a_disk_that_is_full_after_the_flight_leaves_the_run_partial(tmp_path, monkeypatch):
    write, texts = Path.write_text, []

    def fill_up(path, text, **options):
        if path.name == "metrics.json.new":
            texts.append(text)
            if len(texts) > 1:  # the first one marks the run as unfinished
                raise OSError(28, "No space left on device")
        return write(path, text, **options)

    monkeypatch.setattr(Path, "write_text", fill_up)
    result = run_mission(load_description("waypoints", sets=HOP), out=tmp_path / "r")
    assert result.outcome == "interrupted" and "No space left" in result.reason
    assert not (tmp_path / "r").exists()
    assert load_run(tmp_path / "r.partial").outcome == "interrupted"


def test_who_flies_without_a_directory_is_interrupted_too():
    """Comparisons and claims fly many times: half a flight is no number of theirs."""

    class Interrupt(Observer):
        def on_tick(self, t, phase, vehicle):
            if t > 1.0:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly_and_evaluate(load_description("waypoints"), [Interrupt()])


def test_an_interrupt_that_a_callback_swallowed_is_not_lost(monkeypatch):
    monkeypatch.setattr(interrupt, "_noted", False)
    with pytest.raises(KeyboardInterrupt):
        interrupt._interrupt(signal.SIGINT, None)  # as in a callback from C, which forgets it
    with pytest.raises(KeyboardInterrupt):
        interrupt.check_interrupt()
    interrupt.check_interrupt()  # once is enough


def test_a_disk_that_fills_in_flight_interrupts_and_says_how_much_is_kept(
    tmp_path, monkeypatch, capsys
):
    append, calls = RecordingWriter._append, []

    def fill_up(self, samples, rows):
        calls.append(len(samples))
        if self._nanoseconds(samples["t"][-1:])[0] > 6_000_000_000:
            with self._writing():
                raise OSError(28, "No space left on device")
        append(self, samples, rows)

    monkeypatch.setattr(RecordingWriter, "_append", fill_up)
    result = run_mission(load_description("waypoints", sets=HOP), out=tmp_path / "r")
    assert calls and result.exit_code == 1 and result.outcome == "interrupted"
    assert "No space left" in result.reason and not (tmp_path / "r").exists()
    print_result(result)
    said = " ".join(capsys.readouterr().out.split())
    assert "No space left" in said and "up to the end" not in said
    kept = float(load_run(tmp_path / "r.partial").samples["t"][-1])
    assert Pace.SOON_S - 0.02 < kept <= 6.0  # when the first write was due, or later
    assert f"up to t = {kept:.2f} s; the rest of" in said.replace("- ", "-")
    assert "No space left" in explain.describe_outcome(result)


@given(
    outcome=st.sampled_from(["succeeded", "failed", "aborted", "diverged", "interrupted"]),
    passed=st.lists(st.booleans(), max_size=3),
)
def test_a_reason_is_empty_only_where_all_was_met(outcome, passed):
    verdicts = [Verdict(f"m{i}", 1.0, "m", 2.0, "<=", p, "") for i, p in enumerate(passed)]
    reason = describe_outcome(outcome, verdicts)
    assert bool(reason) == (outcome != "succeeded" or not all(passed))
    assert all(v.passed or v.name in reason for v in verdicts)


@pytest.mark.parametrize("step", ["metrics", "requirements"])
def test_a_defect_of_the_evaluation_leaves_a_judged_run_behind(tmp_path, monkeypatch, step):
    def fail(*args):
        return np.zeros(0)[1]

    monkeypatch.setattr(type(load_kind("waypoints")), step, fail)
    result = run_mission(load_description("waypoints", sets=HOP), out=tmp_path / "r")
    written = json.loads((tmp_path / "r" / "metrics.json").read_text())
    assert result.outcome == written["outcome"] == "failed"
    assert written["reason"].startswith("evaluation: IndexError: index 1 is out of bounds")
    assert "of test_run_directory.py" in written["reason"]
    assert written["metrics"]["flight.duration_s"] > 1.0
    assert len(load_run(tmp_path / "r").samples) == len(result.samples)


def evaluate_described(monkeypatch, **parts):
    """Evaluate 1 s of a hold, as a kind whose methods return these values; written and read."""
    for name, value in {"metrics": {}, **parts}.items():
        monkeypatch.setattr(type(load_kind("waypoints")), name, lambda *_, value=value: value)
    s, phases = build_samples(
        [("hold 1", 1.0)], rotor_thrust=np.full(6, 5.0), power=0.0, saturated=0.0,
        f_collision=0.0, p_WB=np.zeros(3), est_p_WB=np.zeros(3),
    )  # fmt: skip
    result = _evaluate(build_flown("waypoints", s, phases), Flight(True, ""), "", Path())
    return json.loads(json.dumps(result.to_json(), allow_nan=False))


def test_numbers_of_numpy_are_written_as_those_of_python(monkeypatch):
    s = np.array([True, False, True])
    written = evaluate_described(
        monkeypatch, metrics={"x.count": np.sum(s), "x.mean_m": np.float32(0.5), "x.min": np.nan},
        describe={"all": s.all(), "spots": s, "at": (np.int32(2), {"x_m": np.float32(0.25)})},
        inspected=Inspected((InspectedFlaw("a", {"depth_mm": np.float32(2.0)}, s.any(), s[1]),)),
        requirements={},
    )  # fmt: skip
    assert written["outcome"] == "succeeded" and written["reason"] == ""
    m = written["metrics"]
    assert (m["x.count"], m["x.mean_m"], m["x.min"]) == (2.0, 0.5, None)
    assert written["result"] == {
        "all": False, "spots": [True, False, True], "at": [2, {"x_m": 0.25}]
    }  # fmt: skip
    (flaw,) = written["inspected"]["flaws"]
    assert flaw["hit"] is True and flaw["contact"] is False and flaw["sizes"] == {"depth_mm": 2.0}


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"metrics": {"x.all": np.zeros(2)}}, "TypeError"),
        (
            {"describe": {"x_m": np.nan}},
            "describe of WaypointsKind is not plain JSON: Out of",
        ),
        ({"describe": {"x": {1, 2}}}, "plain JSON: an object of type set"),
        (
            {"inspected": Inspected((InspectedFlaw("a", {}, True, True, np.inf),))},
            "inspected of WaypointsKind is not plain JSON: Out of range",
        ),
    ],
)
def test_what_json_cannot_represent_is_told_and_the_run_is_kept(monkeypatch, parts, says):
    written = evaluate_described(monkeypatch, requirements={}, **parts)
    assert written["outcome"] == "failed"
    assert written["reason"].startswith("evaluation: ") and says in written["reason"]
    assert written["metrics"]["flight.duration_s"] == 0.99


def test_a_cut_recording_keeps_how_its_phases_ended():
    events = [Event(0.0, "phase hold"), Event(1.0, "ended drawn back"), Event(1.0, "phase retract")]
    assert [p.outcome for p in _phases_of(events, 2.0)] == ["drawn back", "interrupted"]


def test_a_phase_of_no_length_does_not_end_as_the_one_before_it():
    events = [
        Event(10.0, "phase carry"), Event(20.0, "ended failed"), Event(20.0, "phase retract"),
        Event(20.0, "phase come home"),
    ]  # fmt: skip
    assert _phases_of(events, 30.0) == [
        ("carry", 10.0, 20.0, "failed"),
        ("retract", 20.0, 20.0, "done"),
        ("come home", 20.0, 30.0, "interrupted"),
    ]
