"""One run of a campaign, from task to row, in whatever process it flies."""

import math
import traceback
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from skywright.analysis.campaign.spec import Draw
from skywright.description.loader import Description
from skywright.errors import InfeasibleError, InputError, SimulationError
from skywright.run.rows import Row
from skywright.run.run import RunResult, fly_and_evaluate, run_mission

RECORD = ("none", "failed", "all")
"""Runs of which the directory with the recording is kept."""

INTERRUPTED = "interrupted"
"""Outcome of a run that was cut short from outside; it is flown again, and never a row."""

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

    def fly(self) -> Row:
        """Fly the run."""
        return fly_row(self)

    def fail(self, outcome: str, reason: str) -> Row:
        """Return the row of a run whose worker died, or could not read it."""
        return build_failed_row(self, outcome, reason)


class Flyable(Protocol):
    """What workers fly: a run of a campaign (Task), or a job (jobs.py)."""

    def fly(self) -> Any:
        """Do it, in whatever process; never raises."""

    def fail(self, outcome: str, reason: str) -> Any:
        """Return what stands for it where it never came back."""


def fly_row(task: Task) -> Row:
    """Fly one run. Whatever goes wrong becomes a row with its reason; never raises.

    A run whose directory could not be written is `interrupted`: no result of the campaign.
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
                _record(task.description, folder)  # the same again: runs are repeatable
        return _build_row(task, result)
    except _UnrecordedError as error:
        return build_failed_row(task, INTERRUPTED, str(error))
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


class _UnrecordedError(Exception):
    """A run directory could not be written."""


def _record(description: Description, folder: Path) -> RunResult:
    """Fly with a run directory; what an interrupted campaign left half-written is replaced.

    Raises _UnrecordedError when the disk does not take it; nothing of it stays then.
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
            raise  # the description is wrong: nothing was opened
        why = str(error)
    shutil.rmtree(partial, ignore_errors=True)
    raise _UnrecordedError(why)


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
        None if result.inspected is None else result.inspected.to_json(),
    )  # fmt: skip
