"""Read a recording: its metadata list the columns, its schemas define the messages.

Metadata of format 1 do not list the columns of the topics. format_1.json lists them by the parts
(hands, loads, ...) of the run's robot and world.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Collection, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.recordings.columns import Column, build_dtype
from skywright.recordings.mcap_file import McapContents, read_mcap
from skywright.recordings.messages import EVENTS
from skywright.recordings.sample_rows import read_log, read_rows
from skywright.recordings.writer import FORMAT, METADATA, checksum

# Exceptions that metadata and schemas of a damaged or foreign file can raise.
_DAMAGE = (LookupError, TypeError, ValueError, AttributeError, RecursionError, struct.error)

Fields = Mapping[str, str]
"""Path in a message -> column."""


class Event(NamedTuple):
    """An event at `t` (s, with a resolution of 1 ns), such as the start of a phase."""

    t: float
    text: str


class Recording(NamedTuple):
    """A recording that was read; `complete` is False if the file was truncated (a killed run).

    `samples` (n,) has one field for each of `columns`. A part that the run lacked has no columns.
    """

    samples: NDArray[Any]
    columns: tuple[Column, ...]
    topics: Mapping[str, Fields]
    streams: dict[str, NDArray[Any]]
    events: list[Event]
    attachments: dict[str, bytes]
    info: dict[str, Any]
    complete: bool
    stream_names: tuple[str, ...] = ()


class _Head(NamedTuple):
    """Contents of the metadata. `columns` is None in format 1: the messages determine them."""

    columns: tuple[Column, ...] | None
    topics: Mapping[str, Fields]
    streams: dict[str, tuple[tuple[Column, ...], Fields]]
    info: dict[str, Any]


def read_recording(path: Path, streams: Collection[str] = ()) -> Recording:
    """Read a recording, or the readable part of a recording that a killed run left truncated.

    Only the streams that `streams` names are decoded. Raises InputError if the file cannot be
    read, is empty, is not an MCAP file or not a recording of Skywright, has an unknown format, is
    damaged, ends before the first sample, or has no such stream.
    """
    path = Path(path)
    contents = read_mcap(path)
    info = contents.metadata.get(METADATA)
    if info is None:
        raise _no_recording(path, contents)
    form = info.get("format")
    if form not in ("1", FORMAT):
        raise InputError(
            f"{path}: has recording format {form!r}; this version reads '1' and {FORMAT!r}"
        )
    try:
        head = _read_head_1(info, contents) if form == "1" else _read_head(info, contents)
    except _DAMAGE as error:
        raise InputError(f"{path}: has damaged metadata {METADATA!r}") from error
    missing = sorted(set(streams) - set(head.streams))
    if missing:
        raise InputError(
            f"{path}: has no stream {missing[0]!r}; it has {', '.join(head.streams) or 'none'}"
        )
    found = _decode(path, contents, head.topics)
    columns = head.columns or tuple(
        Column(name, values.shape[1:], values.dtype.str) for name, values in found.items()
    )
    samples = _assemble(path, columns, found)
    rows = {}
    for name in streams:
        parts, fields = head.streams[name]
        rows[name] = _assemble(path, parts, _decode(path, contents, {name: fields}, stamped=True))
    return Recording(
        samples, columns, head.topics, rows, _read_events(path, contents), contents.attachments,
        head.info, contents.complete, tuple(head.streams),
    )  # fmt: skip


def _read_head(info: dict[str, str], contents: McapContents) -> _Head:
    """Read the metadata of format 2. Raises one of _DAMAGE if they are damaged."""
    names = ("columns", "topics", "streams", "info", "definitions")
    metadata = {name: info[name] for name in names}
    if info["crc32"] != str(checksum(json.dumps(sorted(metadata.items())))):
        raise ValueError("checksum")
    for name, wanted in json.loads(metadata["definitions"]).items():
        if checksum(contents.definitions.get(name, "")) not in (wanted, 0):  # 0: no channel
            raise ValueError("definitions")
    topics, streams = json.loads(metadata["topics"]), json.loads(metadata["streams"])
    return _Head(
        _read_columns(json.loads(metadata["columns"])),
        topics,
        {name: (_read_columns(parts), fields) for name, (parts, fields) in streams.items()},
        json.loads(metadata["info"]),
    )


def _read_columns(rows: list[list[Any]]) -> tuple[Column, ...]:
    return tuple(Column(n, tuple(s), *more) for n, s, *more in rows)


def _read_head_1(info: dict[str, str], contents: McapContents) -> _Head:
    """Read the metadata of format 1. Raises one of _DAMAGE if they are damaged."""
    table = _load_format_1()
    parts = ["", *json.loads(info.get("parts", "[]"))]
    topics = {name: fields for part in parts for name, fields in table[part].items()}
    others = {name for part in table.values() for name in part} - set(topics)
    if others & set(contents.messages):
        raise ValueError("parts")
    names = [str(name) for name in json.loads(info["joint_names"])]
    return _Head(None, topics, {}, {"joint_names": names, "n_rotors": int(info["n_rotors"])})


@cache
def _load_format_1() -> dict[str, dict[str, dict[str, str]]]:
    text = (files("skywright.core") / "format_1.json").read_text(encoding="utf-8")
    table: dict[str, dict[str, dict[str, str]]] = json.loads(text)
    return table


def _no_recording(path: Path, contents: McapContents) -> InputError:
    if contents.messages or contents.complete:
        topics = ", ".join(sorted(contents.messages)[:5]) or "none"
        return InputError(
            f"{path}: is an MCAP file but not a recording of Skywright (its topics: "
            f"{topics}; no metadata {METADATA!r})"
        )
    return InputError(f"{path}: ends before the first sample")


def _decode(
    path: Path, contents: McapContents, topics: Mapping[str, Fields], stamped: bool = False
) -> dict[str, NDArray[Any]]:
    """Decode the messages of all topics into columns of equal length.

    `stamped` adds `t` from the stamps. Raises InputError if the numbers of messages differ by more
    than 1, or if messages do not match their definition.
    """
    raw = {name: contents.messages.get(name, []) for name in topics}
    counts = {len(m) for m in raw.values()} or {0}
    if max(counts) - min(counts) > 1:  # 1: another tool may cut within a sample
        least = min(raw, key=lambda name: len(raw[name]))
        raise InputError(
            f"{path}: topic {least} has {len(raw[least])} messages, others have "
            f"{max(counts)}; all topics of a recording must be complete"
        )
    found: dict[str, NDArray[Any]] = {}
    for name, fields in topics.items():
        kind = contents.kinds.get(name, ("", ""))[0].replace("/msg/", "/")
        try:
            if kind:
                text = contents.definitions[name]
                found |= read_rows(kind, text, fields, raw[name][: min(counts)], stamped)
        except _DAMAGE as error:
            raise InputError(f"{path}: topic {name} has messages without a definition") from error
    return found


def _assemble(
    path: Path, columns: tuple[Column, ...], found: dict[str, NDArray[Any]]
) -> NDArray[Any]:
    """Return samples (n,) with all columns.

    Raises InputError if a column is missing or has another shape, unless it is empty by its shape.
    """
    n = max(map(len, found.values()), default=0)
    samples = np.zeros(n, build_dtype(columns))
    for column in columns:
        values = found.get(column.name)
        if values is None or values.shape[1:] != column.shape:
            if n and 0 not in column.shape:
                raise InputError(f"{path}: has no column {column.name}, but its metadata list it")
        else:
            samples[column.name] = values
    return samples


def _read_events(path: Path, contents: McapContents) -> list[Event]:
    try:
        return [Event(*read_log(m)) for m in contents.messages.get(EVENTS.name, [])]
    except (struct.error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: has a damaged message on {EVENTS.name}") from error
