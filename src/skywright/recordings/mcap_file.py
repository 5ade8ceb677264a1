"""MCAP container (mcap.dev/spec): write whole chunks, and read everything that is readable.

The `mcap` package serialises the records. Its own writer accepts one message at a time, which takes
about ten times as long as a batch. Therefore this module assembles the chunks and their indexes.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import get_chunk_data_stream
from numpy.typing import NDArray

from skywright.core.bounded import LARGEST_RECORDING, read_bytes
from skywright.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEADER = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE_HEADER = struct.Struct("<BQHIQQ")  # the same, channel, sequence, log and publish time (ns)
_MESSAGE_START = MESSAGE_HEADER.size - RECORD_HEADER.size
COMPRESSION_LEVEL = -7  # fast level of zstd: half the time of level 1, one sixth more bytes
_MAX_CHUNK = 1 << 30  # bytes; a larger size in a chunk's header indicates damage

# Exceptions that damaged records can raise, in this module and in the packages.
_DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    LookupError,
    OverflowError,
    RuntimeError,
    ValueError,
)


def build_message_header(channel: int, length: int, ns: int) -> bytes:
    """Return the record header of a message of `length` bytes, logged and published at `ns`."""
    inside = _MESSAGE_START + length
    return MESSAGE_HEADER.pack(Opcode.MESSAGE, inside, channel, 0, ns, ns)


class McapWriter:
    """Writes an MCAP file with the profile `ros2`; every call flushes to the operating system.

    If the process dies before `finish`, the file can be read up to the last call.
    """

    def __init__(self, stream: BinaryIO, library: str) -> None:
        self._stream = stream
        self._offset = 0
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self._chunks = bytearray()  # serialised chunk indexes: one per second, for hours
        self._n_chunks, self._start, self._end = 0, 0, 0  # ns
        self._attachments: list[records.AttachmentIndex] = []
        self._metadata: list[records.MetadataIndex] = []
        self._counts: dict[int, int] = {}
        # The checksum of zstd takes half the time of the chunk's CRC, which is omitted.
        self._compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL, write_checksum=True)
        self._write(MAGIC + _serialise(records.Header("ros2", library)))

    def add_channel(
        self, topic: str, schema_name: str, schema: str, metadata: dict[str, str] | None = None
    ) -> int:
        """Add a channel of CDR messages with a `ros2msg` schema; return its id (1, 2, ...)."""
        data = schema.encode()
        known = next((s for s in self._schemas if s.name == schema_name), None)
        if known is None:
            known = records.Schema(len(self._schemas) + 1, data, "ros2msg", schema_name)
            self._schemas.append(known)
            self._write(_serialise(known))
        assert known.data == data
        channel = records.Channel(len(self._channels) + 1, topic, "cdr", metadata or {}, known.id)
        self._channels.append(channel)
        self._counts[channel.id] = 0
        self._write(_serialise(channel))
        return channel.id

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Add a named table of strings."""
        data = _serialise(records.Metadata(name, values))
        self._metadata.append(records.MetadataIndex(self._offset, len(data), name))
        self._write(data)

    def add_attachment(self, name: str, data: bytes, media_type: str) -> None:
        """Add a file as an attachment."""
        record = _serialise(records.Attachment(0, 0, name, media_type, data))
        self._attachments.append(
            records.AttachmentIndex(self._offset, len(record), 0, 0, len(data), name, media_type)
        )
        self._write(record)

    def add_chunk(self, data: Any, times: NDArray[Any], offsets: dict[int, NDArray[Any]]) -> None:
        """Add a chunk of message records.

        `data` contains the records (any bytes-like object), `times` (n,) the log times (ns).
        `offsets` maps every channel to the offsets (n,) of its records in `data`.
        """
        compressed = self._compressor.compress(data)
        size = memoryview(data).nbytes
        start, end = int(times.min()), int(times.max())
        # Packed here, because the package's builder copies the data three times.
        head = struct.pack("<QQQII4sQ", start, end, size, 0, 4, b"zstd", len(compressed))
        head = RECORD_HEADER.pack(Opcode.CHUNK, len(head) + len(compressed)) + head
        chunk_length = len(head) + len(compressed)
        index_start = self._offset + chunk_length
        index = bytearray()
        index_offsets = {}
        entries = np.empty((len(times), 2), "<u8")
        entries[:, 0] = times
        for channel, places in offsets.items():
            entries[:, 1] = places
            index_offsets[channel] = index_start + len(index)
            body = struct.pack("<HI", channel, entries.nbytes) + entries.tobytes()
            index += RECORD_HEADER.pack(Opcode.MESSAGE_INDEX, len(body)) + body
            self._counts[channel] += len(times)
        self._chunks += _serialise(
            records.ChunkIndex(
                chunk_length=chunk_length,
                chunk_start_offset=self._offset,
                compression="zstd",
                compressed_size=len(compressed),
                message_end_time=end,
                message_index_length=len(index),
                message_index_offsets=index_offsets,
                message_start_time=start,
                uncompressed_size=size,
            )
        )
        self._start = min(self._start, start) if self._n_chunks else start
        self._end = max(self._end, end)
        self._n_chunks += 1
        self._write(head, compressed, index)

    def finish(self) -> None:
        """Write the summary (an index of chunks by topic and time) and the footer."""
        self._write(_serialise(records.DataEnd(0)))
        start = self._offset
        summary = bytearray()
        groups: list[records.SummaryOffset] = []
        statistics = records.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._n_chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._end,
            message_start_time=self._start,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups_of: list[tuple[Opcode, bytes | bytearray]] = [
            (Opcode.SCHEMA, _join(self._schemas)),
            (Opcode.CHANNEL, _join(self._channels)),
            (Opcode.STATISTICS, _serialise(statistics)),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, _join(self._attachments)),
            (Opcode.METADATA_INDEX, _join(self._metadata)),
        ]
        for opcode, data in groups_of:
            if data:
                groups.append(records.SummaryOffset(opcode, start + len(summary), len(data)))
                summary += data
        offset_start = start + len(summary)
        summary += _join(groups)
        # The checksum covers the summary and the footer up to the checksum itself.
        footer = _serialise(records.Footer(start, offset_start, 0))[:-4]
        crc = zlib.crc32(footer, zlib.crc32(summary))
        self._write(bytes(summary) + footer + struct.pack("<I", crc) + MAGIC)

    def mark(self) -> tuple[int, ...]:
        """Return the current state of the file for `roll_back`."""
        counts = (self._counts.get(n + 1, 0) for n in range(len(self._channels)))
        lengths = map(len, self._list_groups())
        return self._offset, self._n_chunks, self._start, self._end, *lengths, *counts

    def roll_back(self, mark: tuple[int, ...]) -> None:
        """Remove everything added since `mark`, for example after an interrupted call."""
        self._offset, self._n_chunks, self._start, self._end, *lengths = mark
        groups = self._list_groups()
        for group, length in zip(groups, lengths, strict=False):
            del group[length:]
        self._counts = {n + 1: count for n, count in enumerate(lengths[len(groups) :])}
        if not self._stream.closed:
            self._stream.seek(self._offset)
            self._stream.truncate()

    def _list_groups(self) -> list[Any]:
        return [self._schemas, self._channels, self._chunks, self._attachments, self._metadata]

    def _write(self, *parts: bytes | bytearray) -> None:
        for part in parts:
            self._stream.write(part)
            self._offset += len(part)
        self._stream.flush()


