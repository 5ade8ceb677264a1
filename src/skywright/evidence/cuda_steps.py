"""Compile the steps of a vehicle for CUDA from their Python source; no device is needed.

    python -m skywright.evidence.cuda_steps --out benchmarks/cuda.json

Requires numba-cuda, NVIDIA's libraries nvvm and nvrtc, and the assembler ptxas, which are not
dependencies of Skywright (docs/howto/compile-for-cuda.md). Reports for each step whether it
compiles, the size of its PTX, and the registers and the stack that a thread needs.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types

from skywright.core import scratch
from skywright.core.compiled import Helper, HelperType, integers, table, words
from skywright.core.find import list_kinds
from skywright.description.loader import list_missions, load_description
from skywright.errors import InputError, describe_os_error
from skywright.evidence.bench.machine import read_commit
from skywright.run.backends import build_vehicle
from skywright.vehicle.assembly import Assembly
from skywright.vehicle.component import Draws
from skywright.vehicle.ports import Step

ARCHITECTURE = (9, 0)
"""Compute capability of the target."""
Flown = tuple[str, str | None, str]
"""A mission, the robot that flies it (None: its own), and a setting ("": none)."""
NEEDS = {
    "direct_force": ("bridge-contact", None),
    "backstepping_torque": ("bridge-contact", "f550-bridge-torque"),
}
"""Mission and robot of the laws that cannot fly the othex through way-points."""


class Compiled(NamedTuple):
    """Result of compiling a step."""

    mission: str
    step: str
    slot: str
    ptx_bytes: int  # 0: it does not compile
    registers: int  # per thread
    stack_bytes: int
    spilled_bytes: int
    why: str  # why it does not compile, or ""


def check_installed() -> None:
    """Raise InputError without numba-cuda or ptxas."""
    try:
        version("numba-cuda")
    except PackageNotFoundError:
        raise InputError(
            "compiling for CUDA requires numba-cuda: pip install numba-cuda nvidia-nvvm "
            "nvidia-cuda-nvrtc"
        ) from None
    if shutil.which("ptxas") is None:
        raise InputError("ptxas is not installed: it comes with the CUDA toolkit")


@cache
def prepare() -> Any:
    """Register the steps' helpers with numba-cuda and return it. Raises as check_installed.

    Helpers become device functions of the same Python source, and `local` becomes an array on the
    device's stack. The architecture replaces a device.
    """
    check_installed()
    from numba import cuda
    from numba.cuda import cudadecl, cudaimpl, dispatcher, mathimpl, ufuncs

    dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=ARCHITECTURE)
    devices: dict[Any, Any] = {}
    views = _build_views()

    def find_type(self: Any) -> Any:
        if self not in devices:
            host = self.dispatcher
            function = views.get(self, host.py_func)
            options = {
                "device": True, "debug": False, "lineinfo": False, "opt": True, "fastmath": False,
                "error_model": "numpy", "inline": host.targetoptions.get("inline", "never"),
            }  # fmt: skip
            devices[self] = dispatcher.CUDADispatcher(function, options)
        return HelperType(devices[self])

    for name in ("ceil", "exp", "floor", "sqrt"):  # ufuncs that are missing in its list
        implement = mathimpl.get_unary_impl_for_fn_and_ty(getattr(math, name), types.float64)
        ufuncs.ufunc_db().setdefault(getattr(np, name), {"d->d": implement})
    Helper._numba_type_ = property(find_type)  # type: ignore[assignment, method-assign]
    cudadecl.registry.register_global(scratch.local)(type("_Local", (scratch._Local,), {}))
    size = types.IntegerLiteral
    for arguments in ((size,), (size, size)):
        cudaimpl.registry.lower(scratch.local, *arguments)(scratch._build)
    return cuda


def _build_views() -> dict[Any, Any]:
    """Return replacements of `words`, `integers` and `table`: numba-cuda has no `carray`."""
    from numba.cuda.extending import intrinsic
    from numba.cuda.np import arrayobj

    def build(kind: Any, dimensions: int) -> Any:
        def view(typingctx: Any, address: Any, *sizes: Any) -> Any:
            out = types.Array(kind, dimensions, "C")

            def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                array = arrayobj.make_array(out)(context, builder)
                shape = list(values[1:])
                eight = context.get_constant(types.intp, 8)
                steps = [eight] if dimensions == 1 else [builder.mul(shape[1], eight), eight]
                pointer = context.get_data_type(kind).as_pointer()
                data = builder.inttoptr(values[0], pointer)
                arrayobj.populate_array(
                    array, data=data, shape=shape, strides=steps, itemsize=eight, meminfo=None
                )
                return array._getvalue()

            return out(types.intp, *[types.intp] * dimensions), codegen

        if dimensions == 1:
            return intrinsic(lambda typingctx, address, n: view(typingctx, address, n))
        return intrinsic(lambda typingctx, address, n, m: view(typingctx, address, n, m))

    numbers, wholes, rows = build(types.float64, 1), build(types.int64, 1), build(types.float64, 2)

    def view_words(address: int, n: int) -> Any:
        return numbers(address, n)

    def view_integers(address: int, n: int) -> Any:
        return wholes(address, n)

    def view_table(address: int, n: int, m: int) -> Any:
        return rows(address, n, m)

    return {words: view_words, integers: view_integers, table: view_table}


def align(kind: np.dtype[Any]) -> np.dtype[Any]:
    """Return the record's dtype with alignment; otherwise numbers are read byte by byte."""
    if kind.subdtype is not None:
        base, shape = kind.subdtype
        return np.dtype((align(base), shape))
    if kind.fields is not None:
        fields = [(name, align(kind.fields[name][0])) for name in kind.names or ()]
        out = np.dtype(fields, align=True)
        assert out.itemsize == kind.itemsize  # words of 8 bytes only: the layout is unchanged
        return out
    return kind


