"""Publishes run.mcap as ROS 2 topics at its pace, with `/clock`."""

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.core.schedule import NS
from swath.documents.packed import readable
from swath.link.ros2.middleware import Clock, close_node, open_node
from swath.link.ros2.publisher import Publisher
from swath.record.read.definitions import definitions_of

LATCHED = "transient_local"


def find_recording(source: Path) -> Path:
    """The run.mcap of a run folder, or the .mcap file itself. InputError for anything else."""
    file = source / "run.mcap" if source.is_dir() else source
    if file.suffix != ".mcap" or not file.is_file():
        raise InputError("RUN", str(source), "expected a run folder with a run.mcap, or a .mcap file")
    return file


def play(file: Path, *, factor: float = 1.0, wait_s: float = 1.0, name: str = "swath") -> int:
    """Publish a recording; the number of messages published.

    factor: simulated seconds per second; wait_s: between all topics being there and the first message, for
    readers to find them. Raises InputError for a file that is no recording, MissingExtra without rclpy.
    """
    node = open_node(name, "swath ros2 play", start_parameter_services=False)
    try:
        store, firsts = _open(file)
        publisher = Publisher(node, store)
        for topic, (message, is_latched) in firsts.items():
            publisher.declare(topic, message, is_latched)
        clock = Clock(node)
        time.sleep(wait_s)
        began = time.monotonic()
        for topic, t, kind, data, is_latched in _messages(file):
            while clock.due <= t:
                _wait(began, clock.due, factor)
                clock.publish(clock.due)
            _wait(began, t, factor)
            publisher(topic, t, data, partial(store.deserialize_cdr, data, kind), is_latched)
        time.sleep(min(wait_s, 0.5))
        return publisher.count
    finally:
        close_node(node)


def _wait(began: float, t: int, factor: float) -> None:
    left = began + t / NS / factor - time.monotonic()
    if left > 0.0:
        time.sleep(left)


def _open(file: Path) -> tuple[Any, dict[str, tuple[Any, bool]]]:
    """The types of a recording, and the first message of each topic."""
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    firsts: dict[str, tuple[Any, bool]] = {}
    with readable("recording", "a whole MCAP file", file):
        with open_to_read(file, "recording", "an MCAP file") as stream:
            summary = make_reader(stream).get_summary()
        if summary is None:
            raise ValueError("`mcap recover` mends a cut one")
        for schema in summary.schemas.values():
            found = definitions_of(schema.data, schema.name).types
            store.register({name: kind for name, kind in found.items() if name not in store.types})
        for topic, _, kind, data, is_latched in _messages(file):
            if topic not in firsts:
                firsts[topic] = store.deserialize_cdr(data, kind), is_latched
                if len(firsts) == len(summary.channels):
                    break
    return store, firsts


def _messages(file: Path) -> Iterator[tuple[str, int, str, bytes, bool]]:
    """(topic, t [ns], type, CDR bytes, is_latched) in order of time."""
    from mcap.reader import make_reader

    with open_to_read(file, "recording", "an MCAP file") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            is_latched = LATCHED in channel.metadata.get("offered_qos_profiles", "")
            kind = schema.name if schema is not None else ""
            yield channel.topic, message.log_time, kind, bytes(message.data), is_latched
