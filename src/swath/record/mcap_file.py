"""One MCAP file of ROS 2 (CDR) messages, readable up to its last whole chunk whatever happens.

`message_factory.py` makes the messages. `Container` is the MCAP (mcap.dev/spec, version 0): chunks of
messages with an index; small records are encoded by the `mcap` package, messages, some hundred per simulated
second, are kept as they come and packed when their chunk is full. metadata.yaml beside it makes the run
folder a rosbag 2 (version 5 of its information).
"""

import zlib
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO, Protocol, runtime_checkable

import numpy as np

from swath.core.apart.call import apart, written_here
from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.core.files.unnamed_file import UnnamedFile
from swath.core.files.whole_file import open_to_write, write_whole
from swath.documents.packed import readable
from swath.documents.yaml_document import dump
from swath.record.message_factory import Draft, MessageFactory, Template

NAME = "metadata.yaml"


@dataclass
class Topic:
    """msgtype: such as `std_msgs/msg/String`; qos: profiles that are offered, YAML; channel: its number."""

    msgtype: str
    qos: str = ""
    channel: int = 0


def write_metadata(
    recording: Path, topics: Mapping[str, Topic], end: int, message_counts: Mapping[int, int]
) -> Path:
    """Write it for a recording that starts at 0; returns the file.

    end: time of the last message [ns]; message_counts: by channel
    """
    described = [
        {
            "topic_metadata": {
                "name": name,
                "type": topic.msgtype,
                "serialization_format": "cdr",
                "offered_qos_profiles": topic.qos,
            },
            "message_count": message_counts[topic.channel],
        }
        for name, topic in sorted(topics.items())
    ]
    span = {
        "starting_time": {"nanoseconds_since_epoch": 0},
        "duration": {"nanoseconds": end},
        "message_count": sum(message_counts.values()),
    }
    about = {
        "version": 5,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": described,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [recording.name],
        "files": [{"path": recording.name, **span}],
    }
    return write_whole(recording.with_name(NAME), dump({"rosbag2_bagfile_information": about}))


MAGIC = b"\x89MCAP0\r\n"
MESSAGE, FOOTER, INDEX = 0x05, 0x02, 0x07  # opcodes
HEAD = np.dtype("u1, <u8, <u2, <u4, <u8, <u8")  # of a message
HEAD.names = "opcode", "rest", "channel", "sequence", "t", "sent"  # rest: length of what follows
FIXED = HEAD.itemsize - 9  # bytes of a message's length beside its data
INDEX_HEAD = Struct("<BQHI")
LEVEL = 3  # of Zstandard


