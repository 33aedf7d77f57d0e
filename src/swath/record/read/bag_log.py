"""A rosbag 2 in a database, or packed, read with its index."""

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.documents.packed import most_unpacked
from swath.documents.yaml_document import read_document
from swath.record.read.mcap_log import BROKEN, CUT_OFF, unpacked_message

LENGTH = 0  # SQLITE_LIMIT_LENGTH: the longest value of a database, sqlite.org/c3ref/c_limit_attached.html


class BagLog:
    """Reads a rosbag 2 with its index; notes as of McapLog."""

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.notes: dict[str, int] = {}
        self._make: Callable[[], Any] = lambda: AnyReader(
            [path], default_typestore=get_typestore(Stores.ROS2_JAZZY)
        )
        try:
            if path.is_dir():
                _check_parts(path)
            with self._make() as reader:
                self._topics = {c.topic: c.msgtype for c in reader.connections}
                self._begin = int(reader.start_time) if reader.message_count else 0
                self._end = int(reader.end_time) - 1 if reader.message_count else 0
        except Exception as error:  # sqlite, yaml, struct: each container breaks in its own way
            expected = f"expected a readable rosbag ({error}); a broken one needs a new index first"
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
        rest = {also_first} - {""}
        reached = self._begin
        with self._make() as reader:
            connections = [c for c in reader.connections if c.topic in wanted or c.topic in rest]
            if not connections:
                return
            is_packed = _bounded(reader, self.path)
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
                    data = unpacked_message(data) if is_packed else data
                    made = reader.deserialize(data, connection.msgtype)
                except Exception:
                    self.notes[BROKEN] = self.notes.get(BROKEN, 0) + 1
                    continue
                yield connection.topic, reached, made

    def attachment(self, name: str) -> bytes | None:
        """A rosbag has none."""
        return None


def _check_parts(folder: Path) -> None:
    """InputError where the metadata are none, or packed files hold more than they honestly can.

    rosbags reads both without a bound; it unpacks files to the disk.
    """
    import zstandard

    read_document(folder / "metadata.yaml")
    for part in folder.glob("*.zstd"):
        most, held = most_unpacked(part.stat().st_size), 0
        with part.open("rb") as file:
            for piece in zstandard.ZstdDecompressor().read_to_iter(file):
                held += len(piece)
                if held > most:
                    expected = f"expected at most {most} bytes unpacked"
                    raise InputError("recording", part.name, expected, file=part)


def _bounded(reader: Any, path: Path) -> bool:
    """Keeps a database from giving a message longer than the file; whether messages are packed, see
    `unpacked_message`: rosbags would unpack them without a bound."""
    storage = reader.readers[0].storage
    most = most_unpacked(sum(p.stat().st_size for p in ([path] if path.is_file() else path.iterdir())))
    for part in getattr(storage, "storages", [storage]):
        if (database := getattr(part, "dbconn", None)) is not None:
            database.limit(LENGTH, min(most, 2**31 - 1))
    is_packed = bool(storage.metadata.compression_mode == "message")
    storage.metadata = storage.metadata._replace(compression_mode=None)
    return is_packed
