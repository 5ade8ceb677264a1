"""The ground station for a long time: flights one after another, two pages, a stick that moves.

    python benchmarks/soak_station.py [--minutes 30]

One row every 20 s is kept in benchmarks/soak-station.csv: memory of the station's and the flight's
process, frames a second at the first page, median cost of a tick, median age of a stick, messages
refused. It fails where the station's memory grows: the median of the last third above that of the
second third by more than 3 % and 2 MB. A flight keeps its samples until it is judged, so its memory
grows until it ends.
"""

from __future__ import annotations

import argparse
import csv
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from station_client import Page, start_station

from skywright.run.operator import Stick

KEPT = Path(__file__).resolve().parent / "soak-station.csv"
COLUMNS = (
    "t_s", "flights", "station_mb", "flight_mb", "frames_per_s", "cost_ms", "stick_ms",
    "refused",
)  # fmt: skip
EVERY_S = 20.0
POINTS = "mission.task.points=[{ x_m = 0.6, y_m = 0.0, z_m = 1.2, hold_s = 60.0 }]"
SHARE, MEGABYTES = 0.03, 2.0


def read_memory(pid: int) -> float:
    """Return the resident memory of a process (MB), 0 where it is gone."""
    told = subprocess.run(["ps", "-o", "rss=", "-p", str(pid)], capture_output=True, text=True)
    return float(told.stdout.strip() or 0.0) / 1024.0


def find_child(pid: int) -> int:
    """Return the newest child of a process, 0 without one."""
    told = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True
    ).stdout.split()
    return int(told[-1]) if told else 0


def soak(minutes: float) -> list[dict[str, float]]:
    """Fly for a time; returns the rows."""
    rows: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        process, address = start_station(Path(folder), "waypoints")
        try:
            first = Page(address)
            first.send("take")
            first.send("invite")
            first.wait(lambda: "invited" in first.words, 30.0)
            second = Page(first.words["invited"]["address"])
            began = last = time.monotonic()
            flights = frames = 0
            while time.monotonic() < began + 60.0 * minutes:
                if first.state.get("flying") is False:
                    first.send("start", mission="waypoints", seed=flights + 1, sets=[POINTS])
                    flights += 1
                    first.wait(lambda: first.state.get("flying") is True, 60.0)
                turn = float(np.sin(time.monotonic()))
                first.push_stick(Stick(np.array([turn, 0.0, 0.0]), False))
                first.poll(0.05)
                second.poll(0.01)
                now = time.monotonic()
                if now - last < EVERY_S:
                    continue
                status = first.status
                row = {
                    "t_s": now - began, "flights": flights,
                    "station_mb": read_memory(process.pid),
                    "flight_mb": read_memory(find_child(process.pid)),
                    "frames_per_s": (first.frames - frames) / (now - last),
                    "cost_ms": status.get("cost_ms") or np.nan,
                    "stick_ms": status.get("stick_ms") or np.nan,
                    "refused": first.state.get("refused", 0),
                }  # fmt: skip
                last, frames = now, first.frames
                rows.append(row)
                print(" ".join(f"{name}={row[name]:.3g}" for name in COLUMNS), flush=True)
            first.close()
            second.close()
        finally:
            process.terminate()
            process.wait(60)
    return rows


def judge(rows: list[dict[str, float]]) -> str:
    """Return what grew, "" where nothing did."""
    third = len(rows) // 3
    if not third:
        return "too few rows to judge: soak for at least 2 minutes"
    before, after = (
        statistics.median(row["station_mb"] for row in part)
        for part in (rows[third : 2 * third], rows[2 * third :])
    )
    if after - before > max(SHARE * before, MEGABYTES):
        return f"the station's memory grew from {before:.1f} to {after:.1f} MB"
    return ""


def main() -> None:
    """Do what is asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    rows = soak(parser.parse_args().minutes)
    with KEPT.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: f"{row[name]:.4g}" for name in COLUMNS} for row in rows)
    grew = judge(rows)
    print(grew or "nothing grew")
    sys.exit(1 if grew else 0)


if __name__ == "__main__":
    main()
