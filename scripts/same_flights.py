"""Fly built-in missions and compare their recordings bit for bit with another version's.

    python scripts/same_flights.py record DIR [--short | --all] [--seeds 1,2]
    python scripts/same_flights.py compare DIR [--short | --all] [--seeds 1,2]

`record` stores the samples and metrics of each flight in DIR; `compare` flies them again with the
imported checkout and lists every column and metric that differs. `--short` (default) flies the
first seconds of three missions (rigid arm, long reach, docked) in both modes; `--all` flies every
built-in mission in full. Use it at each step of a refactoring: a difference is explained in the
commit or is a defect. The exit code is 1 if anything differs.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

SHORT = {
    "scan": ("pipe-weld-scan", 14.0),
    "longreach": ("impact", 12.0),
    "docked": ("bridge-contact", 14.0),
}
"""Name -> mission and simulated time (s) at which the flight is cut."""
LONGREACH = {"longreach": "bimanual-longreach"}


class Cut(Exception):
    """The flight was long enough."""


class Stop:
    """An observer that ends a flight at `end` seconds of simulated time."""

    def __init__(self, end: float) -> None:
        self.end = end

    def on_plan(self, *_: object) -> None:
        pass

    def on_tick(self, t: float, *_: object) -> None:
        if t >= self.end:
            raise KeyboardInterrupt

    def close(self) -> None:
        pass


def list_cases(arguments: argparse.Namespace) -> list[tuple[str, str, float, int, str]]:
    """Return the requested cases as (case, mission, cut, seed, mode)."""
    seeds = [int(s) for s in arguments.seeds.split(",")]
    if arguments.only:
        names = arguments.only.split(",")
    elif arguments.all:
        from skywright.description.loader import list_missions

        names = [e.name for e in list_missions() if e.name != "follow-plan"]
    else:
        names = []
    if names:
        return [(f"{m}-{s}", m, np.inf, s, "fast") for m in names for s in seeds]
    return [
        (f"{name}-{mode}-{seed}", mission, cut, seed, mode)
        for name, (mission, cut) in SHORT.items()
        for seed in seeds[:1]
        for mode in ("fast", "interactive")
    ]


def fly(case: str, mission: str, cut: float, seed: int, mode: str) -> tuple[np.ndarray, dict]:
    from skywright import load

    sets = {"mission.seed": seed, "mission.mode": mode}
    robot = next((r for name, r in LONGREACH.items() if case.startswith(name)), None)
    description = load(mission, robot=robot, sets=sets) if robot else load(mission, sets=sets)
    run_mission = find_run_mission()
    with tempfile.TemporaryDirectory() as folder:
        result = run_mission(description, out=Path(folder) / "run", observers=[Stop(cut)])
    return result.samples, {"outcome": result.outcome, **result.metrics}


def find_run_mission():  # type: ignore[no-untyped-def]
    try:
        from skywright.run.run import run_mission
    except ImportError:
        from skywright.evaluation.run import run_mission  # type: ignore[import-not-found]
    return run_mission


def compare(name: str, folder: Path, samples: np.ndarray, metrics: dict) -> list[str]:
    path = folder / f"{name}.npz"
    if not path.exists():
        return [f"{name}: nothing recorded in {folder}"]
    stored = np.load(path)
    old = {k: stored[k] for k in stored.files if k != "_metrics"}
    old_metrics = json.loads(str(stored["_metrics"]))
    out = []
    n, m = len(old["t"]), len(samples)
    if n != m:
        out.append(f"{name}: {m} samples instead of {n}")
    k = min(n, m)
    for column, values in old.items():
        if not np.any(values) and column not in samples.dtype.names:
            continue  # a column that this robot never had
        if column not in samples.dtype.names:
            out.append(f"{name}: column {column} is gone")
            continue
        new, was = samples[column][:k], values[:k]
        if new.ndim == 2 and new.shape[1] != was.shape[1]:
            width = min(new.shape[1], was.shape[1])
            new, was = new[:, :width], was[:, :width]
        if new.tobytes() != np.ascontiguousarray(was).tobytes():
            bad = ~((new == was) | (np.isnan(new) & np.isnan(was)))
            rows = np.nonzero(bad.reshape(k, -1).any(axis=1))[0]
            if len(rows):
                first, size = rows[0], float(np.nanmax(np.abs(new - was)))
                out.append(
                    f"{name}: {column} differs in {len(rows)} of {k} samples, first at "
                    f"{samples['t'][first]:.2f} s, at most {size:.3g}"
                )
    for key, value in old_metrics.items():
        now = metrics.get(key)
        if now != value and not (value != value and now != now):
            out.append(f"{name}: metric {key} {value} -> {now}")
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("record", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--only", default="", help="missions, separated by commas")
    parser.add_argument("--seeds", default="1,2")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    differences: list[str] = []
    for case in list_cases(arguments):
        samples, metrics = fly(*case)
        name = case[0]
        if arguments.what == "record":
            columns: dict[str, Any] = {c: samples[c] for c in samples.dtype.names}
            file = arguments.folder / f"{name}.npz"
            np.savez_compressed(file, _metrics=json.dumps(metrics), **columns)
            print(f"{name}: {len(samples)} samples, {metrics['outcome']}", flush=True)
            continue
        found = compare(name, arguments.folder, samples, metrics)
        print("\n".join(found) if found else f"{name}: same ({len(samples)} samples)", flush=True)
        differences += found
    return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())
