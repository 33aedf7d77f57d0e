"""metadata.yaml beside run.mcap: with it the run folder is a rosbag 2 (version 5 of its information)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from swath.core.whole_file import write_whole
from swath.documents.yaml_document import dump

NAME = "metadata.yaml"


@dataclass
class Topic:
    """msgtype: such as `std_msgs/msg/String`; qos: profiles that are offered, YAML; count: of messages."""

    msgtype: str
    qos: str = ""
    count: int = 0


def write_metadata(recording: Path, topics: Mapping[str, Topic], end: int, count: int) -> Path:
    """Write it for a recording that starts at 0; returns the file.

    end: time of the last message [ns]; count: of all messages
    """
    described = [
        {
            "topic_metadata": {
                "name": name,
                "type": topic.msgtype,
                "serialization_format": "cdr",
                "offered_qos_profiles": topic.qos,
            },
            "message_count": topic.count,
        }
        for name, topic in sorted(topics.items())
    ]
    span = {
        "starting_time": {"nanoseconds_since_epoch": 0},
        "duration": {"nanoseconds": end},
        "message_count": count,
    }
    about = {
        "version": 5,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": described,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [recording.name],
        "files": [{"path": recording.name, **span}],
    }
    return write_whole(recording.with_name(NAME), dump({"rosbag2_bagfile_information": about}))
