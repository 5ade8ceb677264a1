"""The recording of a run: samples to and from an MCAP file of ROS 2 messages.

A batch of samples (about a second) becomes one chunk of the file: all messages of one sample make
a row of fixed layout, so that NumPy writes each field of all rows at once (core/cdr.py). Every
field of SAMPLE is read back bit for bit. Quaternions are xyzw in the file, as ROS has them, and
wxyz everywhere else. Time stamps count from the start of the run.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core import messages
from skywright.core.mcap_file import McapContents, McapWriter, build_message_header, read_mcap
from skywright.core.messages import PARTS, TOPICS, list_topics
from skywright.core.sample_rows import (
    BATCH,
    QUATERNIONS,
    build_log_layout,
    build_message_dtype,
    build_rows,
    build_topic_layout,
    compute_stamp,
)
from skywright.core.types import MAX_JOINTS, MAX_ROTORS, SAMPLE
from skywright.errors import InputError

METADATA = "skywright.recording"
FORMAT = "1"
"""Version of topics, types and metadata; a change that old readers misread raises it."""

_INFO = 20  # rcl_interfaces/Log.INFO
_MAX_TIME = 2**31  # s; a ROS stamp holds int32 seconds


class Event(NamedTuple):
    """Something that happened at `t` (s, to the nanosecond), such as the start of a phase."""

    t: float
    text: str


class Recording(NamedTuple):
    """A recording read back; `complete` is False where the file was cut short (a killed run)."""

    samples: NDArray[Any]  # of SAMPLE
    events: list[Event]
    attachments: dict[str, bytes]
    joint_names: tuple[str, ...]
    n_rotors: int
    complete: bool


class RecordingWriter:
    """Writes a recording while the run goes on; what was appended survives a killed process.

    `joint_names` and `n_rotors` say which entries of the joint and rotor fields the robot has,
    `parts` which of `messages.PARTS` robot and world have; all else, which is zero by definition,
    is not written and read back as zero.
    Raises InputError when the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        joint_names: Sequence[str],
        n_rotors: int,
        parts: Sequence[str] = PARTS,
    ) -> None:
        assert len(joint_names) <= MAX_JOINTS and n_rotors <= MAX_ROTORS
        self._path = Path(path)
        self._error = ""
        self._stream: BinaryIO | None = None
        topics = list_topics(parts)
        self._rows = build_rows(joint_names, n_rotors, topics)
        self._events_channel = len(topics) + 1
        self._starts = np.arange(BATCH, dtype=np.uint64) * np.uint64(self._rows.dtype.itemsize)
        self._places = [(i, np.uint64(at)) for i, at in enumerate(self._rows.offsets, 1)]
        with self._writing():
            self._stream = self._path.open("wb", buffering=1 << 20)
            self._mcap = McapWriter(self._stream, f"skywright {_version()}")
            info = {
                "format": FORMAT,
                "joint_names": json.dumps(list(joint_names)),
                "n_rotors": str(n_rotors),
                "parts": json.dumps(list(parts)),
            }
            self._mcap.add_metadata(METADATA, info)
            for topic in (*topics, messages.EVENTS):
                name = messages.full_name(topic.kind)
                self._mcap.add_channel(topic.name, name, messages.definition(topic.kind))

    def append(self, samples: NDArray[Any]) -> None:
        """Append a batch of samples (an array of SAMPLE), best about a second long.

        Raises InputError when a time is not finite or out of range, or the disk is full.
        """
        assert samples.dtype == SAMPLE and samples.ndim == 1
        for start in range(0, len(samples), BATCH):
            batch = samples[start : start + BATCH]
            ns = self._nanoseconds(batch["t"])
            data = self._rows.encode(batch, ns)
            offsets = {i: self._starts[: len(batch)] + at for i, at in self._places}
            with self._writing():
                self._mcap.add_chunk(data, ns, offsets)

    def event(self, t: float, text: str) -> None:
        """Note what happened at time `t` (s). Raises InputError like `append`."""
        ns = self._nanoseconds(np.array([t]))
        layout = build_log_layout(text)
        body = bytearray(layout.template)
        struct.pack_into("<Q", body, layout.column("stamp").offset, int(compute_stamp(ns)[0]))
        struct.pack_into("<B", body, layout.column("level").offset, _INFO)
        channel = self._events_channel
        data = build_message_header(channel, len(body), int(ns[0])) + body
        with self._writing():
            self._mcap.add_chunk(data, ns, {channel: np.zeros(1, np.uint64)})

    def attach(self, name: str, data: bytes) -> None:
        """Put a file into the recording, such as the resolved mission.toml."""
        media_type = "application/toml" if name.endswith(".toml") else "application/octet-stream"
        with self._writing():
            self._mcap.add_attachment(name, data, media_type)

    def close(self) -> None:
        """Finish the file; a second call does nothing."""
        if self._stream is None or self._stream.closed:
            return
        with self._writing():
            self._mcap.finish()
            self._stream.close()

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn an error of the operating system into one line; every later call repeats it."""
        if self._error:
            raise InputError(self._error)
        try:
            yield
        except OSError as error:
            self._error = f"cannot write {self._path}: {error.strerror or error}"
            if self._stream is not None:
                with suppress(OSError):
                    self._stream.close()
            raise InputError(self._error) from error

    def _nanoseconds(self, t: NDArray[Any]) -> NDArray[Any]:
        good = (t >= 0) & (t < _MAX_TIME)  # False for NaN
        if not good.all():
            wrong = t[~good][0]
            raise InputError(f"{self._path}: a time of {wrong} s; valid is 0 to {_MAX_TIME} s")
        return np.rint(t * 1e9).astype(np.uint64)


def read_recording(path: Path) -> Recording:
    """Read a recording, also one that was cut short at any byte by a killed run.

    Raises InputError when the file cannot be read, is empty, no MCAP file, no recording of
    Skywright, damaged, or cut before the first sample could be.
    """
    path = Path(path)
    contents = read_mcap(path)
    info = contents.metadata.get(METADATA)
    if info is None:
        raise _no_recording(path, contents)
    if info.get("format") != FORMAT:
        raise InputError(
            f"{path}: has recording format {info.get('format')!r}; this version reads {FORMAT!r}"
        )
    try:
        joint_names = tuple(map(str, json.loads(info["joint_names"])))
        n_rotors = int(info["n_rotors"])
        parts = tuple(map(str, json.loads(info.get("parts", "[]"))))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: has damaged metadata {METADATA!r}") from error
    known = all(part in PARTS for part in parts)
    unlisted = any(t.part and t.part not in parts and t.name in contents.messages for t in TOPICS)
    if not known or unlisted or len(joint_names) > MAX_JOINTS or not 0 <= n_rotors <= MAX_ROTORS:
        raise InputError(f"{path}: has damaged metadata {METADATA!r}")
    samples = _decode_samples(path, contents, joint_names, n_rotors, parts)
    events = [_decode_event(path, raw) for raw in contents.messages.get(messages.EVENTS.name, [])]
    return Recording(
        samples, events, contents.attachments, joint_names, n_rotors, contents.complete
    )


def _no_recording(path: Path, contents: McapContents) -> InputError:
    if contents.messages or contents.complete:
        topics = ", ".join(sorted(contents.messages)[:5]) or "none"
        return InputError(
            f"{path}: is an MCAP file but no recording of Skywright "
            f"(its topics: {topics}; expected {TOPICS[0].name}, {TOPICS[1].name}, ...)"
        )
    return InputError(f"{path}: was cut before the first sample; nothing can be read")


def _decode_samples(
    path: Path,
    contents: McapContents,
    joint_names: Sequence[str],
    n_rotors: int,
    parts: Sequence[str],
) -> NDArray[Any]:
    """Put the messages of all topics back into samples."""
    topics = [topic for topic in list_topics(parts) if not topic.derived]
    raw = {topic.name: contents.messages.get(topic.name, []) for topic in topics}
    counts = {len(m) for m in raw.values()}
    if max(counts) - min(counts) > 1:  # one: another tool may cut within a sample
        least = min(raw, key=lambda name: len(raw[name]))
        raise InputError(
            f"{path}: topic {least} has {len(raw[least])} messages where others have "
            f"{max(counts)}; a recording needs all its topics in full"
        )
    samples = np.zeros(min(counts), SAMPLE)
    for topic in topics:
        layout = build_topic_layout(topic, joint_names, n_rotors)
        size = len(layout.template)
        chunks = raw[topic.name][: len(samples)]
        data = b"".join(chunks)
        if any(len(part) != size for part in chunks):
            raise InputError(f"{path}: topic {topic.name} has messages of another version")
        dtype = build_message_dtype(topic, layout)
        rows = np.frombuffer(data, dtype)
        for message_path in dtype.names or ():
            field = topic.fields[message_path]
            values, target = rows[message_path], samples[field]
            if field in QUATERNIONS:
                target[:, 0], target[:, 1:] = values[:, 3], values[:, :3]
            elif target.ndim == 2:
                target[:, : values.shape[1]] = values
            else:
                target[:] = values
    return samples


def _decode_event(path: Path, raw: bytes) -> Event:
    try:
        sec, nanosec = struct.unpack_from("<iI", raw, 4)
        at = 16  # CDR header 4, stamp 8, level 1, alignment 3
        (length,) = struct.unpack_from("<I", raw, at)
        at += 4 + length
        at += -at % 4
        (length,) = struct.unpack_from("<I", raw, at)
        t = (sec * 10**9 + nanosec) / 1e9  # one rounding: 5.76 s is read back as 5.76
        return Event(t, raw[at + 4 : at + 3 + length].decode())
    except (struct.error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: has a damaged message on {messages.EVENTS.name}") from error


def _version() -> str:
    try:
        return version("skywright")
    except PackageNotFoundError:
        return "unknown"
