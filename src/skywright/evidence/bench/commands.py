"""Commands of the command line, timed in separate processes."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from skywright.errors import SimulationError

PYTHON = (sys.executable,)
SKYWRIGHT = (sys.executable, "-m", "skywright")


class Timed(NamedTuple):
    """A finished command."""

    wall_s: float
    output: str


def time_command(
    words: Sequence[str],
    *,
    environment: dict[str, str] | None = None,
    codes: Sequence[int] = (0,),
) -> Timed:
    """Run a command and time it. Raises SimulationError if its exit code is not in `codes`."""
    begin = time.perf_counter()
    done = subprocess.run(
        words, capture_output=True, text=True, env={**os.environ, **(environment or {})},
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    wall = time.perf_counter() - begin
    if done.returncode not in codes:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        shown = " ".join(("python" if words[0] == sys.executable else words[0], *words[1:]))
        raise SimulationError(f"`{shown}` exits {done.returncode}: {last}")
    return Timed(wall, done.stdout)


def time_run(
    mission: str, out: Path, *sets: str, environment: dict[str, str] | None = None
) -> tuple[float, dict[str, Any]]:
    """Time `skywright run`; return (wall time, its JSON). Failed requirements are accepted."""
    changes = [word for text in sets for word in ("--set", text)]
    done = time_command(
        [*SKYWRIGHT, "run", mission, *changes, "--out", str(out), "--json"],
        environment=environment, codes=(0, 1),
    )  # fmt: skip
    found = json.loads(done.output)
    if "timing" not in found:
        raise SimulationError(f"skywright run {mission}: {found.get('error', 'did not fly')}")
    return done.wall_s, found
