"""Recordings as topics and messages, whatever their container.

`McapLog` reads an MCAP file, `PartsLog` those of a rosbag 2 one after the other, `BagLog` a rosbag 2 in a
database, or packed, with its index, `ChannelLog` MF4, BLF and ASC.
"""

import os
from collections.abc import Callable, Collection, Iterator
from pathlib import Path, PurePath
from typing import Any, Protocol

from swath.core.apart.call import apart
from swath.core.errors import InputError, reason_of
from swath.core.files.read_file import open_to_read
from swath.core.files.temporary import TemporaryFolder
from swath.core.files.whole_file import new_file, write_whole
from swath.core.schedule import NS
from swath.documents.packed import most_unpacked, readable
from swath.documents.yaml_document import dump, read_document
from swath.field_io.logs.channels import open_channels
from swath.record.formats import ABOUT, RECORDING, check_format, read_about
from swath.record.read.channel_log import ChannelLog
from swath.record.read.definitions import Definitions, types_of_idl, types_of_msg
from swath.record.read.mcap_log import BROKEN, CUT_OFF, MAGIC, McapLog, unpacked_message
from swath.record.read.rosbag1 import MAGIC as MAGIC_1
from swath.record.read.rosbag1 import open_rosbag1

PACKED = ".zstd"
MAGIC_2, DATABASES = b"SQLite format 3", (".db3", PACKED)  # of a rosbag 2
RUN = "run.mcap"  # of swath, in the order in which it was published
KINDS = "expected a run folder, an .mcap, .bag, .db3, .mf4, .blf, .asc or the folder of a rosbag 2"


