"""Commands in forks of one process that has imported the program and loaded its compiled code.

A command of its own process spends seconds on both, half of what a page's command takes. A fork
runs what the console script runs (`skywright.cli.main`), with the arguments, the folder and the
environment of the command, and a fresh state: what one command changes in its process ends with
it. The server has one thread, so forking is safe. Each line on its input is a request as JSON, the
answer is the exit code; output goes to the files that the request names.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

TIMEOUT_S = 600


class CommandServer:
    """Runs `skywright` commands; use as a context. `missions` are those whose robots are loaded."""

    def __init__(self, missions: tuple[str, ...] = ()) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__, *missions],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> CommandServer:
        return self

    def __exit__(self, *error: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(timeout=30)

    def run(self, words: list[str], cwd: Path, **env: str) -> subprocess.CompletedProcess[str]:
        """Run one command, the words after `skywright`, and return what `subprocess.run` would."""
        with tempfile.TemporaryDirectory() as folder:
            files = [str(Path(folder) / name) for name in ("out", "err")]
            request = {"words": words, "cwd": str(cwd), "env": env, "files": files}
            assert self._process.stdin is not None and self._process.stdout is not None
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
            assert answer, "the server of commands has ended"
            out, err = (Path(f).read_text(encoding="utf-8", errors="replace") for f in files)
            return subprocess.CompletedProcess(words, int(answer), out, err)


def serve() -> None:
    """Load, then run what is asked for until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    _warm_up(sys.argv[1:])
    for line in sys.stdin:
        request = json.loads(line)
        child = os.fork()
        if child == 0:
            _run(request)
        _, status = os.waitpid(child, 0)
        answers.write(f"{os.waitstatus_to_exitcode(status)}\n")
        answers.flush()


def _warm_up(missions: list[str]) -> None:
    """Fly and report one mission, and start the robots of others: what they load serves all."""
    from click.testing import CliRunner

    import skywright
    from skywright.cli import main

    with tempfile.TemporaryDirectory() as folder:
        words = ["run", "waypoints", "--robot", "othex", "--out", f"{folder}/run"]
        CliRunner().invoke(main, words)
    for mission in missions:
        vehicle = skywright.build_vehicle(skywright.load(mission))
        for _ in range(5):
            vehicle.tick()


def _run(request: dict[str, Any]) -> None:
    """Be the command; never returns."""
    signal.alarm(TIMEOUT_S)
    code = 70
    try:
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        for target, name in zip((1, 2), request["files"], strict=True):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT, 0o600), target)
        os.chdir(request["cwd"])
        os.environ.update(request["env"])
        sys.argv = ["skywright", *request["words"]]
        sys.stdin = open(0, closefd=False)  # noqa: SIM115
        from skywright.cli import main

        try:
            main.main(request["words"], prog_name="skywright")
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()  # as a process does
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    serve()
