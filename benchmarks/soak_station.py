"""Soak test of the ground station: successive flights, two pages, a moving stick.

    python benchmarks/soak_station.py [--minutes 30] [--browser]

Every 20 s a row of benchmarks/soak-station.csv is recorded: memory of the station's and of the
flight's process, frames per second at the first page, median computing time of a tick, median age
of a stick, refused messages. The script fails if the station's memory grows: the median of the last
third above that of the second third by more than 3 % and 2 MB. A flight keeps its samples until its
evaluation, so its memory grows; the growth per minute is printed.

With --browser a page in headless Chromium watches as a third, and the table is
benchmarks/soak-browser.csv. It also contains the browser's memory (without memory that its
processes share) and its JavaScript heap after a collection, which must not grow either. `taken`
counts how often the first page took control again because this process was stopped.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
from station_client import Page, start_station

from skywright.run.operator import Stick

FOLDER = Path(__file__).resolve().parent
COLUMNS = (
    "t_s", "flights", "station_mb", "flight_mb", "frames_per_s", "cost_ms", "stick_ms",
    "refused",
)  # fmt: skip
BROWSER = ("flown_s", "taken", "browser_mb", "heap_mb", "drawn_per_s", "watched_per_s")
EVERY_S = 20.0
POINTS = "mission.task.points=[{ x_m = 0.6, y_m = 0.0, z_m = 1.2, hold_s = 60.0 }]"
SHARE, MEGABYTES = 0.03, 2.0


def read_memory(pid: int) -> float:
    """Return the resident memory of a process (MB); 0 if it has ended."""
    told = subprocess.run(["ps", "-o", "rss=", "-p", str(pid)], capture_output=True, text=True)
    return float(told.stdout.strip() or 0.0) / 1024.0


def find_child(pid: int) -> int:
    """Return the newest child of a process; 0 without one."""
    told = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True
    ).stdout.split()
    return int(told[-1]) if told else 0


class Chromium:
    """A page in a real browser that watches."""

    def __init__(self) -> None:
        from playwright.sync_api import sync_playwright

        self._playwright = sync_playwright().start()
        self._folder = tempfile.TemporaryDirectory()
        context = self._playwright.chromium.launch_persistent_context(
            self._folder.name, executable_path=shutil.which("chromium"),
            viewport={"width": 1280, "height": 720},
            args=["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
                  "--disable-gpu-compositing"],
        )  # fmt: skip
        self._context, self.page = context, context.new_page()
        self._tools = context.new_cdp_session(self.page)

    def open(self, address: str) -> None:
        """Enter the station and count the drawn frames."""
        self.page.goto(address)
        self.page.wait_for_selector("html[data-ready=yes]", state="attached")
        self.page.evaluate("""() => { window.drawn = 0;
            (function count() { window.drawn++; requestAnimationFrame(count); })(); }""")

    def measure(self) -> tuple[float, float, int, int]:
        """Return memory (MB) of the processes and of the heap, and the numbers of drawn and
        received frames."""
        self._tools.send("HeapProfiler.collectGarbage")
        heap = self._tools.send("Runtime.getHeapUsage")["usedSize"]
        drawn, frames = self.page.evaluate("[window.drawn, window.skywright.player.count]")
        return self._sum_memory(), heap / 2**20, drawn, frames

    def _sum_memory(self) -> float:
        """Return the memory (MB) of the browser's processes; shared memory counts once."""
        parents, ours = dict[int, int](), set[int]()
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                words = (process / "stat").read_text().rpartition(")")[2].split()
                parents[int(process.name)] = int(words[1])
                if self._folder.name.encode() in (process / "cmdline").read_bytes():
                    ours.add(int(process.name))
        while more := {pid for pid, parent in parents.items() if parent in ours} - ours:
            ours |= more
        found = 0.0
        for pid in ours:
            with contextlib.suppress(OSError):
                text = Path(f"/proc/{pid}/smaps_rollup").read_text()
                found += sum(map(float, re.findall(r"^Pss:\s+(\d+)", text, re.M))) / 1024.0
        return found

    def close(self) -> None:
        """Close the browser."""
        self._context.close()
        self._playwright.stop()
        self._folder.cleanup()