class PartsLog:
    """Reads the files of a rosbag 2, each in the order of time, in the order in which they were written."""

    def __init__(self, path: Path, parts: Collection[Path], *, packed: bool = False) -> None:
        self.path = path
        self._parts = [McapLog(part, by_time=True, packed=packed) for part in parts]

    @property
    def notes(self) -> dict[str, int]:
        """What went wrong, with how often; grows while reading."""
        found: dict[str, int] = {}
        for part in self._parts:
            for note, count in part.notes.items():
                found[note] = found.get(note, 0) + count
        return found

    def forget_notes(self) -> None:
        """Begin to count anew."""
        for part in self._parts:
            part.forget_notes()

    def topics(self) -> dict[str, str]:
        """Topic -> type."""
        return {topic: kind for part in self._parts for topic, kind in part.topics().items()}

    def begin(self) -> int:
        """Log time of the first message [ns]; 0 where there is none."""
        return next((t for part in self._parts if (t := part.begin())), 0)

    def end(self) -> int:
        """Log time of the last message [ns]; 0 where there is none."""
        return max((part.end() for part in self._parts), default=0)

    def messages(self, wanted: Collection[str], also_first: str = "") -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) of some topics, and the first one of another."""
        awaited = also_first
        for part in self._parts:
            for found in part.messages(wanted, awaited):
                awaited = "" if found[0] == awaited else awaited
                yield found

    def attachment(self, name: str) -> bytes | None:
        """A rosbag has none."""
        return None


def open_parts(folder: Path) -> PartsLog | None:
    """The MCAP files that the metadata of a rosbag 2 name, None where they name others, or packed files."""
    try:
        about = read_document(folder / "metadata.yaml").data["rosbag2_bagfile_information"]
        parts = [folder / PurePath(str(name)).name for name in about["relative_file_paths"]]
        packing = str(about.get("compression_mode") or "none").lower()
        kind = about["storage_identifier"]
    except (InputError, KeyError, TypeError, AttributeError):
        return None
    if (
        kind != "mcap"
        or packing not in ("none", "message")
        or not all(os.path.isfile(part) for part in parts)
    ):
        return None
    return PartsLog(folder, parts, packed=packing == "message")


LENGTH = 0  # SQLITE_LIMIT_LENGTH: the longest value of a database, sqlite.org/c3ref/c_limit_attached.html


class BagLog:
    """Reads a rosbag 2 with its index; notes as of McapLog."""

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader, anyreader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.notes: dict[str, int] = {}
        vars(anyreader).update(get_types_from_idl=types_of_idl, get_types_from_msg=types_of_msg)
        self._make: Callable[[], Any] = lambda: AnyReader(
            [path], default_typestore=get_typestore(Stores.ROS2_JAZZY)
        )
        try:
            if os.path.isdir(path):
                read_document(path / "metadata.yaml")  # rosbags reads it without a bound
            with self._make() as reader:
                self._definitions = Definitions(reader.typestore.fielddefs)
                self._topics = {c.topic: c.msgtype for c in reader.connections}
                self._begin = int(reader.start_time) if reader.message_count else 0
                self._end = int(reader.end_time) - 1 if reader.message_count else 0
        except Exception as error:  # sqlite, yaml, struct: each container breaks in its own way
            expected = (
                f"expected a readable rosbag ({reason_of(error)}); a broken one needs a new index first"
            )
            raise InputError("recording", path.name, expected, file=path) from error

    def forget_notes(self) -> None:
        """Begin to count anew."""
        self.notes.clear()

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
        awaited = {also_first} - {""}
        reached = self._begin
        with self._make() as reader:
            connections = [c for c in reader.connections if c.topic in wanted or c.topic in awaited]
            if not connections:
                return
            is_packed = _bounded(reader, self.path)
            records = iter(reader.messages(connections=connections))
            counts = [c.msgcount for c in connections]
            stated, count = sum(own_count for own_count in counts), 0
            while True:
                try:
                    connection, reached, data = next(records)
                    count += 1
                except StopIteration:
                    if count < stated:
                        self.notes[f"lost: messages of {stated:,} that the file states"] = stated - count
                    return
                except Exception:  # what breaks off differs from format to format
                    self.notes[f"{CUT_OFF} after {(reached - self._begin) / NS:.2f} s"] = 1
                    return
                if connection.topic not in wanted and connection.topic not in awaited:
                    continue
                awaited.discard(connection.topic)
                try:
                    data = unpacked_message(data) if is_packed else data
                    if len(data) < self._definitions.least(connection.msgtype):
                        raise ValueError("expected more bytes")
                    made = reader.deserialize(data, connection.msgtype)
                except Exception:
                    self.notes[BROKEN] = self.notes.get(BROKEN, 0) + 1
                    continue
                yield connection.topic, reached, made

    def attachment(self, name: str) -> bytes | None:
        """A rosbag has none."""
        return None


@apart("recording", "a packed recording", libraries=("zstandard",))
def _unpacked(part: Path) -> Iterator[bytes]:
    """A packed file, no further than one of its size can honestly hold."""
    import zstandard

    most, held = most_unpacked(part.stat().st_size), 0
    with open_to_read(part, "recording", "a recording") as file:
        for piece in zstandard.ZstdDecompressor().read_to_iter(file):
            held += len(piece)
            if held > most:
                expected = f"expected at most {most} bytes unpacked"
                raise InputError("recording", part.name, expected, file=part)
            yield piece


def _unpack(folder: Path) -> TemporaryFolder:
    """The files of a rosbag 2 that are packed whole, unpacked: rosbags would do it where it may not write."""
    about = read_document(folder / "metadata.yaml").data
    made = TemporaryFolder("bag")
    with readable("recording", "metadata of a rosbag 2", folder / "metadata.yaml"):
        own = about["rosbag2_bagfile_information"]
        names = [PurePath(str(name)).name for name in own["relative_file_paths"]]
        for name in names:
            with new_file(made.path / name.removesuffix(PACKED)) as file:
                file.writelines(_unpacked(folder / name))
        bare = [name.removesuffix(PACKED) for name in names]
        own |= {"relative_file_paths": bare, "compression_mode": "", "compression_format": ""}
        own.pop("files", None)
    write_whole(made.path / "metadata.yaml", dump(about))
    return made


def _bounded(reader: Any, path: Path) -> bool:
    """Keeps a database from giving a message longer than the file; whether messages are packed, see
    `unpacked_message`: rosbags would unpack them without a bound.
    """
    storage = reader.readers[0].storage
    most = most_unpacked(sum(p.stat().st_size for p in ([path] if os.path.isfile(path) else path.iterdir())))
    for part in getattr(storage, "storages", [storage]):
        if (database := getattr(part, "dbconn", None)) is not None:
            database.limit(LENGTH, min(most, 2**31 - 1))
    is_packed = bool(storage.metadata.compression_mode == "message")
    storage.metadata = storage.metadata._replace(compression_mode=None)
    return is_packed


class Log(Protocol):
    """A recording as topics and messages. notes: what went wrong, with how often; grows while reading."""

    path: Path

    @property
    def notes(self) -> dict[str, int]:
        """What went wrong, with how often."""

    def forget_notes(self) -> None:
        """Begin to count anew."""

    def topics(self) -> dict[str, str]:
        """Topic -> type."""

    def begin(self) -> int:
        """Log time of the first message [ns]; 0 where there is none."""

    def end(self) -> int:
        """Log time of the last message [ns]; 0 where there is none."""

    def messages(self, wanted: Collection[str], also_first: str = "") -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) of some topics, and the first one of another."""

    def attachment(self, name: str) -> bytes | None:
        """A file that was put into the recording before its first message."""


