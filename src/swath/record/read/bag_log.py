"""A rosbag 1, or a rosbag 2 in any container, read with its index."""

from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.record.read.mcap_log import BROKEN, CUT_OFF


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
