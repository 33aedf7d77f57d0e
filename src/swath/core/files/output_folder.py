"""The folder that a command writes: of nobody else, and of one process at a time.

While a process writes, the folder holds `run.lock`, which says what it does and keeps others out. A kill
leaves that file and half files, `NAME.part`; whoever comes next takes them for its own. The lock itself goes
with the process.
"""

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path

from swath.core.errors import InputError, reason_of
from swath.core.files.place import is_within, own_folder, remove, remove_folder, within
from swath.core.files.whole_file import PART, open_to_keep

LOCK = "run.lock"


def is_own(name: str, own: Collection[str]) -> bool:
    """Whether a file is one of these, whole or not yet, or the lock. own: names or patterns (`scan.*`)."""
    names = (name, name.removesuffix(PART))
    return name == LOCK or any(fnmatchcase(each, pattern) for each in names for pattern in own)


def check_folder(path: Path, own: Collection[str], what: str) -> None:
    """InputError for an `--out` in which other files lie than these.

    own: as of `is_own`; what: those make, in words
    """
    if os.path.exists(path) and not os.path.isdir(path):
        raise InputError("--out", str(path), "expected a folder, this is a file")
    if os.path.isdir(path) and not all(is_own(f.name, own) for f in path.iterdir()):
        raise InputError("--out", str(path), f"expected a new or empty folder, or an earlier {what}")


def check_free(path: Path) -> None:
    """InputError for a folder that another process writes."""
    if os.path.isfile(path / LOCK):
        os.close(_locked(path))


@contextmanager
def held(
    path: Path, own: Collection[str], what: str, *, alone: bool = True, until: str = ""
) -> Iterator[Path]:
    """Inside the block this process has a folder, which is made where it is missing, without half files.

    Raises as `check_folder`. alone: no other files may lie there; until: the lock stays behind where there
    is no file of this name at the end
    """
    if alone:
        check_folder(path, own, what)
    is_new = not os.path.exists(path)
    with within(*[path] * (not is_within(path))):
        file = _locked(path)
        try:
            os.ftruncate(file, 0)
            os.write(file, f"{os.getpid()} {what}".encode())
            for part in path.glob(f"*{PART}"):
                if is_own(part.name, own):
                    remove(part)
            yield path
        finally:
            if os.path.exists(path / until):
                remove(path / LOCK)
            os.close(file)
            if is_new:
                with suppress(OSError):  # it holds something
                    remove_folder(path)


def _locked(folder: Path) -> int:
    """A locked file descriptor of run.lock, which is made where it is missing. InputError where it is taken.

    The lock goes with the process, however that ends. Where the file system has no locks, there is none.
    """
    path = folder / LOCK
    while True:
        try:
            own_folder(folder)
        except OSError as error:
            expected = f"expected a folder that can be made: {reason_of(error)}"
            raise InputError("--out", str(folder), expected) from None
        file = open_to_keep(path, os.O_RDWR)
        try:
            _take(file, folder)
            with suppress(FileNotFoundError):  # the process before removed it between the two lines above
                if os.path.samestat(os.fstat(file), path.stat()):
                    return file
        except BaseException:
            os.close(file)
            raise
        os.close(file)


def _take(file: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:  # no POSIX system
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(
            "--out", str(folder), f"expected a folder that {_who(file)} does not write to"
        ) from None
    except OSError:
        return


def _who(file: int) -> str:
    """Who holds a lock, in words."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        os.lseek(file, 0, os.SEEK_SET)
        pid, _, what = os.read(file, 1000).decode().partition(" ")
        return f"process {int(pid)} ({what})"
    return "another process"
