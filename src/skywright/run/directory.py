"""A run's directory: written as NAME.partial; finished and unfinished runs can be read."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.bounded import LARGEST_TABLE, parse_json, read_text
from skywright.core.user_files import read_sources
from skywright.errors import InputError
from skywright.recordings.recording import Event, Recording, read_recording
from skywright.run.faults._rule import Acted
from skywright.run.flight import PhaseRecord
from skywright.run.stored import Stored

SUFFIX = ".partial"
MISSION = "mission.toml"
"""A run's settings; a folder's name alone would select a built-in mission of that name."""
UNFINISHED = ("interrupted", "diverged")
"""Outcomes of runs whose recording may end at any time."""


class StoredRun(NamedTuple):
    """The contents of a run's directory, without its mission."""

    recording: Recording
    phases: list[PhaseRecord]
    outcome: str
    reason: str
    timing: dict[str, float]
    acted: tuple[Acted, ...]
    written: dict[str, Any]  # all of metrics.json

    @property
    def samples(self) -> NDArray[Any]:
        """The samples of the recording."""
        return self.recording.samples


def open_directory(out: Path | None, name: str) -> tuple[Path, Path]:
    """Choose and create NAME.partial; returns (NAME, NAME.partial).

    Raises InputError when either exists or cannot be written.
    """
    try:
        if out is None:
            out = _find_free(Path("runs") / name)
        check_free(out)
        partial = out.with_name(out.name + SUFFIX)
        partial.mkdir(parents=True)
    except FileExistsError as error:
        raise _taken(out) from error
    except (OSError, ValueError) as error:
        raise InputError(
            f"cannot create {str(out)[:80]!r}: {getattr(error, 'strerror', None) or error}"
        ) from error
    if not os.access(partial, os.W_OK):
        raise InputError(f"cannot write into {partial}")
    return out, partial


def check_free(out: Path) -> None:
    """Raise InputError if a name is taken; `open_directory` repeats this check."""
    if out.name.endswith(SUFFIX):
        raise InputError(f"{out}: the name of a finished run must not end in {SUFFIX}")
    try:
        if out.exists():
            raise InputError(f"{out} already exists; give another --out or remove it")
        if out.with_name(out.name + SUFFIX).exists():
            raise _taken(out)
    except (OSError, ValueError):
        return  # an invalid name: open_directory reports it


def _taken(out: Path | None) -> InputError:
    return InputError(
        f"{out}{SUFFIX} already exists (an interrupted run, or a run in progress); remove "
        "it or give another --out"
    )


def _find_free(base: Path) -> Path:
    out, i = base, 1
    while out.exists() or out.with_name(out.name + SUFFIX).exists():
        i += 1
        out = base.with_name(f"{base.name}-{i}")
    return out


def write_json(path: Path, value: dict[str, Any]) -> None:
    """Write a JSON object; if it cannot be written, the existing file remains unchanged.

    Raises InputError if the disk is full.
    """
    text = json.dumps(value, indent=2, allow_nan=False)
    fresh = path.with_name(path.name + ".new")
    try:
        fresh.write_text(text + "\n", encoding="utf-8")
        fresh.replace(path)
    except OSError as error:
        with suppress(OSError):
            fresh.unlink()
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error


def to_plain(value: Any, what: str) -> Any:
    """Return `value` as plain JSON, with NumPy's numbers and arrays as those of Python.

    Raises InputError, with `what` it is, for other objects and for numbers that are not finite.
    """

    def convert(part: object) -> object:
        if isinstance(part, np.generic | np.ndarray):
            return part.tolist()
        raise TypeError(f"an object of type {type(part).__name__}")

    try:
        return json.loads(json.dumps(value, default=convert, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} is not plain JSON: {error}") from error


def write_sources(folder: Path, files: Sequence[Path]) -> dict[Path, str]:
    """Copy users' files, and the files beside them that they import, into a run's directory.

    Returns the name of each of `files` in that directory. Files of one folder stay together.
    """
    kept: dict[Path, dict[Path, bytes]] = {}  # by folder
    for file in files:
        kept.setdefault(file.parent, {}).update(read_sources(file))
    taken: set[str] = set()
    names: dict[Path, str] = {}
    for i, (parent, sources) in enumerate(kept.items(), 1):
        found = {path.name for path in sources}
        inside = f"sources_{i}" if found & taken else ""
        taken |= found
        for path, data in sources.items():
            copy = folder / inside / path.name
            copy.parent.mkdir(exist_ok=True)
            copy.write_bytes(data)
        names.update({f: str(Path(inside, f.name)) for f in files if f.parent == parent})
    return names


def write_unfinished(
    partial: Path, outcome: str = "interrupted", reason: str = "killed before it ended"
) -> None:
    """Mark a run as unfinished: the mark remains if the process is killed.

    A full disk is reported by what is written next.
    """
    value = {"outcome": outcome, "reason": reason, "phases": []}
    with suppress(InputError):
        write_json(partial / "metrics.json", {**value, "timing": {}})


class _Requirement(Stored):
    name: str
    value: float | None
    limit: float
    unit: str
    sense: str
    passed: bool


class _Metrics(Stored):
    """The part of metrics.json that is read back."""

    phases: list[PhaseRecord]
    timing: dict[str, float]
    outcome: str
    reason: str
    faults: list[Acted] = []
    metrics: dict[str, float | None] = {}
    requirements: list[_Requirement] = []
    checklist: list[dict[str, Any]] = []
    command: str = ""
    backend: str = ""


def load_run(directory: Path) -> StoredRun:
    """Read recording and metrics.json of a run, finished or partial.

    A finished run whose recording is truncated is read as interrupted, with that reason. Raises
    InputError if files are missing or damaged.
    """
    for name in (MISSION, "recording.mcap", "metrics.json"):
        if not (directory / name).is_file():
            raise InputError(f"{directory}: is not a run directory, {name} is missing")
    file = directory / "metrics.json"
    recording = read_recording(directory / "recording.mcap")
    try:
        old = parse_json(read_text(file, LARGEST_TABLE), str(file))
        read = _Metrics.read(old)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: is damaged: {error}") from error
    phases, outcome, reason = read.phases, read.outcome, read.reason
    end = float(recording.samples["t"][-1]) if len(recording.samples) else 0.0
    if not recording.complete and outcome not in UNFINISHED:  # the flight ended, the file does not
        until = phases[-1].end_s if phases else end
        reason = f"recording.mcap is truncated at t = {end:.1f} s of {until:.1f} s: copy it again"
        outcome = "interrupted"
    if not phases:
        phases = _phases_of(recording.events, end)
    elif not recording.complete:
        phases = [
            p if p.end_s <= end else p._replace(end_s=end, outcome="interrupted")
            for p in phases if p.start_s <= end
        ]  # fmt: skip
    return StoredRun(recording, phases, outcome, reason, read.timing, tuple(read.faults), old)


def _phases_of(events: list[Event], end: float) -> list[PhaseRecord]:
    """Return the phases of a killed run, from the events in its recording."""
    phases: list[PhaseRecord] = []
    for t, text in events:  # an outcome precedes the next phase, at the same time
        if (m := re.fullmatch(r"ended (.+)", text)) and phases:
            phases[-1] = phases[-1]._replace(outcome=m.group(1))
        elif m := re.fullmatch(r"phase (.+)", text):
            if phases:
                phases[-1] = phases[-1]._replace(end_s=t)
            phases.append(PhaseRecord(m.group(1), t, max(end, t), "done"))
    if phases:
        phases[-1] = phases[-1]._replace(outcome="interrupted")
    return phases
