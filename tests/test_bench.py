"""`skywright bench`: what is timed is what is said, results are whole, wrong input is told.

No test has a limit on time: a machine may be busy.
"""

from __future__ import annotations

import importlib.util
import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from skywright import cli
from skywright.errors import InputError
from skywright.evidence.bench import clone, laws, planning, registry, robots, runner, sensors, tick
from skywright.evidence.bench.flights import (
    FULL_STRENGTH,
    count_ticks,
    fly_into_contact,
    fly_to_hover,
    load_scan,
    record_applied,
    step_bare,
)
from skywright.evidence.bench.registry import BENCHMARKS, Benchmark, choose_benchmarks
from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.evidence.bench.runner import run_benchmarks
from skywright.evidence.bench.scan import Cost, fit_exponent
from skywright.evidence.bench.timing import compute_ratios, interleave
from skywright.run.planning import plan_mission
from skywright.vehicle.instruments.eddy_current import EddyProbe
from skywright.vehicle.interface import Probe

ROOT = Path(__file__).resolve().parent.parent
HERE = "test_bench_double"


@pytest.fixture
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _register(monkeypatch: pytest.MonkeyPatch, **measures) -> None:
    """Put benchmarks of this test into the registry, as one file and one line would."""
    table = {}
    for name, measure in measures.items():
        module = ModuleType(f"{HERE}_{name}")
        module.measure = measure
        monkeypatch.setitem(sys.modules, module.__name__, module)
        table[name] = Benchmark(module.__name__, f"{name} of a test")
    for owner in (registry, runner):
        monkeypatch.setattr(owner, "BENCHMARKS", table)


# What is timed


class _Stay:
    def restore(self, sim) -> None:
        """Leave the state where stepping ended."""


@pytest.fixture(scope="module")
def flown():
    """Without artefacts: the estimator replaces one in the measurement that is then kept."""
    vehicle = fly_into_contact(load_scan(*(s for s in FULL_STRENGTH if "outlier" not in s)))
    return vehicle, vehicle.save()


@pytest.fixture
def in_contact(flown):
    vehicle, state = flown
    vehicle.restore(state)
    return vehicle


def test_bare_stepping_repeats_the_flight_bit_for_bit(in_contact):
    """With gusts, a link and varying friction: both sides of the ratio step the same physics."""
    sim = in_contact.sim
    applied = record_applied(in_contact, count_ticks(0.4))
    flown = sim.qpos.copy(), sim.qvel.copy()
    assert np.ptp(applied.frictions) > 0.0 and np.ptp(applied.forces) > 0.0
    step_bare(in_contact, applied._replace(end=_Stay()))
    assert sim.qpos.tobytes() == flown[0].tobytes()
    assert sim.qvel.tobytes() == flown[1].tobytes()


def test_timing_a_row_leaves_the_vehicle_as_it_was(in_contact):
    vehicle = in_contact
    before = vehicle.assembly.arena.copy()
    timed = [i for i, s in enumerate(vehicle.assembly.steps) if s.slot in ("estimate", "control")]
    assert timed
    for row in timed:
        assert tick.time_row(vehicle, row) > 0.0
    assert np.array_equal(vehicle.assembly.arena, before)


def test_copies_of_a_robot_in_one_world_fly_as_it_does_alone():
    description = load_scan()
    vehicle = fly_to_hover(description)
    stretch = robots.record_stretch(vehicle, count_ticks(0.5))
    crowd = robots.build_plants(description, 3)
    robots.step_all(crowd, stretch)
    q = crowd.data.qpos.reshape(3, -1)
    for i in range(3):
        alone = vehicle.sim.qpos.copy()
        alone[1] += 3.0 * i
        assert np.abs(q[i] - alone).max() < 1e-12
    assert crowd.model.nu == 3 * vehicle.scene.model.nu


def test_interleave_takes_turns_and_drops_the_first_round():
    calls: list[str] = []

    def case(name):
        def call() -> float:
            calls.append(name)
            return float(len(calls))

        return call

    times = interleave({"a": case("a"), "b": case("b")}, 3)
    assert calls == ["b", "a", "a", "b", "b", "a", "a", "b"]
    assert times == {"a": [3.0, 6.0, 7.0], "b": [4.0, 5.0, 8.0]}


@given(st.floats(0.1, 3.0), st.floats(0.01, 100.0))
def test_exponent_of_a_power_law(p, scale):
    costs = {n: Cost(100.0 * n, scale * n**p, 1.0, 1.0) for n in (1, 2, 4)}
    assert fit_exponent(costs, "plan_s") == pytest.approx(p, abs=1e-9)
    assert fit_exponent(costs, "run_s") == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("sets", [*sensors.CASES.values(), *planning.CASES.values()], ids=str)
