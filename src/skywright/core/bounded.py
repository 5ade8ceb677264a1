"""Reading files of unknown origin: regular files of limited size and nesting depth.

A device (`/dev/zero`), a pipe without a writer or a file of gigabytes would otherwise exhaust the
memory or block forever.
"""

import json
import os
import stat
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from skywright.errors import InputError

LARGEST_TOML = 5_000_000
"""Bytes of a description; a mission with all its keys takes 0.05 MB."""
LARGEST_CODE = 5_000_000
LARGEST_TABLE = 200_000_000
LARGEST_RECORDING = 8_000_000_000
DEEPEST = 40
"""Largest nesting depth of tables and lists; a description needs 8."""


def read_bytes(path: Path, limit: int, advice: str = "", label: str | None = None) -> bytes:
    """Return the content of a regular file of at most `limit` bytes.

    Raises InputError if the file does not exist, cannot be read, is not a regular file, or is
    larger; `advice` is then added to the message. `label` is the name of the file in messages.
    """
    label, more = label or str(path), f"; {advice}" if advice else ""
    try:
        there = os.stat(path)  # opening a pipe would block until it has a writer
        if not stat.S_ISREG(there.st_mode):
            kind = "directory" if stat.S_ISDIR(there.st_mode) else "device or pipe"
            raise InputError(f"{label}: is a {kind}; a file is needed")
        with open(path, "rb") as file:
            data = file.read(min(limit, max(there.st_size, 1_000_000)) + 1)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{label}: cannot be read ({why})") from None
    if max(len(data), there.st_size) > limit:
        raise InputError(f"{label}: larger than {limit / 1e6:g} MB{more}")
    return data


def read_text(path: Path, limit: int, advice: str = "", label: str | None = None) -> str:
    """Return a file's text in UTF-8; limits and errors are those of `read_bytes`."""
    try:
        return read_bytes(path, limit, advice, label).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{label or path}: not a text file in UTF-8 (byte {error.start})"
        ) from None


def parse_toml(text: str, label: str) -> dict[str, Any]:
    """Parse TOML; raises InputError with one line if it is malformed or nested too deeply."""
    return _parse(tomllib.loads, text, label, "TOML")


def parse_json(text: str, label: str) -> Any:
    """Parse JSON; raises InputError with one line if it is malformed or nested too deeply."""
    return _parse(json.loads, text, label, "JSON")


def _parse(parse: Any, text: str, label: str, kind: str) -> Any:
    try:
        found = parse(text)
    except RecursionError:
        found = _too_deep()
    except ValueError as error:  # also raised for a number too long to convert
        raise InputError(f"{label}: malformed {kind}: {str(error).splitlines()[0]}") from None
    level: Iterable[Any] = [found]
    for _ in range(DEEPEST):
        level = [child for value in level for child in _list_children(value)]
        if not level:
            return found
    raise InputError(
        f"{label}: malformed {kind}: tables or lists nested too deeply; at most {DEEPEST} levels"
    )


def _list_children(value: Any) -> Iterable[Any]:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _too_deep() -> list[Any]:
    out: list[Any] = []
    for _ in range(DEEPEST):
        out = [out]
    return [out]