def open_log(path: Path) -> Log:
    """The reader of a file or folder; a run folder is its run.mcap.

    InputError where it is no recording, or one of swath in a newer format.
    """
    log = _open(path)
    check_format(str(read_about(log.attachment(ABOUT)).get("format", "")), RECORDING, log.path)
    return log


def _open(path: Path) -> Log:
    if os.path.isfile(path / RUN):
        path = path / RUN
    if os.path.isdir(path):
        if not any(path.glob(f"*{PACKED}")) or not os.path.isfile(path / "metadata.yaml"):
            return _recording(path)
        unpacked = _unpack(path)
        log = _recording(unpacked.path)
        vars(log).update(path=path, unpacked=unpacked)
        return log
    is_mcap = path.suffix == ".mcap" or _begins(path, MAGIC)
    channels = None if is_mcap else open_channels(path)
    return _recording(path) if channels is None else ChannelLog(channels)


LIBRARIES = ("mcap.reader", "mcap.stream_reader", "rosbags.highlevel", "rosbags.typesys", "zstandard",
             "lz4.frame")  # fmt: skip


@apart("recording", "a recording", libraries=LIBRARIES, kept=(McapLog, PartsLog, BagLog))
def _recording(path: Path) -> Log:
    """The reader of a recording of messages. InputError where it is none."""
    if os.path.isdir(path):
        return _open_folder(path)
    if path.suffix == ".mcap" or _begins(path, MAGIC):
        return McapLog(path, by_time=path.name != RUN)
    if path.suffix == ".bag" or _begins(path, MAGIC_1):
        return open_rosbag1(path)
    if path.suffix not in DATABASES and not _begins(path, MAGIC_2):
        raise InputError("recording", path.name, f"{KINDS}; by its first bytes it is none", file=path)
    return BagLog(path)


def _open_folder(path: Path) -> Log:
    parts = sorted(path.glob("*.mcap"))
    has_data = bool(parts) or any(file.suffix in DATABASES for file in path.iterdir())
    if not has_data or not (parts or os.path.isfile(path / "metadata.yaml")):
        raise InputError("recording", path.name, f"{KINDS}; it holds no such file", file=path)
    if (named := open_parts(path)) is not None:
        return named
    try:
        return BagLog(path)
    except InputError:
        if len(parts) != 1:
            raise
        return McapLog(parts[0], by_time=True)  # torn, or without metadata: as far as it goes


def _begins(path: Path, magic: bytes) -> bool:
    with open_to_read(path, "recording", "a recording") as file:
        return file.read(len(magic)) == magic
