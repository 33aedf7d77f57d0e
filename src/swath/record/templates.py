"""Messages of one topic differ in a few numbers only: those are written into the bytes of the first.

The layout is that of CDR in little-endian order (OMG DDS-RTPS 2.5, 10.2): numbers aligned to their size,
counted from the end of the four bytes of the encapsulation header; text and sequences after their length in
32 bits.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from struct import Struct, calcsize
from typing import Any, NamedTuple

from swath.core.schedule import NS

STAMPS = ("header.stamp.sec", "clock.sec")
HEAD = 4  # bytes of the encapsulation header
CODES = {
    "bool": "?",
    "byte": "B",
    "octet": "B",
    "char": "b",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}


class Draft(NamedTuple):
    """A message that is only built when somebody wants it as an object.

    t: its stamp [ns]; values: the numbers at `paths`; build: makes the message itself
    paths: of fields, `pose.position.x`, `points.3.x`. All else is the same in every message of the topic.
    variant: which of the topic's forms it has, of messages whose other contents differ
    """

    t: int
    paths: tuple[str, ...]
    values: Sequence[float]
    build: Callable[[], Any]
    variant: Hashable = None


class Template:
    """The bytes of a message, and where its stamp and its numbers stand. data: of a whole message, CDR"""

    def __init__(self, store: Any, message: Any, data: bytes, paths: Sequence[str]) -> None:
        self._data = data
        places = {path: (at, code) for path, at, code in _leaves(store, message)}
        stamp = next(path for path in places if path.endswith(STAMPS))
        self._stamp, self._at = Struct("<iI"), places[stamp][0]
        self._runs: list[tuple[Struct, int, slice]] = []
        first = 0
        for i, path in enumerate(paths):
            at, code = places[path]
            follows = i + 1 < len(paths) and places[paths[i + 1]][0] == at + calcsize(code)
            if not follows:
                codes = "".join(places[p][1] for p in paths[first : i + 1])
                self._runs.append((Struct("<" + codes), places[paths[first]][0], slice(first, i + 1)))
                first = i + 1

    def fill(self, t: int, values: Sequence[float]) -> bytes:
        """The bytes of the message with another stamp [ns] and other numbers."""
        data = bytearray(self._data)
        self._stamp.pack_into(data, self._at, *divmod(max(int(t), 0), NS))
        for layout, at, part in self._runs:
            layout.pack_into(data, at, *values[part])
        return bytes(data)


def _leaves(store: Any, message: Any) -> Iterator[tuple[str, int, str]]:
    """(path, offset in the bytes, struct code) of all numbers of a message."""
    walk = _Walk(store)
    yield from walk.fields("", message)


class _Walk:
    """Goes through a message as CDR does. at: offset behind the encapsulation header"""

    def __init__(self, store: Any) -> None:
        self.store, self.at = store, 0

    def fields(self, path: str, message: Any) -> Iterator[tuple[str, int, str]]:
        for name, kind in self.store.fielddefs[message.__msgtype__][1]:
            yield from self._field(f"{path}{name}", kind, getattr(message, name))

    def _field(self, path: str, kind: Any, value: Any) -> Iterator[tuple[str, int, str]]:
        from rosbags.interfaces import Nodetype

        node, detail = kind
        if node == Nodetype.NAME:
            yield from self.fields(path + ".", value)
        elif node == Nodetype.BASE:
            yield from self._number(path, detail[0], value)
        else:
            if node == Nodetype.SEQUENCE:
                self._skip(4)
            for i, element in enumerate(value):
                yield from self._field(f"{path}.{i}", detail[0], element)

    def _number(self, path: str, name: str, value: Any) -> Iterator[tuple[str, int, str]]:
        if name == "string":
            self._skip(4)
            self.at += len(value.encode()) + 1
            return
        size = calcsize(CODES[name])
        at = self._skip(size)
        yield path, HEAD + at, CODES[name]

    def _skip(self, size: int) -> int:
        at = self.at = -(-self.at // size) * size
        self.at += size
        return at
