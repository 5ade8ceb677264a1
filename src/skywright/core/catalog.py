"""Finding description files: built-in names first, then the user's own paths."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from skywright.errors import InputError, neighbours


class Found(NamedTuple):
    """A description file and what messages call it."""

    path: Path
    label: str


class Entry(NamedTuple):
    """One built-in description, for `skywright list`."""

    name: str
    description: str


def list_names(data: Path, kind: str) -> list[str]:
    """List the built-in names of a kind: the folders of `data` that hold `<kind>.toml`."""
    return sorted(p.parent.name for p in data.glob(f"*/{kind}.toml"))


def list_entries(data: Path, kind: str) -> list[Entry]:
    """List the built-in descriptions of a kind with their one-line descriptions."""
    entries = []
    for name in list_names(data, kind):
        root = tomllib.loads((data / name / f"{kind}.toml").read_text(encoding="utf-8"))[kind]
        entries.append(Entry(name, root.get("description", "")))
    return entries


def find_file(
    name: str | os.PathLike[str], data: Path, kind: str, folders: Sequence[Path] = ()
) -> Found:
    """Find a description by built-in name, or by the path of a file or of a folder that holds one.

    A relative path is looked up in `folders` in order, then in the current folder.
    Raises InputError that lists the built-in names.
    """
    text = os.fspath(name)
    if text in list_names(data, kind):
        return Found(data / text / f"{kind}.toml", f"{kind} {text}")
    if text and "\0" not in text:
        for folder in [*folders, Path()]:
            path = folder / Path(text).expanduser()
            try:
                if path.is_dir() and (path / f"{kind}.toml").is_file():
                    path = path / f"{kind}.toml"
                if path.is_file():
                    return Found(path, str(path))
            except OSError:  # a name longer than the file system allows
                continue
    names = list_names(data, kind)
    shown = text if len(text) <= 80 else text[:77] + "..."
    raise InputError(
        f"unknown {kind} {shown!r}: no built-in name and no file; "
        f"built-in {kind}s: {neighbours(text, names, count=20)}"
    )
