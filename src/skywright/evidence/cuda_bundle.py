"""Record a flight so that its steps can run on a GPU: `benchmarks/fly_bundle.py` does that.

    python -m skywright.evidence.cuda_bundle waypoints --seconds 20 --out BUNDLE

Requires what `skywright.evidence.cuda_steps` requires; no device is needed. A world on the GPU is
one block of memory: the records of the vehicle, copies of MuJoCo's arrays, and the arrays that the
steps change. Addresses in it are stored as offsets. A bundle has:

    bundle.json    the rows of the schedule with the offsets of their ports, and the layout
    row_NN.cubin   one kernel a step, compiled for CUDA from its Python source; a thread is a world
    flight.npz     the block at the start, and its changes by Python code between two mission ticks:
                   rows of the plan, phases, guards; random numbers; positions over the time
    ticks.npz      blocks before and after the control rows of single ticks, on the processor
    plant.mjb      MuJoCo's model of the plant
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import load_description
from skywright.errors import InputError, SkywrightError, describe_os_error
from skywright.evidence.bench.machine import (
    collect_all_versions,
    describe_machine,
    read_commit,
)
from skywright.evidence.cuda_record import FlightRecorder, Words, view_words
from skywright.evidence.cuda_steps import (
    ARCHITECTURE,
    call_ptx,
    check_installed,
    compile_ptx,
    count_parameters,
    prepare,
    shorten,
    write_cubin,
)
from skywright.run.run import fly_and_evaluate
from skywright.vehicle.assembly import BLOCK, FAST_BLOCK, Assembly
from skywright.vehicle.bus import Clock, Truth
from skywright.vehicle.component import Draws

OWN, SHARED = 1, 2
"""An address in the block of the world, and one in the memory that all worlds read."""
MOST = 400
"""Largest number of single ticks. Rounding can double it, and BLOCK is the limit."""
TIMED_S = 8.0
"""s of the flight over which the processor is timed; the default of fly_bundle.py on the GPU."""
TO_PHYSICS = ("ctrl", "xfrc")
"""Arrays of vehicle.bus.MuJoCo that steps may change; fly_bundle.py gives them to MuJoCo Warp."""


class Place(NamedTuple):
    """An array of the vehicle, and where its copy lies: in the block of a world, or shared."""

    name: str
    array: NDArray[Any]
    space: int  # OWN or SHARED
    offset: int  # bytes


class Layout:
    """Places of a vehicle's arrays on the GPU, and encoding of addresses as offsets."""

    def __init__(self, recorder: FlightRecorder) -> None:
        """Arrays that never change, and have no address of one that does, are shared."""
        self.places, block, shared, own = list[Place](), 0, 0, list[Words]()
        owned = _find_owned(recorder)
        for name, where in recorder.slices().items():
            array, size = recorder.arrays[name], 8 * (where.stop - where.start)
            if name in owned:
                self.places.append(Place(name, array, OWN, block))
                own.append(np.arange(where.start, where.stop))
                block += size
            else:
                self.places.append(Place(name, array, SHARED, shared))
                shared += size
        self.own = np.concatenate(own)  # indices of the words of an image that a block has
        for i, table in enumerate(recorder.tables):
            self.places.append(Place(f"table {i}", table, SHARED, shared))
            shared += 8 * len(view_words(table))
        self.block_bytes, self.shared_bytes = block, shared
        filled = [p for p in self.places if p.array.nbytes]
        filled.sort(key=lambda p: int(p.array.ctypes.data))
        self._starts = np.array([p.array.ctypes.data for p in filled], np.int64)
        self._ends = self._starts + [p.array.nbytes for p in filled]
        self._spaces = np.array([p.space for p in filled], np.int8)
        self._offsets = np.array([p.offset for p in filled], np.int64)

    def encode(self, words: Words) -> tuple[Words, NDArray[np.int8]]:
        """Return words with offsets in place of addresses, and the space of each (0: a value)."""
        k = np.searchsorted(self._starts, words, side="right") - 1
        inside = (k >= 0) & (words < self._ends[k])
        out = np.where(inside, words - self._starts[k] + self._offsets[k], words)
        return out, np.where(inside, self._spaces[k], 0).astype(np.int8)

    def find(self, name: str) -> int:
        """Return the offset (bytes) of an array."""
        return next(p.offset for p in self.places if p.name == name)

    def build_shared(self) -> tuple[Words, NDArray[np.int8]]:
        """Return the words of the shared memory, encoded."""
        shared = [view_words(p.array) for p in self.places if p.space == SHARED]
        words, space = self.encode(np.concatenate([np.zeros(0, np.int64), *shared]))
        assert not np.any(space == OWN)  # it would be another address in each world
        return words, space


