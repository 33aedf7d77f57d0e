"""Packed files, unpacked no further than a file of their size can honestly hold."""

import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, SwathError, reason_of
from swath.core.files.read_file import check_readable, open_to_read

MIB = 1 << 20
FLOOR_BYTES = 16 * MIB  # what a file of any size may unpack to
RATIO = 60  # unpacked bytes to packed ones above; logs and grids reach 5 to 15, padded tables 30
MOST_VALUES, VALUES_PER_BYTE = 20_000_000, 25  # of a Parquet file: columns that do not change pack well
LARGEST_BYTES = 1 << 30  # of an unpacked log; a season of one combine is about 1e8


def most_unpacked(size: int, ratio: int = RATIO) -> int:
    """Bytes that a packed file of some size may unpack to."""
    return FLOOR_BYTES + ratio * size


@contextmanager
def readable(key: str, what: str, path: Path) -> Iterator[None]:
    """Makes an InputError of whatever a parser meets in a damaged file: zlib, struct, index, value errors."""
    try:
        yield
    except (SwathError, NameError):  # no file makes the latter: it is a mistake in the program
        raise
    except Exception as error:  # readers of foreign files may raise anything
        if isinstance(error, FileNotFoundError):
            raise InputError(key, str(path), "there is no such file") from error
        raise InputError(key, None, f"expected {what}: {reason_of(error)[:120]}", file=path) from error


def is_archive(path: Path) -> bool:
    """True for a file that ends as a zip archive does, whole or damaged."""
    try:
        return os.path.isfile(path) and zipfile.is_zipfile(path)
    except (OSError, ValueError):  # ValueError: a null character in the path
        return False


def member_names(path: Path) -> list[str]:
    """Names in a zip archive, none where it is no whole one."""
    try:
        with zipfile.ZipFile(path) if is_archive(path) else nullcontext() as archive:
            return [] if archive is None else archive.namelist()
    except Exception:  # a damaged directory may raise anything
        return []


class _Archive(zipfile.ZipFile):
    """A zip archive whose damaged members raise one kind of error, whatever their damage raises."""

    def read(self, name: Any, pwd: bytes | None = None) -> bytes:
        """As `zipfile.ZipFile`."""
        try:
            return super().read(name, pwd)
        except KeyError:
            raise
        except Exception as error:
            raise zipfile.BadZipFile(reason_of(error)) from error


@contextmanager
def open_archive(
    path: Path, key: str, ratio: int = RATIO, what: str = "a whole zip archive"
) -> Iterator[zipfile.ZipFile]:
    """A zip archive.

    InputError where it is none or damaged, and where its members say that they unpack to more than it may
    hold.

    `ZipFile.read` gives no more of a member than the directory says, so this bounds all of them together.
    """
    with readable(key, what, path):
        archive = _Archive(check_readable(path, key, what))
        most = most_unpacked(path.stat().st_size, ratio)
    with archive:
        held = sum(info.file_size for info in archive.infolist())
        if held > most:
            expected = f"expected at most {most} bytes unpacked, it holds {held}"
            raise InputError(key, None, expected, file=path)
        try:
            yield archive
        except zipfile.BadZipFile as error:
            raise InputError(key, None, f"expected {what}: {reason_of(error)[:120]}", file=path) from error


@contextmanager
def open_parquet(path: Path, key: str, what: str) -> Iterator[Any]:
    """A Parquet file.

    InputError with this key where it is none, or holds more values than one of its size can.
    """
    import pyarrow.parquet as pq

    with (
        readable(key, what, path),
        pq.ParquetFile(check_readable(path, key, what), pre_buffer=False) as file,
    ):
        about = file.metadata
        if about.num_rows * about.num_columns > MOST_VALUES + VALUES_PER_BYTE * path.stat().st_size:
            size = f"{about.num_rows} x {about.num_columns}"
            raise InputError(key, size, "expected fewer values in a file of its size", file=path)
        yield file


def read_arrays(path: Path, key: str, what: str, ratio: int = RATIO) -> dict[str, NDArray[Any]]:
    """The arrays of a .npz. ratio: unpacked to packed bytes at most.

    InputError with this key, `expected what: why`, for a file that is none.
    """
    with readable(key, what, path), open_archive(path, key, ratio, what):
        with open_to_read(path, key, what) as file, np.load(file, allow_pickle=False) as data:
            found = {name: data[name] for name in data.files}
        strange = [name for name, array in found.items() if not isinstance(array, np.ndarray)]
        if strange:
            raise ValueError(f"{strange[0]!r} is no array")
        return found
