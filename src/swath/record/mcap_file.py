"""One MCAP file of ROS 2 (CDR) messages, readable up to its last whole chunk whatever happens.

`container.py` writes the container, `message_factory.py` makes the messages.
"""

from collections.abc import Hashable
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from swath.core.whole_file import open_to_write
from swath.record.bag_metadata import Topic, write_metadata
from swath.record.container import Container
from swath.record.message_factory import MessageFactory
from swath.record.templates import Draft, Template

CHUNK_BYTES = 512 * 1024
LATCHED = (
    "- history: keep_last\n  depth: 1\n  reliability: reliable\n  durability: transient_local\n"
    "  deadline:\n    sec: 9223372036\n    nsec: 854775807\n  lifespan:\n    sec: 9223372036\n"
    "    nsec: 854775807\n  liveliness: automatic\n  liveliness_lease_duration:\n    sec: 9223372036\n"
    "    nsec: 854775807\n  avoid_ros_namespace_conventions: false\n"
)


class Tap(Protocol):
    """Called with every message that is written; data: its CDR bytes; t: log time [ns]."""

    def __call__(self, topic: str, t: int, message: Any, data: bytes, is_latched: bool, /) -> None: ...


@runtime_checkable
class Declares(Protocol):
    """A tap that wants to know of a topic before its first message."""

    def declare(self, topic: str, message: Any, is_latched: bool) -> None: ...


class McapFile:
    """Writer of one file. Topics and types are declared by their first message. make: of messages

    Raises OSError when the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.make = MessageFactory()
        self.store = self.make.store
        self.path = path
        self._stream = open_to_write(path)
        self._container = Container(self._stream, chunk_bytes=CHUNK_BYTES, profile="ros2", library="swath")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._topics: dict[str, Topic] = {}
        self._end = self._count = 0
        self._templates: dict[tuple[str, Hashable], Template] = {}
        self._is_torn = False
        self.taps: list[Tap] = []  # called with every message that is written

    def write(self, topic: str, t: int, message: Any, *, is_latched: bool = False) -> None:
        """Append a message or draft, logged at simulated time t [ns]; after a torn one nothing."""
        if self._is_torn:
            return
        if isinstance(message, Draft):
            message, data = self._from_draft(topic, message)
        else:
            data = bytes(self.store.serialize_cdr(message, message.__msgtype__))
        if topic not in self._channels:
            self._declare(topic, message.__msgtype__, is_latched)
        about = self._topics[topic]
        about.count += 1
        self._count += 1
        self._end = max(self._end, t)
        if self._container.add(self._channels[topic], t, data):
            self._is_torn = True  # until the chunk is whole: Ctrl-C may come in between
            self._container.flush()
            self._is_torn = False
        for tap in self.taps:
            tap(topic, t, message, data, is_latched)

    def _from_draft(self, topic: str, draft: Draft) -> tuple[Any, bytes]:
        """The message, None where no tap wants it, and its bytes."""
        template = self._templates.get((topic, draft.variant))
        if template is not None and not self.taps:
            return None, template.fill(draft.t, draft.values)
        message = draft.build()
        data = bytes(self.store.serialize_cdr(message, message.__msgtype__))
        if template is None:
            self._templates[topic, draft.variant] = Template(self.store, message, data, draft.paths)
        return message, data

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
                    write_metadata(self.path, self._topics, self._end, self._count)
            finally:
                self._stream.close()

    def _declare(self, topic: str, msgtype: str, is_latched: bool) -> None:
        if msgtype not in self._schemas:
            text, _ = self.store.generate_msgdef(msgtype, ros_version=2)
            self._schemas[msgtype] = self._container.add_schema(msgtype, "ros2msg", text.encode())
        about = self._topics[topic] = Topic(msgtype, LATCHED if is_latched else "")
        metadata = {"offered_qos_profiles": about.qos}
        self._channels[topic] = self._container.add_channel(topic, "cdr", self._schemas[msgtype], metadata)
