"""Publishes run.mcap as ROS 2 topics at its pace, with `/clock`."""

import os
import time
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from swath.core.apart.call import apart
from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.core.schedule import NS
from swath.documents.packed import readable
from swath.link.ros2.middleware import Clock, close_node, open_node
from swath.link.ros2.publisher import Publisher
from swath.record.message_factory import MessageFactory
from swath.record.read.definitions import definitions_of
from swath.record.read.files import LIBRARIES

LATCHED = "transient_local"


def find_recording(source: Path) -> Path:
    """The run.mcap of a run folder, or the .mcap file itself. InputError for anything else."""
    file = source / "run.mcap" if os.path.isdir(source) else source
    if file.suffix != ".mcap" or not os.path.isfile(file):
        raise InputError("RUN", str(source), "expected a run folder with a run.mcap, or a .mcap file")
    return file


def play(file: Path, *, factor: float = 1.0, wait_s: float = 1.0, name: str = "swath") -> int:
    """Publish a recording; the number of messages published.

    factor: simulated seconds per second; wait_s: between all topics being there and the first message, for
    readers to find them. Raises InputError for a file that is no recording, MissingExtra without rclpy.
    """
    node = open_node(name, "swath ros2 play", start_parameter_services=False)
    try:
        publisher = Publisher(node, MessageFactory().store)
        for topic, _, _, is_latched, message in _messages(file, only_first=True):
            publisher.declare(topic, message, is_latched)
        clock = Clock(node)
        time.sleep(wait_s)
        began = time.monotonic()
        for topic, t, data, is_latched, message in _messages(file, frozenset(publisher.replaced)):
            while clock.due <= t:
                _wait(began, clock.due, factor)
                clock.publish(clock.due)
            _wait(began, t, factor)
            publisher(topic, t, data, partial(_as_it_is, message), is_latched)
        time.sleep(min(wait_s, 0.5))
        return publisher.count
    finally:
        close_node(node)


def _as_it_is(message: Any) -> Any:
    return message


def _wait(began: float, t: int, factor: float) -> None:
    left = began + t / NS / factor - time.monotonic()
    if left > 0.0:
        time.sleep(left)


@apart("recording", "a whole MCAP file", libraries=LIBRARIES)
def _messages(
    file: Path, built: Collection[str] = (), *, only_first: bool = False
) -> Iterator[tuple[str, int, bytes, bool, Any]]:
    """(topic, t [ns], CDR bytes, is_latched, message) in order of time.

    Messages are made of the first of each topic and of those that are `built`, else None.
    only_first: of each topic
    """
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    met = set[str]()
    with (
        readable("recording", "a whole MCAP file", file),
        open_to_read(file, "recording", "an MCAP file") as stream,
    ):
        reader = make_reader(stream)
        summary = reader.get_summary()
        if summary is None:
            raise ValueError("`mcap recover` mends a cut one")
        for schema in summary.schemas.values():
            found = definitions_of(schema.data, schema.name).types
            store.register({name: kind for name, kind in found.items() if name not in store.types})
        for schema, channel, message in reader.iter_messages():
            topic, data = channel.topic, bytes(message.data)
            if only_first and topic in met:
                continue
            is_latched = LATCHED in channel.metadata.get("offered_qos_profiles", "")
            kind = "" if schema is None else schema.name
            is_built = topic not in met or topic in built
            met.add(topic)
            made = store.deserialize_cdr(data, kind) if is_built else None
            yield topic, message.log_time, data, is_latched, made
            if only_first and len(met) == len(summary.channels):
                return
