"""Effect of gap and paint on detection, without flights: `python benchmarks/crack_detection.py`.

A reduced model of `crack-scan`: one pass of its 16 coils over a crack of 6 mm with random depth,
direction and position under the array, on textured steel, at a gap that varies along the path.
Signals, set-up on the notch, contact test, finder and threshold are those of the mission; only the
flight is omitted. Writes inspection/detection.json: a50, a90 and a90/95 of each case and its false
calls.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
from pathlib import Path
from typing import Any

import numba
import numpy as np
from scipy.signal import lfilter

from skywright.analysis.pod.method import Method
from skywright.analysis.pod.pod import compute_pod
from skywright.analysis.pod.table import Inspections
from skywright.core.arrays import Array
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.inspection.indications import FlawFinder
from skywright.inspection.notch_setup import NotchSetup, set_up
from skywright.missions.crack_scan.judge import SITE, Flaw, match
from skywright.models.block_scan import simulate_block_scan
from skywright.models.crack_signal import CELL, GAPS, Metal, build_crack_table
from skywright.models.eddy_current import Coil, Instrument, build_probe_signal, ec_signal
from skywright.models.things.crack import Crack

KEPT = Path(__file__).resolve().parent / "inspection" / "detection.json"
STEP, LENGTH, WIDTH = 1e-4, 0.08, 0.06  # m: 10 mm/s at 100 Hz, of the path, and of the field
COILS = np.linspace(-0.02, 0.02, 16)
ALONG = 0.003  # m, correlation of the gap along the path
NOISE = 0.05  # units rms
DEPTHS = 0.1e-3, 2.0e-3  # m, uniform in the logarithm

CASES: dict[str, dict[str, float]] = {
    "in contact": {},
    "gap 0.1 mm rms": {"rms": 0.1e-3},
    "gap 0.3 mm rms": {"rms": 0.3e-3},
    "gap 0.3 mm rms, 0.5 mm in 99 %": {"mean": 0.28e-3, "std": 0.09e-3},
    "gap 0.5 mm rms": {"rms": 0.5e-3},
    "gap 1.0 mm rms": {"rms": 1.0e-3},
    "paint 0.5 mm, set up on bare metal": {"paint": 0.5e-3},
    "paint 0.5 mm, set up on a shim": {"paint": 0.5e-3, "shim": 0.5e-3},
    "paint 0.5 mm, shim, gap 0.3 mm rms": {"paint": 0.5e-3, "shim": 0.5e-3, "rms": 0.3e-3},
}


@numba.njit(cache=True)
def read_metal(probe: Any, s: Array, c: Array, gap: Array) -> Any:
    """Return the signal (n, k) of metal and texture under coils at (s, c) with `gap` (n,) m."""
    out = np.zeros(s.shape, np.complex128)
    for i in range(s.shape[0]):
        for k in range(s.shape[1]):
            re, im = ec_signal(probe, s[i, k], c[i, k], gap[i], 0.0, 0.0, 0.0)
            out[i, k] = re + 1j * im
    return out


def add_crack(z: Any, crack: Crack, metal: Metal, s: Array, c: Array, gap: Array) -> None:
    """Add the signal of a crack at (0, 0) to `z` (n, k), interpolated from its table."""
    table = build_crack_table(crack.length_m, crack.depth_m, metal, Coil(), Instrument()).signal
    turn = math.radians(crack.angle_deg)
    x = np.abs(s * math.cos(turn) - c * math.sin(turn)) / CELL
    y = np.abs(s * math.sin(turn) + c * math.cos(turn)) / CELL
    near = np.nonzero((x < table.shape[1] - 1) & (y < table.shape[2] - 1))
    i, j = x[near].astype(int), y[near].astype(int)
    fx, fy = x[near] - i, y[near] - j
    at = gap[near[0]]
    g = np.clip(np.searchsorted(GAPS, at, side="right") - 1, 0, len(GAPS) - 2)
    fg = np.clip((at - GAPS[g]) / (GAPS[g + 1] - GAPS[g]), 0.0, 1.0)
    for a, wa in ((0, 1 - fg), (1, fg)):
        for b, wb in ((0, 1 - fx), (1, fx)):
            for d, wd in ((0, 1 - fy), (1, fy)):
                z[near] += wa * wb * wd * table[g + a, i + b, j + d]


def draw_gap(rng: np.random.Generator, n: int, case: dict[str, float]) -> Array:
    """Return gaps (n,) m along a path: the absolute value of a first-order process."""
    decay = math.exp(-STEP / ALONG)
    noise = rng.standard_normal(n + 500) * math.sqrt(1 - decay**2)
    x = np.asarray(lfilter([1.0], [1.0, -decay], noise))[500:]
    return np.abs(case.get("mean", 0.0) + case.get("std", case.get("rms", 0.0)) * x)


def run_case(case: dict[str, float], cracks: int, seed: int) -> dict[str, Any]:
    """Inspect `cracks` sites with a crack and as many without; return the detection results."""
    d = load_description("crack-scan")
    pipe, procedure = d.world.pipe, d.mission.task.procedure
    assert pipe is not None
    metal = Metal(pipe.conductivity_s_per_m, pipe.relative_permeability)
    rng = np.random.default_rng(seed)
    display = set_up(simulate_block_scan(
        metal, Coil(), Instrument(), rng, notch_depth=procedure.notch_m, paint=case.get("shim", 0.0)
    ))  # fmt: skip
    sizes, hits, sites, calls = [], [], 0, 0
    for _ in range(cracks):
        probe = build_probe_signal(pipe, [], rng, Coil(), Instrument())
        low, high = np.log(DEPTHS)
        crack = Crack(
            depth_m=float(np.exp(rng.uniform(low, high))), angle_deg=float(rng.uniform(-90, 90))
        )
        for one in (crack, None):
            found = inspect(rng, display, probe, metal, one, case, procedure)
            if one is not None:
                sizes.append(1e3 * crack.depth_m)
                errors, _ = match(found, [Flaw("a", crack, 0.0, 0.0, (0.0, 0.0))])
                hits.append(errors[0] is not None)
            else:
                sites += int(LENGTH / SITE) * int(COILS.max() / SITE * 2)
                calls += match(found, [])[1]
    size = np.concatenate([sizes, np.zeros(sites)])
    hit = np.concatenate([np.array(hits, float), np.arange(sites) < calls])
    table = Inspections(size, "mm", hit, None, None, None, {})
    pod = compute_pod(table, Method("hit-miss")).to_json()
    pod = {k: pod[k] for k in ("link", "size_axis", "a50", "a90", "a90_95", "false_calls")}
    return {"case": case, "cracks": cracks, "sites": sites, "calls": calls, "pod": pod}


def inspect(
    rng: np.random.Generator, display: NotchSetup, probe: Any, metal: Metal, crack: Crack | None,
    case: dict[str, float], procedure: Any,
) -> list[Any]:  # fmt: skip
    """Slide the array over a site with a crack at a random position between its coils."""
    n = round(LENGTH / STEP)
    aside = float(rng.uniform(-0.5, 0.5) * (COILS[1] - COILS[0]))
    s = np.broadcast_to((np.arange(n) - n / 2)[:, None] * STEP, (n, len(COILS)))
    c = np.broadcast_to(COILS + aside, s.shape)
    lift = draw_gap(rng, n, case)
    gap = lift + case.get("paint", 0.0)
    z = read_metal(probe, np.ascontiguousarray(s), np.ascontiguousarray(c), gap)
    if crack is not None:
        add_crack(z, crack, metal, s, c, gap)
    z += NOISE * (rng.standard_normal(z.shape) + 1j * rng.standard_normal(z.shape))
    shown = display.show(z)
    shown[lift > procedure.gap_max_m] = np.nan
    finder = FlawFinder(threshold=procedure.threshold_percent, track_std=procedure.track_std_m)
    place = 0.3e-3 * rng.standard_normal((2, n, 1))  # error of the tracker
    finder.add(0.01 * np.arange(n), shown, s + place[0], c + place[1])
    return finder.find()


def main() -> None:
    """Run all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cracks", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    git = ["git", "-C", str(KEPT.parent), "rev-parse", "--short=10", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    out: dict[str, Any] = {"commit": commit, "cases": {}}
    for name, case in CASES.items():
        try:
            out["cases"][name] = run_case(case, a.cracks, a.seed)
        except InputError as error:  # no curve
            out["cases"][name] = {"case": case, "error": str(error)}
        told = out["cases"][name]
        curve = told.get("pod", {})
        print(name, told.get("error", ""), told.get("calls"), told.get("sites"),
              {k: curve.get(k) for k in ("a50", "a90", "a90_95")}, flush=True)  # fmt: skip
        KEPT.write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
