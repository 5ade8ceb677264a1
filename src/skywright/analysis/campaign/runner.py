"""Fly one run of a campaign in any process and return its row."""

import math
import traceback
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from skywright.analysis.campaign.spec import Draw
from skywright.description.loader import Description
from skywright.errors import InfeasibleError, InputError, SimulationError
from skywright.run.result import RunResult
from skywright.run.rows import Row
from skywright.run.run import fly_and_evaluate, run_mission

RECORD = ("none", "failed", "all")
"""Valid values of `record`: the runs whose directory is kept."""

INTERRUPTED = "interrupted"
"""Outcome of a run that was stopped from outside; it is repeated and never becomes a row."""

TIMING_METRICS = ("plan.wall_s",)
"""Metrics that depend on the machine. A row omits them, so that it is repeatable."""


class Task(NamedTuple):
    """Input of a worker for one run."""

    draw: Draw
    description: Description
    command: str
    record: str
    folder: str
    """Folder of the directories of recorded runs."""
    refused: str = ""
    """Reason why the description could not be loaded; such a run does not fly."""

    def fly(self) -> Row:
        """Fly the run and return its row."""
        return fly_row(self)

    def fail(self, outcome: str, reason: str) -> Row:
        """Return the row of a run whose worker died or could not read the task."""
        return build_failed_row(self, outcome, reason)


class Flyable(Protocol):
    """A unit of work for the workers: a run of a campaign (Task) or a job (jobs.py)."""

    def fly(self) -> Any:
        """Run in any process; never raises."""

    def fail(self, outcome: str, reason: str) -> Any:
        """Return the result of a unit of work whose worker died."""


def fly_row(task: Task) -> Row:
    """Fly one run. Any error becomes a row with its reason; never raises.

    A run whose directory could not be written gets the outcome `interrupted`, which is not a
    result.
    """
    if task.refused:
        return build_failed_row(task, "refused", task.refused)
    try:
        folder = Path(task.folder) / f"{task.draw.run:05d}"
        if task.record == "all":
            result = _record(task.description, folder)
        else:
            result = fly_and_evaluate(task.description)
            if task.record == "failed" and result.outcome != "succeeded":
                _record(task.description, folder)  # fly again with a recording: runs are repeatable
        return _build_row(task, result)
    except _UnrecordedError as error:
        return build_failed_row(task, INTERRUPTED, str(error))
    except InfeasibleError as error:
        return build_failed_row(task, "infeasible", error.blocked_by)
    except InputError as error:
        return build_failed_row(task, "refused", str(error))
    except SimulationError as error:
        return build_failed_row(task, "diverged", str(error))
    except Exception as error:  # an error in one run does not end the campaign
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno}"
        return build_failed_row(task, "crashed", f"{type(error).__name__}: {error} ({where})")


def build_failed_row(task: Task, outcome: str, reason: str) -> Row:
    """Build the row of a run without a result."""
    d = task.draw
    return Row(
        d.run, d.seed, outcome, outcome, (), " ".join(reason.split()), d.varied, {}, {}, 1,
        task.command,
    )  # fmt: skip


class _UnrecordedError(Exception):
    """A run directory could not be written."""


def _record(description: Description, folder: Path) -> RunResult:
    """Fly with a run directory; replaces incomplete files of an interrupted campaign.

    Raises _UnrecordedError if writing fails, and removes the incomplete directory.
    """
    import shutil

    partial = folder.with_name(folder.name + ".partial")
    for old in (folder, partial):
        shutil.rmtree(old, ignore_errors=True)
    try:
        result = run_mission(description, out=folder)
        if result.outcome != "interrupted":
            return result
        why = result.reason
    except (OSError, InputError) as error:
        disk = isinstance(error, OSError) or isinstance(error.__cause__, OSError)
        if not disk and not partial.exists():
            raise  # the description is wrong; no file was opened
        why = str(error)
    shutil.rmtree(partial, ignore_errors=True)
    raise _UnrecordedError(why)


def _build_row(task: Task, result: RunResult) -> Row:
    d = task.draw
    failed = tuple(v.name for v in result.requirements if not v.passed)
    requirement = "" if result.outcome == "succeeded" else result.outcome
    if result.outcome == "failed":
        requirement = failed[0] if failed else "evaluation"
    metrics = {
        k: float(v) if math.isfinite(v) else math.nan
        for k, v in result.metrics.items()
        if k not in TIMING_METRICS
    }
    return Row(
        d.run, d.seed, result.outcome, requirement, failed, " ".join(result.reason.split()),
        d.varied, metrics, dict(result.timing), 1, task.command,
        None if result.inspected is None else result.inspected.to_json(),
    )  # fmt: skip