def _find_owned(recorder: FlightRecorder) -> set[str]:
    """Return the names of the arrays of which each world needs its own."""
    constant = {
        name: recorder.first[where]
        for name, where in recorder.slices().items()
        if name.startswith("kept") and not recorder.changed[where].any()
    }
    owned = set(recorder.arrays) - set(constant)
    while True:
        spans = [
            (x.ctypes.data, x.ctypes.data + x.nbytes)
            for name, x in recorder.arrays.items() if name in owned
        ]  # fmt: skip
        found = {
            name for name, words in constant.items()
            if any(np.any((words >= first) & (words < end)) for first, end in spans)
        } - owned  # fmt: skip
        if not found:
            return owned
        owned |= found


def build_world_kernel(
    ptx: str, ports: list[int | None], draws: dict[int, tuple[int, int, int]]
) -> str:
    """Return PTX with a kernel that calls `step` for each world; a thread is a world.

    Its parameters are the address of the first block, the bytes of a block, the number of worlds,
    `shift`, and the address of the random numbers of each of `draws`. `ports` are offsets in the
    block, None if absent. `draws` has for a port the offset of its index in the clock, the number
    of its rows, and the bytes of a row: world i reads the row index + i * shift.
    """
    n = count_parameters(ptx)
    if n != len(ports):
        raise InputError(f"the PTX has {n} parameters for {len(ports)} ports")
    given = ["base", "stride", "worlds", "shift", *(f"draw{k}" for k in draws)]
    lines = [
        ".visible .entry run(", ",\n".join(f"  .param .u64 {name}" for name in given), ")", "{",
        "  .reg .pred %p<2>;", "  .reg .b32 %w<4>;", "  .reg .b64 %d<8>;", "  .reg .b64 %r<64>;",
        "  mov.u32 %w0, %ctaid.x;", "  mov.u32 %w1, %ntid.x;", "  mov.u32 %w2, %tid.x;",
        "  mad.lo.u32 %w3, %w0, %w1, %w2;", "  cvt.u64.u32 %d0, %w3;",
        "  ld.param.u64 %d1, [worlds];", "  setp.ge.u64 %p0, %d0, %d1;", "  @%p0 bra END;",
        "  ld.param.u64 %d2, [base];", "  ld.param.u64 %d3, [stride];",
        "  mad.lo.u64 %d4, %d0, %d3, %d2;", "  ld.param.u64 %d6, [shift];",
    ]  # fmt: skip
    for i, offset in enumerate(ports):
        if i in draws:
            index_at, rows, size = draws[i]
            lines += [
                f"  ld.u64 %d5, [%d4 + {index_at}];", "  mad.lo.u64 %d5, %d0, %d6, %d5;",
                f"  rem.u64 %d5, %d5, {rows};", f"  ld.param.u64 %d7, [draw{i}];",
                f"  mad.lo.u64 %r{i}, %d5, {size}, %d7;",
            ]  # fmt: skip
        elif offset is None:
            lines.append(f"  mov.u64 %r{i}, 0;")
        else:
            lines.append(f"  add.u64 %r{i}, %d4, {offset};")
    call = call_ptx([f"%r{i}" for i in range(n)])
    return "\n".join([ptx, *lines, call, "END:", "  ret;", "}", ""])


