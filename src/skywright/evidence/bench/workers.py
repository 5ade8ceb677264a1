"""Runs of a campaign on one and on two workers, and in two processes without a scheduler."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from functools import partial
from multiprocessing import Pipe
from typing import Any

from skywright.analysis.campaign.forks import start_fork
from skywright.analysis.campaign.local import count_cores, fly_local
from skywright.analysis.campaign.runner import Task
from skywright.analysis.campaign.spec import Campaign, build_campaign, draw_run, load_run
from skywright.errors import SimulationError
from skywright.evidence.bench import bare_runs
from skywright.evidence.bench.flights import SCAN
from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.evidence.bench.timing import compute_ratios, interleave

SHORT = ("mission.task.passes=2", "mission.task.pass_length_m=0.1")
SHARE_LIMIT = 0.95


def measure(session: Session) -> list[Row]:
    """Fly the same runs in each way in turns, including the start of the processes."""
    if count_cores() < 2:
        return [build_unmeasured_row("speed_up", "this machine has one core that may be used")]
    campaign = build_campaign(SCAN, ["world.pipe.friction=uniform(0.1,0.3)"], sets=SHORT)
    runs = session.pick(2, 8, 40)
    times = interleave(
        {
            "one": partial(_fly_with_workers, campaign, runs, 1),
            "two": partial(_fly_with_workers, campaign, runs, 2),
            "bare": partial(_fly_bare, campaign, runs),
        },
        session.pick(1, 5, 10),
    )
    rows = [
        build_row(
            "share_of_bare_processes", compute_ratios(times["bare"], times["two"]),
            limit=SHARE_LIMIT, sense=">=",
            note="rate of two workers over that of two processes which fly half of the same "
            f"{runs} runs each, without messages; idle machine",
        ),
        build_row(
            "speed_up", compute_ratios(times["one"], times["two"]),
            note=f"time on one worker over time on two, {runs} runs; two processes on one machine "
            "share its caches and clock",
        ),
    ]  # fmt: skip
    for name, what in (
        ("one", "on 1 worker"), ("two", "on 2 workers"), ("bare", "in 2 processes"),
    ):  # fmt: skip
        rates = [60.0 * runs / t for t in times[name]]
        rows.append(build_row(f"{name}_runs_per_min", rates, "1/min", note=f"short scans {what}"))
    return rows


def _fly_with_workers(campaign: Campaign, runs: int, workers: int) -> float:
    """Return the time (s) from the first task to the last row."""
    begin = time.perf_counter()
    found = list(fly_local(iterate_tasks(campaign, runs), workers))
    wall = time.perf_counter() - begin
    _check(found)
    return wall


def _fly_bare(campaign: Campaign, runs: int) -> float:
    """Return the time (s) until two processes have flown half of the runs each."""
    begin = time.perf_counter()
    tasks, started, found = list(iterate_tasks(campaign, runs)), [], list[Any]()
    for half in (tasks[::2], tasks[1::2]):
        ours, theirs = Pipe()
        started.append((start_fork(bare_runs.__name__, [theirs.fileno()], silent=True), ours))
        theirs.close()
        ours.send(half)
    try:
        for _, connection in started:
            found += connection.recv()
        wall = time.perf_counter() - begin
    except EOFError:
        raise SimulationError("a process of the benchmark ended without a result") from None
    finally:
        for process, connection in started:
            connection.close()
            process.kill()
            process.wait()
    _check(found)
    return wall


def _check(rows: Iterable[Any]) -> None:
    """Raise SimulationError if a run was not flown."""
    lost = [row for row in rows if not row.completed]
    if lost:
        raise SimulationError(f"a run was not flown: {lost[0].outcome}: {lost[0].reason}")


def iterate_tasks(campaign: Campaign, runs: int) -> Iterator[Task]:
    """Yield the tasks of the first runs of a campaign, which record nothing."""
    for run in range(runs):
        one = draw_run(campaign, run)
        yield Task(one, load_run(campaign, one), "", "none", "")
