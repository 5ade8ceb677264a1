"""Runs on this machine: one warm process a worker, one run at a time in each.

A worker that dies is known at once by its closed connection, and with it exactly the one run that
it was flying. That run is tried again in a fresh process, because a worker is more often killed
(memory, an administrator) than brought down by its run.
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
"""Times that a run may take its worker down before it becomes a row."""


def count_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def choose_workers(workers: int | None, runs: int) -> int:
    """Number of workers: all cores unless told; never more than runs. Raises InputError."""
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
    """Inside, workers that one campaign leaves idle fly for the next: a start takes seconds."""
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
    """Fly tasks (or jobs) on `workers` processes; rows come as they finish.

    With `warm_first` one worker flies the first run alone, so that code is compiled once.
    Closing the iterator stops the workers and drops what they are flying.
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
                with suppress(BrokenPipeError, ConnectionResetError):  # dead: wait() tells
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
    # a user's law may print: standard output is for --json, standard error shows the progress
    process = start_fork(f"{__package__}.worker", [theirs.fileno()], silent=True)
    theirs.close()
    return _Worker(process, ours)


def _stop_worker(worker: _Worker, kill: bool = False) -> str:
    """End a worker and say how it ended."""
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