def soak(minutes: float, browser: bool) -> list[dict[str, float]]:
    """Fly for `minutes`; return the rows."""
    rows: list[dict[str, float]] = []
    chromium = Chromium() if browser else None
    with tempfile.TemporaryDirectory() as folder:
        process, address = start_station(Path(folder), "waypoints")
        try:
            first = Page(address)
            first.send("take")
            first.send("invite")
            first.wait(lambda: "invited" in first.words, 30.0)
            second = Page(first.words["invited"]["address"])
            shown = (0, 0)  # drawn and received frames of the browser
            if chromium is not None:
                del first.words["invited"]
                first.send("invite")
                first.wait(lambda: "invited" in first.words, 30.0)
                chromium.open(first.words["invited"]["address"])
            began = last = time.monotonic()
            flights = frames = taken = 0
            while time.monotonic() < began + 60.0 * minutes:
                if first.state.get("mine") is False:  # this process was stopped for 2 s
                    first.send("take")
                    taken += first.wait(lambda: first.state.get("mine") is True, 10.0)
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
                    "t_s": now - began, "flights": flights, "flown_s": status.get("t", 0.0),
                    "taken": taken,
                    "station_mb": read_memory(process.pid),
                    "flight_mb": read_memory(find_child(process.pid)),
                    "frames_per_s": (first.frames - frames) / (now - last),
                    "cost_ms": status.get("cost_ms") or np.nan,
                    "stick_ms": status.get("stick_ms") or np.nan,
                    "refused": first.state.get("refused", 0),
                }  # fmt: skip
                if chromium is not None:
                    memory, heap, *seen = chromium.measure()
                    rates = [(n - m) / (now - last) for n, m in zip(seen, shown, strict=True)]
                    row |= dict(zip(BROWSER[2:], (memory, heap, *rates), strict=True))
                    shown = (seen[0], seen[1])
                last, frames = now, first.frames
                rows.append(row)
                print(" ".join(f"{name}={value:.3g}" for name, value in row.items()), flush=True)
            first.close()
            second.close()
        finally:
            if chromium is not None:
                chromium.close()
            process.terminate()
            process.wait(60)
    return rows


def measure_growth(rows: list[dict[str, float]]) -> float:
    """Return the median growth (MB) of a flight's memory per minute of flight."""
    growth = [
        60.0 * (b["flight_mb"] - a["flight_mb"]) / (b["flown_s"] - a["flown_s"])
        for a, b in pairwise(rows)
        if a["flights"] == b["flights"] and b["flown_s"] > a["flown_s"] > 10.0  # s, in the air
    ]
    return statistics.median(growth) if growth else float("nan")


def judge(rows: list[dict[str, float]]) -> str:
    """Return what grew, or ""."""
    third = len(rows) // 3
    if not third:
        return "too few rows to judge: soak for at least 2 minutes"
    for name in ("station_mb", *(name for name in ("browser_mb", "heap_mb") if name in rows[0])):
        before, after = (
            statistics.median(row[name] for row in part)
            for part in (rows[third : 2 * third], rows[2 * third :])
        )
        if after - before > max(SHARE * before, MEGABYTES):
            return f"{name} grew from {before:.1f} to {after:.1f}"
    return ""


def main() -> None:
    """Run the soak test and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--browser", action="store_true", help="a page in Chromium watches, too")
    args = parser.parse_args()
    rows = soak(args.minutes, args.browser)
    kept, columns = ("soak-browser.csv", (*COLUMNS, *BROWSER)) if args.browser else (
        "soak-station.csv", COLUMNS
    )  # fmt: skip
    with (FOLDER / kept).open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: f"{row[name]:.4g}" for name in columns} for row in rows)
    print(f"the memory of a flight grew by {measure_growth(rows):.1f} MB in a minute")
    grew = judge(rows)
    print(grew or "nothing grew")
    sys.exit(1 if grew else 0)


if __name__ == "__main__":
    main()
