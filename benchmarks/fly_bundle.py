"""Run a recorded flight on a GPU, in many worlds at once: the steps of Skywright and MuJoCo Warp.

    python benchmarks/fly_bundle.py BUNDLE --out benchmarks/cuda/waypoints.json

BUNDLE is a folder that `python -m skywright.evidence.cuda_bundle` wrote; this script needs cupy,
mujoco, warp-lang and mujoco-warp, and not Skywright. Three things are measured:

1. The control rows of single ticks, compared with those of the processor from the same state.
   Integers must be equal.
2. The flight in many worlds, in closed loop. World 0 has the noise of the recorded flight. World i
   reads the rows of each block of noise from row SHIFT * i on, cyclically: as many worlds differ as
   a block has rows. What Python code changed between two mission ticks is replayed.
3. The time of a control tick: of the flight; and of all rows, and of MuJoCo Warp, alone.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NoReturn

import cupy as cp
import numpy as np

OWN, SHARED = 1, 2
THREADS = 64  # of a block
SHIFT = 7
PACKAGES = ("cupy-cuda13x", "cupy-cuda12x", "mujoco", "warp-lang", "mujoco-warp")
MISSION_TICKS = 10  # between two compared positions
KERNELS = r"""
extern "C" {
typedef unsigned long long u64;
__global__ void change(char *base, u64 stride, u64 worlds, char *shared, const u64 *at,
                       const long long *value, const signed char *space, u64 n) {
    u64 i = blockIdx.x * (u64)blockDim.x + threadIdx.x;
    if (i >= worlds * n) return;
    u64 k = i % n;
    char *block = base + (i / n) * stride;
    long long x = value[k];
    if (space[k] == 1) x += (long long)block;
    if (space[k] == 2) x += (long long)shared;
    ((long long *)block)[at[k]] = x;
}
__global__ void advance(char *base, u64 stride, u64 worlds, u64 tick, u64 block, u64 t, u64 dt) {
    u64 i = blockIdx.x * (u64)blockDim.x + threadIdx.x;
    if (i >= worlds) return;
    char *me = base + i * stride;
    long long now = ++*(long long *)(me + tick);
    ++*(long long *)(me + block);
    *(double *)(me + t) = now * *(double *)(me + dt);
}
__global__ void count(char *base, u64 stride, u64 worlds, u64 at) {
    u64 i = blockIdx.x * (u64)blockDim.x + threadIdx.x;
    if (i < worlds) ++*(long long *)(base + i * stride + at);
}
__global__ void widen(char *base, u64 stride, u64 worlds, u64 at, const float *from, u64 n,
                      u64 pitch) {
    u64 i = blockIdx.x * (u64)blockDim.x + threadIdx.x;
    if (i >= worlds * n) return;
    u64 world = i / n, k = i % n;
    ((double *)(base + world * stride + at))[k] = from[world * pitch + k];
}
__global__ void narrow(char *base, u64 stride, u64 worlds, u64 at, float *to, u64 n,
                       u64 pitch) {
    u64 i = blockIdx.x * (u64)blockDim.x + threadIdx.x;
    if (i >= worlds * n) return;
    u64 world = i / n, k = i % n;
    to[world * pitch + k] = (float)((double *)(base + world * stride + at))[k];
}
}
"""
FROM_PHYSICS = {
    "qpos": "qpos", "qvel": "qvel", "sensordata": "sensordata", "site_xpos": "site_xpos",
    "site_xmat": "site_xmat", "body_xpos": "xpos", "body_xmat": "xmat", "act": "act",
    "actuator_force": "actuator_force",
}  # fmt: skip
"""Arrays of the steps (vehicle.bus.MuJoCo) and of mujoco_warp.Data."""
TO_PHYSICS = {"ctrl": "ctrl", "xfrc": "xfrc_applied"}


def find_version(name: str) -> str:
    """Return the version of a package, "" if it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def refuse(says: str) -> NoReturn:
    """End with exit code 2."""
    print(f"error: {says}", file=sys.stderr)
    raise SystemExit(2)


