"""The one way in which files of others are opened: regular ones of a bounded size.

A device has no end and a pipe may never say anything; both are refused before the first byte is read.
"""

import os
import stat
from io import BufferedReader
from pathlib import Path

from swath.core.errors import InputError, reason_of


def open_to_read(path: Path, key: str, what: str, most: int | None = None) -> BufferedReader:
    """A file to read.

    InputError with this key, `expected what`, for what is no regular file or has more bytes than `most`, and
    where it cannot be read.
    """
    place = None if key == str(path) else path
    try:
        file = open(path, "rb", opener=_without_waiting)  # noqa: SIM115 - the caller closes it
    except FileNotFoundError:
        raise InputError(key, place and str(path), f"expected {what}, there is no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = "a name without the character NUL" if isinstance(error, ValueError) else reason_of(error)
        raise InputError(key, None, f"expected {what}: {reason}", file=place) from error
    about, wrong = os.fstat(file.fileno()), ""
    if not stat.S_ISREG(about.st_mode):
        wrong = f"expected {what}, a regular file, not a device or pipe"
    elif most is not None and about.st_size > most:
        wrong = f"expected {what} of at most {most} bytes"
    if wrong:
        file.close()
        raise InputError(key, None, wrong, file=place)
    return file


def check_readable(path: Path, key: str, what: str, most: int | None = None) -> Path:
    """The path of a file that a library opens by itself. Raises as `open_to_read`."""
    open_to_read(path, key, what, most).close()
    return path


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
