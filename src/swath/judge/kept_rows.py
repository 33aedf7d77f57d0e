"""Rows of numbers of a whole run, in little memory."""

import zlib
from array import array
from collections.abc import Iterable

import numpy as np

from swath.record import packed_columns
from swath.signals import F64

BLOCK = 2048  # rows that are compressed together


class KeptRows:
    """Rows of `width` real numbers, in the order they come; older ones are compressed, to the last bit."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._older: list[tuple[str, int, bytes]] = []  # how packed, rows, bytes
        self._newest = array("d")

    def __bool__(self) -> bool:
        return bool(self._older or self._newest)

    def add(self, row: Iterable[float]) -> None:
        """Add a row, or rows one after the other."""
        self._newest.extend(row)
        if len(self._newest) >= BLOCK * self._width:
            block = np.array(self._newest).reshape(-1, self._width)
            how, data = packed_columns.pack(block)
            self._older.append((how, len(block), zlib.compress(data)))
            del self._newest[:]

    def table(self) -> F64:
        """All rows, (n, width)."""
        older = [
            packed_columns.unpack(zlib.decompress(data), how, np.dtype("<f8"), (count, self._width))
            for how, count, data in self._older
        ]
        return np.concatenate([*older, np.array(self._newest, dtype=float).reshape(-1, self._width)])
