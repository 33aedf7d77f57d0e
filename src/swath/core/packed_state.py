"""The state of a run as bytes, and back: data alone, so that reading it runs nothing.

    data = pack(state, {"field": field})       # objects of the second argument are left out, by identity
    state = unpack(data, {"field": other})     # and the ones given here take their place

A JSON tree, and behind it the bytes of arrays. What JSON has no word for is `{kind: content}`. Objects are of
registered types alone: samples (`Signal`), what has `@saved_type` above it, and records of a user's file that
is loaded already. They are rebuilt field by field; no constructor and nothing that the bytes name is called,
and nothing is imported. An object that occurs twice comes back as one.
"""

import dataclasses
import json
import struct
import sys
from array import array
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Any, Literal, TypeVar

import numpy as np

from swath.core.errors import SwathError, reason_of
from swath.core.foreign_code import USER_MODULE
from swath.core.signal import Signal, signal_types

MAGIC = b"swath state 1\n"
LENGTH = struct.Struct("<Q")
SEQUENCES: Mapping[str, type] = {"tuple": tuple, "set": set, "frozenset": frozenset}
RAW: Mapping[str, type] = {"bytes": bytes, "bytearray": bytearray}
NUMBERS = "bBhHiIlLqQfd"  # what an `array` may hold
MOST_PARTS = 4_000_000  # lists and the like in it, which take up to 200 bytes each
PENDING = object()  # of a tuple whose members are being read
T = TypeVar("T", bound=type)


class UnpackableState(SwathError):
    """A state that holds what cannot be written, or bytes that are none."""


_TYPES: dict[str, type] = {}
_FIELDS: dict[type, tuple[str, ...]] = {}


def saved_type(*fields: str) -> Callable[[T], T]:
    """Objects of the class may be saved. fields: of a class that is neither dataclass nor named tuple."""

    def register(kind: T) -> T:
        _TYPES[_name(kind)] = kind
        if fields:
            _FIELDS[kind] = fields
        return kind

    return register


def pack(state: Any, shared: Mapping[str, Any] | None = None) -> bytes:
    """Bytes of a state. shared: what it may refer to and is not written, by name. UnpackableState."""
    writer = _Writer(shared or {})
    try:
        tree = writer.plain(state)
    except RecursionError as error:
        raise UnpackableState("it is too deep to be saved") from error
    head = json.dumps([writer.types, tree], separators=(",", ":")).encode()
    return b"".join((MAGIC, LENGTH.pack(len(head)), head, *writer.buffers))


def unpack(data: bytes, shared: Mapping[str, Any] | None = None) -> Any:
    """What `pack` wrote. UnpackableState for anything else."""
    if not data.startswith(MAGIC):
        raise UnpackableState("expected a saved state of this version of swath")
    start = len(MAGIC) + LENGTH.size
    try:
        (size,) = LENGTH.unpack_from(data, len(MAGIC))
        head = data[start : start + size]
        if head.count(b"[") + head.count(b"{") > MOST_PARTS:
            raise UnpackableState(f"expected a saved state of at most {MOST_PARTS} parts")
        types, tree = json.loads(head)
        return _Reader(data, start + size, types, shared or {}).made(tree)
    except UnpackableState:
        raise
    except Exception as error:  # whatever numpy and JSON make of bytes that somebody changed
        raise UnpackableState(f"expected a saved state ({reason_of(error)})") from error


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def known_types() -> dict[str, type]:
    """All types of objects that are read and written, by name; none is imported for it."""
    samples: list[type] = [Signal, *signal_types()]
    return {**_TYPES, **{_name(kind): kind for kind in samples}}


def _user_type(name: str) -> type | None:
    """A record class of a user's file, if that file is loaded already; whoever started the run allowed it."""
    module, _, path = name.partition(":")
    found: Any = sys.modules.get(module) if module.startswith(USER_MODULE) else None
    for part in path.split("."):
        found = None if found is None else vars(found).get(part)
    if not isinstance(found, type) or found.__module__ != module or issubclass(found, Signal):
        return None
    return None if _fields(found) is None else found


def _fields(kind: type) -> Sequence[str] | None:
    """Names of what an object holds; None for a class that is no record."""
    if kind in _FIELDS:
        return _FIELDS[kind]
    if dataclasses.is_dataclass(kind):
        return [f.name for f in dataclasses.fields(kind)]
    return (
        getattr(kind, "_fields", None) if issubclass(kind, tuple) else [] if issubclass(kind, Enum) else None
    )


