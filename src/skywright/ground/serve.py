"""Start of the ground station: `skywright serve`, or beside a run (`skywright run --view`)."""

from __future__ import annotations

import asyncio
import os
import socket
import subprocess
import sys
import tempfile
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Any

from skywright.errors import InputError
from skywright.ground.backends import list_backends
from skywright.ground.guard import Guard
from skywright.ground.server import Address, run_server
from skywright.ground.station import Station
from skywright.links.pair import build_pair, prepare


def serve(
    target: str | None,
    address: Address,
    runs: Path,
    *,
    open_browser: bool | None = None,
    options: tuple[str, ...] = (),
    backends: tuple[str, ...] = (),
) -> None:
    """Run the station until it is interrupted.

    `target` is None, a mission (name or file) that the page proposes, or a run's directory, which
    is replayed. `options` are passed to `skywright run` for every flight; `backends` are offered in
    addition to those without an address. Raises InputError if the target is neither, the address is
    not available, or a back end is invalid.
    """
    address.check()
    data, proposed, files = None, "", dict[str, str]()
    if target is not None and _is_run(target):
        data = load_replay(Path(target))
    elif target is not None and Path(target).is_dir():
        raise InputError(
            f"{target}: there is no recording.mcap in it; valid: a mission or the directory of a "
            "finished run"
        )
    elif target is not None:
        from skywright.description.loader import load_description

        load_description(target)  # report errors now, not on the page
        proposed = target
        if target.endswith(".toml") or os.sep in target:
            proposed = Path(target).stem
            files[proposed] = str(Path(target).resolve())
    choices = list_choices(proposed, files, backends)
    try:
        runs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--runs {runs}: {error.strerror or error}") from None

    async def run() -> None:
        async def opened(url: str, guard: Guard) -> None:
            print(f"ground station: {url}", file=sys.stderr, flush=True)
            print("(for one browser; Ctrl-C ends the station)", file=sys.stderr, flush=True)
            if has_display() if open_browser is None else open_browser:
                webbrowser.open(url)

        station = Station(runs, choices, files)
        station.options = options
        await run_server(station, address, data, opened)

    with suppress(KeyboardInterrupt):
        asyncio.run(run())


def load_replay(directory: Path) -> str:
    """Return a run's directory as the page's JSON data; raises InputError for an invalid one."""
    import json

    from skywright.reports.replay import build_replay_data
    from skywright.run.directory import UNFINISHED
    from skywright.run.run import evaluate_directory

    result = evaluate_directory(directory)
    if result.outcome in UNFINISHED:
        print(f"{directory}: {result.outcome}: {result.reason}", file=sys.stderr)
    return json.dumps(build_replay_data(result), allow_nan=False)


def list_choices(
    proposed: str, files: dict[str, str], backends: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return the choices of a page."""
    from skywright.description.loader import list_missions
    from skywright.description.robot.loader import list_robots
    from skywright.description.world.loader import list_worlds

    missions = {e.name: e.description for e in list_missions()}
    missions |= {name: f"file {Path(file).name}" for name, file in files.items()}
    return {
        "proposed": proposed,
        "missions": missions,
        "operated": [name for name in missions if _is_operated(files.get(name, name))],
        "robots": {e.name: e.description for e in list_robots()},
        "worlds": {e.name: e.description for e in list_worlds()},
        "backends": list_backends(backends),
    }


def _is_operated(mission: str) -> bool:
    """Whether an operator can do the work of a mission by hand, by its file's kind alone."""
    import tomllib

    from skywright.description.loader import find_mission
    from skywright.run.kind import load_kind

    try:
        tree = tomllib.loads(find_mission(mission).path.read_text(encoding="utf-8"))
        return load_kind(tree["mission"]["kind"]).operated
    except (InputError, OSError, ValueError, KeyError, TypeError):  # reported at start
        return False


def _is_run(target: str) -> bool:
    try:
        return (Path(target) / "recording.mcap").is_file()
    except (OSError, ValueError):
        return False


def has_display() -> bool:
    """Whether there is a screen for a browser."""
    if sys.platform == "darwin":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class Beside:
    """A station in a separate process beside a run: `end` and `folder` are for its `Feed`."""

    def __init__(self, address: Address, *, open_browser: bool | None = None) -> None:
        """Start it; it prints its address on standard error."""
        address.check()
        self._temporary = tempfile.TemporaryDirectory(prefix="skywright-")
        self.folder = Path(self._temporary.name)
        self.end, theirs = build_pair()
        show = has_display() if open_browser is None else open_browser
        self._process = subprocess.Popen(
            [sys.executable, "-m", "skywright.ground.serve", str(theirs.fileno()),
             str(self.folder), address.host, str(address.port), str(int(show))],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=[theirs.fileno()],
            start_new_session=True,
        )  # fmt: skip
        theirs.close()

    def close(self) -> None:
        """Stop the station."""
        self.end.close()
        self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._temporary.cleanup()


def _serve_beside(number: int, folder: Path, address: Address, show: bool) -> None:
    """Show the flight at the other end of socket `number`; the process that `Beside` starts."""
    end = socket.socket(fileno=number)
    prepare(end)

    async def run() -> None:
        station = Station(folder, {"missions": {}}, {})  # it starts no flights

        async def opened(url: str, guard: Guard) -> None:
            station.host(end, folder)
            print(f"live view: {url}", file=sys.stderr, flush=True)
            if show:
                webbrowser.open(url)

        parent = os.getppid()

        async def follow_parent() -> None:  # a killed run leaves no station behind
            while os.getppid() == parent:
                await asyncio.sleep(1.0)
            station.done.set()

        watching = asyncio.create_task(follow_parent())
        try:
            await run_server(station, address, None, opened)
        finally:
            watching.cancel()

    with suppress(KeyboardInterrupt):
        asyncio.run(run())


if __name__ == "__main__":
    number, folder, host, port, show = sys.argv[1:]
    try:
        _serve_beside(int(number), Path(folder), Address(host, int(port)), show == "1")
    except InputError as error:
        print(f"skywright: {error}", file=sys.stderr)
        sys.exit(2)
