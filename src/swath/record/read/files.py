"""Recordings as topics and messages, whatever their container."""

from pathlib import Path

from swath.core.errors import InputError
from swath.record.formats import ABOUT, RECORDING, check_format, read_about
from swath.record.read.bag_log import BagLog
from swath.record.read.mcap_log import MAGIC, McapLog
from swath.record.read.torn_bag import open_torn_bag

KINDS = "expected a run folder, an .mcap, a .bag, a .db3 or the folder of a rosbag 2"

Log = McapLog | BagLog


def open_log(path: Path) -> Log:
    """The reader of a file or folder; a run folder is its run.mcap.

    InputError where it is no recording, or one of swath in a newer format.
    """
    log = _open(path)
    check_format(str(read_about(log.attachment(ABOUT)).get("format", "")), RECORDING, log.path)
    return log


def _open(path: Path) -> Log:
    if (path / "run.mcap").is_file():
        path = path / "run.mcap"
    if path.is_dir():
        return _open_folder(path)
    if not path.is_file():
        raise InputError("recording", str(path), "there is no such file")
    return McapLog(path) if path.suffix == ".mcap" or _has_magic(path) else _open_bag(path)


def _open_bag(path: Path) -> Log:
    try:
        return BagLog(path)
    except InputError:
        torn = open_torn_bag(path)
        if torn is None:
            raise
        return torn


def _open_folder(path: Path) -> Log:
    parts = sorted(path.glob("*.mcap"))
    if not (path / "metadata.yaml").is_file() and not parts:
        raise InputError("recording", path.name, KINDS, file=path)
    try:
        return BagLog(path)
    except InputError:
        if len(parts) != 1:
            raise
        return McapLog(parts[0])  # torn, or without metadata: as far as it goes


def _has_magic(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(8) == MAGIC
