"""The MCAP files of a rosbag 2, one after the other."""

from collections.abc import Collection, Iterator
from pathlib import Path, PurePath
from typing import Any

from swath.core.errors import InputError
from swath.documents.yaml_document import read_document
from swath.record.read.mcap_log import McapLog


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
        rest = also_first
        for part in self._parts:
            for found in part.messages(wanted, rest):
                rest = "" if found[0] == rest else rest
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
    if kind != "mcap" or packing not in ("none", "message") or not all(part.is_file() for part in parts):
        return None
    return PartsLog(folder, parts, packed=packing == "message")