def test_every_case_has_the_plan_that_it_is_said_to_have(sets):
    """A limit of the mission that becomes stricter must not leave a benchmark without flights."""
    refused = {planning.CASES[name] for name in planning.REFUSED}
    plan = plan_mission(load_scan(*sets))
    assert plan.feasible == (sets not in refused), plan.blocked_by


# Rows


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=9), st.floats(-1e6, 1e6))
def test_a_row_is_judged_by_its_median(values, limit):
    below = build_row("x", values, limit=limit)
    above = build_row("x", values, limit=limit, sense=">=")
    assert below.value == pytest.approx(np.median(values))
    assert below.passed == (below.value <= limit) and above.passed == (above.value >= limit)
    assert below.passed or above.passed
    if len(values) > 1:
        assert below.low <= below.value + 1e-6 and below.high >= below.value - 1e-6
        assert below.repetitions == len(values)
    else:
        assert below.low is None and below.high is None


@pytest.mark.parametrize("values", [math.nan, [1.0, math.inf], []])
def test_what_is_not_a_number_is_no_row(values):
    with pytest.raises(InputError, match="not a finite number"):
        build_row("x", values)


def test_ratios_are_of_each_round():
    assert compute_ratios([2.0, 9.0], [1.0, 3.0]) == [2.0, 3.0]


# The registry


def test_every_benchmark_is_there_and_named_once():
    assert choose_benchmarks([], full=True) == list(BENCHMARKS)
    assert "cold" not in choose_benchmarks([], full=False)
    assert choose_benchmarks(["tick", "loop", "loop"], full=False) == ["loop", "tick"]
    for name in BENCHMARKS:
        assert callable(registry.load_benchmark(name))


# The command


def _call(*args: str):
    return CliRunner().invoke(cli.main, ["bench", *args])


def test_bench_measures_prints_and_writes(_in_empty_folder):
    result = _call("contacts", "tick", "robots", "--quick", "--out", "kept", "--json")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["benchmarks"] == ["tick", "contacts", "robots"] and found["failed"] == []
    (file,) = Path("kept").iterdir()
    assert json.loads(file.read_text()) == found
    assert found["machine"]["cores"] >= 1 and "mujoco" in found["versions"]
    rows = {row["name"]: row for row in found["rows"]}
    assert len(rows) == len(found["rows"])
    for row in rows.values():
        assert set(row) == set(Row._fields)
        assert math.isfinite(row["value"]) and row["note"] and row["repetitions"] >= 1
        if row["unit"] == "":
            assert 0.01 < row["value"] < 100.0
    for name in ("scan.law.step", "scan.estimator.step", "arms.bare_tick"):
        assert rows[f"tick.{name}_us"]["value"] > 0.0


def test_a_table_says_what_was_missed_and_exits_0(_in_empty_folder, monkeypatch):
    _register(
        monkeypatch,
        slow=lambda session: [
            build_row("wait_s", [2.0, 4.0, 3.0], "s", limit=1.0, note="a wait"),
            build_row("speed", 3.0, limit=1.0, sense=">="),
            build_unmeasured_row("cores", "this machine has one core"),
        ],
    )
    result = _call("slow")
    assert result.exit_code == 0
    for text in ("wait_s", "3 s", "2.5 to 3.5", "≤ 1", "MISSED", "this machine has one core"):
        assert text in result.stdout
    assert "1 of 2 limits met" in result.stdout and "missed slow.wait_s: 3 s" in result.stdout
    assert not Path("benchmarks").exists()  # named: nothing is kept unless asked for


def test_a_whole_measurement_is_kept(_in_empty_folder, monkeypatch):
    _register(monkeypatch, one=lambda session: [build_row("x", 1.0)])
    report = run_benchmarks()
    assert report.file is not None and report.file.parent == Path("benchmarks/results")
    assert json.loads(report.file.read_text())["rows"][0]["name"] == "one.x"
    assert [p.suffix for p in report.file.parent.iterdir()] == [".json"]
    assert run_benchmarks(effort="quick").file is None


def test_a_benchmark_that_fails_leaves_the_others(_in_empty_folder, monkeypatch):
    monkeypatch.delenv("SKYWRIGHT_DEBUG", raising=False)

    def explode(session):
        raise ZeroDivisionError("two\nlines")

    def refuse(session):
        raise InputError("no pipe")

    _register(monkeypatch, bad=explode, worse=refuse, good=lambda session: [build_row("x", 1.0)])
    result = _call("--quick", "--json")
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert found["failed"] == ["bad", "worse"] and found["benchmarks"] == ["good"]
    notes = {row["name"]: row["note"] for row in found["rows"]}
    assert notes["bad.failed"] == "ZeroDivisionError: two lines"
    assert notes["worse.failed"] == "no pipe"
    assert "Traceback" not in result.stderr


