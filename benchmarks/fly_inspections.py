"""Fly the random sites of an inspection one after the other, and store their results.

    python benchmarks/fly_inspections.py MISSION [--runs N] [--minutes M]

MISSION is thickness-survey, crack-scan or one-coil.

Rows of MISSION-conditions.csv (inspection_conditions.py) are flown with the row's number as seed.
Each flight is a line of inspection/MISSION.jsonl with its commit ("+" if the source differs from
it) and its processor time. Existing rows are not repeated, so an interrupted campaign is continued;
delete the lines that a change of the code invalidates. `python docs/generate_inspection.py`
generates the table of docs/reference/inspection.md from them.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from inspection_conditions import MISSION

from skywright.description.loader import load_description
from skywright.errors import InfeasibleError, InputError, SimulationError
from skywright.missions.crack_scan.judge import NEAR, list_flaws
from skywright.missions.scan.coverage import SCAN
from skywright.missions.thickness_survey.gauge import build_gauge, find_probe
from skywright.missions.thickness_survey.metrics import HELD
from skywright.models.things.wall import build_wall_field, compute_wall
from skywright.models.ultrasonic import build_face, find_tilt_null
from skywright.run.flight import Flown
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup
from skywright.vehicle.sensors.ultrasonic import find_wall, rebuild_ascans

HERE = Path(__file__).resolve().parent
KEPT = HERE / "inspection"


def fly_row(mission: str, row: dict[str, str], number: int) -> dict[str, Any]:
    """Fly one site; return outcome, metrics, and the readings or the cracks."""
    try:
        result = fly_and_evaluate(load_description(mission, sets=row, seed=number))
    except (InfeasibleError, InputError, SimulationError) as error:
        return {"outcome": type(error).__name__, "reason": str(error)}
    out: dict[str, Any] = {
        "outcome": result.outcome, "reason": result.reason,
        "failed": [v.name for v in result.requirements if not v.passed],
        "metrics": {k: _round(v) for k, v in result.metrics.items()},
    }  # fmt: skip
    run = Flown(Setup(result.description), result.plan, result.samples, result.phases)
    more = list_scans(run) if mission == "thickness-survey" else list_cracks(run, result)
    return out | more


def list_scans(run: Any) -> dict[str, Any]:
    """Return every A-scan of the holds: the reading, the truth, and the reason of a refusal."""
    d, task = run.setup.description, run.task
    probe, world = find_probe(run.setup), d.true_world
    t, scans, states = rebuild_ascans(run.samples, probe.true, world, d.mission.seed)
    field = build_wall_field(find_wall(world, probe.name)[0])
    transducer = probe.true.build_transducer()
    face, null = build_face(transducer.radius), find_tilt_null(transducer)
    gauge, touches = build_gauge(task.procedure, run.way.gauge), []
    tries = 0
    for i in HELD.find(run.phases):
        phase = run.phases[i]
        mine = np.flatnonzero((t > phase.start_s) & (t < phase.end_s))
        gauge.restart()
        tries += 1
        read = []
        for k, r in zip(mine, gauge.add(t[mine], scans[mine]) if mine.size else [], strict=True):
            u, v = states[k, 4:].tolist()
            true = float(np.mean(compute_wall(field, u + face[:, 0], v + face[:, 1])[0]))
            # thickness (mm), error (mm), u95 (mm), reason
            read.append([_mm(r.thickness), _mm(r.thickness - true), _mm(r.u95), r.reason])
            if r.accepted:
                break
        good = bool(read) and not read[-1][3]
        first = states[mine[0]].tolist() if mine.size else [0.0] * 6
        touches.append({
            "accepted": good, "air": first[2] == 0.0, "beyond_null": first[3] >= null,
            "tilt_deg": _round(math.degrees(first[3])), "scans": read,
        })  # fmt: skip
        if good or tries == task.tries:
            tries = 0
            gauge.leave_site()
    return {"touches": touches, "spots": len(task.spots)}


def list_cracks(run: Any, result: Any) -> dict[str, Any]:
    """Return the cracks with the position error of their indication, and the inspection's
    result."""
    found = result.details
    out: dict[str, Any] = {
        "inspected": None if result.inspected is None else result.inspected.to_json(),
    }
    if found is None:
        return out
    gap = run.samples[SCAN.select(run.samples, run.phases)]["gap_max"]
    out["gap_rms_mm"] = _mm(float(np.sqrt(np.mean(np.square(gap)))))
    out["u95_mm"] = [_mm(x.u95) for x in found.indications]
    errors = []
    for flaw in list_flaws(run)[0]:
        near = [
            math.hypot(x.s - flaw.wanted[0], x.c - flaw.wanted[1])
            for x in found.indications
            if flaw.measure(np.array([x.s]), np.array([x.c]))[0] <= NEAR
        ]
        errors.append(_mm(min(near)) if near else None)
    return out | {"place_errors_mm": errors}


def read_commit() -> str:
    """Return the commit of the source, with "+" if files of src/ differ from it."""

    def ask(*words: str) -> str:
        git = ["git", "-C", str(HERE), *words]
        return subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()

    changed = ask("status", "--porcelain", "--untracked-files=no", "--", "../src")
    return ask("rev-parse", "--short=10", "HEAD") + ("+" if changed else "")


def _round(x: float) -> float | None:
    return float(f"{x:.5g}") if math.isfinite(x) else None


def _mm(x: float) -> float | None:
    return _round(1e3 * x)


def main() -> None:
    """Fly the missing sites."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mission", choices=("thickness-survey", "crack-scan", "one-coil"))
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin no flight later")
    parser.add_argument("--table", type=Path, help="instead of MISSION-conditions.csv")
    parser.add_argument("--out", type=Path, help="instead of inspection/MISSION.jsonl")
    a = parser.parse_args()
    path = a.out or KEPT / f"{a.mission}.jsonl"
    table = a.table or HERE / f"{a.mission}-conditions.csv"
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))[: a.runs]
    path.parent.mkdir(exist_ok=True)
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    there = [(x["seed"], x["site"]) for x in map(json.loads, lines)]
    commit, name = read_commit(), MISSION.get(a.mission, a.mission)
    end = time.monotonic() + 60.0 * a.minutes
    for number, row in enumerate(rows, 1):
        if (number, row) in there or time.monotonic() > end:
            continue
        began = time.process_time()
        told = {"seed": number, "commit": commit, "site": row, **fly_row(name, row, number)}
        told["cpu_s"] = round(time.process_time() - began, 1)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(told, ensure_ascii=False) + "\n")
        print(
            number, told["outcome"], told["reason"], ", ".join(told.get("failed", [])), flush=True
        )


if __name__ == "__main__":
    main()
