"""The steps compile for CUDA from their one source; needs an interpreter that has numba-cuda."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

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
        (["waypoints", "--seconds", "0"], "must be positive"),
        (["waypoints", "--samples", "-1"], "must be positive"),
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


def test_a_block_with_offsets_gives_the_same_tick_at_another_address() -> None:
    recorder = FlightRecorder(1e9, 100)
    sets = ["mission.task.points=[{x_m=0.5,y_m=0.0,z_m=1.0,yaw_deg=10.0,hold_s=0.2}]"]
    fly_and_evaluate(load_description("waypoints", sets=sets), [recorder])
    layout, a = Layout(recorder), recorder.assembly
    assert {"arena", "qpos", "ctrl"} <= {p.name for p in layout.places if p.space == OWN}
    shared, shared_space = layout.build_shared()
    shared_at, block = shared.ctypes.data, np.zeros(layout.block_bytes // 8 + 8, np.int64)[8:]

    def decode(words: np.ndarray, space: np.ndarray) -> np.ndarray:
        moved = np.where(space == OWN, block.ctypes.data, 0) + np.where(
            space == SHARED, shared_at, 0
        )
        return np.asarray(words + moved)

    shared[:] = decode(shared, shared_space)
    inside = a.arena.ctypes.data
    for tick in recorder.ticks[2::3]:
        block[:] = decode(*layout.encode(tick.before[layout.own]))
        clock = block[: Clock.dtype.itemsize // 8].view(Clock.dtype)
        rows = a.rows.copy()
        rows["ports"] = np.where(rows["ports"] > 0, rows["ports"] - inside + block.ctypes.data, 0)
        for known, drawn in zip(a._blocks, tick.drawn, strict=True):
            for r, d in known.places:
                stride = rows["draw_stride"][r][d]
                index = clock["fast" if known.fast else "block"][0]
                rows["draw_base"][r][d] = drawn.ctypes.data - index * stride
        run_rows(rows.ctypes.data, 0, a.n_control, block.ctypes.data)
        expected = decode(*layout.encode(tick.after[layout.own]))
        assert np.array_equal(block, expected)
        assert np.sum(expected != decode(*layout.encode(tick.before[layout.own]))) > 200


def test_arrays_of_mujoco_that_steps_change_are_checked() -> None:
    same = np.arange(4)
    recorder: Any = SimpleNamespace(
        arrays={"arena": same[:1], "ctrl": same[:1], "pair_friction": same[:2]}, changes=[None],
        ticks=[SimpleNamespace(before=same, after=same + [5, 6, 0, 0])],
    )  # fmt: skip
    cuda_bundle.check_written(recorder)
    recorder.ticks.append(SimpleNamespace(before=same, after=same + [0, 0, 0, 1]))
    with pytest.raises(InputError, match="changes pair_friction of MuJoCo"):
        cuda_bundle.check_written(recorder)


def test_a_kernel_runs_a_step_for_each_world() -> None:
    head = ".visible .func (.param .b64 func_retval0) step("
    ptx = head + "\n.param .b64 a,\n.param .b64 b,\n.param .b64 c\n)\n{ ret; }"
    kernel = build_world_kernel(ptx, [64, None, None], {2: (32, 1000, 24)})
    assert "add.u64 %r0, %d4, 64;" in kernel and "mov.u64 %r1, 0;" in kernel
    assert "ld.u64 %d5, [%d4 + 32];" in kernel and "mad.lo.u64 %r2, %d5, 24, %d7;" in kernel
    with pytest.raises(InputError, match="3 parameters for 2 ports"):
        build_world_kernel(ptx, [64, None], {})
