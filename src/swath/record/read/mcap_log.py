"""An MCAP file, read from its beginning, without its index, up to where it breaks off.

Messages are taken apart by the definitions that travel in the file. One chunk is in memory at a time; where
they are to come in the order of time, also what later chunks may come before.
"""

import struct
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

from swath.core.apart.plain import missing_field
from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.core.schedule import NS
from swath.documents.packed import most_unpacked
from swath.record.read.definitions import definitions_of

MIB = 1 << 20
HELD_BYTES = 64 * MIB  # of messages that wait for the next chunk

Found = tuple[Any, Any, int, bytes]  # channel, schema, log time [ns], data


def in_time_order(found: Iterable[Found | int], held_bytes: int = HELD_BYTES) -> Iterator[Found]:
    """Messages by log time; of equal times as they come.

    A number stands before a chunk: nothing after it is earlier than that [ns], so what is goes out. Where no
    number comes, messages come as they are. Where more than `held_bytes` wait, the earliest goes out.
    """
    waiting: list[tuple[int, int, Found]] = []
    held = serial = 0
    is_sorted = False
    for item in found:
        if isinstance(item, int):
            is_sorted = True
            until, most = item, held_bytes
        elif not is_sorted:
            yield item
            continue
        else:
            heappush(waiting, (item[2], serial, item))
            serial, held = serial + 1, held + len(item[3])
            if held <= held_bytes:
                continue
            until, most = -1, held_bytes
        while waiting and (waiting[0][0] < until or held > most):
            first = heappop(waiting)[2]
            held -= len(first[3])
            yield first
    while waiting:
        yield heappop(waiting)[2]


MAGIC = b"\x89MCAP0\r\n"
CUT_OFF = "damaged: recording broke off"
BROKEN = "damaged: messages not readable"
DAMAGED = "damaged: parts of the file that are left out"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F  # opcodes of MCAP
_HEAD = struct.Struct("<HIQQ")  # of a message: channel, sequence, log time, publish time
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, checksum, length of the compression's name


