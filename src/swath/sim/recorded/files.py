"""Recordings as topics and messages, whatever their container.

An MCAP file needs no index and is read up to where it breaks off; a rosbag 1, or a rosbag 2 in SQLite, is
read with its index. Messages are taken apart by the definitions that travel in the file.
"""

import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.schedule import NS

MAGIC = b"\x89MCAP0\r\n"
CUT_OFF = "recording broke off"
BROKEN = "messages not readable"
DAMAGED = "parts of the file are damaged and left out"
KINDS = "expected a run folder, an .mcap, a .bag, a .db3 or the folder of a rosbag 2"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F  # opcodes of MCAP
_HEAD = struct.Struct("<HIQQ")  # of a message: channel, sequence, log time, publish time
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size, checksum, length of the compression's name


class McapLog:
    """Reads an MCAP file from its beginning, without its index.

    notes: what went wrong, with how often; grows while reading
    """

    magic, kind = MAGIC, "an MCAP file"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: dict[str, int] = {}
        self._codecs: dict[tuple[str, bytes], Any] = {}
        with path.open("rb") as file:
            if file.read(len(self.magic)) != self.magic:
                raise InputError("recording", path.name, f"expected {self.kind}", file=path)

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
        """(topic, log time [ns], message) of some topics, and the first one of another, in file order."""
        rest = {also_first} - {""}
        for channel, schema, t, data in self._records(lambda topic: topic in wanted or topic in rest):
            topic = channel.topic
            rest.discard(topic)
            try:
                made = self._decode(channel, schema, data)
            except Exception:  # what a broken message raises depends on where it is broken
                self.notes[BROKEN] = self.notes.get(BROKEN, 0) + 1
                continue
            yield topic, t, made

    def attachment(self, name: str) -> bytes | None:
        """A file that was put into the file before its first message."""
        from mcap.records import Attachment, Chunk, Message
        from mcap.stream_reader import StreamReader

        with self.path.open("rb") as file:
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
        """From the summary at the end of a whole file."""
        summary = self._summary()
        if summary is None or not summary.channels:
            return None
        return {c.topic: (c.id, summary.schemas.get(c.schema_id)) for c in summary.channels.values()}

    def _summary(self) -> Any:
        from mcap.reader import make_reader

        try:
            with self.path.open("rb") as file:
                return make_reader(file).get_summary()
        except Exception:  # torn, or no index
            return None

    def _records(
        self, is_wanted: Callable[[str], bool], *, channels: bool = False
    ) -> Iterator[tuple[Any, Any, int, bytes]]:
        """(channel, schema, log time, data) of messages; with `channels` of every channel when it is met."""
        from mcap.records import Channel, Schema

        known: dict[int, tuple[Any, Any]] = {}
        schemas: dict[int, Any] = {}
        first: int | None = None
        reached = 0
        with self.path.open("rb") as file:
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
                    else:
                        number, t, data = entry
                        first, reached = t if first is None else first, max(reached, t)
                        if number in known and is_wanted(known[number][0].topic):
                            yield (*known[number], t, bytes(data))
            except GeneratorExit:
                raise
            except Exception:  # the ways in which a torn file fails are those of zstd, struct and mcap
                for old in [note for note in self.notes if note.startswith(CUT_OFF)]:
                    del self.notes[old]
                self.notes[f"{CUT_OFF} after {(reached - (first or 0)) / NS:.2f} s"] = 1

    def _entries(self, file: Any) -> Iterator[Any]:
        return _entries(file)

    def _decode(self, channel: Any, schema: Any, data: bytes) -> Any:
        key = (schema.name, schema.data)
        if key not in self._codecs:
            self._codecs[key] = _store_of(schema)
        name, store = _ros_name(schema.name), self._codecs[key]
        if channel.message_encoding == "ros1":
            return store.deserialize_ros1(data, name)
        return store.deserialize_cdr(data, name)


