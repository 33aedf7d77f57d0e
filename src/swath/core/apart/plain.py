"""Values as plain data: JSON, and behind it the bytes of arrays. Reading them runs and imports nothing.

What JSON has no word for is `{"!": kind, ...}`: arrays, bytes, paths, records of the classes that the reader
expects, and messages, which are names with values. Many messages come by columns, one for each field of a
type, and are put together as they are looked at.
"""

import json
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import lru_cache
from itertools import repeat
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO, NoReturn, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.packed_state import dtype_of

HEAD = struct.Struct("<QI")  # bytes of the JSON, number of buffers
KIND = "!"
NUMBERS = {float: np.float64, int: np.int64}
SMALL = 1 << 14  # bytes of an array that is copied from its block
NAME = re.compile(r"\w{1,255}", re.ASCII)
Classes = Mapping[str, type]


class MissingField(InputError, AttributeError):
    """A field that a message has by its standard, not by the definition in the file."""


def missing_field(message: Any, name: str) -> NoReturn:
    """`__getattr__` of messages."""
    kind = type(message).__name__.replace("__", "/")
    raise MissingField("recording", kind, f"expected a field {name}, the definition in the file has none")


class Message:
    """What a recording holds at a time: fields by the names of its definition, which are attributes.

    _fields: number of the column of a field that was not looked at yet, or type and fields of a message in it
    """

    _fields: Mapping[str, "int | tuple[type[Message], Mapping[str, Any]]"] = {}
    _row: tuple[Any, ...] = ()

    def __getattr__(self, name: str) -> Any:
        if (at := self._fields.get(name)) is None:
            missing_field(self, name)
        value = self._row[at] if isinstance(at, int) else _message(*at, self._row)
        self.__dict__[name] = value
        return value


class Plain:
    """Makes JSON and buffers of values, and writes them."""

    def __init__(self) -> None:
        self.buffers: list[bytes] = []
        self.size = 0  # bytes of the arrays so far
        self._forms: dict[type, tuple[Any, Callable[[Any], Any], bool]] = {}
        self._encoder = json.JSONEncoder(default=self._said, separators=(",", ":"))

    def text(self, value: Any) -> str:
        """JSON of a value; its arrays are kept."""
        return self._encoder.encode(value)

    def many(self, items: list[Any]) -> str:
        """JSON of a list, (topic, time, message) by columns."""
        if not all(isinstance(item, tuple) and len(item) == 3 and _is_message(item[2]) for item in items):
            return self.text(items)
        by_type: dict[type, list[Any]] = {}
        for _, _, message in items:
            by_type.setdefault(type(message), []).append(message)
        numbers = {kind: number for number, kind in enumerate(by_type)}
        of = zip(*((topic, t, numbers[type(message)]) for topic, t, message in items), strict=True)
        types = [self._columns(messages) for messages in by_type.values()]
        return self.text({KIND: "messages", "of": [*map(_column, of)], "types": types})

    def _columns(self, messages: list[Any]) -> dict[str, Any]:
        """Messages of a type by the columns of their fields."""
        kind = type(messages[0])
        if kind not in self._forms:
            paths: list[str] = []
            form = _form(messages[0], "", paths)
            self._forms[kind] = form, attrgetter(*paths) if paths else lambda _: (), len(paths) == 1
        form, values_of, is_one = self._forms[kind]
        rows = map(values_of, messages)
        columns = [tuple(rows)] if is_one else zip(*rows, strict=True)
        return {"form": form, "columns": [_column(each) for each in columns]}

    def write(self, file: BinaryIO, text: str) -> None:
        """Write what `text` gave, and begin anew."""
        data = text.encode()
        sizes = np.array([len(buffer) for buffer in self.buffers], "<u8")
        file.write(HEAD.pack(len(data), len(sizes)) + sizes.tobytes() + data)
        file.writelines(self.buffers)
        file.flush()
        self.buffers, self.size = [], 0

    def _said(self, value: Any) -> Any:
        """What stands for a value that JSON has no word for. TypeError for one that cannot be said."""
        if isinstance(value, np.ndarray) and not value.dtype.hasobject:
            return {
                KIND: "array",
                "of": _described(value.dtype),
                "in": self._kept(value.tobytes()),
                "shape": value.shape,
            }
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        if isinstance(value, bytes | bytearray | memoryview):
            return {KIND: "bytes", "in": self._kept(bytes(value))}
        if isinstance(value, Path):
            return {KIND: "path", "text": str(value)}
        if _is_message(value):
            return {KIND: f"message {type(value).__name__}", **vars(value)}
        if is_dataclass(value) and not isinstance(value, type):
            shown = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
            return {KIND: f"record {type(value).__qualname__}", **shown}
        raise TypeError(f"{type(value).__name__} is no plain data")

    def _kept(self, data: bytes) -> int:
        self.buffers.append(data)
        self.size += len(data)
        return len(self.buffers) - 1


