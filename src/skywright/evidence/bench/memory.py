"""Memory of a long flight and of many runs, each in a separate process.

    python -m skywright.evidence.bench.memory flight MINUTES [keep]
    python -m skywright.evidence.bench.memory runs COUNT

print the resident memory (MB) after each simulated minute, or after each run.
"""

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.evidence.bench.commands import PYTHON, time_command
from skywright.evidence.bench.flights import count_ticks, fly_into_contact, load_scan, run_ticks
from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.evidence.bench.timing import read_rss
from skywright.recordings.writer import RecordingWriter
from skywright.run.run import fly_and_evaluate

FLIGHT_LIMIT = 20.0
"""MB, project limit for the flight loop and the recording, independent of the duration."""
RUN_LIMIT = 1.0
"""MB per run, project limit for a worker that flies many runs of a campaign."""

SHORT = ("mission.task.passes=2", "mission.task.pass_length_m=0.05")


def measure(session: Session) -> list[Row]:
    """Fly long twice, without and with the samples that a run keeps, and many runs."""
    if not Path("/proc/self/status").exists():
        return [
            build_unmeasured_row("flight_growth_mb", "resident memory is read from Linux's /proc")
        ]
    minutes = session.pick(2, 10, 30)
    loop = _call("flight", str(minutes))
    rows = [
        build_row(
            "flight_growth_mb", loop[-1] - loop[1], "MB", limit=FLIGHT_LIMIT,
            note=f"from minute 1 to {minutes} of a contact flight that is recorded",
        ),
        build_row("flight_mb", loop[-1], "MB", note=f"resident after {minutes} min"),
    ]  # fmt: skip
    if session.effort == "quick":
        return rows
    few = session.pick(2, 4, 10)
    kept = _call("flight", str(few), "keep")
    runs = _call("runs", str(session.pick(2, 8, 40)))
    half = len(runs) // 2  # caches and arenas are filled by then
    return [
        *rows,
        build_row(
            "samples_mb_per_min", (kept[-1] - kept[1]) / (few - 1), "MB/min",
            note="what a run keeps to be evaluated: every column, 100 a second",
        ),
        build_row(
            "run_growth_mb", (runs[-1] - runs[half]) / (len(runs) - 1 - half), "MB",
            limit=RUN_LIMIT, note=f"a run, over the last {len(runs) - 1 - half} in one process",
        ),
    ]  # fmt: skip


def _call(*words: str) -> list[float]:
    done = time_command([*PYTHON, "-m", __name__, *words])
    found: list[float] = json.loads(done.output)
    return found


def fly_long(minutes: int, keep: bool, folder: Path) -> list[float]:
    """Fly in contact with a recording; return the memory (MB) before and after each minute."""
    description = load_scan()
    vehicle = fly_into_contact(description)
    kept: list[NDArray[Any]] = []
    with RecordingWriter(folder / "long.mcap", *vehicle.recorded) as writer:

        def deliver(samples: NDArray[Any]) -> None:
            writer.append(samples)
            if keep:
                kept.append(samples)

        vehicle.on_samples, vehicle.on_stream = deliver, writer.append_stream
        found = [read_rss()]
        for _ in range(minutes):
            run_ticks(vehicle, count_ticks(60.0))
            found.append(read_rss())
    if keep:
        np.concatenate(kept)  # as at the end of a run: both copies exist for a moment
    return found


def fly_many(count: int) -> list[float]:
    """Fly short runs one after the other, like a worker of a campaign."""
    found = []
    for i in range(count):
        fly_and_evaluate(load_scan(*SHORT, f"mission.seed={i}"))
        found.append(read_rss())
    return found


def main(words: list[str]) -> None:
    """Print one JSON list."""
    if words[0] == "runs":
        found = fly_many(int(words[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            found = fly_long(int(words[1]), "keep" in words, Path(folder))
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1:])
