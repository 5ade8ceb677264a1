"""The steps compile for CUDA from their one source; needs an interpreter that has numba-cuda."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from copy import copy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from skywright.core.record import Mat3, Record, Vec3
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence import cuda_bundle
from skywright.evidence.cuda_bundle import OWN, SHARED, Layout, build_world_kernel
from skywright.evidence.cuda_record import FlightRecorder
from skywright.evidence.cuda_steps import align, build_kernel, prepare
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.bus import Clock
from skywright.vehicle.schedule import run_rows

ROOT = Path(__file__).parent.parent


class Inner(Record):
    a: float
    R: Mat3


class Outer(Record):
    n: int
    inner: Inner
    p: Vec3


@pytest.mark.cuda
def test_law_observers_filter_allocation_and_instruments_compile(tmp_path: Path) -> None:
    out = tmp_path / "cuda.json"
    words = [
        "PushAndSlide", "Cascade", "Filter", "Observer", "WrenchObserver", "NominalBody",
        "RotorAllocation", "EddyProbe", "EddyArray", "RangeFinder",
    ]  # fmt: skip
    only = [text for word in words for text in ("--only", f"({word}.step")]
    done = subprocess.run(
        [os.environ["SKYWRIGHT_CUDA"], "-m", "skywright.evidence.cuda_steps", *only, "--out", out],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    steps = json.loads(out.read_text())["steps"]
    assert len(steps) == len(words)
    for step in steps:
        assert not step["why"] and step["ptx_bytes"] > 2_000, step
        assert 0 < step["registers"] <= 255


def test_every_step_but_one_of_the_recorded_flights_compiles() -> None:
    kept = json.loads((ROOT / "benchmarks" / "cuda.json").read_text())
    assert {flight.split()[0] for flight in kept["flights"]} >= {
        s["mission"] for s in kept["steps"]
    }
    failed = [step["step"] for step in kept["steps"] if step["why"]]
    assert failed == ["law (WholeBodyQp.step)"]  # it calls a C library


def test_aligned_records_have_the_same_places() -> None:
    kind = align(Outer.dtype)
    assert kind.isalignedstruct and kind["inner"].isalignedstruct
    x = np.zeros(1, kind)
    x["inner"]["R"][0] = np.arange(9).reshape(3, 3)
    x["p"], x["n"] = [1.0, 2.0, 3.0], 7
    same = x.view(Outer.dtype)
    assert np.array_equal(same["inner"]["R"], x["inner"]["R"]) and same["n"][0] == 7
    assert np.array_equal(same["p"][0], [1.0, 2.0, 3.0])


def test_a_kernel_calls_the_device_function_with_its_ports() -> None:
    head = ".visible .func (.param .b64 func_retval0) step("
    ptx = head + "\n.param .b64 a,\n.param .b64 b\n)\n{ ret; }"
    kernel = build_kernel(ptx)
    assert kernel.count("ld.param.u64") == 2 and "call (out), step, (a0, a1);" in kernel
    with pytest.raises(InputError, match="has no function 'step'"):
        build_kernel(".visible .entry other()")


def test_without_numba_cuda_one_line_says_what_to_install() -> None:
    if importlib.util.find_spec("numba_cuda") is not None:
        pytest.fail("numba-cuda is no dependency: the environment of the tests is another")
    with pytest.raises(InputError, match="pip install numba-cuda"):
        prepare()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["waypoints"], "pip install numba-cuda"),
        (["waypoints", "--seconds", "nan"], "valid: 1 or more"),
        (["waypoints", "--samples", "-1"], "valid: 1 or more"),
        (["waypoints", "--out", "."], "exists already"),
    ],
)
def test_a_bundle_that_cannot_be_written_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], says: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    given = arguments if "--out" in arguments else [*arguments, "--out", "new/bundle"]
    monkeypatch.setattr("sys.argv", ["cuda_bundle", *given])
    with pytest.raises(SystemExit) as ended:
        cuda_bundle.main()
    error = capsys.readouterr().err
    assert ended.value.code == 2 and says in error and error.count("\n") == 1
    assert not (tmp_path / "new" / "bundle").exists()


SHORT = ["mission.task.points=[{x_m=0.5,y_m=0.0,z_m=1.0,yaw_deg=10.0,hold_s=0.2}]"]


@pytest.fixture(scope="module")
def recorder() -> FlightRecorder:
    """A recorded flight."""
    out = FlightRecorder(1e3, 200)
    out.every = 100
    fly_and_evaluate(load_description("waypoints", sets=SHORT), [out])
    return out


class Block:
    """A block in this process's memory, as a world on a GPU has it."""

    def __init__(self, layout: Layout) -> None:
        self.words = np.zeros(layout.block_bytes // 8 + 8, np.int64)[8:]
        self.shared, space = layout.build_shared()
        self.shared += np.where(space == SHARED, self.shared.ctypes.data, 0)

    def decode(self, words: np.ndarray, space: np.ndarray) -> np.ndarray:
        """Return encoded words with addresses in this block."""
        own = np.where(space == OWN, self.words.ctypes.data, 0)
        return np.asarray(words + own + np.where(space == SHARED, self.shared.ctypes.data, 0))


def test_a_block_gives_the_same_tick_at_another_address(recorder: FlightRecorder) -> None:
    layout, a = Layout(recorder), recorder.assembly
    assert {"arena", "qpos", "ctrl"} <= {p.name for p in layout.places if p.space == OWN}
    block = Block(layout)
    at, inside = block.words.ctypes.data, a.arena.ctypes.data
    assert len(recorder.ticks) > 5
    for tick in recorder.ticks[2::3]:
        before = block.decode(*layout.encode(tick.before[layout.own]))
        block.words[:] = before
        clock = block.words[: Clock.dtype.itemsize // 8].view(Clock.dtype)
        rows = a.rows.copy()
        rows["ports"] = np.where(rows["ports"] > 0, rows["ports"] - inside + at, 0)
        for known, drawn in zip(a._blocks, tick.drawn, strict=True):
            for r, d in known.places:
                index = clock["fast" if known.fast else "block"][0]
                rows["draw_base"][r][d] = drawn.ctypes.data - index * rows["draw_stride"][r][d]
        run_rows(rows.ctypes.data, 0, a.n_control, at)
        assert np.array_equal(block.words, block.decode(*layout.encode(tick.after[layout.own])))
        assert np.sum(block.words != before) > 200


def test_changes_of_a_recorded_flight_are_those_of_python(recorder: FlightRecorder) -> None:
    layout = Layout(recorder)
    flight = cuda_bundle.encode_flight(recorder, layout)
    assert np.array_equal(flight["tick"], [c.tick for c in recorder.changes[1:]])
    assert np.all(np.diff(flight["tick"]) > 0) and len(flight["path"]) == len(recorder.changes)
    own, last = set(layout.own.tolist()), 0
    for change, end in zip(recorder.changes[1:], flight["end"], strict=True):
        assert own.issuperset(change.at.tolist())
        assert np.array_equal(layout.own[flight["at"][last:end]], change.at)
        last = end
    first_drawn = {int(b) for t, b in zip(flight["drawn_tick"], flight["drawn_block"], strict=True)
                   if t == 0}  # fmt: skip
    assert first_drawn == set(range(len(recorder.assembly._blocks)))
    ticks = cuda_bundle.encode_ticks(recorder, layout)
    assert len(ticks["before"]) == len(recorder.ticks)
    cuda_bundle.check_written(recorder)


def test_a_recorded_flight_is_the_flight_itself(recorder: FlightRecorder) -> None:
    plain = FlightRecorder(1.0, 0)  # only times
    fly_and_evaluate(load_description("waypoints", sets=SHORT), [plain])
    assert plain.path == recorder.path and not plain.ticks and not plain.changes
    assert plain.ticks_timed == round(1.0 / plain.vehicle.dt) and plain.spent_s > 0.0


def test_a_flight_that_changes_the_plant_is_refused(recorder: FlightRecorder) -> None:
    where, tick = recorder.slices()["eq_active"], recorder.ticks[0]
    if where.start == where.stop:
        where = recorder.slices()["geom_contype"]
    wrong = tick.after.copy()
    wrong[where.start] += 1
    other = copy(recorder)
    other.ticks = [*recorder.ticks, tick._replace(after=wrong)]
    with pytest.raises(InputError, match=r"changes (eq_active|geom_contype) of MuJoCo outside"):
        cuda_bundle.check_written(other)


def test_integers_of_the_records_are_found(recorder: FlightRecorder) -> None:
    found = set(cuda_bundle.list_integers(recorder.assembly))
    at = (recorder.assembly.address(Clock) - recorder.assembly.arena.ctypes.data) // 8
    names = list(Clock.dtype.names or ())
    assert {at + names.index(n) for n in ("tick", "block", "fast", "fired")} <= found
    assert not {at + names.index(n) for n in ("t", "dt", "h")} & found


def test_steps_in_plain_python_are_refused() -> None:
    step = SimpleNamespace(label="wind (Own.step)")
    assembly = SimpleNamespace(steps=[step], list_python_rows=lambda: [0])
    supervisor = SimpleNamespace(vehicle=SimpleNamespace(assembly=assembly))
    with pytest.raises(InputError, match=r"plain Python do not run on a GPU: wind \(Own.step\)"):
        FlightRecorder(1.0, 1).on_supervisor(supervisor)


def test_a_kernel_runs_a_step_for_each_world() -> None:
    head = ".visible .func (.param .b64 func_retval0) step("
    ptx = head + "\n.param .b64 a,\n.param .b64 b,\n.param .b64 c\n)\n{ ret; }"
    kernel = build_world_kernel(ptx, [64, None, None], {2: (32, 1000, 24)})
    assert "add.u64 %r0, %d4, 64;" in kernel and "mov.u64 %r1, 0;" in kernel
    assert "ld.u64 %d5, [%d4 + 32];" in kernel and "mad.lo.u64 %r2, %d5, 24, %d7;" in kernel
    with pytest.raises(InputError, match="3 parameters for 2 ports"):
        build_world_kernel(ptx, [64, None], {})
