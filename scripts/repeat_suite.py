"""Run the test suite repeatedly: `python scripts/repeat_suite.py [--runs N] [--load K] [--check]`.

Repetition on an idle and on a loaded machine finds tests that fail occasionally. `--load K` keeps K
processes busy during each run; `--workers W` is passed to `make test`. `--check` runs `make check`
instead, the style and the quick tests. Appends one row per run to
benchmarks/suite-runs.csv. The exit code is 1 if a run failed.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import resource
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

from skywright.evidence.bench.machine import describe_machine, read_commit

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "benchmarks" / "suite-runs.csv"
COLUMNS = (
    "when_utc", "commit", "cores", "busy_processes", "passed", "failed", "wall_s", "processor_s",
    "failures", "workers", "processor", "target",
)  # fmt: skip


def run(load: int, workers: int, commit: str, target: str) -> list[object]:
    """Run the suite once beside `load` busy processes; return the row."""
    when = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(load)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    try:
        done = subprocess.run(
            ["make", target, f"WORKERS={workers}"], cwd=ROOT,
            env={**os.environ, "SKYWRIGHT_NO_SKIP": "1"},
            capture_output=True, text=True, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    names = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.M)
    passed = re.search(r"(\d+) passed", done.stdout)
    if done.returncode != 0:
        print(done.stdout[-20000:], done.stderr[-3000:], sep="\n", file=sys.stderr)
    if done.returncode != 0 and not names:
        names = [f"exit code {done.returncode}"]
    return [
        when, commit, os.cpu_count(), load, int(passed[1]) if passed else 0, len(names),
        round(wall), round(spent), " ".join(names), workers if target == "test" else 2,
        describe_machine()["processor"], target,
    ]  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--load", type=int, default=0)
    usual = re.search(r"^WORKERS := (\d+)", (ROOT / "Makefile").read_text("utf-8"), re.M)
    parser.add_argument("--workers", type=int, default=int(usual[1]) if usual else 1)
    parser.add_argument("--check", action="store_true", help="`make check` instead of `make test`")
    asked = parser.parse_args()
    failed, source = 0, read_commit()
    commit = f"{source['commit']}{'-changed' if source['changed'] else ''}"
    for _ in range(asked.runs):
        row = run(asked.load, asked.workers, commit, "check" if asked.check else "test")
        new = not TABLE.exists()
        with TABLE.open("a", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if new:
                writer.writerow(COLUMNS)
            writer.writerow(row)
        print(*row, flush=True)
        failed += bool(row[5])
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
