"""Runs of a campaign on one worker and on two: gain of the second core."""

import time
from collections.abc import Iterator

from skywright.analysis.campaign.local import count_cores, fly_local
from skywright.analysis.campaign.runner import Task
from skywright.analysis.campaign.spec import Campaign, build_campaign, draw_run, load_run
from skywright.errors import SimulationError
from skywright.evidence.bench.flights import SCAN
from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.evidence.bench.timing import compute_ratios

SHORT = ("mission.task.passes=2", "mission.task.pass_length_m=0.1")


def measure(session: Session) -> list[Row]:
    """Fly the same runs on one and on two workers in turns, including their start."""
    if count_cores() < 2:
        return [build_unmeasured_row("speed_up", "this machine has one core that may be used")]
    campaign = build_campaign(SCAN, ["world.pipe.friction=uniform(0.1,0.3)"], sets=SHORT)
    runs = session.pick(2, 8, 40)
    counts = {"one": 1, "two": 2}
    times: dict[str, list[float]] = {name: [] for name in counts}
    for _ in range(session.pick(1, 1, 5)):
        for name, workers in counts.items():
            times[name].append(_fly(campaign, runs, workers))
    rows = [
        build_row(
            "speed_up", compute_ratios(times["one"], times["two"]),
            note=f"time on one worker over time on two, {runs} runs; 2 is perfect",
        )
    ]  # fmt: skip
    for name, workers in counts.items():
        rates = [60.0 * runs / t for t in times[name]]
        note = f"short scans on {workers} worker{'s' if workers > 1 else ''}"
        rows.append(build_row(f"{name}_runs_per_min", rates, "1/min", note=note))
    return rows


def _fly(campaign: Campaign, runs: int, workers: int) -> float:
    """Return the time (s) from the first task to the last row."""
    begin = time.perf_counter()
    found = list(fly_local(_iterate_tasks(campaign, runs), workers))
    wall = time.perf_counter() - begin
    lost = [row for row in found if not row.completed]
    if lost:
        raise SimulationError(f"a run was not flown: {lost[0].outcome}: {lost[0].reason}")
    return wall


def _iterate_tasks(campaign: Campaign, runs: int) -> Iterator[Task]:
    for run in range(runs):
        one = draw_run(campaign, run)
        yield Task(one, load_run(campaign, one), "", "none", "")
