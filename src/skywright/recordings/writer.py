"""Record a run: samples and streams in an MCAP file of ROS 2 messages.

A batch of samples (about a second) becomes one chunk of the file. All messages of one sample form a
row of fixed layout, so that NumPy writes each column of all rows at once (cdr.py). Every column is
read back bit for bit (recording.py). Quaternions are xyzw in the file, as in ROS, and wxyz
everywhere else. Time stamps count from the start of the run.

The metadata of the file list the columns of its topics, and its schemas define its messages. A
reader needs nothing else.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError
from skywright.recordings.columns import Column, Stream, Topic, build_dtype, check_columns
from skywright.recordings.mcap_file import McapWriter, build_message_header
from skywright.recordings.messages import EVENTS, definition, full_name
from skywright.recordings.sample_rows import BATCH, Rows, build_message, build_rows

METADATA = "skywright.recording"
FORMAT = "2"
"""Version of the metadata; incremented by a change that older readers would misread."""

INFO = 20  # rcl_interfaces/Log.INFO
_MAX_TIME = 2**31  # s; a ROS stamp holds int32 seconds
# QoS with which `ros2 bag play` offers a message to late subscribers: keep last 1, reliable,
# transient local.
_LATCHED = {
    "offered_qos_profiles": (
        "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
        + "".join(
            f"  {name}:\n    sec: 0\n    nsec: 0\n"
            for name in ("deadline", "lifespan", "liveliness_lease_duration")
        )
        + "  liveliness: 1\n  avoid_ros_namespace_conventions: false"
    )
}


class RecordingWriter:
    """Writes a recording during the run; appended data survive a killed process.

    `columns` form one sample, and `topics` carry them. `streams` have rows at their own rates.
    `info` is further information for readers, stored as JSON. Raises InputError if the file cannot
    be written.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[Column],
        topics: Sequence[Topic],
        streams: Sequence[Stream] = (),
        info: Mapping[str, Any] | None = None,
    ) -> None:
        check_columns(columns, topics)
        self._path = Path(path)
        self._error = ""
        self._stream: BinaryIO | None = None
        self._channels: dict[str, int] = {}
        self.dtype = build_dtype(columns)
        metadata = {
            "columns": json.dumps(columns),
            "topics": json.dumps({t.name: dict(t.fields) for t in topics}),
            "streams": json.dumps(
                {s.topic.name: [s.columns, dict(s.topic.fields)] for s in streams}
            ),
            "info": json.dumps(info or {}),
        }
        every = [*topics, *(s.topic for s in streams)]
        texts = {t.name: checksum(definition(t.kind, t.types)) for t in every}
        metadata["definitions"] = json.dumps(texts)  # their checksums
        metadata["crc32"] = str(checksum(json.dumps(sorted(metadata.items()))))
        with self._writing():
            self._stream = self._path.open("wb", buffering=1 << 20)
            self._mcap = McapWriter(self._stream, f"skywright {_version()}")
            self._mcap.add_metadata(METADATA, {"format": FORMAT, **metadata})
            for topic in (*every, EVENTS):
                self._add_channel(topic)
        number = self._channels
        self._rows = build_rows([(number[t.name], t) for t in topics], self.dtype)
        self._streams: dict[str, Rows] = {}
        self._dtypes: dict[str, np.dtype[Any]] = {}
        for topic, parts in streams:
            check_columns(parts, [topic._replace(fields={**topic.fields, "": "t"})])
            dtype = self._dtypes[topic.name] = build_dtype(parts)
            self._streams[topic.name] = build_rows([(number[topic.name], topic)], dtype)

    def append(self, samples: NDArray[Any]) -> None:
        """Append a batch of samples (an array of `dtype`), ideally about a second long.

        Raises InputError if a time is not finite or out of range, or if the file cannot be written
        (for example because the disk is full).
        """
        assert samples.dtype == self.dtype and samples.ndim == 1
        self._append(samples, self._rows)

    def append_stream(self, topic: str, rows: NDArray[Any]) -> None:
        """Append rows of a stream (an array of its columns). Raises InputError like `append`."""
        assert rows.dtype == self._dtypes[topic] and rows.ndim == 1
        self._append(rows, self._streams[topic])

    def event(self, t: float, text: str) -> None:
        """Write an event at time `t` (s). Raises InputError like `append`."""
        topic = EVENTS._replace(texts={"name": "skywright", "msg": text})
        self.message(topic, t, {"level": INFO})

    def text(self, name: str, t: float, text: str, *, latched: bool = False) -> None:
        """Write a text (std_msgs/String) on the topic `name`; see `message`."""
        topic = Topic(name, "std_msgs/String", "", {}, {"data": text})
        self.message(topic, t, {}, latched=latched)

    def message(
        self, topic: Topic, t: float, values: Mapping[str, float], *, latched: bool = False
    ) -> None:
        """Write one message at time `t` (s) with the numbers `values` by path.

        `read_recording` does not return it, unless it is an event. A `latched` topic, such as
        /robot_description, is offered to late subscribers. Raises InputError like `append`.
        """
        ns = self._nanoseconds(np.array([t]))
        body = build_message(topic, int(ns[0]), values)
        with self._writing():
            if topic.name not in self._channels:
                self._add_channel(topic, _LATCHED if latched else None)
            channel = self._channels[topic.name]
            data = build_message_header(channel, len(body), int(ns[0])) + body
            self._mcap.add_chunk(data, ns, {channel: np.zeros(1, np.uint64)})

    def attach(self, name: str, data: bytes) -> None:
        """Attach a file to the recording, such as the resolved mission.toml."""
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

    def _add_channel(self, topic: Topic, metadata: dict[str, str] | None = None) -> None:
        text = definition(topic.kind, topic.types)
        number = self._mcap.add_channel(topic.name, full_name(topic.kind), text, metadata)
        self._channels[topic.name] = number

    def _append(self, samples: NDArray[Any], rows: Rows) -> None:
        with self._writing():
            for start in range(0, len(samples), BATCH):
                batch = samples[start : start + BATCH]
                ns = self._nanoseconds(batch["t"])
                data = rows.encode(batch, ns)
                offsets = {channel: at[: len(batch)] for channel, at in rows.offsets.items()}
                self._mcap.add_chunk(data, ns, offsets)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn an OSError into an InputError of one line; every later call raises it again.

        Any other exception, such as an interrupt, restores the previous state of the file.
        """
        if self._error:
            raise InputError(self._error)
        mcap: McapWriter | None = getattr(self, "_mcap", None)  # None while the file is opened
        mark, channels = mcap.mark() if mcap else None, dict(self._channels)
        try:
            yield
        except OSError as error:
            self._error = f"cannot write {self._path}: {error.strerror or error}"
            if self._stream is not None:
                with suppress(OSError):
                    self._stream.close()
            raise InputError(self._error) from error
        except BaseException:
            if mcap is not None and mark is not None:
                mcap.roll_back(mark)
                self._channels = channels
            raise

    def _nanoseconds(self, t: NDArray[Any]) -> NDArray[Any]:
        good = (t >= 0) & (t < _MAX_TIME)  # False for NaN
        if not good.all():
            wrong = t[~good][0]
            raise InputError(f"{self._path}: a time of {wrong} s; valid is 0 to {_MAX_TIME} s")
        return np.rint(t * 1e9).astype(np.uint64)


def checksum(text: str) -> int:
    """Return the CRC-32 of a text that defines how messages are read; MCAP has none for it."""
    return zlib.crc32(text.encode())


def _version() -> str:
    try:
        return version("skywright")
    except PackageNotFoundError:
        return "unknown"
