"""Bytes that would fill the memory, in a temporary file that no one else sees."""

from array import array
from os import SEEK_END
from tempfile import TemporaryFile
from typing import Any
from weakref import finalize


class UnnamedFile:
    """Grows at its end and is read anywhere. There from the first bytes on, gone with this object."""

    def __init__(self) -> None:
        self._file: Any = None

    def append(self, data: "bytes | array[float]") -> int:
        """Put bytes, or those of numbers, to the end; returns where they begin; 0 for none."""
        if not data:
            return 0
        if self._file is None:
            self._file = TemporaryFile()  # noqa: SIM115 - closed with this object
            finalize(self, self._file.close)
        at: int = self._file.seek(0, SEEK_END)
        self._file.write(data)
        return at

    def read(self, at: int = 0, size: int = -1) -> bytes:
        """As many bytes from a place on; -1: all that follow."""
        if self._file is None:
            return b""
        self._file.seek(at)
        found: bytes = self._file.read(size)
        return found

    @property
    def size(self) -> int:
        """Number of bytes."""
        return 0 if self._file is None else int(self._file.seek(0, SEEK_END))