def write_rows(folder: Path, assembly: Assembly) -> list[dict[str, Any]]:
    """Compile each step into a kernel and return the rows of the schedule."""
    prepare()
    clock_at, base = _find_offset(assembly, Clock, ""), int(assembly.arena.ctypes.data)
    readers = {
        place: i for i, block in enumerate(assembly._blocks) for place in block.places
    }  # (row, index of the draw in it)
    most, out = int(assembly.rows["every"].max()), []
    for r, step in enumerate(assembly.steps):
        row, ports = assembly.rows[r], list[int | None]()
        periods = (1, 1 if row["fast"] else most)
        if row["phase"] or row["calls"] != 1 or row["every"] not in periods:
            raise InputError(
                f"{step.label} runs every {row['every']} ticks; on a GPU valid: 1 or, for a "
                f"control row, {most}"
            )
        draws: dict[int, tuple[int, int, int]] = {}
        blocks: list[int] = []
        for k, port in enumerate(step.ports):
            if issubclass(port.record, Draws):
                field = "fast" if row["fast"] else "block"
                index_at = clock_at + int(Clock.dtype.fields[field][1])  # type: ignore[index]
                rows = FAST_BLOCK if row["fast"] else BLOCK
                draws[k] = (index_at, rows, port.record.dtype.itemsize)
                blocks.append(readers[r, len(blocks)])
                ports.append(None)
            else:
                found = assembly.resolve(step, port) is not None
                ports.append(int(row["ports"][k]) - base if found else None)
        name = f"row_{r:02d}.cubin"
        try:
            kernel = build_world_kernel(compile_ptx(assembly, step), ports, draws)
            write_cubin(kernel, folder / name)
        except Exception as error:  # numba and its passes raise arbitrary exceptions
            raise InputError(f"{step.label} does not compile for CUDA: {shorten(error)}") from error
        numbers = {key: int(row[key]) for key in ("every", "phase", "fast")}
        out.append({"label": step.label, "file": name, **numbers, "draws": blocks})
    return out


def _find_offset(assembly: Assembly, record: Any, name: str) -> int:
    return assembly.address(record, name) - int(assembly.arena.ctypes.data)


def check_written(recorder: FlightRecorder) -> None:
    """Raise InputError if steps or Python code change an array that only MuJoCo should change.

    fly_bundle.py gives MuJoCo Warp the controls and external forces, but not, for example, a
    friction that varies along the surface.
    """
    changed = np.zeros(len(recorder.first), bool)
    for tick in recorder.ticks:
        changed |= tick.before != tick.after
    for change in recorder.changes[1:]:
        changed[change.at] = True
    names = [
        name for name, where in recorder.slices().items()
        if changed[where].any() and name not in ("arena", *TO_PHYSICS)
        and not name.startswith("kept")
    ]  # fmt: skip
    if names:
        raise InputError(
            f"this flight changes {', '.join(names)} of MuJoCo outside its steps; a flight on a "
            f"GPU may change: {', '.join(TO_PHYSICS)}"
        )


def write_bundle(mission: str, sets: list[str], seconds: float, samples: int, out: Path) -> None:
    """Fly a mission and write its bundle into an empty folder.

    Raises InputError if a step does not compile, and the errors of the flight.
    """
    check_installed()
    description = load_description(mission, sets=sets)
    timed, recorder = FlightRecorder(TIMED_S, 0), FlightRecorder(seconds, samples)
    fly_and_evaluate(description, [timed])
    result = fly_and_evaluate(description, [recorder])
    a, vehicle = recorder.assembly, recorder.vehicle
    layout = Layout(recorder)
    check_written(recorder)
    rows = write_rows(out, a)
    flight = encode_flight(recorder, layout)
    ticks = encode_ticks(recorder, layout)
    np.savez_compressed(out / "flight.npz", allow_pickle=False, **flight)
    np.savez_compressed(out / "ticks.npz", allow_pickle=False, **ticks)
    vehicle.sim.write_model(out / "plant.mjb")
    clock = _find_offset(a, Clock, "")
    fields: Any = Clock.dtype.fields
    meta = {
        "mission": mission, "sets": sets, "architecture": list(ARCHITECTURE),
        "outcome": result.outcome, "recorded_s": min(seconds, vehicle.t),
        "processor": {
            "name": describe_machine()["processor"],
            "tick_us": 1e6 * timed.spent_s / timed.ticks_timed,
        },
        "versions": collect_all_versions() | {"numba-cuda": version("numba-cuda")},
        "commit": read_commit(), "dt": vehicle.dt, "n_steps": vehicle.n_steps, "rows": rows,
        "clock": {name: clock + int(fields[name][1]) for name in fields},
        "records": {
            f"{record.__qualname__} {name}".strip(): [
                int(view.ctypes.data - a.arena.ctypes.data), view.nbytes
            ]
            for (record, name), view in a.records.items()
        },
        "integers": list_integers(a), "truth": _find_offset(a, Truth, ""),
        "others": {
            p.name: [p.offset, p.array.nbytes]
            for p in layout.places if p.space == OWN and p.name != "arena"
        },
        "arrays": {
            name: [layout.find(name), list(array.shape)]
            for name, array in vehicle.sim.arrays.items()
        },
        "block_bytes": layout.block_bytes, "shared_bytes": layout.shared_bytes,
    }  # fmt: skip
    (out / "bundle.json").write_text(json.dumps(meta, indent=1) + "\n", encoding="utf-8")


