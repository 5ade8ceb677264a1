"""The recording of a run: samples to and from an MCAP file of ROS 2 messages.

A batch of samples (about a second) becomes one chunk of the file: all messages of one sample make
a row of fixed layout, so that NumPy writes each field of all rows at once (core/cdr.py). Every
field of SAMPLE is read back bit for bit. Quaternions are xyzw in the file, as ROS has them, and
wxyz everywhere else. Time stamps count from the start of the run.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core import messages
from skywright.core.cdr import Column, Layout, build_layout
from skywright.core.messages import TOPICS, Topic
from skywright.core.types import MAX_JOINTS, MAX_ROTORS, SAMPLE
from skywright.errors import InputError

if TYPE_CHECKING:  # loaded when a recording is written or read, not with every command
    from skywright.core.mcap_file import McapContents

METADATA = "skywright.recording"
FORMAT = "1"
"""Version of topics, types and metadata; a change that old readers misread raises it."""

_QUATERNIONS = frozenset(n for n in SAMPLE.names or () if "q_W" in n)
_BATCH = 256  # samples; the most in one chunk
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

    `joint_names` and `n_rotors` say which entries of the joint and rotor fields the robot has;
    the others, which are zero by definition, are not written and read back as zero.
    Raises InputError when the file cannot be written.
    """

    def __init__(self, path: Path, joint_names: Sequence[str], n_rotors: int) -> None:
        from skywright.core.mcap_file import McapWriter

        assert len(joint_names) <= MAX_JOINTS and n_rotors <= MAX_ROTORS
        self._path = path
        self._rows = _build_rows(joint_names, n_rotors)
        self._starts = np.arange(_BATCH, dtype=np.uint64) * np.uint64(self._rows.dtype.itemsize)
        self._places = [(i, np.uint64(at)) for i, at in enumerate(self._rows.offsets, 1)]
        try:
            self._stream = path.open("wb", buffering=1 << 20)
            self._mcap = McapWriter(self._stream, f"skywright {_version()}")
            info = {
                "format": FORMAT,
                "joint_names": json.dumps(list(joint_names)),
                "n_rotors": str(n_rotors),
            }
            self._mcap.add_metadata(METADATA, info)
            for topic in (*TOPICS, messages.EVENTS):
                name = messages.full_name(topic.kind)
                self._mcap.add_channel(topic.name, name, messages.definition(topic.kind))
        except OSError as error:
            raise self._cannot_write(error) from error

    def append(self, samples: NDArray[Any]) -> None:
        """Append a batch of samples (an array of SAMPLE), best about a second long.

        Raises InputError when a time is not finite or out of range, or the disk is full.
        """
        assert samples.dtype == SAMPLE and samples.ndim == 1
        for start in range(0, len(samples), _BATCH):
            batch = samples[start : start + _BATCH]
            ns = self._nanoseconds(batch["t"])
            data = self._rows.encode(batch, ns)
            offsets = {i: self._starts[: len(batch)] + at for i, at in self._places}
            try:
                self._mcap.add_chunk(data, ns, offsets)
            except OSError as error:
                raise self._cannot_write(error) from error

    def event(self, t: float, text: str) -> None:
        """Note what happened at time `t` (s). Raises InputError like `append`."""
        ns = self._nanoseconds(np.array([t]))
        layout = _log_layout(text)
        body = bytearray(layout.template)
        struct.pack_into("<Q", body, layout.column("stamp").offset, int(_stamp(ns)[0]))
        struct.pack_into("<B", body, layout.column("level").offset, _INFO)
        channel = len(TOPICS) + 1
        data = _message_header(channel, len(body), int(ns[0])) + body
        try:
            self._mcap.add_chunk(data, ns, {channel: np.zeros(1, np.uint64)})
        except OSError as error:
            raise self._cannot_write(error) from error

    def attach(self, name: str, data: bytes) -> None:
        """Put a file into the recording, such as the resolved mission.toml."""
        media_type = "application/toml" if name.endswith(".toml") else "application/octet-stream"
        try:
            self._mcap.add_attachment(name, data, media_type)
        except OSError as error:
            raise self._cannot_write(error) from error

    def close(self) -> None:
        """Finish the file; a second call does nothing."""
        if self._stream.closed:
            return
        try:
            self._mcap.finish()
            self._stream.close()
        except OSError as error:
            raise self._cannot_write(error) from error

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _cannot_write(self, error: OSError) -> InputError:
        return InputError(f"cannot write {self._path}: {error.strerror or error}")

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
    from skywright.core.mcap_file import read_mcap

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
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: has damaged metadata {METADATA!r}") from error
    if len(joint_names) > MAX_JOINTS or not 0 <= n_rotors <= MAX_ROTORS:
        raise InputError(f"{path}: has damaged metadata {METADATA!r}")
    samples = _decode_samples(path, contents, joint_names, n_rotors)
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
    path: Path, contents: McapContents, joint_names: Sequence[str], n_rotors: int
) -> NDArray[Any]:
    """Put the messages of all topics back into samples."""
    topics = [topic for topic in TOPICS if not topic.derived]
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
        layout = _topic_layout(topic, joint_names, n_rotors)
        size = len(layout.template)
        parts = raw[topic.name][: len(samples)]
        data = b"".join(parts)
        if any(len(part) != size for part in parts):
            raise InputError(f"{path}: topic {topic.name} has messages of an unknown layout")
        dtype = _build_dtype(topic, layout)
        rows = np.frombuffer(data, dtype)
        for message_path in dtype.names or ():
            field = topic.fields[message_path]
            values, target = rows[message_path], samples[field]
            if field in _QUATERNIONS:
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
        return Event(sec + nanosec * 1e-9, raw[at + 4 : at + 3 + length].decode())
    except (struct.error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: has a damaged message on {messages.EVENTS.name}") from error


class _Fill(NamedTuple):
    """Which field of SAMPLE goes to which column of a row; `length` entries of it (0: a scalar)."""

    column: str
    field: str
    length: int


class _Rows(NamedTuple):
    """All messages of one sample, one after the other, as one row of bytes.

    `buffer` holds rows of the template and is reused: only the numbers in it change.
    """

    dtype: np.dtype[Any]
    buffer: NDArray[Any]
    offsets: list[int]  # of each topic's message record
    headers: list[str]  # columns of log and publish time
    stamps: list[str]
    fills: list[_Fill]

    def encode(self, samples: NDArray[Any], ns: NDArray[Any]) -> NDArray[Any]:
        """Return the message records of at most len(buffer) samples: a view of the buffer."""
        rows = self.buffer[: len(samples)]
        for name in self.headers:
            rows[name] = ns[:, None]
        stamp = _stamp(ns)
        for name in self.stamps:
            rows[name] = stamp
        for name, field, length in self.fills:
            column, values = rows[name], samples[field]
            if field in _QUATERNIONS:
                column[:, :3], column[:, 3] = values[:, 1:], values[:, 0]
            else:
                column[...] = values[:, :length] if length else values
        return rows.view(np.uint8)


def _build_rows(joint_names: Sequence[str], n_rotors: int) -> _Rows:
    template = bytearray()
    names: list[str] = []
    formats: list[Any] = []
    places: list[int] = []
    offsets: list[int] = []
    headers: list[str] = []
    stamps: list[str] = []
    fills: list[_Fill] = []

    def add(name: str, format: Any, place: int) -> str:
        names.append(name)
        formats.append(format)
        places.append(place)
        return name

    for channel, topic in enumerate(TOPICS, 1):
        layout = _topic_layout(topic, joint_names, n_rotors)
        header = _message_header(channel, len(layout.template), 0)
        start = len(template)
        body = start + len(header)
        offsets.append(start)
        headers.append(add(f"{topic.name} log_time", ("<u8", (2,)), body - 16))
        template += header + layout.template
        for path, column in layout.leaves.items():
            if path.endswith("stamp"):
                name = add(f"{topic.name} {path}", column.format, body + column.offset)
                stamps.append(name)
        for path, (field, column) in _bound_columns(topic, layout).items():
            name = add(f"{topic.name} {path}", _format(field, column), body + column.offset)
            fills.append(_Fill(name, field, column.length if SAMPLE[field].shape else 0))
    dtype = np.dtype(
        {"names": names, "formats": formats, "offsets": places, "itemsize": len(template)}
    )
    buffer = np.frombuffer(bytearray(template * _BATCH), dtype)
    return _Rows(dtype, buffer, offsets, headers, stamps, fills)


def _build_dtype(topic: Topic, layout: Layout) -> np.dtype[Any]:
    """Return the type of one message with the fields that hold fields of SAMPLE, by path."""
    bound = _bound_columns(topic, layout)
    return np.dtype(
        {
            "names": list(bound),
            "formats": [_format(field, column) for field, column in bound.values()],
            "offsets": [column.offset for _, column in bound.values()],
            "itemsize": len(layout.template),
        }
    )


def _bound_columns(topic: Topic, layout: Layout) -> dict[str, tuple[str, Column]]:
    """Return the field of SAMPLE and its place for each path; empty sequences have none."""
    empty = [p for p in topic.lengths if p in topic.fields and f"{p}[0]" not in layout.leaves]
    return {p: (f, layout.column(p)) for p, f in topic.fields.items() if p not in empty}


def _format(field: str, column: Column) -> Any:
    return (column.format, (column.length,)) if SAMPLE[field].shape else column.format


def _topic_layout(topic: Topic, joint_names: Sequence[str], n_rotors: int) -> Layout:
    counts = {"joints": len(joint_names), "rotors": n_rotors}
    lengths = {path: counts[what] for path, what in topic.lengths.items()}
    texts = {"header.frame_id": topic.frame}
    if "name" in lengths:
        texts |= {f"name[{i}]": name for i, name in enumerate(joint_names)}
    if topic.derived:  # the transforms
        children = messages.TF_CHILDREN
        lengths["transforms"] = len(children)
        for i, child in enumerate(children):
            texts[f"transforms[{i}].header.frame_id"] = topic.frame
            texts[f"transforms[{i}].child_frame_id"] = child
    layout = build_layout(topic.kind, messages.definition(topic.kind), texts, lengths)
    if not topic.derived:
        return layout
    template = bytearray(layout.template)
    last = len(messages.TF_CHILDREN) - 1  # its axes are those of map: the rotation is constant
    w = layout.column(f"transforms[{last}].transform.rotation.w")
    struct.pack_into("<d", template, w.offset, 1.0)
    return layout._replace(template=bytes(template))


def _log_layout(text: str) -> Layout:
    kind = messages.EVENTS.kind
    texts = {"name": "skywright", "msg": text.replace("\0", "")}
    return build_layout(kind, messages.definition(kind), texts, {})


def _message_header(channel: int, length: int, ns: int) -> bytes:
    from skywright.core.mcap_file import MESSAGE_HEADER, RECORD_HEADER

    inside = MESSAGE_HEADER.size - RECORD_HEADER.size
    return MESSAGE_HEADER.pack(5, inside + length, channel, 0, ns, ns)


def _stamp(ns: NDArray[Any]) -> NDArray[Any]:
    """Return seconds + nanoseconds * 2^32 (core/cdr.py: STAMP)."""
    second = np.uint64(1_000_000_000)
    return (ns // second) | ((ns % second) << np.uint64(32))


def _version() -> str:
    try:
        return version("skywright")
    except PackageNotFoundError:
        return "unknown"