def _serialise(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _join(group: Sequence[records.McapRecord]) -> bytes:
    return b"".join(map(_serialise, group))


CUT = "the recording was cut short; read up to the cut"
"""Note on a file that is not complete."""


class McapContents(NamedTuple):
    """Contents of an MCAP file: messages of each topic as raw bytes, in the order of the file."""

    messages: dict[str, list[bytes]]
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    complete: bool  # False: truncated (a killed run); contains everything before the cut
    kinds: dict[str, tuple[str, str]] = {}  # topic -> name of its schema, encoding of its messages
    definitions: dict[str, str] = {}  # topic -> text of its schema


class _Tables(NamedTuple):
    """Records read so far; channels and schemas by their ids."""

    topics: dict[int, str]
    schemas: dict[int, tuple[str, str]]  # name, text
    messages: dict[int, list[bytes]]
    kinds: dict[str, tuple[str, str]]
    definitions: dict[str, str]


def read_mcap(path: Path) -> McapContents:
    """Read a whole MCAP file, or the part of a truncated file that is readable.

    Raises InputError if the file cannot be read, is empty or is not an MCAP file, or if a file
    that was finished is damaged.
    """
    data = read_bytes(path, LARGEST_RECORDING, "cut it into parts")
    if not data:
        raise InputError(f"{path}: is empty; expected an MCAP recording")
    if data[: len(MAGIC)] != MAGIC[: len(data)]:
        raise InputError(f"{path}: is not an MCAP file")
    finished = len(data) > 2 * len(MAGIC) and data.endswith(MAGIC)
    tables = _Tables({}, {}, {}, {}, {})
    messages = tables.messages
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    complete = False
    position = len(MAGIC)
    try:
        for position, opcode, record in _iterate_records(data, len(MAGIC)):  # noqa: B007
            if opcode == Opcode.CHUNK:
                _split_messages(_decompress(record), tables)
            elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
                _add_channel(opcode, record, tables)
            elif opcode == Opcode.MESSAGE:  # outside a chunk: valid, but not written here
                (channel,) = struct.unpack_from("<H", record)
                messages[channel].append(bytes(record[_MESSAGE_START:]))
            elif opcode == Opcode.METADATA:
                table = records.Metadata.read(ReadDataStream(BytesIO(record)))
                metadata[table.name] = table.metadata
            elif opcode == Opcode.ATTACHMENT:
                attachments.update([_read_attachment(record)])
            elif opcode == Opcode.DATA_END:  # the rest repeats and indexes the data
                complete = finished
            elif opcode == Opcode.STATISTICS:  # a damaged record may have hidden a chunk
                count = records.Statistics.read(ReadDataStream(BytesIO(record))).message_count
                complete = complete and count == sum(map(len, messages.values()))
    except _DAMAGE:
        pass  # treat the file as truncated here
    if finished and not complete:
        raise InputError(f"{path}: is damaged at or before byte {position}")
    by_topic: dict[str, list[bytes]] = {}
    for channel, parts in messages.items():
        by_topic.setdefault(tables.topics[channel], []).extend(parts)
    return McapContents(by_topic, metadata, attachments, complete, tables.kinds, tables.definitions)


def _iterate_records(data: bytes, position: int) -> Iterator[tuple[int, int, memoryview]]:
    """Yield offset, opcode and content of every whole record."""
    view = memoryview(data)
    while position + RECORD_HEADER.size <= len(data):
        opcode, length = RECORD_HEADER.unpack_from(data, position)
        end = position + RECORD_HEADER.size + length
        if end > len(data):
            return
        yield position, opcode, view[position + RECORD_HEADER.size : end]
        position = end


def _add_channel(opcode: int, record: memoryview | bytes, tables: _Tables) -> None:
    """Store a channel, or a schema that later channels refer to."""
    stream = ReadDataStream(BytesIO(record))
    if opcode == Opcode.SCHEMA:
        schema = records.Schema.read(stream)
        tables.schemas[schema.id] = schema.name, schema.data.decode(errors="replace")
        return
    channel = records.Channel.read(stream)
    name, text = tables.schemas.get(channel.schema_id, ("", ""))
    tables.topics[channel.id] = channel.topic
    tables.kinds[channel.topic] = (name, channel.message_encoding)
    tables.definitions[channel.topic] = text
    tables.messages.setdefault(channel.id, [])


def _decompress(record: memoryview) -> bytes:
    """Return the content of a chunk. Raises ValueError or another of _DAMAGE if it is damaged."""
    chunk = records.Chunk.read(ReadDataStream(BytesIO(record)))
    if chunk.uncompressed_size > _MAX_CHUNK:
        raise ValueError("size")
    # A damaged size in the compressed data must not allocate all memory.
    if (
        chunk.compression == "zstd"
        and zstandard.frame_content_size(chunk.data) > chunk.uncompressed_size
    ):
        raise ValueError("size")
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    if length != chunk.uncompressed_size:
        raise ValueError("length")
    return stream.read(length)


def _split_messages(data: bytes, tables: _Tables) -> None:
    """Append every message of a chunk to the list of its channel."""
    position, end = 0, len(data)
    unpack, size = struct.Struct("<BQH").unpack_from, RECORD_HEADER.size
    while position + size < end:
        opcode, length, channel = unpack(data, position)
        start = position + size
        position = start + length
        if opcode == Opcode.MESSAGE:
            tables.messages[channel].append(data[start + _MESSAGE_START : position])
        elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            _add_channel(opcode, data[start:position], tables)


def _read_attachment(record: memoryview) -> tuple[str, bytes]:
    (crc,) = struct.unpack("<I", record[-4:])
    if crc and crc != zlib.crc32(record[:-4]):
        raise ValueError("attachment")
    attachment = records.Attachment.read(ReadDataStream(BytesIO(record)))
    return attachment.name, attachment.data
