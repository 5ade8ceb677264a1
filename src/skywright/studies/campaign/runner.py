"""One run of a campaign, from task to row, in whatever process it flies."""

from __future__ import annotations

import math
import traceback
from pathlib import Path
from typing import NamedTuple

from skywright.errors import InfeasibleError, InputError, SimulationError
from skywright.evaluation.rows import Row
from skywright.evaluation.run import RunResult, fly_and_evaluate, run_mission
from skywright.missions.loader import Description
from skywright.studies.campaign.spec import Draw

RECORD = ("none", "failed", "all")
"""Runs of which the directory with the recording is kept."""

TIMING_METRICS = ("plan.wall_s",)
"""Metrics that depend on the machine; a row keeps them apart, so that it is repeatable."""


class Task(NamedTuple):
    """Everything that a worker needs to fly one run."""

    draw: Draw
    description: Description
    command: str
    record: str
    folder: str
    """Where directories of recorded runs go."""
    refused: str = ""
    """Why the description could not be loaded; such a run does not fly."""


def fly_row(task: Task) -> Row:
    """Fly one run. Whatever goes wrong becomes a row with its reason; never raises."""
    if task.refused:
        return build_failed_row(task, "refused", task.refused)
    try:
        folder = Path(task.folder) / f"{task.draw.run:05d}"
        if task.record == "all":
            result = _record(task.description, folder)
        else:
            result = fly_and_evaluate(task.description)
            if task.record == "failed" and result.outcome != "succeeded":
                _record(task.description, folder)  # the same again: runs are repeatable
        return _build_row(task, result)
    except InfeasibleError as error:
        return build_failed_row(task, "infeasible", error.blocked_by)
    except InputError as error:
        return build_failed_row(task, "refused", str(error))
    except SimulationError as error:
        return build_failed_row(task, "diverged", str(error))
    except Exception as error:  # a run must not end the campaign
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno}"
        return build_failed_row(task, "crashed", f"{type(error).__name__}: {error} ({where})")


def build_failed_row(task: Task, outcome: str, reason: str) -> Row:
    """Build the row of a run that has no result."""
    d = task.draw
    return Row(
        d.run, d.seed, outcome, outcome, (), " ".join(reason.split()), d.varied, {}, {}, 1,
        task.command,
    )  # fmt: skip


def _record(description: Description, folder: Path) -> RunResult:
    """Fly with a run directory; what an interrupted campaign left half-written is replaced."""
    import shutil

    for old in (folder, folder.with_name(folder.name + ".partial")):
        shutil.rmtree(old, ignore_errors=True)
    return run_mission(description, out=folder)


def _build_row(task: Task, result: RunResult) -> Row:
    d = task.draw
    failed = tuple(v.name for v in result.requirements if not v.passed)
    requirement = ""
    if result.outcome == "failed":
        requirement = failed[0]
    elif result.outcome != "succeeded":
        requirement = result.outcome
    metrics = {
        k: float(v) if math.isfinite(v) else math.nan
        for k, v in result.metrics.items()
        if k not in TIMING_METRICS
    }
    return Row(
        d.run, d.seed, result.outcome, requirement, failed, " ".join(result.reason.split()),
        d.varied, metrics, dict(result.timing), 1, task.command,
    )  # fmt: skip
