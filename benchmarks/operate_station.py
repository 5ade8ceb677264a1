"""Operator models do a mission's manual work through the ground station's own web socket.

    python benchmarks/operate_station.py [MISSION] [--runs 20] [--delay-ms 150] [--operator careful]

Each run starts a station, enters with its one-time address, takes control, starts the flight and
moves the stick according to the page's messages. View and stick of the operator are delayed. Each
run is a row of benchmarks/operated-MISSION.csv: outcome, frames per second, median age of the
sticks when they reach the flight, median computing time of a tick, and duration of the work. Runs
are in real time and take minutes each.

Rows of `tool-install` whose `by_hand` is "installation" were flown with an automatic retrieval,
which no longer exists; no command reproduces them.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
from pathlib import Path

import numpy as np
from station_client import Page, Pilot, start_station

from skywright.ground.operator_model import ModelOperator

KEPT = Path(__file__).resolve().parent
COLUMNS = (
    "run", "operator", "delay_ms", "by_hand", "outcome", "frames_per_s", "stick_ms", "cost_ms",
    "time_s", "reason",
)  # fmt: skip
SETS = {
    "tool-install": ["mission.task.hover_s=0", "mission.task.wait_s=1"],
    "sensor-install": [
        "mission.task.hover_s=0", "mission.task.swing_deg=0", "mission.task.survey=false",
    ],
}  # fmt: skip


def operate(mission: str, run: int, operator: str, delay_ms: float) -> list[str]:
    """Fly once; return the row."""
    with tempfile.TemporaryDirectory() as folder:
        process, address = start_station(Path(folder), mission)
        try:
            page = Page(address)
            page.send("take")
            page.send("start", mission=mission, seed=run, sets=SETS.get(mission, []), operated=True)
            page.wait(lambda: page.status.get("over") is False, 300.0)
            page.send("speed", x=0)  # fast until the operator's work starts
            if not page.wait(lambda: bool(page.status.get("asked")), 600.0):
                raise RuntimeError(f"the mission did not ask: {page.state.get('note')}")
            page.send("speed", x=1)
            pilot = Pilot(page, ModelOperator(operator, run, 0.03), 1e-3 * delay_ms)
            costs, ages, took, frames = [], [], 0.0, 0
            while page.state.get("flying") and took < 240.0:
                began, before = time.monotonic(), page.frames
                page.poll(0.02)
                if not page.status.get("asked"):  # the robot works automatically
                    continue
                pilot.step()
                costs.append(page.status.get("cost_ms") or np.nan)
                ages.append(page.status.get("stick_ms") or np.nan)
                took, frames = took + time.monotonic() - began, frames + page.frames - before
            page.send("speed", x=0)
            page.wait(lambda: page.state.get("flying") is False, 600.0)
            entry = page.words["logbook"]["entries"][-1]
            page.close()
        finally:
            process.terminate()
            process.wait(60)
    numbers = [frames / took, np.nanmedian(ages), np.nanmedian(costs), took]
    told = [f"{x:.3g}" for x in numbers]
    return [str(run), operator, f"{delay_ms:g}", "all", entry["outcome"], *told, entry["reason"]]


def main() -> None:
    """Fly the requested runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mission", nargs="?", default="tool-install")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--delay-ms", type=float, default=150.0)
    parser.add_argument("--operator", default="careful")
    args = parser.parse_args()
    path = KEPT / f"operated-{args.mission}.csv"
    done = set()
    if path.is_file():
        with path.open(newline="", encoding="utf-8") as file:
            done = {
                (r["run"], r["operator"], r["delay_ms"])
                for r in csv.DictReader(file)
                if r["by_hand"] == "all"
            }
    else:
        path.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    for run in range(1, args.runs + 1):
        if (str(run), args.operator, f"{args.delay_ms:g}") in done:
            continue
        row = operate(args.mission, run, args.operator, args.delay_ms)
        with path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerow(row)
        print(*row, flush=True)


if __name__ == "__main__":
    main()
