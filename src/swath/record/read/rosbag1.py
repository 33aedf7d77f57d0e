"""A rosbag 1, read chunk by chunk in the order of time; without its index as far as it goes.

The layout is that of the bag format, version 2.0 (wiki.ros.org/Bags/Format/2.0): records of a header of
name=value fields and data; messages and the definitions of their types lie in chunks. The index at the end
gives the times of the chunks.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, reason_of
from swath.core.files.read_file import open_to_read
from swath.core.schedule import NS
from swath.record.read.mcap_log import Cut, McapLog, unpacked

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 5, 6, 7  # values of the field `op`
Record = tuple[dict[bytes, bytes], bytes]
Span = tuple[int, int, int, int]  # first and last log time [ns] of a chunk, its place, messages in it


class Rosbag1(McapLog):
    """Reads a rosbag 1; notes as of McapLog. What a torn one holds ends with a note."""

    magic, kind = MAGIC, "a rosbag 1"

    def attachment(self, name: str) -> bytes | None:
        """A rosbag has none."""
        return None

    def end(self) -> int:
        """Log time of the last message [ns]; 0 where there is none."""
        with open_to_read(self.path, "recording", "a recording") as file:
            index = _index(file)
        return super().end() if index is None else max((last for _, last, *_ in index[1]), default=0)

    def _indexed_topics(self) -> dict[str, tuple[int, Any]] | None:
        from mcap.records import Channel, Schema

        with open_to_read(self.path, "recording", "a recording") as file:
            index = _index(file)
        if index is None:
            return None
        schemas = {entry.id: entry for entry in index[0] if isinstance(entry, Schema)}
        channels = [entry for entry in index[0] if isinstance(entry, Channel)]
        return {c.topic: (c.id, schemas.get(c.schema_id)) for c in channels}

    def _summary(self) -> Any:
        return None

    def _stated(self) -> int:
        with open_to_read(self.path, "recording", "a recording") as file:
            index = _index(file)
        return 0 if index is None else sum(message_count for *_, message_count in index[1])

    def _entries(self, file: Any) -> Iterator[Any]:
        """Schemas, channels and (channel number, log time, data) of messages, as MCAP would have them."""
        index = _index(file)
        if index is None:
            for header, body in _records(file, len(MAGIC), _size(file)):
                yield from _inside(header, body)
            raise Cut
        yield from index[0]
        for first, _, at, _ in sorted(index[1], key=lambda span: (span[0], span[2])):
            yield first
            found = next(_records(file, at, _size(file)), None)
            if found is None or found[0].get(b"op") != bytes([_CHUNK]):
                raise Cut
            yield from _inside(*found)


def open_rosbag1(path: Path) -> Rosbag1:
    """What can be read of a rosbag 1. InputError where nothing can."""
    try:
        log = Rosbag1(path)
        if log.topics() or not log.notes:
            return log
        reason = "it holds no message"
    except InputError:
        reason = f"it is not {Rosbag1.kind}"
    except Exception as error:  # broken headers fail in many ways
        reason = reason_of(error)
    expected = f"expected a readable rosbag ({reason}); a broken one needs a new index first"
    raise InputError("recording", path.name, expected, file=path)


def _index(file: Any) -> tuple[list[Any], list[Span]] | None:
    """Schemas and channels, and the chunks, of the index at the end; None where it is missing or torn."""
    size = _size(file)
    header, _ = next(_records(file, len(MAGIC), size), ({}, b""))
    begin = int.from_bytes(header.get(b"index_pos", b""), "little")
    if not len(MAGIC) < begin < size:
        return None
    counts = [int.from_bytes(header.get(name, b""), "little") for name in (b"conn_count", b"chunk_count")]
    declared: list[Any] = []
    spans: list[Span] = []
    for header, body in _records(file, begin, size):
        op = header.get(b"op")
        if op == bytes([_CONNECTION]):
            declared += list(_entry(header, body))
        elif op == bytes([_CHUNK_INFO]):
            first, last = (_time(header[name]) for name in (b"start_time", b"end_time"))
            counts_of = struct.iter_unpack("<II", body[: len(body) // 8 * 8])  # connection, messages of it
            place = int.from_bytes(header[b"chunk_pos"], "little")
            spans.append((first, last, place, sum(own_count for _, own_count in counts_of)))
    return (declared, spans) if [len(declared) // 2, len(spans)] == counts else None


def _inside(header: dict[bytes, bytes], body: bytes) -> Iterator[Any]:
    """What a record holds: a chunk, or a connection or message by itself."""
    if header.get(b"op") != bytes([_CHUNK]):
        yield from _entry(header, body)
        return
    from io import BytesIO

    data = _unpacked(header, body)
    for inner in _records(BytesIO(data), 0, len(data)):
        yield from _entry(*inner)


def _entry(header: dict[bytes, bytes], body: bytes) -> Iterator[Any]:
    from mcap.records import Channel, Schema

    op = header.get(b"op")
    if op == bytes([_CONNECTION]):
        number = int.from_bytes(header[b"conn"], "little") + 1
        about = _fields(body)
        name, text = about[b"type"].decode(), about[b"message_definition"]
        yield Schema(id=number, name=name, encoding="ros1msg", data=text)
        topic = header[b"topic"].decode()
        yield Channel(id=number, topic=topic, message_encoding="ros1", metadata={}, schema_id=number)
    elif op == bytes([_MESSAGE]):
        yield int.from_bytes(header[b"conn"], "little") + 1, _time(header[b"time"]), body


def _records(file: Any, at: int, size: int) -> Iterator[Record]:
    """Records one by one, as far as they are whole; of the last one, if a chunk, as much data as there is."""
    while at + 4 <= size:
        file.seek(at)
        length = int.from_bytes(file.read(4), "little")
        begin = at + 4 + length
        if begin + 4 > size:
            return
        header = _fields(file.read(length))
        if b"op" not in header:
            return
        end = begin + 4 + int.from_bytes(file.read(4), "little")
        if end > size and header.get(b"op") != bytes([_CHUNK]):
            return
        yield header, file.read(min(end, size) - begin - 4)
        at = end


def _size(file: Any) -> int:
    return int(file.seek(0, 2))


def _time(data: bytes) -> int:
    seconds, rest = struct.unpack("<II", data)
    return int(seconds) * NS + int(rest)


def _unpacked(header: dict[bytes, bytes], body: bytes) -> bytes:
    declared = int.from_bytes(header.get(b"size", b""), "little")
    return unpacked(header.get(b"compression", b""), body, declared)


def _fields(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<I", data, at)
        name, _, value = data[at + 4 : at + 4 + length].partition(b"=")
        found[name] = value
        at += 4 + length
    return found
