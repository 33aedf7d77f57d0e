"""The state of a run as bytes, and back, without running anything that the bytes name.

    data = pack(state, {"field": field})       # objects of the second argument are left out, by identity
    state = unpack(data, {"field": other})     # and the ones given here take their place

A pickle of which only this is read: plain values, arrays of numpy, and objects of swath's own classes, which
are made without calling their `__init__`. What refers to anything else (a function, an open file, a class of
a user) is refused when it is written and when it is read: a run folder may come from somebody else.
"""

import copyreg
import io
import pickle
from collections.abc import Mapping
from importlib import import_module
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any

import numpy as np

from swath.core.errors import SwathError

OWN = "swath."
MADE = "made", "found"  # functions of this module that a reader calls
ALLOWED = {
    ("builtins", "set"), ("builtins", "frozenset"), ("builtins", "bytearray"), ("builtins", "complex"),
    ("builtins", "range"), ("builtins", "slice"), ("collections", "deque"), ("collections", "OrderedDict"),
    ("collections", "Counter"), ("array", "array"), ("array", "_array_reconstructor"), ("_codecs", "encode"),
    ("numpy", "ndarray"), ("numpy", "dtype"),
}  # fmt: skip
NUMPY = {"_reconstruct", "scalar", "_frombuffer"}  # of numpy's private modules, which it names in a pickle


class UnpackableState(SwathError):
    """A state that holds what cannot be written, or bytes that name what is not read."""


def pack(state: Any, shared: Mapping[str, Any] | None = None) -> bytes:
    """Bytes of a state. shared: what it may refer to and is not written, by name. UnpackableState."""
    out = io.BytesIO()
    try:
        _Packer(out, shared or {}).dump(state)
    except UnpackableState:
        raise
    except Exception as error:
        raise UnpackableState(f"it holds what cannot be saved ({error})") from error
    return out.getvalue()


def unpack(data: bytes, shared: Mapping[str, Any] | None = None) -> Any:
    """What `pack` wrote. UnpackableState for anything else."""
    try:
        return _Unpacker(io.BytesIO(data), shared or {}).load()
    except UnpackableState:
        raise
    except Exception as error:
        raise UnpackableState(f"expected a saved state ({error})") from error


def made(module: str, name: str, *items: Any) -> Any:
    """An object of a class of swath, without its `__init__`; what it holds is put in by the reader."""
    kind = _own_class(module, name)
    return tuple.__new__(kind, items) if issubclass(kind, tuple) else object.__new__(kind)


def found(module: str, name: str) -> type:
    """A class of swath."""
    return _own_class(module, name)


def _own_class(module: str, name: str) -> type:
    if not f"{module}.".startswith(OWN):
        raise UnpackableState(f"expected a class of swath, not {module}.{name}")
    kind: Any = import_module(module)
    for part in name.split("."):
        kind = vars(kind).get(part)
    if not isinstance(kind, type) or kind.__module__ != module:
        raise UnpackableState(f"{module}.{name} is no class of swath")
    return kind


class _Packer(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: Mapping[str, Any]) -> None:
        super().__init__(file, protocol=5)
        self._names = {id(value): name for name, value in shared.items() if value is not None}

    def persistent_id(self, obj: Any) -> str | None:
        return self._names.get(id(obj))

    def reducer_override(self, obj: Any) -> Any:
        kind = type(obj)
        if isinstance(obj, type):
            return self._class(obj)
        if kind in (FunctionType, BuiltinFunctionType, MethodType):
            return self._function(obj)
        if f"{kind.__module__}.".startswith(OWN):
            return _reduced(obj)
        if issubclass(kind, np.ndarray | np.generic | np.dtype):
            return NotImplemented
        if (kind.__module__, kind.__name__) in ALLOWED:
            return NotImplemented
        raise UnpackableState(f"an object of {kind.__module__}.{kind.__qualname__} cannot be saved")

    def _class(self, obj: type) -> Any:
        if f"{obj.__module__}.".startswith(OWN):
            _own_class(obj.__module__, obj.__qualname__)
            return found, (obj.__module__, obj.__qualname__)
        if (obj.__module__, obj.__qualname__) in ALLOWED:
            return NotImplemented
        raise UnpackableState(f"{obj.__module__}.{obj.__qualname__} cannot be saved")

    def _function(self, obj: Any) -> Any:
        module, name = getattr(obj, "__module__", ""), getattr(obj, "__name__", repr(obj))
        if obj in (made, found) or _is_allowed(str(module), str(name)):
            return NotImplemented
        raise UnpackableState(f"the function {name} of {module} cannot be saved")


def _reduced(obj: Any) -> Any:
    """How an object of swath is written: `made` with its class, then its attributes."""
    kind = type(obj)
    _own_class(kind.__module__, kind.__qualname__)
    make, arguments, *rest = obj.__reduce_ex__(2)
    items = tuple(obj) if issubclass(kind, tuple) else ()
    if make is not copyreg.__newobj__ or (len(arguments) > 1 and not items):  # type: ignore[attr-defined]
        raise UnpackableState(f"an object of {kind.__module__}.{kind.__qualname__} cannot be saved")
    return made, (kind.__module__, kind.__qualname__, *items), *rest


def _is_allowed(module: str, name: str) -> bool:
    is_numpy = module.startswith(("numpy._core.", "numpy.core.")) and name in NUMPY
    return is_numpy or (module, name) in ALLOWED


class _Unpacker(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: Mapping[str, Any]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: Any) -> Any:
        if pid not in self._shared:
            raise UnpackableState(f"expected a state of this world, it refers to {pid}")
        return self._shared[pid]

    def find_class(self, module: str, name: str) -> Any:
        if module == __name__ and name in MADE:
            return globals()[name]
        if module == "numpy" and name.startswith("dtype"):
            return np.dtype
        if not _is_allowed(module, name) or "." in name:
            raise UnpackableState(f"a saved state names {module}.{name}, which is not read")
        return super().find_class(module, name)
