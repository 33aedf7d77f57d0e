"""Writes the container of a recording, MCAP (mcap.dev/spec, version 0): chunks of messages with an index.

Small records are encoded by the `mcap` package. Messages, some hundred per simulated second, are kept as they
come and packed when their chunk is full.
"""

import zlib
from array import array
from collections import defaultdict
from struct import Struct
from sys import byteorder
from typing import Any, BinaryIO

from swath.core.unnamed_file import UnnamedFile

MAGIC = b"\x89MCAP0\r\n"
MESSAGE, FOOTER, INDEX = 0x05, 0x02, 0x07  # opcodes
HEAD = Struct("<BQHIQQ")  # of a message: opcode, length of the rest, channel, sequence, log and publish time
FIXED = HEAD.size - 9  # bytes of a message's length beside its data
INDEX_HEAD = Struct("<BQHI")
LEVEL = 3  # of Zstandard


class Container:
    """A file in the making: `add` messages of channels, `finish`. stream: open to write; nothing closes it

    chunk_bytes: of messages that make a chunk. A file that ends early is whole up to its last chunk.
    """

    def __init__(self, stream: BinaryIO, *, chunk_bytes: int, profile: str, library: str) -> None:
        from mcap.data_stream import RecordBuilder
        from mcap.records import Header

        self._stream, self._chunk_bytes = stream, chunk_bytes
        self._builder = RecordBuilder
        self._schemas: list[Any] = []
        self._channels: list[Any] = []
        self._declared: list[bytes] = []  # schemas and channels since the last chunk
        self._open: list[tuple[int, int, int, bytes]] = []  # channel, sequence, time, data
        self._size = 0  # bytes in the open chunk
        self._counts: dict[int, int] = defaultdict(int)  # messages by channel
        self._chunk_count = 0
        self._chunks = UnnamedFile()  # ChunkIndex of each, encoded
        self._span: tuple[int, int] | None = None  # times of the first and the last message
        self._attachments: list[Any] = []
        stream.write(MAGIC)
        self._put(Header(profile, library))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """A message type; returns its number."""
        from mcap.records import Schema

        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._declare(schema)
        return int(schema.id)

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str]) -> int:
        """A topic whose messages are of a schema; returns its number."""
        from mcap.records import Channel

        channel = Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding=encoding, schema_id=schema,
            metadata=metadata,
        )  # fmt: skip
        self._channels.append(channel)
        self._declare(channel)
        return int(channel.id)

    def add(self, channel: int, t: int, data: bytes) -> bool:
        """Append a message, logged and published at t [ns]. True when the chunk is full: `flush` it."""
        self._counts[channel] = sequence = self._counts[channel] + 1
        self._open.append((channel, sequence, t, data))
        self._size += HEAD.size + len(data)
        return self._size > self._chunk_bytes

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the file, at once."""
        from mcap.records import Attachment, AttachmentIndex

        at = self._stream.tell()
        length = self._put(Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data))
        self._attachments.append(
            AttachmentIndex(
                offset=at, length=length, create_time=0, log_time=0, data_size=len(data), name=name,
                media_type=media_type,
            )
        )  # fmt: skip

    def flush(self) -> None:
        """Write the open chunk and its index, and hand them to the system."""
        if not self._open:
            return
        from mcap.records import Chunk, ChunkIndex

        records, index = self._records()
        packed = _compressed(records)
        times = [t for _, _, t, _ in self._open]
        chunk = Chunk(
            compression="zstd", data=packed, message_start_time=min(times), message_end_time=max(times),
            uncompressed_crc=zlib.crc32(records), uncompressed_size=len(records),
        )  # fmt: skip
        at = self._stream.tell()
        length = self._put(chunk)
        offsets, begin = {}, at + length
        for channel, entries in index.items():
            offsets[channel] = begin
            data = _bytes(entries)
            begin += self._stream.write(INDEX_HEAD.pack(INDEX, 6 + len(data), channel, len(data)) + data)
        entry = ChunkIndex(
            message_start_time=chunk.message_start_time, message_end_time=chunk.message_end_time,
            chunk_start_offset=at, chunk_length=length, message_index_offsets=offsets,
            message_index_length=begin - at - length, compression="zstd", compressed_size=len(packed),
            uncompressed_size=len(records),
        )  # fmt: skip
        self._chunk_count += 1
        self._chunks.append(self._encoded(entry))
        span = self._span or (min(times), max(times))
        self._span = min(span[0], min(times)), max(span[1], max(times))
        self._open, self._declared, self._size = [], [], 0
        self._stream.flush()

    def finish(self) -> None:
        """The last chunk, then the summary, without which readers have to search the file."""
        from mcap.records import DataEnd

        self.flush()
        self._put(DataEnd(0))
        start = self._stream.tell()
        summary, offsets = self._builder(), self._builder()
        for opcode, records in self._summary():
            begin = summary.count
            for record in records:
                record.write(summary)
            if records:
                _group(opcode, start + begin, summary.count - begin).write(offsets)
        groups = start + summary.count
        data = summary.end() + offsets.end()
        foot = Struct("<BQQQ").pack(FOOTER, 20, start, groups)
        crc = zlib.crc32(foot, zlib.crc32(data))
        self._stream.write(data + foot + Struct("<I").pack(crc) + MAGIC)
        self._stream.flush()

    def _declare(self, record: Any) -> None:
        self._declared.append(self._encoded(record))
        self._size += len(self._declared[-1])

    def _put(self, record: Any) -> int:
        """Write a record; its length."""
        return self._stream.write(self._encoded(record))

    def _encoded(self, record: Any) -> bytes:
        builder = self._builder()
        record.write(builder)
        return bytes(builder.end())

    def _records(self) -> tuple[bytes, dict[int, "array[int]"]]:
        """The open chunk, and by channel the time and the place of every message, one after the other."""
        parts, pack = list(self._declared), HEAD.pack
        at = sum(len(part) for part in parts)
        index: dict[int, array[int]] = {}
        for channel, sequence, t, data in self._open:
            entries = index.get(channel)
            if entries is None:
                entries = index[channel] = array("Q")
            entries.append(t)
            entries.append(at)
            size = len(data)
            parts += (pack(MESSAGE, FIXED + size, channel, sequence, t, t), data)
            at += HEAD.size + size
        return b"".join(parts), index

    def _summary(self) -> list[tuple[int, list[Any]]]:
        """Groups of records by their opcode."""
        from mcap.opcode import Opcode
        from mcap.records import Statistics

        first, last = self._span or (0, 0)
        chunks = [_Encoded(self._chunks.read())] if self._chunk_count else []
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=self._chunk_count,
            message_count=sum(self._counts.values()),
            metadata_count=0,
            message_start_time=first,
            message_end_time=last,
            schema_count=len(self._schemas),
        )
        return [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
        ]


class _Encoded:
    """Records that are encoded already."""

    __slots__ = ("_data",)

    def __init__(self, data: bytes) -> None:
        self._data = data

    def write(self, builder: Any) -> None:
        """As records of the `mcap` package do."""
        builder.write(self._data)


def _group(opcode: int, start: int, length: int) -> Any:
    from mcap.records import SummaryOffset

    return SummaryOffset(group_opcode=opcode, group_start=start, group_length=length)


def _bytes(numbers: "array[int]") -> bytes:
    """In little-endian order."""
    if byteorder == "big":
        numbers.byteswap()
    return numbers.tobytes()


def _compressed(data: bytes) -> bytes:
    """Zstandard, at a level that takes a third of the time of level 7, and 2.4 % more room."""
    import zstandard

    return bytes(zstandard.compress(data, LEVEL))