def compile_ptx(assembly: Assembly, step: Step) -> str:
    """Return a step of a vehicle as PTX: a device function `step` of the addresses of its ports.

    Raises the errors of numba if it does not compile.
    """
    cuda, ports = prepare(), list[Any]()
    for port in step.ports:
        absent = not issubclass(port.record, Draws) and assembly.resolve(step, port) is None
        ports.append(types.none if absent else from_dtype(align(port.record.dtype)))
    ptx, _ = cuda.compile(
        step.function, types.void(*ports), device=True, cc=ARCHITECTURE, output="ptx", abi="c",
        abi_info={"abi_name": "step"},
    )  # fmt: skip
    return str(ptx)


def compile_cuda(mission: str, assembly: Assembly, step: Step) -> Compiled:
    """Compile a step of a mission's vehicle for its ports."""
    try:
        ptx = compile_ptx(assembly, step)
        needs = assemble(build_kernel(ptx))
    except InputError:
        raise
    except Exception as error:  # numba and its passes raise arbitrary exceptions
        return Compiled(mission, step.label, step.slot, 0, 0, 0, 0, shorten(error))
    return Compiled(mission, step.label, step.slot, len(ptx), *needs, "")


def assemble(kernel: str) -> tuple[int, int, int]:
    """Return registers, stack and spilled bytes per thread of a kernel, as reported by ptxas."""
    with tempfile.TemporaryDirectory() as folder:
        said = write_cubin(kernel, Path(folder) / "step.cubin").split("'run'")[-1]
    numbers = [
        int(found.group(1)) if (found := re.search(pattern, said)) else 0
        for pattern in (r"Used (\d+) registers", r"(\d+) bytes stack frame",
                        r"(\d+) bytes spill stores")
    ]  # fmt: skip
    return numbers[0], numbers[1], numbers[2]


def write_cubin(kernel: str, file: Path) -> str:
    """Assemble PTX into `file` and return what ptxas reports; RuntimeError if it refuses."""
    architecture = f"-arch=sm_{ARCHITECTURE[0]}{ARCHITECTURE[1]}"
    done = subprocess.run(
        ["ptxas", architecture, "-v", "-", "-o", str(file)], input=kernel,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"ptxas: {done.stderr.strip().splitlines()[0]}")
    return done.stderr


def count_parameters(ptx: str) -> int:
    """Return the number of parameters of the device function `step`."""
    head = re.search(r"\.visible \.func\s*\(\.param \.b64 func_retval0\) step\((.*?)\)", ptx, re.S)
    if head is None:
        raise InputError("the PTX has no function 'step': numba-cuda writes it otherwise")
    return head.group(1).count(".param")


