"""Finding description files: built-in names first, then the user's own paths."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from skywright.errors import InputError, neighbours


class Found(NamedTuple):
    """A description file and its name in messages."""

    path: Path
    label: str


class Entry(NamedTuple):
    """One built-in description, for `skywright list`."""

    name: str
    description: str


def list_folders(data: Path, kind: str) -> dict[str, Path]:
    """List the built-in files of a kind by name: those in the folders of `data`."""
    return {p.parent.name: p for p in sorted(data.glob(f"*/{kind}.toml"))}


def list_entries(known: Mapping[str, Path], kind: str) -> list[Entry]:
    """List the built-in descriptions of a kind with their one-line descriptions."""
    return [Entry(n, _read(p)[kind].get("description", "")) for n, p in sorted(known.items())]


@cache  # built-in files do not change
def _read(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def find_file(
    name: str | os.PathLike[str],
    known: Mapping[str, Path],
    kind: str,
    folders: Sequence[Path] = (),
) -> Found:
    """Find a description by built-in name (in `known`), or by the path of a file or its folder.

    A relative path is looked up in `folders` in order, then in the current folder.
    Raises InputError that lists the built-in names.
    """
    text = os.fspath(name)
    if text in known:
        return Found(known[text], f"{kind} {text}")
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
    shown = text if len(text) <= 80 else text[:77] + "..."
    raise InputError(
        f"unknown {kind} {shown!r}: no built-in name, no file and no folder with {kind}.toml; "
        f"built-in {kind}s: {neighbours(text, known, count=20)}"
    )
