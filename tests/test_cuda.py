"""The steps compile for CUDA from their one source; needs an interpreter that has numba-cuda."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from skywright.core.record import Mat3, Record, Vec3
from skywright.errors import InputError
from skywright.evidence.cuda_steps import align, build_kernel, prepare

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
    assert kernel.count("ld.param.u64") == 2 and "call.uni (out), step, (a0, a1);" in kernel
    with pytest.raises(InputError, match="has no function 'step'"):
        build_kernel(".visible .entry other()")


def test_without_numba_cuda_one_line_says_what_to_install() -> None:
    if importlib.util.find_spec("numba_cuda") is not None:
        pytest.fail("numba-cuda is no dependency: the environment of the tests is another")
    with pytest.raises(InputError, match="pip install numba-cuda"):
        prepare()