class BagLog:
    """Reads a rosbag 1 or 2 with its index; notes as of McapLog."""

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.notes: dict[str, int] = {}
        self._make: Callable[[], Any] = lambda: AnyReader(
            [path], default_typestore=get_typestore(Stores.ROS2_JAZZY)
        )
        try:
            with self._make() as reader:
                self._topics = {c.topic: c.msgtype for c in reader.connections}
                self._begin = int(reader.start_time) if reader.message_count else 0
                self._end = int(reader.end_time) - 1 if reader.message_count else 0
        except Exception as error:  # sqlite, yaml, struct: each container breaks in its own way
            expected = f"expected a readable rosbag ({error}); a broken one needs a new index first"
            raise InputError("recording", path.name, expected, file=path) from error

    def topics(self) -> dict[str, str]:
        """Topic -> type."""
        return dict(self._topics)

    def begin(self) -> int:
        """Log time of the first message [ns]."""
        return self._begin

    def end(self) -> int:
        """Log time of the last message [ns]."""
        return self._end

    def messages(self, wanted: Collection[str], also_first: str = "") -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) of some topics, and the first one of another, in order of time."""
        rest = {also_first} - {""}
        reached = self._begin
        with self._make() as reader:
            connections = [c for c in reader.connections if c.topic in wanted or c.topic in rest]
            if not connections:
                return
            records = iter(reader.messages(connections=connections))
            while True:
                try:
                    connection, reached, data = next(records)
                except StopIteration:
                    return
                except Exception:  # what breaks off differs from format to format
                    self.notes[f"{CUT_OFF} after {(reached - self._begin) / NS:.2f} s"] = 1
                    return
                if connection.topic not in wanted and connection.topic not in rest:
                    continue
                rest.discard(connection.topic)
                try:
                    made = reader.deserialize(data, connection.msgtype)
                except Exception:
                    self.notes[BROKEN] = self.notes.get(BROKEN, 0) + 1
                    continue
                yield connection.topic, reached, made

    def attachment(self, name: str) -> bytes | None:
        """A rosbag has none."""
        return None


Log = McapLog | BagLog


def open_log(path: Path) -> Log:
    """The reader of a file or folder; a run folder is its run.mcap. InputError where it is no recording."""
    if (path / "run.mcap").is_file():
        path = path / "run.mcap"
    if path.is_dir():
        return _open_folder(path)
    if not path.is_file():
        raise InputError("recording", str(path), "there is no such file")
    return McapLog(path) if path.suffix == ".mcap" or _has_magic(path) else _open_bag(path)


def _open_bag(path: Path) -> Log:
    from swath.sim.recorded.torn_bag import open_torn_bag

    try:
        return BagLog(path)
    except InputError:
        torn = open_torn_bag(path)
        if torn is None:
            raise
        return torn


def _open_folder(path: Path) -> Log:
    parts = sorted(path.glob("*.mcap"))
    if not (path / "metadata.yaml").is_file() and not parts:
        raise InputError("recording", path.name, KINDS, file=path)
    try:
        return BagLog(path)
    except InputError:
        if len(parts) != 1:
            raise
        return McapLog(parts[0])  # torn, or without metadata: as far as it goes


def _has_magic(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(8) == MAGIC


class Cut(Exception):
    """The file ends before its data do."""


def _entries(file: Any) -> Iterator[Any]:
    """Schemas, channels and (channel number, log time, data) of messages, in the order of the file.

    DAMAGED stands for a chunk whose checksum is wrong. Of a chunk that is torn, what can be unpacked is given
    before Cut is raised. The layout of the records is that of the MCAP specification, version 0
    (mcap.dev/spec).
    """
    size = file.seek(0, 2)
    file.seek(len(MAGIC))
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
    size = _CHUNK_HEAD.unpack_from(chunk)[-1]
    begin = _CHUNK_HEAD.size + size
    kind, data = bytes(chunk[_CHUNK_HEAD.size : begin]), chunk[begin + 8 :]
    if kind == b"zstd":
        import zstandard

        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    if kind == b"lz4":
        import lz4.frame  # type: ignore[import-not-found,import-untyped,unused-ignore]

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data))
    return data if kind == b"" else b""


def _read(kind: Any, body: memoryview) -> Any:
    from io import BytesIO

    from mcap.data_stream import ReadDataStream

    return kind.read(ReadDataStream(BytesIO(bytes(body))))


def _ros_name(name: str) -> str:
    """`sensor_msgs/LaserScan`, as ROS 1 says, as `sensor_msgs/msg/LaserScan`."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


def _store_of(schema: Any) -> Any:
    """A type store of a schema's own definitions; of ROS 2 Jazzy where it has none."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if not schema.data:
        return get_typestore(Stores.ROS2_JAZZY)
    text, name = schema.data.decode(), _ros_name(schema.name)
    found = get_types_from_idl(text) if schema.encoding == "ros2idl" else get_types_from_msg(text, name)
    store = get_typestore(Stores.EMPTY)
    store.register(found)
    return store
