"""Start worker processes as forks of one process that has imported the simulator.

A new interpreter spends 2.2 s of processor time and 240 MB on imports and on loading compiled code.
A fork starts at once and shares that memory, so the cost arises once for all workers and for the
replacements of killed ones. A single worker gains nothing. The caller itself is not forked, because
threads (numba, BLAS, a notebook) do not survive a fork. The forked process, `python -m
skywright.analysis.campaign.forks FD`, has one thread and ends with the caller.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing import Pipe, reduction
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any

from skywright.errors import SimulationError

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
"""Environment of a worker: one thread per library, because the workers already use all cores."""

POLL_S = 0.002
GONE = -int(signal.SIGKILL)
"""Exit code of a worker whose real exit code is lost, because the source was killed."""
RUNS = 1 << 16
"""Returned instead of an exit code while the worker runs."""


class Source:
    """Handle of the caller to the process that is forked."""

    def __init__(self) -> None:
        ours, theirs = Pipe()
        self.owner, self._lock, self._connection = os.getpid(), Lock(), ours
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, str(theirs.fileno())],
            pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD},
        )  # fmt: skip
        theirs.close()

    def ask(self, request: tuple[Any, ...], files: Sequence[int] = ()) -> int:
        """Send a request and return the answer. Raises OSError or EOFError if the process has
        ended."""
        with self._lock:
            try:
                self._connection.send(request)
                for file in files:
                    reduction.send_handle(self._connection, file, self._process.pid)
                answer: int = self._connection.recv()
                return answer
            except BaseException:  # an unread answer would be taken for the next one
                self._process.kill()
                self._process.wait()
                raise

    def close(self) -> None:
        """End the process; its workers continue."""
        self._connection.close()
        try:
            self._process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class Fork:
    """A worker process with the methods of `subprocess.Popen` that its owner needs."""

    def __init__(self, pid: int, source: Source) -> None:
        self.pid, self._source = pid, source
        self._code: int | None = None

    def kill(self) -> None:
        """Kill the process. Its pid cannot be reused before somebody has waited for it."""
        if self._code is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code. Raises subprocess.TimeoutExpired after `timeout` (s)."""
        if self._code is None:
            try:
                code = self._source.ask(("wait", self.pid, timeout))
            except (OSError, EOFError):
                code = GONE
            if code == RUNS:
                raise subprocess.TimeoutExpired("worker", timeout or 0.0)
            self._code = code
        return self._code


_source: Source | None = None


def start_fork(module: str, files: Sequence[int], *, silent: bool = False) -> Fork:
    """Start `module.serve(*files)` in a new process, with this folder and environment.

    `silent` discards its output. The file descriptors stay open in the caller. Raises
    SimulationError if no process can be started.
    """
    global _source
    request = ("start", module, os.getcwd(), dict(os.environ), len(files), silent)
    for _ in range(2):
        try:
            if _source is None or _source.owner != os.getpid():
                _source = Source()
            return Fork(_source.ask(request, files), _source)
        except (OSError, EOFError):  # the process was killed
            _source = None
    raise SimulationError(
        "no worker process could be started: each one ended at once (out of memory?)"
    )


def end_source() -> None:
    """End the process that is forked, if any; the next worker starts a new one.

    Its processor time, and that of its ended workers, then counts for the caller's children.
    """
    global _source
    if _source is not None and _source.owner == os.getpid():
        _source.close()
    _source = None


atexit.register(end_source)


def main() -> None:
    """Fork for the connection with the file descriptor in argv[1], until the connection closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    gc.set_threshold(50_000)  # as in cli/group.py
    control = Connection(int(sys.argv[1]))
    with suppress(Exception):  # a faulty user component is reported by the run that uses it
        _load()
    gc.freeze()
    while True:
        try:
            what, *request = control.recv()
            if what == "wait":
                control.send(_wait(*request))
                continue
            module, folder, environment, count, silent = request
            files = [reduction.recv_handle(control) for _ in range(count)]
        except (EOFError, OSError):  # the caller has ended
            os._exit(0)  # an orderly shutdown of the libraries would take half a second
        pid = os.fork()
        if pid == 0:
            control.close()
            _serve(module, folder, environment, files, silent)
        for file in files:
            os.close(file)
        control.send(pid)


def _load() -> None:
    """Import the simulator and load its compiled code if it is cached."""
    from skywright.analysis.campaign import runner  # noqa: F401
    from skywright.description.loader import load_description
    from skywright.run.backends import build_vehicle
    from skywright.run.warm_up import is_compiled

    description = load_description("waypoints")
    if is_compiled():
        vehicle = build_vehicle(description)
        vehicle.tick()


def _wait(pid: int, timeout: float | None) -> int:
    end = time.monotonic() + (float("inf") if timeout is None else timeout)
    while True:
        try:
            found, status = os.waitpid(pid, os.WNOHANG)
        except ChildProcessError:
            return GONE
        if found:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > end:
            return RUNS
        time.sleep(POLL_S)


def _serve(
    module: str, folder: str, environment: dict[str, str], files: list[int], silent: bool
) -> None:
    """Run the worker in the forked process; never returns."""
    code = 1
    try:
        if silent:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, 1)
            os.dup2(null, 2)
        os.environ.clear()
        os.environ.update({**environment, **ONE_THREAD})
        with suppress(OSError):  # the folder was removed; a run that needs it reports the error
            os.chdir(folder)
        import_module(module).serve(*files)
        code = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    main()
