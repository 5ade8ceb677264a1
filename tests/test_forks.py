"""Worker processes that are forks of one: how they end, what they share, and what they do not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from skywright.analysis.campaign import forks
from skywright.analysis.campaign.forks import GONE, Fork, start_fork
from waiting import wait_for


def serve(file: int) -> None:
    """A worker: answers where it is, then sleeps until it is killed or told how to end."""
    connection: Any = Connection(file)
    told = {"folder": os.getcwd(), "mark": os.environ.get("MARK"), "pid": os.getpid(),
            "parent": os.getppid(), "one": os.environ["OMP_NUM_THREADS"]}  # fmt: skip
    connection.send_bytes(json.dumps(told).encode())
    try:
        raise SystemExit(connection.recv())
    except EOFError:
        return


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Forks find this module; the source of other tests is left alone."""
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths).strip(os.pathsep))
    monkeypatch.setattr(forks, "_source", None)
    yield
    forks.end_source()


def start() -> tuple[Fork, Any, dict[str, Any]]:
    ours, theirs = Pipe()
    fork = start_fork("test_forks", [theirs.fileno()])
    theirs.close()
    return fork, ours, json.loads(ours.recv_bytes())


def test_each_has_the_caller_s_folder_and_environment_and_says_how_it_ended(
    here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = os.getcwd()
    first, a, told = start()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MARK", "later")
    second, b, later = start()
    assert (told["folder"], told["mark"], told["one"]) == (before, None, "1")
    assert (later["folder"], later["mark"], later["one"]) == (str(tmp_path), "later", "1")
    assert told["parent"] == later["parent"] != os.getpid()  # forks of one process
    with pytest.raises(subprocess.TimeoutExpired):
        first.wait(timeout=0.01)
    first.kill()
    assert first.wait() == first.wait() == -signal.SIGKILL
    b.close()  # no more work
    assert second.wait(timeout=60) == 0
    third, c, _ = start()
    c.send(3)
    assert third.wait(timeout=60) == 1  # it raised
    a.close()


def test_a_source_that_was_killed_is_replaced(here: None) -> None:
    fork, connection, told = start()
    os.kill(told["parent"], signal.SIGKILL)
    connection.close()
    assert fork.wait(timeout=60) == GONE  # nobody knows
    other, second, later = start()
    assert later["parent"] != told["parent"]
    other.kill()
    assert other.wait(timeout=60) == -signal.SIGKILL
    second.close()


def has_ended(pid: int) -> bool:
    try:
        return ") Z " in Path(f"/proc/{pid}/stat").read_text()  # nobody has waited for it yet
    except OSError:
        return True


def test_it_ends_with_its_caller(here: None) -> None:
    """Also where the caller is killed, and with it the connections of both."""
    code = (
        "import time, test_forks; fork, c, told = test_forks.start(); "
        "print(told['parent'], told['pid'], flush=True); time.sleep(600)"
    )
    caller = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert caller.stdout is not None
    source, worker = map(int, caller.stdout.readline().split())
    caller.kill()
    caller.wait()
    wait_for(lambda: has_ended(source) and has_ended(worker))
