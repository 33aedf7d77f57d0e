"""Calls into the binary of an FMU: groups of variables of one type, status codes, what the FMU logs.

Plain ctypes with arrays made once: only the functions that are used must be there, which some exporters need.
"""

import ctypes
import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

from swath.core.errors import SwathError
from swath.link.fmi.description import Description, Variable

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
KEPT_MESSAGES = 5
_TYPES: dict[str, Any] = {
    "Real": ctypes.c_double,
    "Integer": ctypes.c_int,
    "Float32": ctypes.c_float,
    "Float64": ctypes.c_double,
    **{f"{u}Int{n}": getattr(ctypes, f"c_{u.lower()}int{n}") for u in ("", "U") for n in (8, 16, 32, 64)},
}
_BOOLEANS: dict[int, Any] = {1: ctypes.c_byte, 2: ctypes.c_int, 3: ctypes.c_bool}
_MISSING = re.compile(
    r"^(?P<file>(?P<name>lib[^/\s]+?)\.so\.?(?P<version>\d*)[\d.]*): cannot open shared object"
)
_LOGS: dict[str, "deque[str]"] = {}


class FmuError(SwathError):
    """An FMU that failed, refused, crashed or gave no answer; the level adds slot, file and time."""


@dataclass
class Group:
    """Neighbouring variables that one call sets or gets.

    name: of the function, without Get or Set
    kind: real, int or bool
    values: array of C
    args: of the function after the instance
    start, stop: where their numbers lie in the flat list
    is_discrete: may only change at an event
    """

    name: str
    kind: str
    values: Any
    args: tuple[Any, ...]
    start: int
    stop: int
    is_discrete: bool

    def fill(self, numbers: Sequence[float]) -> None:
        """Put the group's part of the flat list into its array."""
        part: Sequence[float] = numbers[self.start : self.stop]
        if self.kind != "real":
            part = [round(x) if self.kind == "int" else x != 0.0 for x in part]
        self.values[:] = part


def make_groups(variables: Sequence[Variable], major: int) -> list[Group]:
    """Groups in the order of the variables. FmuError for one that is not a number."""
    made: list[Group] = []
    for (kind, variability), members in groupby(variables, key=lambda v: (v.type, v.variability)):
        group = list(members)
        if not group[0].is_number:
            raise FmuError(f"variable {group[0].name} is of type {kind}, expected a number or a boolean")
        if kind == "Enumeration":
            kind = "Int64" if major == 3 else "Integer"
        refs = [r for v in group for r in v.refs]
        start, count = made[-1].stop if made else 0, sum(v.size for v in group)
        values = (_TYPES.get(kind, _BOOLEANS[major]) * count)()
        args: tuple[Any, ...] = ((ctypes.c_uint * len(refs))(*refs), ctypes.c_size_t(len(refs)), values)
        args = (*args, ctypes.c_size_t(count)) if major == 3 else args
        is_discrete = variability == "discrete"
        made.append(Group(kind, group[0].kind, values, args, start, start + count, is_discrete))
    return made


class Library:
    """The loaded binary of one FMU.

    name: of the instance, under which its messages are kept; is_dead: it said fatal, nothing may be called
    """

    def __init__(self, description: Description, folder: Path, name: str) -> None:
        assert description.library is not None
        self.prefix, self.name = f"fmi{description.major}", name
        if description.major == 1:  # its functions are named after the model
            self.prefix = f"{Path(description.library).stem}_fmi"
        self.messages: deque[str] = deque(maxlen=KEPT_MESSAGES)
        self.is_dead = False
        _LOGS[name] = self.messages
        try:
            self._dll = ctypes.CDLL(str(folder / description.library))
        except OSError as error:
            raise FmuError(f"its binary {description.library} {why_not_loaded(str(error))}") from error

    def function(self, name: str) -> Any:
        """A function of the FMU by its name without prefix. FmuError where the binary has none."""
        try:
            return getattr(self._dll, self.prefix + name)
        except AttributeError as error:
            raise FmuError(f"its binary has no function {self.prefix}{name}") from error

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
        return FmuError(f"{self.prefix}{name} gave {word}{self.said}")

    @property
    def said(self) -> str:
        """The last messages of the FMU in one line, as the end of an error; empty without any."""
        said = " | ".join(" ".join(m.split()) for m in self.messages)
        return f"; it says: {said}" if said else ""

    def unload(self) -> None:
        """Let go of the binary."""
        from fmpy import freeLibrary

        _LOGS.pop(self.name, None)
        freeLibrary(self._dll._handle)


def log_categories(description: Description) -> tuple[Any, Any] | None:
    """Count and names of the categories worth listening to, warnings and errors; None without any."""
    wanted = ("warn", "discard", "error", "fatal")
    found = [c.encode() for c in description.log_categories if any(w in c.lower() for w in wanted)]
    return (ctypes.c_size_t(len(found)), (ctypes.c_char_p * len(found))(*found)) if found else None


def why_not_loaded(text: str) -> str:
    """What the loader said of a binary, with the package in which a missing system library is."""
    found = _MISSING.match(text)
    if found is None:
        return f"cannot be loaded: {text}"
    name, version = found["name"], found["version"]
    package = f"{name}{'-' if name[-1].isdigit() and version else ''}{version}".lower().replace("_", "-")
    return (
        f"needs the system library {found['file']}, which is not on this machine; on Debian and Ubuntu it is "
        f"in the package {package}"
    )


@cache
def callbacks(major: int) -> Any:
    """The callbacks that all instances of FMI 1 or 2 share (FMI 2.0.4, section 2.1.5)."""
    from fmpy import calloc, fmi1, fmi2, free

    module, prefix = (fmi1, "fmi1Callback") if major == 1 else (fmi2, "fmi2Callback")

    def log(_: Any, name: bytes | None, status: int, __: Any, message: bytes | None) -> None:
        if status >= WARNING and (kept := _LOGS.get(_text(name))) is not None:
            kept.append(_text(message))

    made = getattr(module, prefix + "Functions")()
    made.logger = getattr(module, prefix + "LoggerTYPE")(log)
    made.allocateMemory = ctypes.cast(calloc, getattr(module, prefix + "AllocateMemoryTYPE"))
    made.freeMemory = ctypes.cast(free, getattr(module, prefix + "FreeMemoryTYPE"))
    try:
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(ctypes.byref(made))  # fills in the variadic arguments, which ctypes cannot
    except (ImportError, OSError, AttributeError):
        pass
    return made


def logger3(library: Library) -> Any:
    """fmi3LogMessageCallback of one instance."""
    from fmpy.fmi3 import fmi3LogMessageCallback

    kept = library.messages

    def log(_: Any, status: int, __: Any, message: bytes | None) -> None:
        if status >= WARNING:
            kept.append(_text(message))

    return fmi3LogMessageCallback(log)


def _text(value: bytes | None) -> str:
    return "" if value is None else value.decode("utf-8", errors="replace")
