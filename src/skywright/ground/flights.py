"""Flights that the station starts, each in a separate process, and their logbook."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from skywright.core.bounded import parse_json, read_text
from skywright.errors import InputError
from skywright.ground.disturb import list_sets
from skywright.ground.orders import names_code
from skywright.links.pair import build_pair
from skywright.run.backends import PHYSICS

LOGBOOK = "logbook.jsonl"
UNDER_WAY = ".flying-"
"""Prefix of the note of a flight in progress; the station's process id completes it."""
KEPT = 50
"""Number of logbook entries on a page."""
PATIENCE_S = 15.0
"""s for a flight to end its recording when the station is stopped."""
LARGEST_LOG = 4_000_000  # bytes, largest logbook that is read


class Asked(NamedTuple):
    """A requested flight."""

    mission: str
    robot: str | None = None
    world: str | None = None
    seed: int | None = None
    sets: tuple[str, ...] = ()
    operated: bool = False  # by the page in control
    backend: str = PHYSICS  # that flies it (run/backends.py)

    def check(self) -> None:
        """Raise InputError if it would load code."""
        for text in self.sets:
            if names_code(text):
                raise InputError(
                    f"{text[:80]!r} names a Python file; the page loads no code: use "
                    "`skywright run` with --view"
                )

    def list_arguments(self) -> list[str]:
        """Return the arguments of `skywright run`."""
        out = [self.mission]
        for name in ("robot", "world", "seed"):
            value = getattr(self, name)
            if value is not None:
                out += [f"--{name}", str(value)]
        for text in self.sets:
            out += ["--set", text]
        if self.backend != PHYSICS:
            out += ["--backend", self.backend]
        return out


class Logbook:
    """One line of JSON per flight, in the folder of the runs."""

    def __init__(self, folder: Path) -> None:
        """`folder` contains the runs."""
        self.path = folder / LOGBOOK
        self.entries: list[dict[str, Any]] = []
        """The newest entries, each with its line in the file as "number", from 0."""
        lines = read_text(self.path, LARGEST_LOG).splitlines() if self.path.is_file() else []
        self._lines = len(lines)
        for number, line in list(enumerate(lines))[-KEPT:]:
            with suppress(ValueError, InputError):
                entry = json.loads(line)
                if isinstance(entry, dict):
                    self.entries.append({**entry, "number": number})
        self._note = folder / f"{UNDER_WAY}{os.getpid()}.json"
        self._adopt(folder)

    def begin(self, process: Process, mission: str) -> None:
        """Note a flight in progress: if this station is killed, the next one adds the entry."""
        asked = {**process.asked._asdict(), "mission": mission}
        note = {"asked": asked, "out": str(process.out), "started": process.started}
        with suppress(OSError):  # the flight's recording meets the same full disk, and reports it
            self._note.write_text(json.dumps({**note, "pid": process.pid}), encoding="utf-8")

    def _adopt(self, folder: Path) -> None:
        """Add entries of flights that ended after their station was killed."""
        for note in sorted(folder.glob(f"{UNDER_WAY}*.json")):
            with suppress(OSError, ValueError, KeyError, TypeError, InputError):
                found = json.loads(read_text(note, LARGEST_LOG))
                if _is_alive(int(note.stem.removeprefix(UNDER_WAY))) or _is_alive(found["pid"]):
                    continue
                asked = Asked(**{**found["asked"], "sets": tuple(found["asked"]["sets"])})
                process = Process(asked, Path(found["out"]), folder)
                process.started = float(found["started"])
                self.add(write_down(process, 0, []))
                note.unlink()

    def add(self, entry: dict[str, Any]) -> None:
        """Add a flight's entry; a full disk raises InputError."""
        self.entries = [*self.entries, {**entry, "number": self._lines}][-KEPT:]
        self._lines += 1
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry, allow_nan=False) + "\n")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        with suppress(OSError):
            self._note.unlink(missing_ok=True)