class Container:
    """A file in the making: `add` messages of channels, `finish`. stream: open to write; nothing closes it.

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
        self.message_counts: dict[int, int] = defaultdict(int)  # messages by channel
        self._chunk_count = 0
        self._chunks = UnnamedFile()  # ChunkIndex of each, encoded
        self.span: tuple[int, int] | None = None  # times of the first and the last message in chunks
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
        self.message_counts[channel] = sequence = self.message_counts[channel] + 1
        self._open.append((channel, sequence, t, data))
        self._size += HEAD.itemsize + len(data)
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
            head = INDEX_HEAD.pack(INDEX, 6 + len(entries), channel, len(entries))
            begin += self._stream.write(head + entries)
        entry = ChunkIndex(
            message_start_time=chunk.message_start_time, message_end_time=chunk.message_end_time,
            chunk_start_offset=at, chunk_length=length, message_index_offsets=offsets,
            message_index_length=begin - at - length, compression="zstd", compressed_size=len(packed),
            uncompressed_size=len(records),
        )  # fmt: skip
        self._chunk_count += 1
        self._chunks.append(self._encoded(entry))
        span = self.span or (min(times), max(times))
        self.span = min(span[0], min(times)), max(span[1], max(times))
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

    def _records(self) -> tuple[bytes, dict[int, bytes]]:
        """The open chunk, and by channel the time and the place of every message, one after the other."""
        channels, sequences, times, data = zip(*self._open, strict=True)
        heads, declared = np.empty(len(data), HEAD), b"".join(self._declared)
        heads["opcode"], heads["channel"], heads["sequence"] = MESSAGE, channels, sequences
        heads["rest"], heads["t"], heads["sent"] = [FIXED + len(part) for part in data], times, times
        ends = len(declared) + np.cumsum(heads["rest"] + 9)
        entries = np.stack([heads["t"], ends - heads["rest"] - 9], axis=1).astype("<u8")
        index = {c: entries[heads["channel"] == c].tobytes() for c in dict.fromkeys(channels)}
        parts = zip(heads.view(f"V{HEAD.itemsize}").tolist(), data, strict=True)
        return b"".join([declared, *chain.from_iterable(parts)]), index

    def _summary(self) -> list[tuple[int, list[Any]]]:
        """Groups of records by their opcode."""
        from mcap.opcode import Opcode
        from mcap.records import Statistics

        first, last = self.span or (0, 0)
        chunks = [_Encoded(self._chunks.read())] if self._chunk_count else []
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self.message_counts),
            chunk_count=self._chunk_count,
            message_count=sum(self.message_counts.values()),
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


def _compressed(data: bytes) -> bytes:
    """Zstandard, at a level that takes a third of the time of level 7, and 2.4 % more room."""
    import zstandard

    return bytes(zstandard.compress(data, LEVEL))


CHUNK_BYTES = 192 * 1024
QOS = "offered_qos_profiles"  # key of a channel's metadata
LATCHED = (
    "- history: keep_last\n  depth: 1\n  reliability: reliable\n  durability: transient_local\n"
    "  deadline:\n    sec: 9223372036\n    nsec: 854775807\n  lifespan:\n    sec: 9223372036\n"
    "    nsec: 854775807\n  liveliness: automatic\n  liveliness_lease_duration:\n    sec: 9223372036\n"
    "    nsec: 854775807\n  avoid_ros_namespace_conventions: false\n"
)


class Tap(Protocol):
    """Called with every message that is written.

    t: log time [ns]; data: CDR bytes; build: makes the message.
    """

    def __call__(
        self, topic: str, t: int, data: bytes, build: Callable[[], Any], is_latched: bool, /
    ) -> None:
        """Take a message."""


@runtime_checkable
class Declares(Protocol):
    """A tap that wants to know of a topic before its first message."""

    def declare(self, topic: str, message: Any, is_latched: bool) -> None:
        """Take the kind of a topic's messages."""


@apart("recording", "a whole run.mcap", libraries=("mcap.stream_reader",), records=(Topic,))
def _written(source: Path) -> Iterator[tuple[str, Topic, bytes, int, bytes]]:
    """Messages of a file, in its order: topic, what is said of it, its definition, log time [ns], CDR bytes.

    What is said of a topic, and its definition, come with its first message.
    """
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    told = set[str]()
    with (
        open_to_read(source, "recording", "a recording") as stream,
        readable("recording", "a whole run.mcap", source),
    ):
        for record in StreamReader(stream).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                about, definition = Topic("", ""), b""
                if channel.topic not in told:
                    told.add(channel.topic)
                    schema = schemas[channel.schema_id]
                    about, definition = Topic(schema.name, channel.metadata.get(QOS, "")), schema.data
                yield channel.topic, about, definition, record.log_time, record.data


