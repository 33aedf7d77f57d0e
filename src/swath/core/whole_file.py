"""Files that are written whole or not at all, and writing errors that name their file."""

import io
from pathlib import Path
from typing import Any, BinaryIO

PART = ".part"  # at the end of the name of a file that is still being written


class _NamedFile(io.FileIO):
    """A file opened to write, whose errors name it: those of the system name none, as on a full disk."""

    def write(self, data: Any) -> int:
        """As `io.FileIO`."""
        try:
            return super().write(data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.name)) from error


def open_to_write(path: Path) -> BinaryIO:
    """A new file, buffered. OSError, which names the file, when it or what is written cannot be had."""
    return io.BufferedWriter(_NamedFile(str(path), "wb"))


def write_whole(path: Path, data: str | bytes) -> Path:
    """Write a file in one go and return its path; text is UTF-8.

    Until it is whole the file is called `NAME.part`, which an error removes. OSError names the file.
    """
    part = path.with_name(path.name + PART)
    try:
        with open_to_write(part) as file:
            file.write(data.encode("utf-8") if isinstance(data, str) else data)
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path