def test_an_interrupt_keeps_what_was_measured(_in_empty_folder, monkeypatch):
    def interrupt(session):
        raise KeyboardInterrupt

    _register(monkeypatch, first=lambda session: [build_row("x", 1.0)], second=interrupt)
    result = _call("first", "second", "--out", "kept", "--json")
    assert result.exit_code == 1 and "interrupted" in result.stderr
    found = json.loads(result.stdout)
    assert found["interrupted"] and found["benchmarks"] == ["first"]
    (file,) = Path("kept").iterdir()
    assert json.loads(file.read_text()) == found
    _register(monkeypatch, second=interrupt)
    result = _call("second", "--out", "other")
    assert result.exit_code == 1 and result.stderr.endswith("skywright: interrupted\n")
    assert list(Path("other").iterdir()) == []


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["lop"], ["unknown benchmark 'lop'", "loop", "planning", "robots"]),
        (["loop", "tik"], ["'tik'", "tick"]),
        (["--quick", "--full"], ["--quick", "--full"]),
        (["loop", "--out", "/proc/nope"], ["/proc/nope", "cannot be written"]),
        (["loop", "--out", "file"], ["file", "cannot be written"]),
        (["loop", "--frobnicate"], ["--frobnicate"]),
    ],
)  # fmt: skip
def test_wrong_input_is_told_before_anything_is_measured(_in_empty_folder, args, words):
    Path("file").write_text("")
    result = _call(*args)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1 and "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr


def test_help_lists_the_benchmarks():
    text = _call("--help").stdout
    for name in BENCHMARKS:
        assert f"\n  {name} " in text


def test_a_killed_measurement_leaves_no_half_file(tmp_path):
    command = [sys.executable, "-m", "skywright", "bench", "memory", "--out", "kept"]
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    assert "memory" in process.stderr.readline()
    time.sleep(1.0)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 1
    assert "interrupted" in errors and "Traceback" not in errors
    assert list((tmp_path / "kept").iterdir()) == []


# The page


def _load_generator():
    path = ROOT / "docs" / "generate_benchmarks.py"
    spec = importlib.util.spec_from_file_location("generate_benchmarks", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_shows_the_committed_results():
    generator = _load_generator()
    text = generator.PAGE.read_text(encoding="utf-8")
    assert text == generator.build_page(text), "run: python docs/generate_benchmarks.py"


def test_the_page_shows_history_and_what_was_missed(_in_empty_folder, monkeypatch):
    _register(monkeypatch, one=lambda s: [build_row("x_s", [1.0, 2.0], "s", limit=1.0, note="a|b")])
    first = run_benchmarks(effort="full").to_json()
    second = {**first, "rows": [{**first["rows"][0], "value": 0.5, "passed": True}]}
    generator = _load_generator()
    text = generator.build_section([first, second])
    assert "| `one.x_s` | ≤ 1 | 0.5 s | 1.25 to 1.75 | 1.5 s | a\\|b |" in text
    assert "**1.5 s** missed" in generator.build_section([first])
    assert text.index("| #2 |") < text.index("| #1 |")


# Last: it changes what the vehicle of this module believes


def test_contact_is_judged_from_the_calibrated_signal(in_contact):
    shown = in_contact.read(EddyProbe.Reading).ec
    for off, touching in ((0.0, True), (20.0, False), (-20.0, False)):
        Probe(in_contact).calibrate(complex(*shown) + off * 1j, 1j)
        in_contact.tick()
        assert in_contact.in_contact() is touching


def test_a_fresh_clone_is_not_measured_without_git_or_a_checkout(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(clone, "read_commit", lambda: {"commit": None, "changed": None})
    for found, why in (("/bin/tool", "requires a checkout"), (None, "requires git and make")):
        monkeypatch.setattr(clone.shutil, "which", lambda tool, found=found: found)
        (row,) = clone.measure(Session("quick", tmp_path))
        assert row.value is None and row.note == why


def test_each_law_is_measured_with_a_robot_that_it_can_fly(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = ["push_and_slide", "direct_force", "backstepping_torque"]
    first, *others = laws.measure_laws(kinds, 2)
    assert first.name == "push_and_slide_us" and first.note == "a step, hovering"
    assert [(row.name, row.note) for row in others] == [
        ("direct_force_over_push_and_slide", "a step, with the robot othex-force"),
        ("backstepping_torque_over_push_and_slide", "a step, with the robot f550-bridge-torque"),
    ]
    assert all(row.value is not None and row.value > 0.0 for row in (first, *others))
    monkeypatch.setattr(laws, "ROBOTS", ("othex",))
    *_, refused = laws.measure_laws(["push_and_slide", "direct_force"], 2)
    assert refused.value is None and "'othex' has no force sensor there" in refused.note