def build_kernel(ptx: str) -> str:
    """Return PTX with a kernel that calls the device function `step` once."""
    n = count_parameters(ptx)
    given = ",\n".join(f"  .param .u64 p{i}" for i in range(n))
    loads = [f"  ld.param.u64 %r{i}, [p{i}];" for i in range(n)]
    body = "\n".join(["  .reg .b64 %r<64>;", *loads, call_ptx([f"%r{i}" for i in range(n)])])
    return f"{ptx}\n.visible .entry run(\n{given}\n)\n{{\n{body}\n  ret;\n}}\n"


def call_ptx(arguments: Sequence[str]) -> str:
    """Return the call in PTX of the device function `step` with registers as arguments."""
    lines = ["  {"]
    for i, register in enumerate(arguments):
        lines += [f"  .param .b64 a{i};", f"  st.param.b64 [a{i}], {register};"]
    names = ", ".join(f"a{i}" for i in range(len(arguments)))
    return "\n".join([*lines, "  .param .b64 out;", f"  call (out), step, ({names});", "  }"])


def shorten(error: Exception) -> str:
    """Return the last lines of a message of numba, without colours and places."""
    text = re.sub(r"\x1b\[\d*m", "", str(error))
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    told = [x for x in lines if not x.startswith(("During:", "Failed in", "File", "<", "This"))]
    return " ".join(told[-2:])[:300] or type(error).__name__


def list_flights() -> list[Flown]:
    """Return all built-in missions, way-points with every law, and the scan with every
    estimator."""
    missions: list[Flown] = [(entry.name, None, "") for entry in list_missions()]
    laws: list[Flown] = [
        (*NEEDS.get(law, ("waypoints", "othex")), f"mission.law={law}") for law in list_kinds("law")
    ]
    estimators: list[Flown] = [
        ("pipe-weld-scan", None, f"mission.estimator={kind}")
        for kind in list_kinds("estimator")
        if kind != "station_camera"  # `filter` with a total station, as in bridge-contact
    ]
    return missions + laws + estimators


def compile_all(flights: Sequence[Flown], only: list[str]) -> list[Compiled]:
    """Compile the steps of the vehicles whose label contains one of `only` (all if it is empty)."""
    vehicles = [  # compiled for the processor before `prepare` changes the helpers' types
        (mission, build_vehicle(load_description(mission, robot, sets=[value] if value else [])))
        for mission, robot, value in flights
    ]
    prepare()
    steps: dict[str, tuple[str, Assembly, Step]] = {}
    for mission, vehicle in vehicles:
        for step in vehicle.assembly.steps:
            steps.setdefault(step.label, (mission, vehicle.assembly, step))
    chosen = [k for k in steps if not only or any(text in k for text in only)]
    if not chosen:
        raise InputError(
            f"--only {', '.join(only)}: no such step; valid parts of: {', '.join(steps)}"
        )
    return [compile_cuda(*steps[k]) for k in chosen]


def main() -> None:
    """Compile, print one line per step, and write the table."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--mission", action="append", default=[], help="default: all")
    p.add_argument("--only", action="append", default=[], metavar="TEXT", help="part of a label")
    p.add_argument("--out", type=Path, help="JSON")
    asked = p.parse_args()
    try:
        _run(asked.mission, asked.only, asked.out)
    except (InputError, OSError) as error:
        text = describe_os_error(error) if isinstance(error, OSError) else None
        print(f"error: {text or error}", file=sys.stderr)
        raise SystemExit(2) from None


def _run(missions: list[str], only: list[str], out: Path | None) -> None:
    flights = [(mission, None, "") for mission in missions] or list_flights()
    found = compile_all(flights, only)
    for one in found:
        told = (
            f"{one.ptx_bytes} bytes of PTX, {one.registers} registers, {one.stack_bytes} bytes of "
            f"stack, {one.spilled_bytes} spilled"
            if not one.why
            else f"does not compile: {one.why}"
        )
        print(f"{one.step}: {told}")
    if out is not None:
        table = {
            "when": datetime.now(UTC).strftime("%Y-%m-%d"), "commit": read_commit()["commit"],
            "architecture": list(ARCHITECTURE), "numba_cuda": version("numba-cuda"),
            "flights": [" ".join(filter(None, flight)) for flight in flights],
            "steps": [one._asdict() for one in found],
        }  # fmt: skip
        out.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
