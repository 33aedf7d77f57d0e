"""A rosbag 1 without its index, as a crash leaves it: read record by record up to where it breaks off.

The layout is that of the bag format, version 2.0 (wiki.ros.org/Bags/Format/2.0): records of a header of
name=value fields and data; messages and the definitions of their types lie in chunks.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.record.read.mcap_log import Cut, McapLog, unpacked

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7  # values of the field `op`
Record = tuple[dict[bytes, bytes], bytes]


class TornBag(McapLog):
    """Reads a rosbag 1 from its beginning; notes as of McapLog. What it holds ends with a note."""

    magic, kind = MAGIC, "a rosbag 1"

    def attachment(self, name: str) -> bytes | None:
        """A rosbag has none."""
        return None

    def _summary(self) -> Any:
        return None

    def _entries(self, file: Any) -> Iterator[Any]:
        """Schemas, channels and (channel number, log time, data) of messages, as MCAP would have them."""
        data = file.read()
        for header, body in _records(data, len(MAGIC)):
            if header.get(b"op") == bytes([_CHUNK]):
                for inner in _records(_unpacked(header, body), 0):
                    yield from _entry(*inner)
            else:
                yield from _entry(header, body)
        raise Cut


def open_torn_bag(path: Path) -> TornBag | None:
    """What can be read of a rosbag 1 whose index cannot; None where nothing can."""
    try:
        log = TornBag(path)
    except InputError:
        return None
    return log if log.topics() else None


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
        seconds, rest = struct.unpack("<II", header[b"time"])
        yield int.from_bytes(header[b"conn"], "little") + 1, seconds * NS + rest, body


def _records(data: bytes, at: int) -> Iterator[Record]:
    """Whole records; of the last one as much of its data as there is, where it is a chunk."""
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<I", data, at)
        begin = at + 4 + length
        if begin + 4 > len(data):
            return
        header = _fields(data[at + 4 : begin])
        (size,) = struct.unpack_from("<I", data, begin)
        at = begin + 4 + size
        if at <= len(data) or header.get(b"op") == bytes([_CHUNK]):
            yield header, data[begin + 4 : at]


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