class McapFile:
    """Writer of one file. Topics and types are declared by their first message. make: of messages.

    Raises OSError when the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.make = MessageFactory()
        self.store = self.make.store
        self.path = path
        self._stream = open_to_write(path)
        self._container = Container(self._stream, chunk_bytes=CHUNK_BYTES, profile="ros2", library="swath")
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, Topic] = {}
        self._templates: dict[tuple[str, Hashable], Template] = {}
        self._is_torn = False
        self.taps: list[Tap] = []  # called with every message that is written while `is_heard`
        self.is_heard = True

    def write(self, topic: str, t: int, message: Any, *, is_latched: bool = False) -> None:
        """Append a message or draft, logged at simulated time t [ns]; after a torn one nothing."""
        if self._is_torn:
            return
        if isinstance(message, Draft):
            data, build = self._from_draft(topic, message)
        else:
            data, build = bytes(self.store.serialize_cdr(message, message.__msgtype__)), lambda: message
        if topic not in self._topics:
            self._declare(topic, build().__msgtype__, is_latched)
        self.add(topic, t, data, build)

    @property
    def count(self) -> int:
        """Messages so far."""
        return sum(self._container.message_counts.values())

    def begin_as(self, source: Path, count: int) -> None:
        """Take over the first messages of another file, in place of those that a new run would write.

        InputError where it has fewer of them; this file then is of no use.
        """
        for topic, about, definition, t, data in islice(_written(source), count):
            if topic not in self._topics:
                self._register(about, topic, definition)
            self.add(topic, t, data)
        if self.count < count:
            raise InputError("recording", source.name, f"expected {count} messages of the run", file=source)

    def rows(self, topic: str, draft: Draft) -> list[bytes] | None:
        """CDR bytes of many messages of a topic; None before one of their form was written."""
        template = self._templates.get((topic, draft.variant))
        return None if template is None else template.fill_all(draft.t, draft.values)

    def add(self, topic: str, t: int, data: bytes, build: Callable[[], Any] | None = None) -> None:
        """Append the bytes of a message of a topic that is known; after a torn one nothing.

        build: makes the message, else it is made of its bytes
        """
        if self._is_torn:
            return
        about = self._topics[topic]
        if self._container.add(about.channel, t, data):
            self._is_torn = True  # until the chunk is whole: Ctrl-C may come in between
            self._container.flush()
            self._is_torn = False
        if self.taps and self.is_heard:
            build = build or partial(self.store.deserialize_cdr, data, about.msgtype)
            for tap in self.taps:
                tap(topic, t, data, build, bool(about.qos))

    def _from_draft(self, topic: str, draft: Draft) -> tuple[bytes, Callable[[], Any]]:
        """CDR bytes of a message, and what makes the message."""
        template = self._templates.get((topic, draft.variant))
        if template is not None:
            return template.fill(draft.t, draft.values), draft.build
        message = draft.build()
        data = bytes(self.store.serialize_cdr(message, message.__msgtype__))
        self._templates[topic, draft.variant] = Template(self.store, message, data, draft.paths)
        return data, lambda: message

    def announce(self, topic: str, message: Any) -> None:
        """Let the taps that publish know of a topic whose first message is still to come; writes nothing."""
        if isinstance(message, Draft):
            message = message.build()
        for tap in self.taps:
            if isinstance(tap, Declares):
                tap.declare(topic, message, False)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the file, readable from here on."""
        self._container.attach(name, media_type, data)
        self._stream.flush()

    def close(self) -> None:
        """Write the index and `metadata.yaml`, and close. Calling it again does nothing.

        After an interruption within a chunk the file ends with its last whole chunk, without an index.
        """
        if not self._stream.closed:
            try:
                if not self._is_torn:
                    self._container.finish()
                    _, end = self._container.span or (0, 0)
                    write_metadata(self.path, self._topics, end, self._container.message_counts)
            finally:
                self._stream.close()
                written_here(self.path)
                self.make.keep()

    def _declare(self, topic: str, msgtype: str, is_latched: bool) -> None:
        text = b""
        if msgtype not in self._schemas:
            text = self.store.generate_msgdef(msgtype, ros_version=2)[0].encode()
        self._register(Topic(msgtype, LATCHED if is_latched else ""), topic, text)

    def _register(self, about: Topic, topic: str, definition: bytes) -> None:
        """Write of what type a topic is. definition: needed for a type that is new."""
        if about.msgtype not in self._schemas:
            made = self._container.add_schema(about.msgtype, "ros2msg", definition)
            self._schemas[about.msgtype] = made
        kind = self._schemas[about.msgtype]
        channel = self._container.add_channel(topic, "cdr", kind, {QOS: about.qos})
        self._topics[topic] = replace(about, channel=channel)
