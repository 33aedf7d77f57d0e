"""The one way in which files are written: new, whole or not at all, and never through a link.

Whatever lies in the place of a file, or of the one beside it that is being written, is replaced, not written
to: a link there goes, what it leads to stays. Where it is, `place` finds. Errors of writing name their file.
"""

import csv
import errno
import io
import os
import shutil
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from swath.core.errors import InputError
from swath.core.files.place import place
from swath.core.files.read_file import open_to_read

PART = ".part"  # at the end of the name of a file that is still being written


class NamedFile(io.FileIO):
    """A file opened to write, whose errors name it: those of the system name none, as on a full disk."""

    def write(self, data: Any) -> int:
        """As `io.FileIO`, but all of it."""
        done, whole = 0, memoryview(data).cast("B")
        try:
            while done < len(whole):
                done += super().write(whole[done:])
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.name)) from error
        return done


def open_to_write(path: Path) -> BinaryIO:
    """A new file in the place of what was there, buffered. InputError as `place`; OSError, which names it."""
    with place(path, make=True) as at:
        return _created(path, *at)


def open_to_keep(path: Path, flags: int) -> int:
    """Descriptor of a file that may be there. flags: as of `os.open`. InputError where it is a link."""
    more = os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # a pipe may wait
    try:
        with place(path, make=True) as (name, folder):
            if folder is None and os.path.islink(path):
                raise OSError(errno.ELOOP, "", name)
            file = os.open(name, flags | more, 0o644, dir_fd=folder)
    except OSError as error:
        if os.path.islink(path):
            raise InputError("file", str(path), "expected a file, not a link to another one") from error
        if error.errno == errno.ENXIO:
            raise InputError("file", str(path), "expected a file, not a device or pipe") from error
        raise
    about = os.fstat(file)
    if not stat.S_ISREG(about.st_mode) or about.st_nlink != 1:
        os.close(file)
        raise InputError("file", str(path), "expected a file that has no other name (a hard link)")
    return file


def open_to_append(path: Path) -> BinaryIO:
    """A file to write at its end, at once, made where it is missing. InputError where it is a link."""
    return NamedFile(str(path), "ab", opener=lambda name, flags: open_to_keep(Path(name), flags))


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write; it takes its name at the end of the block. OSError names the file.

    Until then it is called `NAME.part`, which an error removes. Folders around it are made where they are
    missing. InputError as `place`.
    """
    if not path.name:
        raise InputError("file", str(path), "expected the name of a file")
    part = path.with_name(path.name + PART)
    with place(part, make=True) as (name, folder), ExitStack() as held:
        try:
            with _created(part, name, folder) as file:
                whole = os.dup(file.fileno())
                held.callback(os.close, whole)
                yield file
            if is_alone := _is_named(whole, name, folder):
                os.fsync(whole)  # else a crash of the system can leave the name and not what it names
                os.replace(name, name.removesuffix(PART), src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException as error:
            if isinstance(error, OSError) and error.filename in (name, str(part)):
                error.filename = str(path)
            with suppress(FileNotFoundError):
                os.unlink(name, dir_fd=folder)
            raise
    if not is_alone:
        raise InputError("file", str(path), "expected a file that no other process writes")


def _created(path: Path, name: str, folder: int | None) -> BinaryIO:
    """A new file, in the place of what was there."""
    with suppress(FileNotFoundError):
        os.unlink(name, dir_fd=folder)
    file = NamedFile(str(path), "xb", opener=lambda _, flags: os.open(name, flags, 0o666, dir_fd=folder))
    return io.BufferedWriter(file)


def _is_named(file: int, name: str, folder: int | None) -> bool:
    """Whether an open file still has its name."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(file), os.stat(name, dir_fd=folder, follow_symlinks=False))
    return False


def write_whole(path: Path, data: str | bytes) -> Path:
    """Write a file in one go and return its path; text is UTF-8. OSError names the file."""
    with new_file(path) as file:
        file.write(data.encode("utf-8") if isinstance(data, str) else data)
    return path


def write_csv(path: Path, rows: Sequence[Mapping[str, object]], head: Sequence[str] = ()) -> Path:
    """Write a CSV file and return its path. head: names of the columns, by default those of the first row."""
    text = io.StringIO()
    writer = csv.DictWriter(text, head or list(rows[0] if rows else ()), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return write_whole(path, text.getvalue())


def copy_whole(source: Path, target: Path, key: str, what: str) -> None:
    """Copy a file. InputError with this key, `expected what`, where it cannot be read."""
    with open_to_read(source, key, what) as old, new_file(target) as new:
        shutil.copyfileobj(old, new)