class Bundle:
    """The files of a bundle."""

    def __init__(self, folder: Path) -> None:
        """Exit with code 2 if files are missing, or were compiled for another GPU."""
        missing = [n for n in ("bundle.json", "flight.npz", "ticks.npz", "plant.mjb")
                   if not (folder / n).is_file()]  # fmt: skip
        if missing:
            refuse(f"{folder}: lacks {', '.join(missing)}; it is written by cuda_bundle")
        self.folder = folder
        self.meta: dict[str, Any] = json.loads((folder / "bundle.json").read_text())
        self.flight = dict(np.load(folder / "flight.npz"))
        self.ticks = dict(np.load(folder / "ticks.npz"))
        self.stride = -(-self.meta["block_bytes"] // 128) * 128
        self.n_words = self.meta["block_bytes"] // 8
        capability, built = cp.cuda.Device().compute_capability, self.meta["architecture"]
        here = int(capability[:-1]), int(capability[-1])
        if here[0] != built[0] or here[1] < built[1]:
            refuse(
                f"{folder}: was compiled for compute capability {built[0]}.{built[1]}, this GPU "
                f"has {here[0]}.{here[1]}: change ARCHITECTURE in cuda_steps.py, and pack it again"
            )

    def load_plant(self) -> Any:
        """Return the plant with the settings that MuJoCo Warp accepts."""
        import mujoco

        model = mujoco.MjModel.from_binary_path(str(self.folder / "plant.mjb"))
        off = mujoco.mjtDisableBit
        model.opt.disableflags &= ~int(off.mjDSBL_AUTORESET | off.mjDSBL_MIDPHASE)
        return model


class Worlds:
    """The blocks of all worlds in device memory, and the kernels that run on them."""

    def __init__(self, bundle: Bundle, n: int, shift: int) -> None:
        """World i reads random numbers `shift` rows after those of world i - 1."""
        meta, flight = bundle.meta, bundle.flight
        self.bundle, self.n, self.stride, self.clock = bundle, n, bundle.stride, meta["clock"]
        self.blocks = cp.zeros((n, bundle.stride // 8), cp.int64)
        self.base = int(self.blocks.data.ptr)
        self.shared = cp.asarray(flight["shared"])
        space = cp.asarray(flight["shared_space"])
        self.shared += cp.where(space == SHARED, int(self.shared.data.ptr), 0)
        module = cp.RawModule(code=KERNELS)
        names = ("change", "advance", "count", "widen", "narrow")
        self.kernels = {name: module.get_function(name) for name in names}
        n_draws = 1 + max((d for row in meta["rows"] for d in row["draws"]), default=-1)
        drawn = {d: flight[f"drawn {i}"] for i, d in enumerate(flight["drawn_block"])}
        self.drawn = [cp.asarray(drawn[d]) for d in range(n_draws)]
        self.rows = []
        for row in meta["rows"]:
            loaded = cp.RawModule(path=str(bundle.folder / row["file"])).get_function("run")
            draws = [int(self.drawn[d].data.ptr) for d in row["draws"]]
            self.rows.append((loaded, (self.base, self.stride, n, shift, *draws)))
        self.at, self.value = cp.asarray(flight["at"]), cp.asarray(flight["value"])
        self.space = cp.asarray(flight["space"])
        cp.cuda.Device().synchronize()  # the loop uses another stream

    def launch(self, name: str, count: int, *arguments: int) -> None:
        """Run one of KERNELS with a thread for each of `count` items."""
        given = (self.base, self.stride, self.n, *arguments)
        self.kernels[name]((-(-count // 256),), (256,), tuple(map(np.uint64, given)))

    def set(self, at: Any, value: Any, space: Any) -> None:
        """Set words of all blocks (encoded)."""
        m = len(at)
        shared = int(self.shared.data.ptr)
        pointers = (int(at.data.ptr), int(value.data.ptr), int(space.data.ptr))
        if m:
            self.launch("change", self.n * m, shared, *pointers, m)

    def start(self) -> None:
        """Set all blocks to the start of the flight."""
        f = self.bundle.flight
        self.set(cp.arange(len(f["start"])), cp.asarray(f["start"]), cp.asarray(f["start_space"]))

    def run_rows(self, fast: bool, due: bool) -> None:
        """Run the rows of a control tick, or those after a physics step; `due`: also those that
        do not run each tick."""
        grid = (-(-self.n // THREADS),)
        for row, (kernel, arguments) in zip(self.bundle.meta["rows"], self.rows, strict=True):
            if bool(row["fast"]) == fast and (due or row["every"] == 1):
                kernel(grid, (THREADS,), tuple(map(np.uint64, arguments)))

    def end_control(self) -> None:
        """Advance the clocks by a control tick."""
        c = self.clock
        self.launch("advance", self.n, c["tick"], c["block"], c["t"], c["dt"])


class Physics:
    """MuJoCo Warp's data of all worlds."""

    def __init__(self, bundle: Bundle, worlds: Worlds) -> None:
        """Place all worlds at the start of the flight."""
        import mujoco
        import mujoco_warp as mjw
        import warp as wp

        self.mjw, self.wp, self.worlds = mjw, wp, worlds
        model = bundle.load_plant()
        data = mujoco.MjData(model)
        start = bundle.flight["start"].view(np.float64)
        arrays = bundle.meta["arrays"]
        for name in ("qpos", "qvel", "act"):
            at, shape = arrays[name][0] // 8, arrays[name][1]
            getattr(data, name)[:] = start[at : at + shape[0]]
        mujoco.mj_forward(model, data)
        self.model, self.data = mjw.put_model(model), mjw.put_data(model, data, nworld=worlds.n)
        names = ("qpos", "qvel", "act", "ctrl", "xfrc_applied", "qacc_warmstart", "time")
        self._first = {name: wp.clone(getattr(self.data, name)) for name in names}

    def restart(self) -> None:
        """Return to the state of the start."""
        for name, array in self._first.items():
            self.wp.copy(getattr(self.data, name), array)

    def step(self) -> None:
        """Advance all worlds by a physics step."""
        self.mjw.step(self.model, self.data)

    def write(self) -> None:
        """Give MuJoCo Warp the steps' controls and forces."""
        self._copy("narrow", TO_PHYSICS)

    def read(self) -> None:
        """Give the steps MuJoCo Warp's arrays."""
        self._copy("widen", FROM_PHYSICS)

    def _copy(self, kernel: str, names: dict[str, str]) -> None:
        for ours, theirs in names.items():
            at, shape = self.worlds.bundle.meta["arrays"][ours]
            n = int(np.prod(shape))
            if n:
                array = getattr(self.data, theirs)
                pitch = array.strides[0] // 4
                self.worlds.launch(kernel, self.worlds.n * n, at, int(array.ptr), n, pitch)


def compare_ticks(bundle: Bundle) -> dict[str, Any]:
    """Run the control rows of the recorded single ticks and compare with the processor's."""
    ticks, meta = bundle.ticks, bundle.meta
    n = len(ticks["before"])
    worlds = Worlds(bundle, n, shift=1)
    block_at = meta["clock"]["block"] // 8
    before, space = ticks["before"].copy(), ticks["space"]
    before[:, block_at] = 0  # world i reads row i of the random numbers
    own = worlds.base + worlds.stride * np.arange(n, dtype=np.int64)[:, None]
    words = before + np.where(space == OWN, own, 0)
    words += np.where(space == SHARED, int(worlds.shared.data.ptr), 0)
    worlds.blocks[:, : bundle.n_words] = cp.asarray(words)
    for d, drawn in enumerate(worlds.drawn):
        drawn[:n] = cp.asarray(ticks[f"drawn {d}"])
    worlds.run_rows(fast=False, due=True)
    cp.cuda.Device().synchronize()
    found = cp.asnumpy(worlds.blocks[:, : bundle.n_words])
    after = ticks["before"] ^ ticks["changed"]
    after[:, block_at] = 0
    values = (space == 0) & ((before != after) | (before != found))
    same = values & (found == after)
    a, b = found.view(np.float64), after.view(np.float64)
    scale = np.max(np.where(values, np.abs(b), 0.0), axis=0, initial=0.0)  # of all ticks
    with np.errstate(all="ignore"):
        off = np.where(values & ~same, np.abs(a - b) / np.maximum(scale, 1e-300), 0.0)
    worst = [
        (float(np.max(off[:, at // 8 : (at + size) // 8], initial=0.0)), name)
        for name, (at, size) in {**meta["records"], **meta["others"]}.items()
    ]
    whole = np.zeros(values.shape[1], bool)
    whole[meta["integers"]] = True
    differ = off[values & ~same & ~whole]
    return {
        "ticks": n, "words": int(values.sum()), "same": int(same.sum()),
        "integers": int((values & whole).sum()),
        "wrong_integers": int((values & ~same & whole).sum()),
        "not_finite": int(np.sum(~np.isfinite(off))), "largest": float(np.max(off)),
        "median": float(np.median(differ)) if len(differ) else 0.0,
        "worst": sorted(worst, reverse=True)[:6],
    }  # fmt: skip


class Loop:
    """Graphs of a control tick of all worlds: "rows", "physics", or "both"."""

    def __init__(self, bundle: Bundle, n: int) -> None:
        """Compile the kernels for `n` worlds and capture the graphs."""
        import warp as wp

        self.wp, self.bundle = wp, bundle
        self.worlds = Worlds(bundle, n, SHIFT)
        self.stream = cp.cuda.ExternalStream(int(wp.get_stream().cuda_stream))
        self.every = max(row["every"] for row in bundle.meta["rows"])
        with self.stream:
            self.worlds.start()
            self.physics = Physics(bundle, self.worlds)
            self.graphs = {}
            for what in ("rows", "physics", "both"):
                for due in (True, False):
                    self._tick(what, due)  # compile
                    with wp.ScopedCapture() as capture:
                        self._tick(what, due)
                    self.graphs[what, due] = capture.graph
        wp.synchronize()

    def _tick(self, what: str, due: bool) -> None:
        w, p = self.worlds, self.physics
        if what != "physics":
            w.run_rows(fast=False, due=due)
            w.end_control()
        for _ in range(self.bundle.meta["n_steps"]):
            if what == "both":
                p.write()
            if what != "rows":
                p.step()
            if what == "both":
                p.read()
            if what != "physics":
                w.run_rows(fast=True, due=due)
                w.launch("count", w.n, w.clock["fast"])

    def restart(self) -> None:
        """Return to the start of the flight."""
        with self.stream:
            self.worlds.blocks[:] = 0
            self.worlds.start()
            self.physics.restart()

    def run(self, what: str, first: int, last: int) -> None:
        """Run the control ticks first to last - 1."""
        for i in range(first, last):
            self.wp.capture_launch(self.graphs[what, i % self.every == 0])

    def measure(self, what: str, ticks: int) -> float:
        """Return the seconds of a control tick of all worlds, from their present state."""
        self.run(what, 0, self.every)
        self.wp.synchronize()
        start = time.perf_counter()
        self.run(what, self.every, self.every + ticks)
        self.wp.synchronize()
        return (time.perf_counter() - start) / ticks


def fly(bundle: Bundle, loop: Loop, seconds: float) -> dict[str, Any]:
    """Fly all worlds along the recorded flight, up to `seconds` (s), and compare positions (m).

    `not_finite` and `guards_fired` are numbers of worlds, at any of the compared times.
    """
    f, meta, w = bundle.flight, bundle.meta, loop.worlds
    loop.restart()
    starts, ends = [0, *map(int, f["tick"])], [0, 0, *map(int, f["end"])]
    drawn = dict[int, list[tuple[int, Any]]]()
    for i, (t, d) in enumerate(zip(f["drawn_tick"], f["drawn_block"], strict=True)):
        drawn.setdefault(int(t), []).append((int(d), cp.asarray(f[f"drawn {i}"])))
    n = min(sum(t * meta["dt"] < seconds for t in starts), len(starts) - 1)
    cp.cuda.Device().synchronize()
    truth, fired_at = meta["truth"] // 8, meta["clock"]["fired"] // 8
    fired, taken, begin = cp.zeros(w.n, bool), list[Any](), time.perf_counter()
    with loop.stream:
        for k in range(n):  # the stretches between two changes
            for d, rows in drawn.get(starts[k], []):
                w.drawn[d][:] = rows
            a, b = ends[k], ends[k + 1]
            w.set(w.at[a:b], w.value[a:b], w.space[a:b])
            loop.run("both", starts[k], starts[k + 1])
            if (k + 1) % MISSION_TICKS == 0:
                taken.append(w.blocks[:, truth : truth + 3].copy())
                fired |= w.blocks[:, fired_at] != 0
    loop.wp.synchronize()
    spent = time.perf_counter() - begin
    p = np.array([cp.asnumpy(x).view(np.float64) for x in taken])  # (times, worlds, 3)
    off = np.linalg.norm(
        p - f["path"][MISSION_TICKS - 1 :: MISSION_TICKS][: len(p), None, 1:4], axis=2
    )
    return {
        "worlds": w.n, "seconds": starts[n] * meta["dt"], "wall_s": spent,
        "tick_s": spent / starts[n],
        "world_0_largest_m": float(np.max(off[:, 0])),
        "world_0_m": [round(float(x), 9) for x in off[:: max(len(off) // 40, 1), 0]],
        "all_largest_m": float(np.max(off)), "all_rms_m": float(np.sqrt(np.mean(off**2))),
        "not_finite": int(np.sum(~np.isfinite(off).all(axis=0))),
        "guards_fired": int(fired.sum()),
    }  # fmt: skip


def main() -> None:
    """Measure, print, and write."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("bundle", type=Path)
    p.add_argument("--worlds", type=int, nargs="*", default=[1, 1024, 16384, 65536])
    p.add_argument("--seconds", type=float, default=8.0, help="of the flight of each number")
    p.add_argument("--whole", type=int, default=1024, help="worlds of the whole flight, 0: none")
    p.add_argument("--out", type=Path)
    asked = p.parse_args()
    if not asked.seconds >= 1.0 or asked.whole < 0 or any(n < 1 for n in asked.worlds):
        refuse("--seconds must be 1 or more, --worlds positive, --whole 0 or positive")
    if asked.out is not None and not asked.out.parent.is_dir():
        refuse(f"--out {asked.out}: the folder {asked.out.parent} does not exist")
    if cp.cuda.runtime.getDeviceCount() == 0:
        refuse("there is no CUDA device")
    bundle = Bundle(asked.bundle)
    device = cp.cuda.runtime.getDeviceProperties(0)["name"].decode()
    out: dict[str, Any] = {
        "mission": bundle.meta["mission"], "device": device, "block_bytes": bundle.stride,
        "recorded": {k: bundle.meta[k] for k in
                     ("processor", "recorded_s", "dt", "n_steps", "sets", "versions", "commit")},
        "arguments": {k: str(v) for k, v in vars(asked).items()},
        "versions": {name: find_version(name) for name in PACKAGES},
        "driver": cp.cuda.runtime.driverGetVersion(),
    }  # fmt: skip

    def note(key: str, value: Any) -> None:
        out[key] = value
        print(key, json.dumps(value), flush=True)
        if asked.out is not None:
            asked.out.write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")

    note("agreement", compare_ticks(bundle))
    speed = []
    for n in asked.worlds:
        loop = Loop(bundle, n)
        flown = fly(bundle, loop, asked.seconds)
        rows, physics = (loop.measure(what, 100) for what in ("rows", "physics"))
        flown |= {"rows_s": rows, "physics_s": physics}
        speed.append({k: v for k, v in flown.items() if k != "world_0_m"})
        note("speed", speed)
        del loop
        cp.get_default_memory_pool().free_all_blocks()
    if asked.whole:
        note("flight", fly(bundle, Loop(bundle, asked.whole), math.inf))


if __name__ == "__main__":
    main()
