"""Rows of numbers of a whole run, in memory that does not grow with its length."""

import zlib
from array import array
from collections.abc import Iterable, Iterator

import numpy as np

from swath.core.packed_state import saved_type
from swath.core.unnamed_file import UnnamedFile
from swath.record import packed_columns
from swath.record.tracks import EvenRows
from swath.signals import F64

BLOCK = 2048  # rows that are compressed together


@saved_type("_width", "_newest", "older")
class KeptRows:
    """Rows of `width` real numbers, in the order they come; older ones lie compressed, to the last bit, in a
    file that has no name.
    """

    def __init__(self, width: int) -> None:
        self._width = width
        self._older: list[tuple[str, int, int, int]] = []  # how packed, rows; place, bytes in the file
        self._newest = array("d")
        self._file = UnnamedFile()

    def __bool__(self) -> bool:
        return bool(self._older or self._newest)

    @property
    def older(self) -> list[tuple[str, int, bytes]]:
        """How packed, rows, bytes of the blocks in the file; setting them begins a new file."""
        return [*self._blocks()]

    @older.setter
    def older(self, blocks: Iterable[tuple[str, int, bytes]]) -> None:
        self._older, self._file = [], UnnamedFile()
        for block in blocks:
            self._put(*block)

    def add(self, row: Iterable[float]) -> None:
        """Add a row, or rows one after the other."""
        self._newest.extend(row)
        if len(self._newest) >= BLOCK * self._width:
            block = np.array(self._newest).reshape(-1, self._width)
            how, data = packed_columns.pack(block)
            self._put(how, len(block), zlib.compress(data))
            del self._newest[:]

    def table(self, most: int | None = None) -> F64:
        """All rows, (n, width). most: spread evenly, where there are more"""
        rows = EvenRows(most)
        for how, count, data in self._blocks():
            shape = count, self._width
            rows.add({"": packed_columns.unpack(zlib.decompress(data), how, np.dtype("<f8"), shape)})
        rows.add({"": np.array(self._newest, dtype=float).reshape(-1, self._width)})
        return rows.columns().get("", np.zeros((0, self._width)))

    def _put(self, how: str, count: int, data: bytes) -> None:
        self._older.append((how, count, self._file.append(data), len(data)))

    def _blocks(self) -> Iterator[tuple[str, int, bytes]]:
        """How packed, rows, bytes."""
        for how, count, at, size in self._older:
            yield how, count, self._file.read(at, size)