class _Writer:
    """Plain trees of values. Objects are numbered in the order in which the reader will make them."""

    def __init__(self, shared: Mapping[str, Any]) -> None:
        self.types: list[str] = []
        self.buffers: list[bytes] = []
        self._known, self._shared = known_types(), {id(v): k for k, v in shared.items() if v is not None}
        self._numbers: dict[int, int] = {}
        self._alive: list[Any] = []  # an id is its object's as long as that is there

    def plain(self, value: Any) -> Any:
        """The value as JSON can say it."""
        kind = type(value)
        if value is None or kind in (bool, int, float, str):
            return value
        if id(value) in self._shared:
            return {"shared": self._shared[id(value)]}
        if id(value) in self._numbers:
            return {"again": self._numbers[id(value)]}
        self._numbers[id(value)] = len(self._alive)
        self._alive.append(value)
        return self._container(kind, value)

    def _container(self, kind: type, value: Any) -> Any:
        plain = self.plain
        if kind is list:
            return [plain(v) for v in value]
        if kind is dict:
            return {"dict": [plain(v) for pair in value.items() for v in pair]}
        if kind.__name__ in SEQUENCES and kind is SEQUENCES[kind.__name__]:
            return {kind.__name__: [plain(v) for v in value]}
        if kind is deque:
            return {"deque": [value.maxlen, *(plain(v) for v in value)]}
        if kind is Counter:
            return {"Counter": [plain(v) for pair in value.items() for v in pair]}
        if kind in RAW.values():
            return {kind.__name__: self._kept(bytes(value))}
        if kind is array and value.typecode in NUMBERS:
            return {"row": [value.typecode, self._kept(value.tobytes())]}
        if kind is np.ndarray or (issubclass(kind, np.generic) and kind is value.dtype.type):
            return self._array(value)
        return self._object(kind, value)

    def _array(self, value: Any) -> Any:
        if value.dtype.hasobject:
            raise UnpackableState("an array of objects cannot be saved")
        described = np.lib.format.dtype_to_descr(value.dtype)
        if not isinstance(value, np.ndarray):
            return {"number": [described, self._kept(value.tobytes())]}
        order: Literal["F", "C"] = "F" if value.flags.fnc else "C"
        return {"array": [described, order, value.shape, self._kept(value.tobytes(order))]}

    def _object(self, kind: type, value: Any) -> Any:
        if isinstance(value, type):
            return {"type": self._type(value)}
        number = self._type(kind)
        if isinstance(value, Enum):
            return {"enum": [number, value.name]}
        if isinstance(value, tuple):
            return {"named": [number, *map(self.plain, value)]}
        return {"object": [number, *(self.plain(getattr(value, name)) for name in _fields(kind) or ())]}

    def _type(self, kind: type) -> int:
        name = _name(kind)
        if (self._known.get(name) or _user_type(name)) is not kind:
            what = f"{kind.__module__}.{kind.__qualname__}"
            raise UnpackableState(f"{what} cannot be saved: expected plain data, arrays, samples, records")
        if name not in self.types:
            self.types.append(name)
        return self.types.index(name)

    def _kept(self, data: bytes) -> int:
        self.buffers.append(data)
        return len(data)


class _Reader:
    """Makes values of a tree; the buffers come in the order in which they were written."""

    def __init__(self, data: bytes, at: int, types: list[str], shared: Mapping[str, Any]) -> None:
        self._data, self._at, self._shared, self._met = data, at, shared, list[Any]()
        known = known_types()
        self._types = [self._type(name, known) for name in types]

    def made(self, plain: Any) -> Any:
        """The value."""
        if isinstance(plain, list):
            found = self._new([])
            found.extend(map(self.made, plain))
            return found
        if not isinstance(plain, dict):
            return plain
        ((kind, content),) = plain.items()
        if kind == "shared":
            if content not in self._shared:
                raise UnpackableState(f"expected a state of this world, it refers to {content}")
            return self._shared[content]
        if kind == "again":
            if not 0 <= content < len(self._met) or self._met[content] is PENDING:
                raise ValueError(f"no object {content}")
            return self._met[content]
        if kind in ("dict", "Counter"):
            return self._mapping(self._new({} if kind == "dict" else Counter()), content)
        if kind == "deque":
            queue = self._new(deque(maxlen=content[0]))
            queue.extend(map(self.made, content[1:]))
            return queue
        if kind == "object":
            return self._object(self._types[content[0]], content[1:])
        place = len(self._met)
        self._met.append(PENDING)
        self._met[place] = found = self._whole(kind, content)
        return found

    def _whole(self, kind: str, content: Any) -> Any:
        """A value that can only be made once all of its parts are made, so that no part can refer to it."""
        if kind in SEQUENCES:
            return SEQUENCES[kind](map(self.made, content))
        if kind in RAW:
            return RAW[kind](self._take(content))
        if kind == "row" and content[0] in NUMBERS:
            return array(content[0], self._take(content[1]))
        if kind == "number":
            return np.frombuffer(self._take(content[1]), dtype_of(content[0]))[0]
        if kind == "array":
            described, order, shape, size = content
            found = np.frombuffer(self._take(size), dtype_of(described))
            return found.reshape(shape, order=order).copy(order="K")
        if kind == "type":
            return self._types[content]
        record = self._types[content[0]]
        if kind == "enum" and issubclass(record, Enum):
            return record.__members__[content[1]]
        if kind == "named" and issubclass(record, tuple) and len(_fields(record) or ()) == len(content) - 1:
            return tuple.__new__(record, map(self.made, content[1:]))
        raise ValueError(f"unknown kind {kind}")

    def _new(self, value: Any) -> Any:
        self._met.append(value)
        return value

    def _mapping(self, into: Any, content: list[Any]) -> Any:
        each = map(self.made, content)
        for key in each:
            dict.__setitem__(into, key, next(each))
        return into

    def _object(self, kind: type, content: list[Any]) -> Any:
        names = _fields(kind)
        if names is None or len(names) != len(content) or issubclass(kind, tuple | Enum):
            raise ValueError(f"no {kind.__name__} with these fields")
        found = self._new(object.__new__(kind))
        for name, plain in zip(names, content, strict=True):
            object.__setattr__(found, name, self.made(plain))
        return found

    def _type(self, name: str, known: Mapping[str, type]) -> type:
        found = known.get(name) or _user_type(name)
        if found is None:
            raise UnpackableState(f"a saved state names {name}, which is not read")
        return found

    def _take(self, size: int) -> bytes:
        if not 0 <= size <= len(self._data) - self._at:
            raise ValueError("it ends too early")
        self._at += size
        return self._data[self._at - size : self._at]


def dtype_of(described: Any) -> np.dtype[Any]:
    """The dtype that a description stands for; JSON has turned the tuples of the description into lists."""
    given: Any = described if isinstance(described, str) else [tuple(part) for part in described]
    found = np.lib.format.descr_to_dtype(given)
    if found.hasobject:
        raise ValueError("objects in an array")
    return found
