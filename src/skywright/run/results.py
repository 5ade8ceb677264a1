"""Samples and results of a run, as arrays by name: `run = open_run(DIR); run["tip.p_W"]`."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from skywright.errors import InputError, check_path, neighbours
from skywright.recordings.columns import Column
from skywright.recordings.recording import Event, Recording, read_recording
from skywright.run.directory import load_run
from skywright.run.flight import PhaseRecord

_SUBJECTS = {"B": "platform", "T": "tip", "H": "hand", "O": ""}
_SOURCES = {"est": "estimate.", "ref": "reference.", "meas": "measured."}


class Run:
    """A run's directory, finished or not, opened for reading.

    `run[NAME]` is a column of the samples (100 Hz): (n,), or (n, k) for vectors; SI and radians.
    Quaternions are wxyz. NAME is that of docs/reference/messages.md (`p_WT`); poses and velocities
    also have names of body and quantity (`tip.p_W`, `estimate.platform.v_W`). A name that begins
    with a slash is a stream with its own times, a structured array with its `t` (s):
    `run["/sensors/inertial"]["gyro"]`.
    """

    def __init__(self, directory: Path) -> None:
        """`directory` is a run's, or NAME.partial; raises InputError as `open_run` does."""
        stored = load_run(directory)
        self.directory, self.recording = directory, stored.recording
        self.outcome, self.reason, self.phases = stored.outcome, stored.reason, stored.phases
        self.metrics: dict[str, float] = {
            name: float("nan") if value is None else value
            for name, value in stored.written.get("metrics", {}).items()
        }
        """Numbers by their names in docs/reference/metrics.md; NaN where one was not finite."""
        self.requirements: list[dict[str, Any]] = stored.written.get("requirements", [])
        """One dictionary each: name, value, unit, limit, sense, passed, where (of the phases)."""

    def __repr__(self) -> str:
        return f"<Run {self.directory}: {self.outcome}>"

    recording: Recording
    outcome: str
    reason: str
    phases: list[PhaseRecord]
    """Name, start_s, end_s and outcome of each phase."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns, in order: each has name, shape, dtype, unit and meaning."""
        return self.recording.columns

    @property
    def events(self) -> list[Event]:
        """The events of the flight, each with its time `t` (s) and text."""
        return self.recording.events

    @cached_property
    def _columns(self) -> dict[str, str]:
        """Column name by each of its aliases."""
        names = [c.name for c in self.columns]
        return {name: name for name in names} | {read_name(name): name for name in names}

    @property
    def names(self) -> list[str]:
        """All names that `run[NAME]` accepts, streams last."""
        return [*self._columns, *self.recording.stream_names]

    def __getitem__(self, name: str) -> NDArray[Any]:
        if str(name).startswith("/"):
            path = self.directory / "recording.mcap"
            return read_recording(path, [name]).streams[name]
        if name not in self._columns:
            near = neighbours(str(name), self._columns)
            raise InputError(f"{self.directory}: the run has no {name!r}; valid: {near}")
        return self.recording.samples[self._columns[name]]

    def __contains__(self, name: object) -> bool:
        return name in self._columns or name in self.recording.stream_names

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def to_dataframe(self) -> Any:
        """Return the samples as a pandas DataFrame over `t` (s), one column per number.

        Vectors in a frame end in `_x`, `_y`, `_z`, quaternions in `_w`, `_x`, `_y`, `_z`, others
        in `_0`, `_1`, ... Raises InputError if pandas is not installed (extra `pandas`).
        """
        try:
            import pandas
        except ImportError:
            raise InputError(
                "a DataFrame needs pandas: pip install skywright[pandas]; run[NAME] gives arrays "
                "without it"
            ) from None
        return pandas.DataFrame(flatten(self.recording)).set_index("t")


def open_run(directory: str | os.PathLike[str]) -> Run:
    """Read the directory of a run, or NAME.partial of an unfinished one.

    Raises InputError if it is not a run directory, or if a file in it is damaged.
    """
    check_path("directory", directory)
    return Run(Path(directory))


def read_name(column: str) -> str:
    """Return the name as body and quantity: `tip.p_W` for `p_WT`; other columns keep their name."""
    found = re.fullmatch(r"((?:[a-z]+\d*_)?)([pqvw])_W([BTHO])(_B)?", column)
    if found is None:
        return column
    owner, quantity, subject, in_body = found.groups()
    owner = owner.rstrip("_")
    whose = f"{_SOURCES.get(owner, owner)}{_SUBJECTS[subject]}"
    if owner and owner not in _SOURCES and subject == "H":
        whose = f"{owner}.hand"
    return f"{whose}.{quantity}{in_body or '_W'}"


def flatten(recording: Recording) -> dict[str, NDArray[Any]]:
    """Return the samples as columns of one number each, with vectors split."""
    flat: dict[str, NDArray[Any]] = {}
    for column in recording.columns:
        values = recording.samples[column.name]
        if not column.shape:
            flat[column.name] = values
            continue
        in_frame = re.search(r"_[A-Z]|^f_", column.name) and column.shape in ((3,), (4,))
        ends = "wxyz"[4 - column.shape[0] :] if in_frame else range(column.shape[0])
        flat |= {f"{column.name}_{end}": values[:, i] for i, end in enumerate(ends)}
    return flat
