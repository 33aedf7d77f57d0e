"""One MCAP file of ROS 2 (CDR) messages, readable up to its last whole chunk whatever happens.

`container.py` writes the container, `message_factory.py` makes the messages.
"""

from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from swath.core.errors import InputError
from swath.core.whole_file import open_to_write
from swath.documents.packed import readable
from swath.record.bag_metadata import Topic, write_metadata
from swath.record.container import Container
from swath.record.message_factory import MessageFactory
from swath.record.templates import Draft, Template

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
    ) -> None: ...


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
            data, build = self._from_draft(topic, message)
        else:
            data, build = bytes(self.store.serialize_cdr(message, message.__msgtype__)), lambda: message
        if topic not in self._channels:
            self._declare(topic, build().__msgtype__, is_latched)
        self._add(topic, t, data)
        for tap in self.taps:
            tap(topic, t, data, build, is_latched)

    @property
    def count(self) -> int:
        """Messages so far."""
        return self._count

    def begin_as(self, source: Path, count: int) -> None:
        """Take over the first messages of another file, in place of those that a new run would write.

        InputError where it has fewer of them; this file then is of no use.
        """
        from mcap.records import Channel, Message, Schema
        from mcap.stream_reader import StreamReader

        schemas: dict[int, Any] = {}
        channels: dict[int, Any] = {}
        with source.open("rb") as stream, readable("recording", "a whole run.mcap", source):
            for record in StreamReader(stream).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    if self._count == count:
                        break
                    self._copy(record, channels[record.channel_id], schemas)
        if self._count < count:
            raise InputError("recording", source.name, f"expected {count} messages of the run", file=source)

    def _copy(self, message: Any, channel: Any, schemas: Mapping[int, Any]) -> None:
        """A message as it stands in another file."""
        topic, schema = channel.topic, schemas[channel.schema_id]
        if topic not in self._topics:
            self._register(Topic(schema.name, channel.metadata.get(QOS, "")), topic, schema.data)
        self._add(topic, message.log_time, message.data)

    def _add(self, topic: str, t: int, data: bytes) -> None:
        self._topics[topic].count += 1
        self._count += 1
        self._end = max(self._end, t)
        if self._container.add(self._channels[topic], t, data):
            self._is_torn = True  # until the chunk is whole: Ctrl-C may come in between
            self._container.flush()
            self._is_torn = False

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
                    write_metadata(self.path, self._topics, self._end, self._count)
            finally:
                self._stream.close()
                self.make.keep()

    def _declare(self, topic: str, msgtype: str, is_latched: bool) -> None:
        text = b""
        if msgtype not in self._schemas:
            text = self.store.generate_msgdef(msgtype, ros_version=2)[0].encode()
        self._register(Topic(msgtype, LATCHED if is_latched else ""), topic, text)

    def _register(self, about: Topic, topic: str, definition: bytes) -> None:
        """Write of what type a topic is. definition: needed for a type that is new"""
        if about.msgtype not in self._schemas:
            made = self._container.add_schema(about.msgtype, "ros2msg", definition)
            self._schemas[about.msgtype] = made
        self._topics[topic] = about
        kind = self._schemas[about.msgtype]
        self._channels[topic] = self._container.add_channel(topic, "cdr", kind, {QOS: about.qos})
