"""The one way in which files are written: new, whole or not at all, and never through a link.

Whatever lies in the place of a file, or of the one beside it that is being written, is replaced, not written
to: a link there goes, what it leads to stays. Errors of writing name their file.
"""

import csv
import io
import os
import shutil
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from swath.core.errors import InputError
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
    """A new file in the place of what was there, buffered. OSError, which names the file."""
    path.unlink(missing_ok=True)
    return io.BufferedWriter(NamedFile(str(path), "xb"))


def open_to_keep(path: Path, flags: int) -> int:
    """Descriptor of a file that may be there. flags: as of `os.open`. InputError where it is a link."""
    try:
        file = os.open(path, flags | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
    except OSError as error:
        if path.is_symlink():
            raise InputError("file", str(path), "expected a file, not a link to another one") from error
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

    Until then it is called `NAME.part`, which an error removes.
    """
    part = path.with_name(path.name + PART)
    try:
        with open_to_write(part) as file:
            own = os.fstat(file.fileno())
            yield file
        if is_alone := part.exists() and os.path.samestat(own, part.stat()):
            whole = open_to_keep(part, os.O_RDWR)
            os.fsync(whole)  # else a crash of the system can leave the name and not what it names
            os.close(whole)
            part.replace(path)
    except BaseException as error:
        if isinstance(error, OSError) and error.filename == str(part):
            error.filename = str(path)
        part.unlink(missing_ok=True)
        raise
    if not is_alone:
        raise InputError("file", str(path), "expected a file that no other process writes")


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


def no_link(path: Path) -> Path:
    """A folder within one that is written. InputError where it is a link."""
    if path.is_symlink():
        raise InputError("folder", str(path), "expected a folder, not a link to another one")
    return path


def own_folder(path: Path) -> Path:
    """As `no_link`, made where it is missing."""
    no_link(path).mkdir(parents=True, exist_ok=True)
    return path
