"""Run any function with its arguments on worker processes or a cluster.

Jobs use the same workers as the runs of a campaign, with the same handling of dead workers. The
function must be a module-level function; its arguments and result must be picklable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import Any, NamedTuple

from skywright.analysis.campaign.local import choose_workers, fly_local
from skywright.errors import SimulationError
from skywright.run.warm_up import is_compiled


class Done(NamedTuple):
    """Result of a job, or its error."""

    number: int
    value: Any
    error: BaseException | None = None
    attempts: int = 1


class Job(NamedTuple):
    """A call of a module-level function."""

    number: int
    what: str  # for progress and messages
    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def fly(self) -> Done:
        """Call the function; `fly_jobs` raises its exception again."""
        try:
            return Done(self.number, self.function(*self.arguments))
        except Exception as error:
            return Done(self.number, None, error)

    def fail(self, outcome: str, reason: str) -> Done:
        """Return the result of a job whose worker died."""
        return Done(self.number, None, SimulationError(f"{self.what}: {outcome}: {reason}"))


def fly_jobs(
    jobs: Sequence[Job], *, workers: int | None = None, ray: str | None = None,
    step: Callable[[str], None] | None = None,
) -> list[Any]:  # fmt: skip
    """Return the results of the jobs in their order; raise the first exception of a job.

    Without `workers` and `ray` the jobs run one after the other in this process. `step` receives
    the name of each job before it runs here, or when its result arrives.
    """
    check_places(len(jobs), workers, ray)
    tell = step or (lambda what: None)
    if workers is None and ray is None:
        values = []
        for job in jobs:
            tell(job.what)
            values.append(job.function(*job.arguments))
        return values
    found: dict[int, Done] = {}
    with closing(_fly(iter(jobs), len(jobs), workers, ray)) as answers:
        for done in answers:
            found[done.number] = done
            tell(jobs[done.number].what)
            if done.error is not None:
                raise done.error
    return [found[job.number].value for job in jobs]


def check_places(n: int, workers: int | None, ray: str | None) -> None:
    """Raise InputError if `n` jobs cannot run on these workers or this cluster."""
    if ray is not None:
        from skywright.analysis.campaign.cluster import check_workers

        check_workers(ray, workers)
    elif workers is not None:
        choose_workers(workers, n)


def _fly(jobs: Iterator[Job], n: int, workers: int | None, ray: str | None) -> Any:
    if ray is None:
        count = choose_workers(workers, n)
        yield from fly_local(jobs, count, warm_first=not is_compiled())
        return
    from skywright.analysis.campaign import cluster

    ours = cluster.connect(ray, workers)
    try:
        yield from cluster.fly_cluster(jobs)
    finally:
        if ours:
            cluster.disconnect()
