"""Run a campaign: check the input, open the folder, fly the missing runs, evaluate, write."""

import time
from collections.abc import Generator, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from skywright.analysis.campaign.local import choose_workers, fly_local
from skywright.analysis.campaign.progress import CampaignProgress
from skywright.analysis.campaign.results import (
    CSV,
    PARQUET,
    check_parquet,
    write_csv,
    write_parquet,
)
from skywright.analysis.campaign.runner import INTERRUPTED, RECORD, Task
from skywright.analysis.campaign.spec import (
    DRAWING,
    Campaign,
    build_identity,
    check_unchanged,
    check_variations,
    draw_run,
    load_run,
    write_command,
)
from skywright.analysis.campaign.store import Store, compare_identity
from skywright.core.user_files import tried_first
from skywright.errors import InputError
from skywright.models.capability import check_can_fly
from skywright.run.kind import load_kind
from skywright.run.names import list_measures
from skywright.run.requirements import check_requirements
from skywright.run.rows import Row
from skywright.run.setup import Setup
from skywright.run.source_hash import collect_code_versions
from skywright.run.verdict import GO, Verdict, build_verdict
from skywright.run.warm_up import is_compiled

PAGE = "campaign.html"

MOST = 1_000_000
"""Maximum number of runs of a campaign."""

TARGET = 0.9
"""Default success rate that the campaign has to demonstrate."""


