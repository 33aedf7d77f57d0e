"""Packed files, unpacked no further than a file of their size can honestly hold."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, SwathError

MIB = 1 << 20
FLOOR_BYTES = 16 * MIB  # what a file of any size may unpack to
RATIO = 60  # unpacked bytes to packed ones above; logs and grids reach 5 to 15, padded tables 30
LARGEST_BYTES = 1 << 30  # of any unpacked file; a season of one combine is about 1e8


def most_unpacked(size: int) -> int:
    """Bytes that a packed file of some size may unpack to."""
    return min(FLOOR_BYTES + RATIO * size, LARGEST_BYTES)


def check_unpacked(found: int, path: Path, key: str) -> None:
    """Raise InputError for more unpacked bytes than a file of its size may hold."""
    most = most_unpacked(path.stat().st_size)
    if found > most:
        raise InputError(key, None, f"expected at most {most} bytes unpacked, it holds {found}", file=path)


@contextmanager
def readable(key: str, what: str, path: Path) -> Iterator[None]:
    """Makes an InputError of whatever a parser meets in a damaged file: zlib, struct, index, value errors."""
    try:
        yield
    except SwathError:
        raise
    except Exception as error:  # readers of foreign files may raise anything
        text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        reason = next(iter(text.splitlines()), "") or type(error).__name__
        raise InputError(key, None, f"expected {what}: {reason[:120]}", file=path) from error


@contextmanager
def open_archive(path: Path, key: str) -> Iterator[zipfile.ZipFile]:
    """A zip archive. InputError where its members say that they unpack to more than it may hold.

    `ZipFile.read` gives no more of a member than the directory says, so this bounds all of them together.
    """
    with zipfile.ZipFile(path) as archive:
        check_unpacked(sum(info.file_size for info in archive.infolist()), path, key)
        yield archive


def read_arrays(path: Path, key: str, what: str) -> dict[str, NDArray[Any]]:
    """The arrays of a .npz. InputError with this key, `expected what: why`, for a file that is none."""
    with readable(key, what, path), open_archive(path, key):
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            found = {name: data[name] for name in data.files}
        strange = [name for name, array in found.items() if not isinstance(array, np.ndarray)]
        if strange:
            raise ValueError(f"{strange[0]!r} is no array")
        return found
