"""Calls into the binary of an FMU: groups of variables of one type, status codes, what the FMU logs.

Plain ctypes with arrays made once: only the functions that are used must be there, which some exporters need.
"""

import ctypes
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from swath.link.fmi.description import Description, Variable
from swath.link.fmi.errors import FmuError

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
KEPT_MESSAGES = 5
_C2: dict[str, Any] = {"Real": ctypes.c_double, "Integer": ctypes.c_int, "Boolean": ctypes.c_int}
_C3: dict[str, Any] = {
    "Float32": ctypes.c_float,
    "Float64": ctypes.c_double,
    "Int8": ctypes.c_int8,
    "UInt8": ctypes.c_uint8,
    "Int16": ctypes.c_int16,
    "UInt16": ctypes.c_uint16,
    "Int32": ctypes.c_int32,
    "UInt32": ctypes.c_uint32,
    "Int64": ctypes.c_int64,
    "UInt64": ctypes.c_uint64,
    "Boolean": ctypes.c_bool,
}
_LOGS: dict[str, "deque[str]"] = {}


@dataclass
class Group:
    """Neighbouring variables that one call sets or gets.

    refs, values: arrays of C; start, stop: where their numbers lie in the flat list; name: of the function,
    without Get or Set; is_discrete: may only change at an event
    """

    name: str
    kind: str
    refs: Any
    ref_count: Any
    values: Any
    value_count: Any
    start: int
    stop: int
    is_discrete: bool


def make_groups(variables: Sequence[Variable], major: int) -> list[Group]:
    """Groups in the order of the variables. FmuError for one that is not a number."""
    groups: list[list[Variable]] = []
    for v in variables:
        if v.kind not in ("real", "int", "bool"):
            raise FmuError(f"variable {v.name} is of type {v.type}, expected a number or a boolean")
        last = groups[-1][-1] if groups else None
        same = last is not None and last.type == v.type and last.variability == v.variability
        if same:
            groups[-1].append(v)
        else:
            groups.append([v])
    made, start = [], 0
    for group in groups:
        made.append(_group(group, start, major))
        start = made[-1].stop
    return made


def _group(variables: list[Variable], start: int, major: int) -> Group:
    kind = variables[0].type
    if major == 2:
        kind = "Integer" if kind == "Enumeration" else kind
    else:
        kind = "Int64" if kind == "Enumeration" else kind
    refs = [r for v in variables for r in v.refs]
    count = sum(v.size for v in variables)
    return Group(
        name=kind,
        kind=variables[0].kind,
        refs=(ctypes.c_uint * len(refs))(*refs),
        ref_count=ctypes.c_size_t(len(refs)),
        values=((_C2 if major == 2 else _C3)[kind] * count)(),
        value_count=ctypes.c_size_t(count),
        start=start,
        stop=start + count,
        is_discrete=variables[0].variability == "discrete",
    )


def fill(group: Group, numbers: Sequence[float]) -> None:
    """Put the group's part of the flat list into its array."""
    part = numbers[group.start : group.stop]
    if group.kind == "real":
        group.values[:] = part
    elif group.kind == "int":
        group.values[:] = [round(x) for x in part]
    else:
        group.values[:] = [x != 0.0 for x in part]


class Library:
    """The loaded binary of one FMU.

    name: of the instance, under which its messages are kept; is_dead: it said fatal, nothing may be called
    """

    def __init__(self, description: Description, folder: Path, name: str) -> None:
        assert description.library is not None
        self.prefix = f"fmi{description.major}"
        self.name = name
        self.messages: deque[str] = deque(maxlen=KEPT_MESSAGES)
        self.is_dead = False
        _LOGS[name] = self.messages
        file = folder / description.library
        try:
            self._dll = ctypes.CDLL(str(file))
        except OSError as error:
            raise FmuError(f"its binary {description.library} cannot be loaded: {error}") from error
        self._functions: dict[str, Any] = {}

    def function(self, name: str) -> Any:
        """A function of the FMU by its name without prefix. FmuError where the binary has none."""
        if name not in self._functions:
            try:
                self._functions[name] = getattr(self._dll, self.prefix + name)
            except AttributeError as error:
                raise FmuError(f"its binary has no function {self.prefix}{name}") from error
        return self._functions[name]

    def call(self, name: str, *args: Any) -> int:
        """Call and check the status: ok and warning are returned, FmuError for anything else."""
        status: int = self.function(name)(*args)
        if status > WARNING:
            raise self.failed(name, status)
        return status

    def failed(self, name: str, status: int) -> FmuError:
        """The error for a status that is not good, with what the FMU logged."""
        self.is_dead |= status == FATAL
        word = STATUS[status] if 0 <= status < len(STATUS) else f"status {status}"
        said = f"; it says: {self.said}" if self.messages else ""
        return FmuError(f"{self.prefix}{name} gave {word}{said}")

    @property
    def said(self) -> str:
        """The last messages of the FMU in one line."""
        return " | ".join(" ".join(m.split()) for m in self.messages)

    def unload(self) -> None:
        """Let go of the binary."""
        _LOGS.pop(self.name, None)
        self._functions.clear()
        handle = self._dll._handle
        if hasattr(ctypes, "windll"):
            ctypes.windll.kernel32.FreeLibrary(ctypes.c_void_p(handle))
        else:
            close = ctypes.CDLL(None).dlclose
            close.argtypes = [ctypes.c_void_p]
            close(handle)


def log_categories(description: Description) -> list[str]:
    """The categories worth listening to: warnings and errors, so that a chatty FMU costs nothing."""
    wanted = ("warn", "discard", "error", "fatal")
    return [c for c in description.log_categories if any(w in c.lower() for w in wanted)]


class Callbacks2(ctypes.Structure):
    """fmi2CallbackFunctions (FMI 2.0.4, section 2.1.5)."""

    _fields_ = [
        ("logger", ctypes.c_void_p),
        ("allocateMemory", ctypes.c_void_p),
        ("freeMemory", ctypes.c_void_p),
        ("stepFinished", ctypes.c_void_p),
        ("componentEnvironment", ctypes.c_void_p),
    ]


@cache
def callbacks2() -> tuple[Callbacks2, Any]:
    """The callbacks that all instances of FMI 2 share, and what must stay alive for them."""
    kind = ctypes.CFUNCTYPE(
        None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p
    )

    def log(_: Any, name: bytes | None, status: int, __: Any, message: bytes | None) -> None:
        if status >= WARNING and (kept := _LOGS.get(_text(name))) is not None:
            kept.append(_text(message))

    logger, libc = kind(log), ctypes.CDLL(None)
    made = Callbacks2(
        ctypes.cast(logger, ctypes.c_void_p),
        ctypes.cast(libc.calloc, ctypes.c_void_p),
        ctypes.cast(libc.free, ctypes.c_void_p),
        None,
        None,
    )
    try:
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(ctypes.byref(made))  # fills in the variadic arguments, which ctypes cannot
    except (ImportError, OSError, AttributeError):
        pass
    return made, (logger, libc)


def logger3(library: Library) -> Any:
    """fmi3LogMessageCallback of one instance."""
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)
    kept = library.messages

    def log(_: Any, status: int, __: Any, message: bytes | None) -> None:
        if status >= WARNING:
            kept.append(_text(message))

    return kind(log)


def _text(value: bytes | None) -> str:
    return "" if value is None else value.decode("utf-8", errors="replace")