class Process:
    """A flight in progress."""

    def __init__(
        self, asked: Asked, out: Path, folder: Path, options: tuple[str, ...] = ()
    ) -> None:
        """`out` is the run's directory, `folder` that of the scene and the output.

        `options` are further ones of `skywright run`.
        """
        self.options = options
        self.asked, self.out, self.folder = asked, out, folder
        self.end: socket.socket | None = None
        self.started = time.time()
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        """Start it; raises InputError if no process can be started."""
        self.asked.check()
        operator = ["--operator", "page"] if self.asked.operated else []
        disturbing = [x for text in self._list_disturbances() for x in ("--set", text)]
        ours, theirs = build_pair()
        command = [
            sys.executable, "-m", "skywright", "run", *self.asked.list_arguments(), *disturbing,
            *operator, *self.options, "--out", str(self.out),
            "--station", f"{theirs.fileno()}:{self.folder}",
        ]  # fmt: skip
        try:
            with (self.folder / "output.txt").open("wb") as log:
                # a separate session: Ctrl-C reaches the station only, which ends the flight in
                # order
                self._process = await asyncio.create_subprocess_exec(
                    *command, stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log,
                    pass_fds=[theirs.fileno()], start_new_session=True,
                )  # fmt: skip
        except (OSError, ValueError) as error:  # ValueError: an argument that is no text
            ours.close()
            why = getattr(error, "strerror", None) or error
            raise InputError(f"the flight cannot be started: {why}") from None
        finally:
            theirs.close()
        self.end = ours

    def _list_disturbances(self) -> list[str]:
        given = " ".join(self.asked.sets)
        starts = [text for text in list_sets() if text.split("=")[0] not in given]
        return starts

    @property
    def pid(self) -> int:
        """Of the process, 0 before it is started."""
        return 0 if self._process is None else self._process.pid

    async def wait(self) -> int:
        """Wait for the end of the flight; return the exit code."""
        assert self._process is not None
        return await self._process.wait()

    async def stop(self) -> None:
        """Interrupt the flight; it closes its recording, or is killed after PATIENCE_S."""
        process = self._process
        if process is None or process.returncode is not None:
            return
        with suppress(ProcessLookupError):
            process.send_signal(signal.SIGINT)
        try:
            await asyncio.wait_for(process.wait(), PATIENCE_S)
        except TimeoutError:
            with suppress(ProcessLookupError):
                process.kill()

    def tell_error(self) -> str:
        """Return the last line that the process printed as an error, or ""."""
        try:
            text = (self.folder / "output.txt").read_bytes()[-8000:].decode("utf-8", "replace")
        except OSError:
            return ""
        lines = [line for line in text.splitlines() if line.startswith(("skywright: ", "error: "))]
        return lines[-1].split(": ", 1)[1] if lines else ""

    def read_result(self) -> dict[str, Any]:
        """Return the content of metrics.json, and the path of the run."""
        for directory in (self.out, self.out.with_name(self.out.name + ".partial")):
            try:
                found = parse_json(read_text(directory / "metrics.json", LARGEST_LOG), "metrics")
            except (OSError, InputError, ValueError):
                continue
            if isinstance(found, dict):
                return {**found, "directory": str(directory)}
        return {}


def _is_alive(pid: int) -> bool:
    """Whether a process with this id exists, other than this one."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return pid not in (0, os.getpid())


def choose_out(folder: Path, mission: str) -> Path:
    """Return a free directory for a run of a mission."""
    number = 1
    while True:
        out = folder / f"{mission}-{number}"
        if not out.exists() and not out.with_name(out.name + ".partial").exists():
            return out
        number += 1


def write_down(process: Process, code: int, repeats: list[str]) -> dict[str, Any]:
    """Return the logbook's entry of a flight that has ended."""
    found, asked = process.read_result(), process.asked
    timing = found.get("timing") or {}
    if code < 0 and not process.out.exists():  # a complete run has its name without .partial
        name = signal.Signals(-code).name
        found |= {"outcome": "killed", "reason": f"the flight was killed ({name})"}
    return {
        "when": time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(process.started)),
        **asked._asdict(),
        "seed": found.get("seed", asked.seed),
        "robot": found.get("robot", asked.robot),
        "world": found.get("world", asked.world),
        "asked": [asked.robot, asked.world],
        "sets": [*asked.sets, *repeats],
        "outcome": str(found.get("outcome") or ("wrong input" if code == 2 else "killed")),
        "reason": str(found.get("reason") or process.tell_error())[:400],
        "simulated_s": timing.get("simulated_s"),
        "directory": found.get("directory", ""),
    }
