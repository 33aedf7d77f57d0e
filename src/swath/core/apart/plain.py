"""Values as plain data: JSON, and behind it the bytes of arrays. Reading them runs and imports nothing.

What JSON has no word for is `{"!": kind, ...}`: arrays, bytes, paths, records of the classes that the reader
expects, and messages, which are names with values.
"""

import json
import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, get_args, get_origin, get_type_hints

import numpy as np

from swath.core.errors import InputError
from swath.core.packed_state import dtype_of

HEAD = struct.Struct("<QI")  # bytes of the JSON, number of buffers
KIND = "!"
SMALL = 1 << 14  # bytes of an array that is copied from its block
NAME = re.compile(r"\w{1,255}", re.ASCII)
Classes = Mapping[str, type]


class MissingField(InputError, AttributeError):
    """A field that a message has by its standard, not by the definition in the file."""


def missing_field(message: Any, name: str) -> Any:
    """`__getattr__` of messages."""
    kind = type(message).__name__.replace("__", "/")
    raise MissingField("recording", kind, f"expected a field {name}, the definition in the file has none")


class Message:
    """What a recording holds at a time: fields by the names of its definition, which are attributes."""

    __getattr__ = missing_field


class Plain:
    """Makes JSON and buffers of values, and writes them."""

    def __init__(self) -> None:
        self.buffers: list[bytes] = []
        self.size = 0  # bytes of the arrays so far
        self._encoder = json.JSONEncoder(default=self._said, separators=(",", ":"))

    def text(self, value: Any) -> str:
        """JSON of a value; its arrays are kept."""
        return self._encoder.encode(value)

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
        if hasattr(value, "__msgtype__"):
            return {KIND: f"message {type(value).__name__}", **vars(value)}
        if is_dataclass(value) and not isinstance(value, type):
            shown = {f.name: getattr(value, f.name) for f in fields(value) if f.init}
            return {KIND: f"record {type(value).__qualname__}", **shown}
        raise TypeError(f"{type(value).__name__} is no plain data")

    def _kept(self, data: bytes) -> int:
        self.buffers.append(data)
        self.size += len(data)
        return len(self.buffers) - 1


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