class CampaignResult(NamedTuple):
    """Rows of a campaign in the order of their runs, and the verdict."""

    rows: list[Row]
    verdict: Verdict
    folder: Path
    wall_s: float
    """Duration (s) of this call, without runs of earlier calls."""
    interrupted: bool

    @property
    def exit_code(self) -> int:
        """0 if every run met every requirement or the target is demonstrated, else 1."""
        v = self.verdict
        good = v.answer == GO or v.succeeded == v.runs
        return 0 if good and not self.interrupted else 1

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright campaign --json`."""
        v = self.verdict
        return {
            "answer": v.answer,
            "runs": v.runs,
            "succeeded": v.succeeded,
            "success_rate": v.rate,
            "interval": list(v.interval),
            "failures": [
                {
                    "run": row.run,
                    "seed": row.seed,
                    "requirement": row.requirement,
                    "varied": row.varied,
                }
                for row in self.rows
                if not row.succeeded
            ],
            "wall_s": self.wall_s,
        }


@tried_first()
def run_campaign(
    campaign: Campaign,
    runs: int,
    *,
    out: Path | None = None,
    workers: int | None = None,
    ray: str | None = None,
    record: str = "none",
    target: float = TARGET,
    parquet: bool = False,
    progress: bool = False,
) -> CampaignResult:
    """Fly the missing runs, write the table and the page, and return all rows.

    `workers` processes fly on this machine (default: all cores); `ray` is "local" or the address of
    a Ray cluster. `record` ("none", "failed", "all") selects the runs whose directories are kept
    under `runs/`. The table is results.csv, with `parquet` (an extra) also results.parquet.

    If `out` holds the same campaign, unfinished or with fewer runs, the call continues it. If `out`
    holds more runs than `runs`, all of them are evaluated. Raises InputError for wrong input before
    a run flies, and if the folder can no longer be written; finished runs are then in the folder.
    """
    start = time.perf_counter()
    _check(campaign, runs, record, target)
    if parquet:
        check_parquet()
    count = choose_workers(workers, runs) if ray is None else _check_ray_workers(ray, workers)
    check_variations(campaign, runs)
    identity = build_identity(campaign)
    folder = choose_folder(campaign, identity) if out is None else out
    store = Store(folder, identity)
    interrupted = False
    try:
        missing = [i for i in range(runs) if i not in store.rows]
        done = [store.rows[i] for i in range(runs) if i in store.rows]
        bad = sum(not row.succeeded for row in done)
        bar = CampaignProgress(runs, len(done), bad, quiet=not progress)
        try:
            beyond = len(store.rows) - len(done)
            if beyond:
                bar.say(
                    f"{folder} contains {beyond} runs more than --runs {runs}; all are evaluated"
                )
            if missing and not is_compiled():
                bar.say("compiling (first run on this machine, about 40 s) ...")
            tasks = _iterate_tasks(campaign, missing, record, folder, identity)
            with closing(_fly(tasks, count, ray)) as rows:
                for row in rows:
                    if row.outcome == INTERRUPTED:
                        raise InputError(
                            f"run {row.run} could not be recorded: {row.reason}; {len(store.rows)} "
                            "finished runs are kept, the same command continues"
                        )
                    store.append(row)
                    bar.on_row(row)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            bar.close()
        found = [row for _, row in sorted(store.rows.items())]
        if not found:
            raise KeyboardInterrupt
        flown = len(found) - beyond - len(done)
        wall = time.perf_counter() - start
        if parquet:
            store.write(PARQUET, lambda path: write_parquet(found, path, identity))
        return _conclude(campaign, store, found, runs, flown, target, wall, interrupted)
    finally:
        store.close()


def choose_folder(campaign: Campaign, identity: dict[str, Any]) -> Path:
    """Return `campaigns/<mission>`, with the first number that is free or holds this campaign."""
    base = Path("campaigns") / campaign.base.mission.name
    folder, i = base, 1
    while folder.exists() and compare_identity(folder, identity) is not None:
        i += 1
        folder = base.with_name(f"{base.name}-{i}")
    return folder


def _check(campaign: Campaign, runs: int, record: str, target: float) -> None:
    if not 1 <= runs <= MOST:
        raise InputError(f"--runs {runs}: at least 1 is needed (and at most {MOST})")
    if record not in RECORD:
        raise InputError(f"--record {record!r}: valid: {', '.join(RECORD)}")
    if not 0.0 < target < 1.0:
        raise InputError(f"--target {target:g}: a rate between 0 and 1 is needed, e.g. 0.9")
    if not campaign.base.mission.requirements:
        raise InputError(
            f"{campaign.mission}: the mission has no [mission.requirements]; a campaign counts "
            "the runs that meet them"
        )
    check_requirements(campaign.base.mission)
    if not any(v.key.startswith(("robot.", "mission.robot")) for v in campaign.variations):
        check_can_fly(campaign.base.robot, campaign.base.world.gravity_mps2)


def _check_ray_workers(ray: str, workers: int | None) -> int | None:
    from skywright.analysis.campaign.cluster import check_workers

    return check_workers(ray, workers)


def _iterate_tasks(
    campaign: Campaign, missing: list[int], record: str, folder: Path, identity: dict[str, Any]
) -> Iterator[Task]:
    """Build the tasks one by one, when a worker requests the next.

    Raises InputError if a file of the campaign has changed since its start.
    """
    for run in missing:
        check_unchanged(campaign, identity)
        one = draw_run(campaign, run)
        command = write_command(campaign, one)
        runs_folder = str((folder / "runs").resolve())
        try:
            description, refused = load_run(campaign, one), ""
        except InputError as error:  # each value is valid, but not their combination
            description, refused = campaign.base, str(error)
        yield Task(one, description, command, record, runs_folder, refused)


def _fly(tasks: Iterator[Task], workers: int | None, ray: str | None) -> Generator[Row, None, None]:
    """Fly the tasks on this machine or on a cluster."""
    if ray is None:
        assert workers is not None
        yield from fly_local(tasks, workers, warm_first=not is_compiled())
        return
    from skywright.analysis.campaign import cluster

    following = next(tasks, None)
    if following is None:
        return
    ours = cluster.connect(ray, workers)
    try:
        yield from cluster.fly_cluster(_chain(following, tasks))
    finally:
        if ours:
            cluster.disconnect()


def _chain(first: Task, rest: Iterator[Task]) -> Iterator[Task]:
    yield first
    yield from rest


def _conclude(
    campaign: Campaign,
    store: Store,
    rows: list[Row],
    runs: int,
    flown: int,
    target: float,
    wall: float,
    interrupted: bool,
) -> CampaignResult:
    """Evaluate the rows; write the table and the page."""
    from skywright.analysis.campaign.report import Facts, write_campaign_page

    base = campaign.base
    keys = [v.key for v in campaign.variations]
    kind = base.mission.kind
    requirements = load_kind(kind).requirements(Setup(base), None)
    verdict = build_verdict(rows, keys, requirements, target, list_measures(kind))
    facts = Facts(
        base.mission.name, base.mission.description, base.robot.name, base.world.name,
        campaign.seed, runs, {v.key: v.text for v in campaign.variations}, campaign.sets, flown,
        wall, collect_code_versions(*DRAWING),
    )  # fmt: skip
    store.write(CSV, lambda path: write_csv(rows, path))
    store.write(PAGE, lambda path: write_campaign_page(path, rows, verdict, facts))
    return CampaignResult(rows, verdict, store.folder, wall, interrupted)
