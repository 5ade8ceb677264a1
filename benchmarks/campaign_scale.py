"""Cost of a campaign's run with 1, 2 and 100 workers, and its limit.

    python benchmarks/campaign_scale.py                # writes benchmarks/scale.json
    python docs/generate_scale.py                      # and the table of docs/howto/campaign.md

Numbers of workers alternate: 1, 2, 1, 2, ... Processor time gives the cost of a flight, of a
worker's start, and of the process that distributes the runs; it does not depend on other users of
the machine. 100 workers are not measured; their time is computed from these parts.

Campaigns of two sizes fly on two workers, forked ones and those of Ray (extra `cluster`). Their
difference is the cost of further runs: processor time of this process, and wall time. Ray's threads
in this process also use processor time while it waits. A line through the missions, over the wall
time per run, separates this share from the cost of handing out a run.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from skywright.analysis.campaign.campaign import run_campaign
from skywright.analysis.campaign.cluster import connect, disconnect
from skywright.analysis.campaign.forks import end_source
from skywright.analysis.campaign.spec import (
    build_campaign,
)
from skywright.evidence.bench.machine import describe_machine, read_commit

MISSIONS = {
    "waypoints": ["world.wind.kind=choice('steady')", "world.wind.mean_mps=uniform(0.1,2)"],
    "pipe-weld-scan": ["world.pipe.friction=uniform(0.1,0.3)"],
}
HERE = Path(__file__).parent
PLANNED = 100


def fly(mission: str, runs: int, workers: int, folder: Path) -> dict[str, float]:
    """Fly a campaign; return wall time and the processor time of parent and workers, in s."""
    campaign = build_campaign(mission, MISSIONS[mission], seed=1)
    began, ours = time.perf_counter(), time.process_time()
    theirs = resource.getrusage(resource.RUSAGE_CHILDREN)
    run_campaign(campaign, runs, out=folder, workers=workers)
    end_source()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "wall": time.perf_counter() - began, "parent": time.process_time() - ours,
        "workers": after.ru_utime + after.ru_stime - theirs.ru_utime - theirs.ru_stime,
    }  # fmt: skip


def measure_further(mission: str, runs: int, turns: int, ray: str | None) -> dict[str, float]:
    """Return processor time of this process and wall time (s) per further run on two workers."""
    campaign = build_campaign(mission, MISSIONS[mission], seed=1)
    parent, wall = [], []
    if ray is not None:
        connect(ray, 2)
    try:
        for turn in range(turns + 1):  # the first one starts and warms the workers of Ray
            spent = []
            for n in (runs, 2 * runs):
                began, ours = time.perf_counter(), time.process_time()
                with tempfile.TemporaryDirectory() as name:
                    run_campaign(
                        campaign, n, out=Path(name) / "more", ray=ray,
                        workers=2 if ray is None else None,
                    )  # fmt: skip
                spent.append((time.process_time() - ours, time.perf_counter() - began))
            if turn:
                parent.append((spent[1][0] - spent[0][0]) / runs)
                wall.append((spent[1][1] - spent[0][1]) / runs)
    finally:
        if ray is not None:
            disconnect()
    return {"parent": statistics.median(parent), "wall": statistics.median(wall)}


def measure(mission: str, runs: int, turns: int) -> dict[str, Any]:
    """Return the parts of a run's cost, each the median over the turns."""
    few: list[dict[str, float]] = []
    many: dict[int, list[dict[str, float]]] = {1: [], 2: []}
    for _ in range(turns):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            few.append(fly(mission, 1, 1, folder / "one"))
            for workers, found in many.items():
                found.append(fly(mission, runs, workers, folder / str(workers)))

    def middle(rows: list[dict[str, float]], key: str) -> float:
        return statistics.median(row[key] for row in rows)

    flight = (middle(many[1], "workers") - middle(few, "workers")) / (runs - 1)
    local = measure_further(mission, runs, turns, None)
    ray = measure_further(mission, runs, turns, "local")
    return {
        "mission": mission, "runs": runs, "turns": turns, "flight_cpu_s": round(flight, 4),
        "parent_cpu_s": round(local["parent"], 5),
        "once_cpu_s": round(max(middle(few, "parent") - local["parent"], 0.0), 3),
        "worker_start_cpu_s": round(max(middle(few, "workers") - flight, 0.0), 3),
        "run_cpu_s": {str(w): round(middle(r, "workers") / runs, 3) for w, r in many.items()},
        "run_wall_s": {str(w): round(middle(r, "wall") / runs, 3) for w, r in many.items()},
        "most_workers": round(flight / local["parent"]),
        "ray_parent_cpu_s": round(ray["parent"], 5), "ray_run_wall_s": round(ray["wall"], 3),
    }  # fmt: skip


def add_ray_cost(missions: list[dict[str, Any]]) -> None:
    """Add the processor time per run that Ray's handing out takes, without that of waiting."""
    wall = [m["ray_run_wall_s"] for m in missions]
    share, cost = statistics.linear_regression(wall, [m["ray_parent_cpu_s"] for m in missions])
    for m in missions:
        m["ray_hand_out_s"], m["ray_waiting_share"] = round(cost, 5), round(share, 4)
        m["most_workers_ray"] = round(m["flight_cpu_s"] / cost)


def main() -> None:
    """Measure and write the table."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--runs", type=int, default=8)
    p.add_argument("--turns", type=int, default=3)
    p.add_argument("--out", type=Path, default=HERE / "scale.json")
    asked = p.parse_args()
    if asked.runs < 2 or asked.turns < 1:
        p.error(f"--runs {asked.runs} --turns {asked.turns}; valid: 2 runs or more, 1 turn or more")
    if not asked.out.parent.is_dir():
        p.error(f"--out {asked.out}: the folder {asked.out.parent} does not exist")
    missions = [measure(m, asked.runs, asked.turns) for m in MISSIONS]
    add_ray_cost(missions)
    found = {
        "when": datetime.now(UTC).strftime("%Y-%m-%d"), **read_commit(),
        "processor": describe_machine()["processor"],
        "cores": os.cpu_count(), "load_1_min": round(os.getloadavg()[0], 1), "planned": PLANNED,
        "missions": missions,
    }  # fmt: skip
    asked.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found))


if __name__ == "__main__":
    main()
