"""Run on this machine: persistent worker processes that fly one run at a time.

The closed connection of a worker that died identifies the one run that it flew. That run is
repeated in a new process, because workers are more often killed from outside (out of memory, an
administrator) than by their run.
"""

import os
import signal
import subprocess
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

from skywright.analysis.campaign.forks import Fork, start_fork
from skywright.analysis.campaign.runner import Flyable
from skywright.errors import InputError

ATTEMPTS = 3
"""Maximum number of attempts of a run whose worker dies."""


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def choose_workers(workers: int | None, runs: int) -> int:
    """Return the number of workers (default: all cores), at most `runs`. Raises InputError."""
    cores = count_cores()
    if workers is None:
        return max(min(cores, runs), 1)
    if not 1 <= workers <= cores:
        raise InputError(
            f"--workers {workers}: this machine has {cores} available cores; valid: 1 to "
            f"{cores} (several machines: --ray ADDRESS)"
        )
    return max(min(workers, runs), 1)


class _Worker(NamedTuple):
    process: Fork
    connection: Connection


_KEPT: list[_Worker] | None = None


@contextmanager
def keep_workers() -> Iterator[None]:
    """Keep idle workers of one campaign for the next inside this context; a start takes seconds."""
    global _KEPT
    outer, _KEPT = _KEPT, [] if _KEPT is None else _KEPT
    try:
        yield
    finally:
        if outer is None:
            for worker in _KEPT:
                _stop_worker(worker, kill=True)
        _KEPT = outer


def fly_local(
    tasks: Iterator[Flyable], workers: int, *, warm_first: bool = False
) -> Generator[Any, None, None]:
    """Fly tasks (or jobs) on `workers` processes; yield the rows in the order in which they finish.

    With `warm_first` one worker flies the first run alone, so that code is compiled only once.
    Closing the iterator stops the workers and discards their runs.
    """
    idle: list[_Worker] = [] if _KEPT is None else _KEPT
    busy: dict[Connection, tuple[_Worker, Flyable, int]] = {}
    again: list[tuple[Flyable, int]] = []
    wanted = 1 if warm_first else workers
    exhausted = False
    try:
        while True:
            while len(busy) < wanted and not (exhausted and not again):
                if again:
                    task, attempt = again.pop()
                else:
                    following = next(tasks, None)
                    if following is None:
                        exhausted = True
                        continue
                    task, attempt = following, 1
                worker = idle.pop() if idle else _start_worker()
                with suppress(BrokenPipeError, ConnectionResetError):  # dead: wait() detects it
                    worker.connection.send(task)
                busy[worker.connection] = (worker, task, attempt)
            if not busy:
                return
            for connection in wait(list(busy)):
                assert isinstance(connection, Connection)
                worker, task, attempt = busy.pop(connection)
                try:
                    answer: Any = connection.recv()
                except (EOFError, OSError):
                    why = _stop_worker(worker)
                    if attempt < ATTEMPTS:
                        again.append((task, attempt + 1))
                        continue
                    reason = f"the worker process died {attempt} times ({why})"
                    row = task.fail("crashed", reason)
                else:
                    idle.append(worker)
                    row = task.fail("refused", answer) if isinstance(answer, str) else answer
                wanted = workers
                yield row._replace(attempts=attempt)
    finally:
        left = [] if idle is _KEPT else idle
        for worker in [*left, *(entry[0] for entry in busy.values())]:
            _stop_worker(worker, kill=True)


def _start_worker() -> _Worker:
    ours, theirs = Pipe()
    # discard prints of user code: standard output is for --json, standard error shows the progress
    process = start_fork(f"{__package__}.worker", [theirs.fileno()], silent=True)
    theirs.close()
    return _Worker(process, ours)


def _stop_worker(worker: _Worker, kill: bool = False) -> str:
    """Stop a worker and return its exit code or signal as text."""
    worker.connection.close()
    if kill:
        worker.process.kill()
    try:
        code = worker.process.wait(timeout=5.0)
    except subprocess.TimeoutExpired:
        worker.process.kill()
        code = worker.process.wait()
    if code < 0:
        with suppress(ValueError):
            return signal.Signals(-code).name
    return f"exit code {code}"