def list_integers(assembly: Assembly) -> list[int]:
    """Return the indices of the words of the records that are integers."""
    out, base = list[int](), int(assembly.arena.ctypes.data)

    def look(kind: np.dtype[Any], at: int) -> None:
        if kind.fields:
            for inner, offset, *_ in kind.fields.values():
                look(inner, at + offset)
        elif kind.subdtype:
            part = kind.subdtype[0]
            for i in range(kind.itemsize // part.itemsize):
                look(part, at + i * part.itemsize)
        elif kind.kind == "i":
            out.append(at // 8)

    for view in assembly.records.values():
        look(view.dtype, int(view.ctypes.data) - base)
    return out


def encode_flight(recorder: FlightRecorder, layout: Layout) -> dict[str, NDArray[Any]]:
    """Return the start, the changes, the random numbers and the path of a flight."""
    own = layout.own
    start, start_space = layout.encode(recorder.start[own])
    place = np.full(len(recorder.first), -1)  # of a word of the image in the block
    place[own] = np.arange(len(own))
    shared, shared_space = layout.build_shared()
    ticks, at, values, spaces, ends = list[int](), list[Words](), list[Words](), list[Any](), []
    drawn, drawn_tick, drawn_block = list[NDArray[np.float64]](), list[int](), list[int]()
    for i, change in enumerate(recorder.changes):
        for block, rows in change.drawn:
            if len(rows):
                drawn.append(rows)
                drawn_tick.append(change.tick)
                drawn_block.append(block)
        if i == 0:
            continue  # the start
        value, space = layout.encode(change.value)
        ticks.append(change.tick)
        at.append(place[change.at])
        values.append(value)
        spaces.append(space)
        ends.append(len(value))
    return {
        "start": start, "start_space": start_space, "shared": shared, "shared_space": shared_space,
        "tick": np.array(ticks), "end": np.cumsum(ends), "at": np.concatenate(at),
        "value": np.concatenate(values), "space": np.concatenate(spaces),
        "drawn_tick": np.array(drawn_tick), "drawn_block": np.array(drawn_block),
        **{f"drawn {i}": rows for i, rows in enumerate(drawn)},
        "path": np.array(recorder.path),
    }  # fmt: skip


def encode_ticks(recorder: FlightRecorder, layout: Layout) -> dict[str, NDArray[Any]]:
    """Return the blocks before and after single ticks, and their random numbers."""
    own, ticks = layout.own, [t for t in recorder.ticks if all(map(len, t.drawn))]
    before = [layout.encode(t.before[own]) for t in ticks]
    after = [layout.encode(t.after[own]) for t in ticks]
    drawn = {
        f"drawn {i}": np.array([t.drawn[i] for t in ticks])
        for i in range(len(recorder.assembly._blocks))
    }
    return {
        "before": np.array([words for words, _ in before]),
        "space": np.array([space for _, space in before]),
        "changed": np.array([words for words, _ in after]) ^ [words for words, _ in before],
        **drawn,
    }  # fmt: skip


def main() -> None:
    """Fly, compile and write the bundle."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("mission")
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    p.add_argument("--seconds", type=float, default=20.0, help="length of the recorded flight")
    p.add_argument("--samples", type=int, default=64, help="single ticks to compare")
    p.add_argument("--out", type=Path, required=True, help="a new folder")
    asked = p.parse_args()
    try:
        if asked.out.exists():
            raise InputError(f"--out {asked.out} exists already: give a new folder")
        if not (1.0 <= asked.seconds < math.inf and 1 <= asked.samples <= MOST):
            raise InputError(
                f"--seconds {asked.seconds:g}, --samples {asked.samples}; valid: 1 or more, and "
                f"1 to {MOST}"
            )
        asked.out.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=asked.out.parent) as folder:
            write_bundle(asked.mission, asked.set, asked.seconds, asked.samples, Path(folder))
            shutil.copytree(folder, asked.out)
    except SkywrightError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(error.exit_code) from None
    except OSError as error:
        print(f"error: {describe_os_error(error) or error}", file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
