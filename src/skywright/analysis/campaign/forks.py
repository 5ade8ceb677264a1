"""Worker processes as forks of one process that has imported the simulator.

An interpreter of its own spends 2.2 s of processor time and 240 MB on imports and on loading
compiled code. That is paid once: a fork starts at once and shares that memory. One worker gains
nothing; each further one saves that, and so does one that replaces a killed one. The caller is not
forked, because threads (numba, BLAS, a notebook) do not survive a fork: the process that is forked,
`python -m skywright.analysis.campaign.forks FD`, has one thread. It ends with the caller.
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
"""Workers share the cores: a library's own threads would only get in each other's way."""

POLL_S = 0.002
GONE = -int(signal.SIGKILL)
"""Exit code of a worker about which nobody can be asked, because the source was killed."""
RUNS = 1 << 16
"""In place of an exit code: it has not ended."""


class Source:
    """The process that is forked, seen from the caller."""

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
        """Return the answer to a request; raises OSError or EOFError where the process is gone."""
        with self._lock:
            try:
                self._connection.send(request)
                for file in files:
                    reduction.send_handle(self._connection, file, self._process.pid)
                answer: int = self._connection.recv()
                return answer
            except BaseException:  # an answer that nobody took would be taken for the next one
                self._process.kill()
                self._process.wait()
                raise

    def close(self) -> None:
        """End it; workers go on."""
        self._connection.close()
        try:
            self._process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class Fork:
    """A worker process, with the methods of `subprocess.Popen` that its owner needs."""

    def __init__(self, pid: int, source: Source) -> None:
        self.pid, self._source = pid, source
        self._code: int | None = None

    def kill(self) -> None:
        """End it; its number is its own until somebody has waited for it."""
        if self._code is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        """Return its exit code; raises subprocess.TimeoutExpired after `timeout` (s)."""
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
    """Start `module.serve(*files)` in a process of its own, in this folder and environment.

    `silent`: what it prints is dropped. The files' descriptors stay open here. Raises
    SimulationError where no process can be started.
    """
    global _source
    request = ("start", module, os.getcwd(), dict(os.environ), len(files), silent)
    for _ in range(2):
        try:
            if _source is None or _source.owner != os.getpid():
                _source = Source()
            return Fork(_source.ask(request, files), _source)
        except (OSError, EOFError):  # it was killed
            _source = None
    raise SimulationError(
        "no worker process could be started: each one ended at once (out of memory?)"
    )


def end_source() -> None:
    """End the process that is forked, if there is one; the next worker starts another.

    Its processor time, with that of the workers that have ended, counts as the caller's children's.
    """
    global _source
    if _source is not None and _source.owner == os.getpid():
        _source.close()
    _source = None


atexit.register(end_source)


def main() -> None:
    """Fork for the connection whose file descriptor is the first argument, until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    gc.set_threshold(50_000)  # as in cli/group.py
    control = Connection(int(sys.argv[1]))
    with suppress(Exception):  # what is wrong with an installed part is told where it flies
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
        except (EOFError, OSError):  # the caller is gone
            os._exit(0)  # taking libraries down in order would cost half a second
        pid = os.fork()
        if pid == 0:
            control.close()
            _serve(module, folder, environment, files, silent)
        for file in files:
            os.close(file)
        control.send(pid)


def _load() -> None:
    """Import what flies; load its compiled code where there is some."""
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
    """Be the worker; never returns."""
    code = 1
    try:
        if silent:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, 1)
            os.dup2(null, 2)
        os.environ.clear()
        os.environ.update({**environment, **ONE_THREAD})
        with suppress(OSError):  # it was removed: a run that needs it says so
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