def _is_message(value: Any) -> bool:
    return hasattr(value, "__msgtype__")


def _form(message: Any, prefix: str, paths: list[str]) -> list[Any]:
    """Type of a message, and of each field the number of its column, or the form of a message in it."""
    fields: dict[str, Any] = {}
    for name, value in vars(message).items():
        if _is_message(value):
            fields[name] = _form(value, f"{prefix}{name}.", paths)
        else:
            fields[name] = len(paths)
            paths.append(prefix + name)
    return [type(message).__name__, fields]


def _column(values: tuple[Any, ...]) -> Any:
    """An array of numbers, or of arrays that are alike; else the values."""
    kinds = set(map(type, values))
    if len(kinds) == 1 and (number := NUMBERS.get(kinds.pop())) is not None:
        with suppress(OverflowError):
            return np.array(values, number)
    if isinstance(values[0], np.ndarray) and len({(each.dtype.str, each.shape) for each in values}) == 1:
        return np.stack(values)
    return values


def read_plain(read: Callable[[int], bytearray], classes: Classes, most: int) -> Any:
    """The next value. read: gives as many bytes, or raises; most: bytes in it. ValueError for others."""
    length, count = HEAD.unpack(read(HEAD.size))
    if count > most // 8 or length > most:
        raise ValueError("an answer that is too long")
    sizes = np.frombuffer(read(8 * count), "<u8").tolist()
    if length + sum(sizes) > most:
        raise ValueError("an answer that is too long")
    text = read(length)
    whole, at, buffers = memoryview(read(sum(sizes))), 0, list[Any]()
    for size in sizes:  # small ones do not keep the whole block
        part = whole[at : at + size]
        buffers.append(bytearray(part) if size < SMALL else part)
        at += size
    return json.loads(
        text, object_hook=lambda found: _made(found, buffers, classes) if KIND in found else found
    )


def _made(found: dict[str, Any], buffers: list[Any], classes: Classes) -> Any:
    kind, _, name = str(found.pop(KIND)).partition(" ")
    if kind == "message":
        made = object.__new__(_message_class(name))
        made.__dict__ = found
        return made
    if kind == "messages":
        rows = [_rows(**each) for each in found["types"]]
        of = zip(*map(_values, found["of"]), strict=True)
        return [(topic, t, next(rows[number])) for topic, t, number in of]
    if kind == "array":
        of = found["of"]
        dtype = _named_dtype(of) if isinstance(of, str) else dtype_of(of)
        return np.frombuffer(buffers[found["in"]], dtype).reshape(found["shape"])
    if kind == "bytes":
        return bytes(buffers[found["in"]])
    if kind == "path":
        return Path(found["text"])
    if kind == "record" and name in classes:
        hints = _hints(classes[name])
        return classes[name](**{key: _typed(hints[key], value) for key, value in found.items()})
    raise ValueError(f"unknown kind {kind} {name}")


def _rows(form: Any, columns: list[Any]) -> Iterator[Message]:
    kind, inner = _read_form(form, len(columns))
    rows = zip(*map(_values, columns), strict=True) if columns else repeat(())
    return (_message(kind, inner, row) for row in rows)


def _values(column: list[Any] | NDArray[Any]) -> Iterable[Any]:
    """The values of a column; small arrays do not keep the whole column."""
    if isinstance(column, np.ndarray) and column.ndim > 1:
        return map(np.copy, column) if column[0].nbytes < SMALL else column
    return column.tolist() if isinstance(column, np.ndarray) else column


def _read_form(form: Any, columns: int) -> tuple[type[Message], dict[str, Any]]:
    name, inner = form
    made: dict[str, Any] = {}
    for field, at in inner.items():
        if isinstance(at, list):
            made[field] = _read_form(at, columns)
        elif 0 <= at < columns:
            made[field] = at
        else:
            raise ValueError("a field without its column")
    return _message_class(name), made


def _message(kind: type[Message], inner: Mapping[str, Any], row: tuple[Any, ...]) -> Message:
    made = object.__new__(kind)
    made.__dict__ = {"_fields": inner, "_row": row}
    return made


_described = lru_cache(maxsize=64)(np.lib.format.dtype_to_descr)
_named_dtype = lru_cache(maxsize=64)(dtype_of)


@lru_cache(maxsize=1024)
def _message_class(name: str) -> type[Message]:
    if not NAME.fullmatch(name):
        raise ValueError("no name of a message")
    return type(name, (Message,), {"__msgtype__": name.replace("__", "/")})


def _typed(hint: Any, value: Any) -> Any:
    """A value whose lists are the tuples that its type says."""
    if isinstance(value, list) and get_origin(hint) is tuple:
        inner = get_args(hint)
        each = [inner[0]] * len(value) if len(inner) == 2 and inner[1] is ... else inner
        return tuple(_typed(of, part) for of, part in zip(each, value, strict=True))
    return value


_hints = lru_cache(maxsize=64)(get_type_hints)