class McapLog:
    """Reads an MCAP file from its beginning, without its index.

    by_time: messages in the order of time, not of the file, which is that in which swath writes
    packed: every message is packed by zstd, as rosbag 2 can do it
    notes: what went wrong, with how often; grows while reading
    """

    magic, kind = MAGIC, "an MCAP file"

    def __init__(self, path: Path, *, by_time: bool = False, packed: bool = False) -> None:
        self.path, self.by_time, self.packed = path, by_time, packed
        self.notes: dict[str, int] = {}
        self._codecs: dict[tuple[str, bytes], Any] = {}
        with open_to_read(path, "recording", "a recording") as file:
            if file.read(len(self.magic)) != self.magic:
                raise InputError("recording", path.name, f"expected {self.kind}", file=path)

    def forget_notes(self) -> None:
        """Begin to count anew."""
        self.notes.clear()

    def topics(self) -> dict[str, str]:
        """Topic -> type, in the order they were declared."""
        found = self._indexed_topics()
        if found is None:
            found = {}
            for channel, schema, _, _ in self._records(lambda topic: False, channels=True):
                found.setdefault(channel.topic, (channel.id, schema))
        ordered = sorted(found.items(), key=lambda item: item[1][0])
        return {topic: _ros_name(schema.name) if schema is not None else "" for topic, (_, schema) in ordered}

    def begin(self) -> int:
        """Log time of the first message [ns]; 0 where there is none."""
        return next((t for _, _, t, _ in self._records(lambda topic: True)), 0)

    def end(self) -> int:
        """Log time of the last message [ns]; 0 where there is none."""
        summary = self._summary()
        if summary is not None and summary.statistics is not None:
            return int(summary.statistics.message_end_time)
        return max((t for _, _, t, _ in self._records(lambda topic: True)), default=0)

    def messages(self, wanted: Collection[str], also_first: str = "") -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) of some topics, and the first one of another."""
        awaited = {also_first} - {""}
        for channel, schema, t, data in self._records(lambda topic: topic in wanted or topic in awaited):
            topic = channel.topic
            if topic not in wanted and topic not in awaited:
                continue
            awaited.discard(topic)
            try:
                data = unpacked_message(data) if self.packed else data
                made = self._decode(channel, schema, data)
            except Exception:  # what a broken message raises depends on where it is broken
                self.notes[BROKEN] = self.notes.get(BROKEN, 0) + 1
                continue
            yield topic, t, made

    def attachment(self, name: str) -> bytes | None:
        """A file that was put into the file before its first message."""
        from mcap.records import Attachment, Chunk, Message
        from mcap.stream_reader import StreamReader

        with open_to_read(self.path, "recording", "a recording") as file:
            try:
                records: Any = StreamReader(file, emit_chunks=True).records
                for record in records:
                    if isinstance(record, Attachment) and record.name == name:
                        return bytes(record.data)
                    if isinstance(record, Chunk | Message):
                        break
            except Exception:  # a torn or broken file has none
                return None
        return None

    def _indexed_topics(self) -> dict[str, tuple[int, Any]] | None:
        """Topics by the summary at the end of a whole file."""
        summary = self._summary()
        if summary is None or not summary.channels:
            return None
        return {c.topic: (c.id, summary.schemas.get(c.schema_id)) for c in summary.channels.values()}

    def _summary(self) -> Any:
        from mcap.reader import make_reader

        try:
            with open_to_read(self.path, "recording", "a recording") as file:
                return make_reader(file).get_summary()
        except Exception:  # torn, or no index
            return None

    def _stated(self) -> int:
        """Messages that the file says it has; 0 where it does not say."""
        summary = self._summary()
        return 0 if summary is None or summary.statistics is None else int(summary.statistics.message_count)

    def _records(
        self, is_wanted: Callable[[str], bool], *, channels: bool = False
    ) -> Iterator[tuple[Any, Any, int, bytes]]:
        """(channel, schema, log time, data) of messages; with `channels` of every channel when it is met."""
        return in_time_order(self._found(is_wanted, channels))

    def _found(
        self, is_wanted: Callable[[str], bool], channels: bool
    ) -> Iterator[tuple[Any, Any, int, bytes] | int]:
        """What `_records` gives, in the order of the file; before a chunk its first time [ns], if known."""
        from mcap.records import Channel, Schema

        known: dict[int, tuple[Any, Any]] = {}
        schemas: dict[int, Any] = {}
        first: int | None = None
        reached = count = 0
        with open_to_read(self.path, "recording", "a recording") as file:
            try:
                for entry in self._entries(file):
                    if entry is DAMAGED:
                        self.notes[DAMAGED] = self.notes.get(DAMAGED, 0) + 1
                    elif isinstance(entry, Schema):
                        schemas[entry.id] = entry
                    elif isinstance(entry, Channel):
                        known[entry.id] = (entry, schemas.get(entry.schema_id))
                        if channels:
                            yield (*known[entry.id], 0, b"")
                    elif isinstance(entry, int):
                        yield entry
                    else:
                        number, t, data = entry
                        count += 1
                        first, reached = t if first is None else first, max(reached, t)
                        if number in known and is_wanted(known[number][0].topic):
                            yield (*known[number], t, bytes(data))
                if count < (stated := self._stated()):
                    self.notes[f"lost: messages of {stated:,} that the file states"] = stated - count
            except GeneratorExit:
                raise
            except Exception:  # the ways in which a torn file fails are those of zstd, struct and mcap
                for old in [note for note in self.notes if note.startswith(CUT_OFF)]:
                    del self.notes[old]
                self.notes[f"{CUT_OFF} after {(reached - (first or 0)) / NS:.2f} s"] = 1

    def _entries(self, file: Any) -> Iterator[Any]:
        starts = _chunk_starts(file) if self.by_time else None
        return _entries(file) if starts is None else self._sorted_entries(file, starts)

    def _sorted_entries(self, file: Any, starts: list[tuple[int, int]]) -> Iterator[Any]:
        """What _entries gives, chunks by their first time, which stands before each of them."""
        summary = self._summary()
        if summary is not None:  # a channel may be declared in a chunk that comes later
            yield from summary.schemas.values()
            yield from summary.channels.values()
        for first, at in sorted(starts):
            file.seek(at)
            yield first
            yield from _entries_here(file, one=True)

    def _decode(self, channel: Any, schema: Any, data: bytes) -> Any:
        key = (schema.name, schema.data)
        if key not in self._codecs:
            self._codecs[key] = _store_of(schema)
        name, (store, least) = _ros_name(schema.name), self._codecs[key]
        if len(data) < least:
            raise ValueError(f"expected at least {least} bytes")
        if channel.message_encoding == "ros1":
            return store.deserialize_ros1(data, name)
        return store.deserialize_cdr(data, name)


class Cut(Exception):
    """The file ends before its data do."""


def _entries(file: Any) -> Iterator[Any]:
    """Schemas, channels and (channel number, log time, data) of messages, in the order of the file.

    DAMAGED stands for a chunk whose checksum is wrong. Of a chunk that is torn, what can be unpacked is given
    before Cut is raised. The layout of the records is that of the MCAP specification, version 0
    (mcap.dev/spec).
    """
    file.seek(len(MAGIC))
    yield from _entries_here(file)


def _entries_here(file: Any, *, one: bool = False) -> Iterator[Any]:
    """From where the file stands; only of one record."""
    at = file.tell()
    size = file.seek(0, 2)
    file.seek(at)
    while True:
        head = file.read(9)
        if len(head) < 9:
            raise Cut
        opcode, length = head[0], int.from_bytes(head[1:], "little")
        if opcode == _DATA_END:
            return
        if opcode not in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK):
            file.seek(length, 1)
            continue
        body = file.read(min(length, size - file.tell()))
        if opcode == _CHUNK:
            records = _unpacked(body)
            is_sound = len(body) < length or _CHUNK_HEAD.unpack_from(body)[3] in (0, zlib.crc32(records))
            yield from _records_of(memoryview(records)) if is_sound else (DAMAGED,)
        elif len(body) == length:
            yield from _records_of(memoryview(head + body))
        if len(body) < length:
            raise Cut
        if one:
            return


def _chunk_starts(file: Any) -> list[tuple[int, int]] | None:
    """(first time [ns], place) of all chunks; None where the file is torn or messages lie outside of them."""
    size = file.seek(0, 2)
    file.seek(len(MAGIC))
    found: list[tuple[int, int]] = []
    while True:
        at = file.tell()
        head = file.read(17)
        if len(head) < 9 or head[0] == _MESSAGE:
            return None
        if head[0] == _DATA_END:
            return found
        if head[0] == _CHUNK and len(head) == 17:
            found.append((int.from_bytes(head[9:], "little"), at))
        after = at + 9 + int.from_bytes(head[1:9], "little")
        if after > size:
            return None
        file.seek(after)


def _records_of(view: memoryview) -> Iterator[Any]:
    """What _entries gives, of whole records one after the other."""
    from mcap.records import Channel, Schema

    at = 0
    while at + 9 <= len(view):
        end = at + 9 + int.from_bytes(view[at + 1 : at + 9], "little")
        if end > len(view):
            return
        opcode, body = view[at], view[at + 9 : end]
        at = end
        if opcode == _MESSAGE:
            number, _, t, _ = _HEAD.unpack_from(body)
            yield number, t, body[_HEAD.size :]
        elif opcode in (_SCHEMA, _CHANNEL):
            yield _read(Schema if opcode == _SCHEMA else Channel, body)


def _unpacked(chunk: bytes) -> bytes:
    """The records in a chunk; of a torn one as many bytes as can be had."""
    if len(chunk) < _CHUNK_HEAD.size:
        return b""
    _, _, declared, _, size = _CHUNK_HEAD.unpack_from(chunk)
    begin = _CHUNK_HEAD.size + size
    kind, data = bytes(chunk[_CHUNK_HEAD.size : begin]), chunk[begin + 8 :]
    return unpacked(kind, data, declared)


def unpacked(kind: bytes, data: bytes, declared: int) -> bytes:
    """Packed data unpacked as far as they go, no further than they declare; kind: zstd, lz4, bz2 or none."""
    most = min(declared, most_unpacked(len(data)))
    if kind == b"zstd":
        import zstandard

        return bytes(zstandard.ZstdDecompressor().stream_reader(data).read(most))
    if kind == b"lz4":
        import lz4.frame  # type: ignore[import-not-found,import-untyped,unused-ignore]

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
    if kind == b"bz2":
        from bz2 import BZ2Decompressor

        return BZ2Decompressor().decompress(data, max_length=most)
    return data if kind in (b"", b"none") else b""


def unpacked_message(data: bytes) -> bytes:
    """A message that rosbag 2 packed, no longer than an honest one of its size can be."""
    return unpacked(b"zstd", data, most_unpacked(len(data)))


def _read(kind: Any, body: memoryview) -> Any:
    from io import BytesIO

    from mcap.data_stream import ReadDataStream

    return kind.read(ReadDataStream(BytesIO(bytes(body))))


def _ros_name(name: str) -> str:
    """`sensor_msgs/LaserScan`, as ROS 1 says, as `sensor_msgs/msg/LaserScan`."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


def _store_of(schema: Any) -> tuple[Any, int]:
    """A type store of a schema's own definitions, or of ROS 2 Jazzy; bytes that its type has at least."""
    from rosbags.typesys import Stores, get_typestore

    if not schema.data:
        return get_typestore(Stores.ROS2_JAZZY), 0
    name = _ros_name(schema.name)
    found = definitions_of(schema.data, name, is_idl=schema.encoding == "ros2idl")
    store = get_typestore(Stores.EMPTY)
    store.register(found.types)
    for kind in store.types.values():
        kind.__getattr__ = missing_field
    return store, found.least(name)
