"""The folder of a campaign: identity and journal.

Each finished run is appended to `runs.jsonl` and synced to disk immediately, so that an
interruption loses only the runs in flight. The same command continues the campaign.
"""

import fcntl
import json
import math
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, BinaryIO

from pydantic import ConfigDict, Field

from skywright.core.bounded import (
    LARGEST_RECORDING,
    LARGEST_TOML,
    parse_json,
    read_bytes,
    read_text,
)
from skywright.errors import InputError
from skywright.run.rows import Row, Value
from skywright.run.stored import Stored

Count = Annotated[int, Field(ge=0, lt=2**63)]

IDENTITY = "campaign.json"
JOURNAL = "runs.jsonl"

_CHANGED = {
    "description": "the mission's files",
    "values": "the values of a CSV file",
    "law": "the file of a control law, or of a robot or world that varies",
}
"""Descriptions of the identity's entries that are hashes."""


class Store:
    """An open campaign folder; a lock on the journal excludes a second writer."""

    def __init__(self, folder: Path, identity: dict[str, Any]) -> None:
        """Open `folder` for the campaign with this identity; create the folder if it does not
        exist.

        Raises InputError if it holds other content, is in use, or cannot be written.
        """
        self.folder, self.rows = folder, dict[int, Row]()
        check_folder(folder, identity)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not (folder / IDENTITY).exists():
                text = json.dumps(identity, indent=2) + "\n"
                self.write(IDENTITY, lambda path: path.write_text(text, encoding="utf-8"))
            if (folder / JOURNAL).exists() and not (folder / JOURNAL).is_file():
                raise InputError(f"{folder / JOURNAL}: is a device or pipe; a file is needed")
            self._file: BinaryIO = (folder / JOURNAL).open("ab")
        except OSError as error:
            raise InputError(f"cannot write into {folder}: {error.strerror or error}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise InputError(f"{folder}: another process is running this campaign") from None
        try:
            check_folder(folder, identity)  # another campaign may have begun here since
            self.rows = {row.run: row for row in self._load_journal()}
        except BaseException:
            self._file.close()
            raise

    def append(self, row: Row) -> None:
        """Append a finished run. Raises InputError if writing fails."""
        line = json.dumps(encode_row(row), allow_nan=False) + "\n"
        try:
            self._file.write(line.encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise InputError(self._explain(JOURNAL, error)) from None
        self.rows[row.run] = row

    def write(self, name: str, write: Callable[[Path], object]) -> Path:
        """Write a file of the folder under a temporary name and rename it when it is complete."""
        path = self.folder / name
        partial = path.with_name(name + ".partial")
        try:
            write(partial)
            partial.replace(path)
        except OSError as error:
            partial.unlink(missing_ok=True)
            raise InputError(self._explain(name, error)) from None
        return path

    def close(self) -> None:
        """Release the folder."""
        with suppress(OSError):  # `append` has reported what could not be written
            self._file.close()

    def _explain(self, name: str, error: OSError) -> str:
        return (
            f"cannot write {self.folder / name}: {error.strerror or error}; {len(self.rows)} "
            "finished runs are kept, the same command continues"
        )

    def _load_journal(self) -> list[Row]:
        """Read the rows and truncate an incomplete last line."""
        path = self.folder / JOURNAL
        data = read_bytes(path, LARGEST_RECORDING)
        complete = data.rfind(b"\n") + 1
        if complete < len(data):
            os.truncate(path, complete)
        rows = []
        for number, line in enumerate(data[:complete].splitlines(), start=1):
            try:
                rows.append(decode_row(json.loads(line)))
            except (ValueError, RecursionError) as error:
                why = str(error)[:200] or type(error).__name__
                raise InputError(
                    f"{path}, line {number}: is damaged ({why}); remove the line to repeat that run"
                ) from None
        return rows


def check_folder(folder: Path, identity: dict[str, Any]) -> None:
    """Check that `folder` can hold this campaign. Raises InputError that states the difference."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: is a file; give another --out")
    if not any(folder.iterdir()):
        return
    differs = compare_identity(folder, identity)
    if differs is not None:
        raise InputError(f"{folder}: {differs}; give another --out")


def compare_identity(folder: Path, identity: dict[str, Any]) -> str | None:
    """Return how the campaign in `folder` differs from this one; None if it is the same."""
    path = folder / IDENTITY
    if not path.is_file():
        return "is not empty and contains no campaign"
    try:
        old = parse_json(read_text(path, LARGEST_TOML), str(path))
    except InputError as error:
        return f"{IDENTITY} cannot be read ({error})"
    if not isinstance(old, dict):
        return f"{IDENTITY} is damaged"
    if old == identity:
        return None
    for name in identity:
        a, b = old.get(name), identity[name]
        if a == b:
            continue
        if name == "versions":
            return "contains this campaign, run by another version of Skywright"
        if name in _CHANGED:
            return f"contains another campaign: {_CHANGED[name]} changed since"
        return f"contains another campaign: its {name} is {json.dumps(a)}, not {json.dumps(b)}"
    return "holds another campaign"


def encode_row(row: Row) -> dict[str, Any]:
    """Convert a row to JSON types; NaN becomes null."""
    out = row._asdict()
    out["failed"] = list(row.failed)
    for name in ("metrics", "timing"):
        out[name] = {k: v if math.isfinite(v) else None for k, v in out[name].items()}
    return out


class _Line(Stored):
    """Schema of a row that `encode_row` writes."""

    model_config = ConfigDict(extra="forbid")

    run: Count
    seed: Count
    outcome: str
    requirement: str
    failed: list[str]
    reason: str
    varied: dict[str, Value]
    metrics: dict[str, float | None]
    timing: dict[str, float | None]
    attempts: Count
    command: str
    inspected: dict[str, Any] | None = None


def decode_row(data: Any) -> Row:
    """Invert `encode_row`. Raises ValueError on other data."""
    line = _Line.read(data)
    metrics, timing = (
        {k: math.nan if v is None else v for k, v in told.items()}
        for told in (line.metrics, line.timing)
    )
    return Row(
        line.run, line.seed, line.outcome, line.requirement, tuple(line.failed), line.reason,
        line.varied, metrics, timing, line.attempts, line.command, line.inspected,
    )  # fmt: skip
