"""The state of an exported FMU as bytes, and back: data alone, so that reading them runs no code.

A JSON tree, and behind it the bytes of the arrays. What JSON has no word for is `{kind: content}`; objects
are dataclasses and named tuples of swath and of a user's own levels, rebuilt field by field, without calling
their constructors.
"""

import dataclasses
import importlib
import json
import struct
import sys
from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.registry import USER_MODULE
from swath.link.fmi.archive import BROKEN, reason

MAGIC = b"swath FMU state 1\n"
LENGTH = struct.Struct("<Q")
SEQUENCES: Mapping[str, Callable[[list[Any]], Any]] = {"tuple": tuple, "set": set, "frozenset": frozenset}
EXPECTED = "expected the bytes of a state of this FMU"


def state_to_bytes(state: Any) -> bytes:
    """The bytes of a state. InputError for what is no data."""
    buffers: list[bytes] = []
    tree = json.dumps(_plain(state, buffers)).encode()
    return b"".join((MAGIC, LENGTH.pack(len(tree)), tree, *buffers))


def state_from_bytes(data: bytes) -> Any:
    """The state. InputError for bytes that are none."""
    try:
        if not data.startswith(MAGIC):
            raise ValueError("another beginning")
        start = len(MAGIC) + LENGTH.size
        size = LENGTH.unpack_from(data, len(MAGIC))[0]
        return _Reader(data, start + size).made(json.loads(data[start : start + size]))
    except (*BROKEN, ImportError, RecursionError) as error:
        raise InputError("FMU state", None, f"{EXPECTED}: {reason(error)}") from error


def _plain(value: Any, buffers: list[bytes]) -> Any:
    """The value as JSON can say it; the bytes of arrays are added to the buffers."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return [_plain(v, buffers) for v in value]
    if kind is dict:
        return {"dict": [[_plain(k, buffers), _plain(v, buffers)] for k, v in value.items()]}
    if kind in SEQUENCES.values():
        return {kind.__name__: [_plain(v, buffers) for v in value]}
    if kind is deque:
        return {"deque": [[_plain(v, buffers) for v in value], value.maxlen]}
    if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        buffers.append(value.tobytes())
        shape = list(value.shape) if isinstance(value, np.ndarray) else None
        return {"array": [np.lib.format.dtype_to_descr(value.dtype), shape, len(buffers[-1])]}
    if kind is bytes:
        buffers.append(value)
        return {"bytes": len(value)}
    name = f"{kind.__module__}:{kind.__qualname__}"
    if isinstance(value, Enum):
        return {"enum": [name, value.name]}
    if isinstance(value, tuple) and _is_ours(kind.__module__):
        return {"named": [name, [_plain(v, buffers) for v in value]]}
    if dataclasses.is_dataclass(value) and _is_ours(kind.__module__):
        held = {f.name: _plain(getattr(value, f.name), buffers) for f in dataclasses.fields(value)}
        return {"object": [name, held]}
    raise InputError("FMU state", name, "expected plain data, arrays and dataclasses")


class _Reader:
    """Makes values of a tree; the buffers come in the order in which they were written."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at = data, at

    def made(self, plain: Any) -> Any:
        """The value."""
        if isinstance(plain, list):
            return [self.made(v) for v in plain]
        if not isinstance(plain, dict):
            return plain
        ((kind, content),) = plain.items()
        if kind == "dict":
            return {self.made(k): self.made(v) for k, v in content}
        if kind in SEQUENCES:
            return SEQUENCES[kind]([self.made(v) for v in content])
        if kind == "deque":
            return deque((self.made(v) for v in content[0]), content[1])
        if kind == "named":
            return tuple.__new__(_class(content[0], tuple), [self.made(v) for v in content[1]])
        if kind == "array":
            return self._array(*content)
        if kind == "bytes":
            return self._take(content)
        if kind == "enum":
            return _class(content[0], Enum)[content[1]]
        if kind == "object":
            return self._object(*content)
        raise ValueError(f"unknown kind {kind}")

    def _array(self, described: Any, shape: list[int] | None, size: int) -> Any:
        dtype = np.lib.format.descr_to_dtype(_descr(described))
        if dtype.hasobject:
            raise ValueError("objects in an array")
        found = np.frombuffer(self._take(size), dtype)
        return found[0] if shape is None else found.reshape(shape).copy()

    def _object(self, name: str, held: dict[str, Any]) -> Any:
        kind = _class(name, object)
        if not dataclasses.is_dataclass(kind) or {f.name for f in dataclasses.fields(kind)} != set(held):
            raise ValueError(f"no dataclass {name} with these fields")
        made: Any = object.__new__(_class(name, object))
        for field, value in held.items():
            object.__setattr__(made, field, self.made(value))
        return made

    def _take(self, size: int) -> bytes:
        if not 0 <= size <= len(self._data) - self._at:
            raise ValueError("it ends too early")
        self._at += size
        return self._data[self._at - size : self._at]


def _descr(described: Any) -> Any:
    """The description of a dtype as numpy wants it: JSON made lists of the tuples."""
    return described if isinstance(described, str) else [tuple(part) for part in described]


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == "swath" or module.startswith(USER_MODULE)


def _class(name: str, base: Any) -> Any:
    """A class of swath, or of a user's file that is loaded already."""
    module, _, path = name.partition(":")
    if not _is_ours(module):
        raise ValueError(f"{module} is no module of swath")
    found: Any = sys.modules[module] if module.startswith(USER_MODULE) else importlib.import_module(module)
    for part in path.split("."):
        found = vars(found)[part]
    if not (isinstance(found, type) and issubclass(found, base)):
        raise ValueError(f"{name} is no such class")
    return found
