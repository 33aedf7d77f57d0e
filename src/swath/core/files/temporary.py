"""Folders for a while: gone with the process that made them, after a kill with the next of its user."""

import os
import shutil
import tempfile
import time
import weakref
from contextlib import suppress
from pathlib import Path

PREFIX = "swath-tmp-"
OPENING_S = 60.0  # within which a folder that was made has its lock


class TemporaryFolder:
    """A folder that nobody else can read, also as a block; removed with this object. path: where it is."""

    def __init__(self, what: str) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{what}-"))
        self.remove = weakref.finalize(self, _remove, self.path, _locked(self.path))

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *args: object) -> None:
        self.remove()


def sweep() -> None:
    """Remove the folders of processes of this user that were killed; those of others have a lock."""
    with suppress(OSError):  # one that another process sweeps, or that may not be read
        for entry in os.scandir(tempfile.gettempdir()):
            if entry.name.startswith(PREFIX) and entry.is_dir(follow_symlinks=False):
                about = entry.stat(follow_symlinks=False)
                is_own = hasattr(os, "getuid") and about.st_uid == os.getuid()
                if is_own and time.time() - about.st_mtime > OPENING_S:
                    with suppress(BlockingIOError):
                        _remove(Path(entry.path), _locked(Path(entry.path)))


def _locked(folder: Path) -> int:
    """A descriptor that locks a folder while it is open, -1 on no POSIX system. BlockingIOError."""
    try:
        import fcntl
    except ImportError:
        return -1
    file = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(file)
        raise
    return file


def _remove(folder: Path, file: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    if file >= 0:
        os.close(file)
