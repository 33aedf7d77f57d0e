"""Recordings as topics and messages, whatever their container."""

from pathlib import Path

from swath.core.errors import InputError
from swath.record.formats import ABOUT, RECORDING, check_format, read_about
from swath.record.read.bag_log import BagLog
from swath.record.read.mcap_log import MAGIC, McapLog
from swath.record.read.parts import PartsLog, open_parts
from swath.record.read.rosbag1 import MAGIC as MAGIC_1
from swath.record.read.rosbag1 import open_rosbag1

RUN = "run.mcap"  # of swath, in the order in which it was published
KINDS = "expected a run folder, an .mcap, a .bag, a .db3 or the folder of a rosbag 2"

Log = McapLog | PartsLog | BagLog


def open_log(path: Path) -> Log:
    """The reader of a file or folder; a run folder is its run.mcap.

    InputError where it is no recording, or one of swath in a newer format.
    """
    log = _open(path)
    check_format(str(read_about(log.attachment(ABOUT)).get("format", "")), RECORDING, log.path)
    return log


def _open(path: Path) -> Log:
    if (path / RUN).is_file():
        path = path / RUN
    if path.is_dir():
        return _open_folder(path)
    if not path.is_file():
        raise InputError("recording", str(path), "there is no such file")
    if path.suffix == ".mcap" or _begins(path, MAGIC):
        return McapLog(path, by_time=path.name != RUN)
    return open_rosbag1(path) if path.suffix == ".bag" or _begins(path, MAGIC_1) else BagLog(path)


def _open_folder(path: Path) -> Log:
    parts = sorted(path.glob("*.mcap"))
    if not (path / "metadata.yaml").is_file() and not parts:
        raise InputError("recording", path.name, KINDS, file=path)
    if (named := open_parts(path)) is not None:
        return named
    try:
        return BagLog(path)
    except InputError:
        if len(parts) != 1:
            raise
        return McapLog(parts[0], by_time=True)  # torn, or without metadata: as far as it goes


def _begins(path: Path, magic: bytes) -> bool:
    with path.open("rb") as file:
        return file.read(len(magic)) == magic
