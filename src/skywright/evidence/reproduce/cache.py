"""Flights cached by content: the same flight of the same code is flown once.

The key contains the resolved description, the kind of evaluation, and everything on which the
result depends: the source of the flying packages, a user's law, and the versions of MuJoCo, numba,
NumPy and SciPy. A damaged entry is flown again. Without disk space the cache is unused; results do
not change.
"""

import contextlib
import hashlib
import json
import os
import shutil
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.run.source_hash import collect_code_versions
from skywright.run.versions import collect_versions

FLIGHTS = (
    "evidence/reproduce/flights.py", "evidence/reproduce/flights_arms.py",
    "evidence/force_estimators.py", "analysis/compare/flown.py",
)  # fmt: skip
"""Further source files on which the results depend."""

KEEP = 3
"""Number of versions of the source whose flights are kept."""


class Record(NamedTuple):
    """Stored result of a flight: JSON values and arrays."""

    info: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


def default_folder() -> Path:
    """Return the user's cache folder for flights."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "skywright" / "reproduce"


def hash_source() -> str:
    """Return a hash of the source and of the versions on which a flight depends."""
    versions = {**collect_versions(), **collect_code_versions(*FLIGHTS)}
    return hashlib.sha256(json.dumps(versions, sort_keys=True).encode()).hexdigest()[:16]


class Cache:
    """A folder of flights; with `folder` None nothing is kept."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.trouble = ""  # why the last flight could not be kept

    def path(self, content: str) -> Path | None:
        """Return the file of the flight with this content."""
        if self.folder is None:
            return None
        key = hashlib.sha256(content.encode()).hexdigest()[:24]
        return self.folder / hash_source() / f"{key}.npz"

    def load(self, content: str) -> Record | None:
        """Return the flight; None if it is missing or damaged."""
        path = self.path(content)
        if path is None or not path.is_file():
            return None
        try:
            with np.load(path, allow_pickle=False) as data:
                info = json.loads(str(data["info"]))
                return Record(info, {k: data[k] for k in data.files if k != "info"})
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def store(self, content: str, record: Record) -> None:
        """Keep a flight; `trouble` holds the reason if that fails."""
        path = self.path(content)
        if path is None:
            return
        scratch = path.with_name(f"{path.stem}.{os.getpid()}.tmp")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with scratch.open("wb") as file:
                arrays: dict[str, Any] = dict(record.arrays)
                np.savez(file, info=np.array(json.dumps(record.info)), **arrays)
            scratch.replace(path)
        except OSError as error:
            self.trouble = f"{path.parent}: flights are not kept: {error.strerror or error}"
            with contextlib.suppress(OSError):
                scratch.unlink()

    def prune(self) -> None:
        """Remove the flights of all but the newest versions of the source."""
        if self.folder is None or not self.folder.is_dir():
            return
        versions = [p for p in self.folder.iterdir() if p.is_dir() and len(p.name) == 16]
        versions.sort(key=lambda p: p.stat().st_mtime, reverse=True)
        for old in versions[KEEP:]:
            shutil.rmtree(old, ignore_errors=True)
