"""Run benchmarks one after the other: check, measure, collect, write."""

import json
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from skywright.core.threads import on_one_thread
from skywright.errors import InputError, SkywrightError
from skywright.evidence.bench.machine import (
    BUSY,
    collect_all_versions,
    describe_machine,
    read_commit,
    read_load,
)
from skywright.evidence.bench.registry import BENCHMARKS, choose_benchmarks, load_benchmark
from skywright.evidence.bench.rows import Effort, Row, Session, build_unmeasured_row
from skywright.run.warm_up import is_compiled

RESULTS = Path("benchmarks") / "results"
"""Folder of complete measurements, below the current folder."""


class Watcher(Protocol):
    """Interface for the display of progress."""

    def begin(self, name: str, description: str) -> None:
        """A benchmark starts; the name is empty while code is compiled."""

    def end(self, name: str, rows: list[Row]) -> None:
        """A benchmark has ended or failed; a row of a failed one gives the reason."""


class Report(NamedTuple):
    """Results of one call, and their conditions."""

    when: str
    """UTC, ISO 8601."""
    effort: Effort
    machine: dict[str, Any]
    versions: dict[str, str]
    commit: dict[str, Any]
    load: dict[str, float | None]
    """Load average of the minute before, and of the last minute."""
    wall_s: float
    benchmarks: list[str]
    rows: list[Row]
    interrupted: bool
    failed: list[str]
    file: Path | None

    @property
    def exit_code(self) -> int:
        """0 if everything was measured, whether limits are met or not; else 1."""
        return 1 if self.interrupted or self.failed else 0

    @property
    def busy(self) -> bool:
        """Whether the machine was busy before the first benchmark."""
        load = self.load["before"]
        return load is not None and load > BUSY * (self.machine["cores"] or 1)

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright bench --json` and of a result file."""
        out = self._asdict()
        del out["file"]
        return {**out, "busy": self.busy, "rows": [row.to_json() for row in self.rows]}


class _Silent:
    def begin(self, name: str, description: str) -> None:
        pass

    def end(self, name: str, rows: list[Row]) -> None:
        pass


def run_benchmarks(
    names: Sequence[str] = (),
    *,
    effort: Effort = "default",
    out: Path | None = None,
    watcher: Watcher | None = None,
    workers: int = 1,
    resume: Path | None = None,
) -> Report:
    """Measure the named benchmarks, or the default ones.

    A measurement of all default benchmarks is written to `benchmarks/results`; one of named
    benchmarks or a quick one is written only if `out` (a folder) is given. An interrupted call
    returns the finished results. A benchmark that fails becomes a row with the reason, and the
    others continue.

    `workers` processes share what can be shared (the comparison of planners, in processor time).
    `resume` is a folder that keeps its finished parts, so that a second call continues. Raises
    InputError for an unknown name or a folder that cannot be written, before the start.
    """
    chosen = choose_benchmarks(names, effort == "full")
    folder = RESULTS if out is None and not names and effort != "quick" else out
    if folder is not None:
        check_folder(folder)
    if resume is not None:
        check_folder(resume, "--resume")
    watcher = watcher or _Silent()
    load_before, begin = read_load(), time.perf_counter()
    when = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    rows: list[Row] = []
    done: list[str] = []
    failed: list[str] = []
    interrupted = False
    with tempfile.TemporaryDirectory(prefix="skywright-bench-") as scratch:
        try:
            if not is_compiled():
                watcher.begin("", "compiling (first run on this machine, about 40 s)")
                _compile()
            for name in chosen:
                watcher.begin(name, BENCHMARKS[name].description)
                path = Path(scratch) / name
                path.mkdir()
                found, well = _measure(name, Session(effort, path, workers, resume))
                rows += found
                (done if well else failed).append(name)
                watcher.end(name, found)
        except KeyboardInterrupt:
            interrupted = True
    report = Report(
        when, effort, describe_machine(), collect_all_versions(), read_commit(),
        {"before": load_before, "after": read_load()}, round(time.perf_counter() - begin, 1),
        done, rows, interrupted, failed, None,
    )  # fmt: skip
    if not rows and interrupted:
        raise KeyboardInterrupt
    return report if folder is None else report._replace(file=write_report(report, folder))


@on_one_thread
def _measure(name: str, session: Session) -> tuple[list[Row], bool]:
    """Measure one benchmark; return its rows and whether it succeeded."""
    try:
        rows = load_benchmark(name)(session)
        good = True
    except SkywrightError as error:
        rows, good = [build_unmeasured_row("failed", str(error), failed=True)], False
    except Exception as error:  # one broken benchmark must not discard the others
        if os.environ.get("SKYWRIGHT_DEBUG"):
            raise
        why = " ".join(f"{type(error).__name__}: {error}".split())
        rows, good = [build_unmeasured_row("failed", why, failed=True)], False
    return [row._replace(name=f"{name}.{row.name}") for row in rows], good


def _compile() -> None:
    from skywright.evidence.bench.flights import fly_to_hover, load_scan

    fly_to_hover(load_scan())


def check_folder(folder: Path, option: str = "--out") -> None:
    """Raise InputError if a folder cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"{option} {folder}: results cannot be written there: {why}") from None


def write_report(report: Report, folder: Path) -> Path:
    """Write `DATE-TIME.json` atomically and return its path. Raises InputError."""
    stamp = report.when.replace(":", "").removesuffix("Z").replace("T", "-")
    path = folder / f"{stamp}.json"
    partial = path.with_suffix(".partial")
    try:
        partial.write_text(json.dumps(report.to_json(), indent=1) + "\n", encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path
