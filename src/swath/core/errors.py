"""Errors a user can act on: what is wrong, where, and what was expected."""

import errno
import os
import re
from collections.abc import Iterable, Sequence
from opcode import opmap
from pathlib import Path
from typing import Any

MIGRATED_BY = "`swath migrate` of version 0.2 rewrites a file of version 0.1"
"""What an error about a file in an old form says: the last version that reads it."""
LONGEST = 300
"""Characters of an error at most, whatever its input holds."""
TOO_LONG = "its names may have at most 255 bytes, all of it 4,095"
DAMAGED = "it is damaged, or of another kind"
_LONGEST_PLACE, _LONGEST_VALUE, _LEAST_VALUE = 150, 80, 50
_MOST_LISTS, _MOST_LIKE = 8, 2000  # lists in a text that are cut; names of one that are compared
_ITEM = r"[^\s,;]*[^\s,;:](?: \([^()]*+\))?"
_LIST = re.compile(rf"(?<![^\s,;])((?:{_ITEM}, (?!did you|or )){{3,}}{_ITEM})(?: and (\d+) more)?")


class SwathError(Exception):
    """Base of every error that swath raises on purpose: printed as one line, exit code 2.

    Its text is at most LONGEST characters, all of them printable; of a list that is too long it holds some
    names and says how many more there are. It can be pickled, so that it reaches the parent of a worker
    process as it is.
    """

    def __init__(self, text: str = "") -> None:
        super().__init__(fitted(text))

    def _render_traceback_(self) -> list[str]:
        """What IPython shows instead of the frames: the error, and the other mistakes."""
        return [f"{type(self).__name__}: {error}" for error in (self, *getattr(self, "others", ()))]

    def __reduce__(self) -> tuple[Any, ...]:
        state = {key: value if _can_be_pickled(value) else _shown(value) for key, value in vars(self).items()}
        return _restored, (type(self), self.args, state)


class InputError(SwathError):
    """A value from outside that cannot be used.

    Reads `key = value: expected what (file:line)`, one line; parts that are unknown are left out, and each is
    shortened to its share of LONGEST; of a list of names those nearest to the value stay. others: what else
    is wrong in the same document, in the order found. Made of another InputError it is a copy of it:
    pools of processes raise anew what a worker raised.
    """

    others: "tuple[InputError, ...]" = ()

    def __init__(
        self,
        key: "str | InputError",
        value: Any = None,
        expected: str = "",
        *,
        file: Path | str | None = None,
        line: int | None = None,
    ) -> None:
        if isinstance(key, InputError):
            super().__init__(str(key))
            vars(self).update(vars(key))
            return
        self.key, self.value, self.expected, self.file, self.line = key, value, expected, file, line
        place = ""
        if file is not None:
            place = f" ({shortened(str(file), _LONGEST_PLACE)}{'' if line is None else f':{line}'})"
        text = shortened(key, _LONGEST_PLACE if "/" in key else _LONGEST_VALUE)
        if value is not None:  # what is expected stays whole where the value's text can be shorter
            room = LONGEST - len(place) - len(text) - len(expected) - len(" = : ")
            shown = _shown(value)
            text += f" = {shown if _LIST.search(expected) else shortened(shown, max(room, _LEAST_VALUE))}"
        if expected:
            text += f": {expected}"
        super().__init__(fitted(text, LONGEST - len(place), value if isinstance(value, str) else "") + place)


def raise_all(errors: "Sequence[InputError]") -> None:
    """Raise the first error, where there is one; its `others` are the rest."""
    if errors:
        errors[0].others = tuple(errors[1:])
        raise errors[0]


def check_within(key: str, value: float, low: float, high: float) -> None:
    """InputError for a number that does not lie within limits, both included."""
    if not low <= value <= high:
        raise InputError(key, value, f"expected {low:g} to {high:g}")


def check_once(key: str, names: "Sequence[object]") -> None:
    """InputError for names of which one is there twice."""
    if len(set(names)) < len(names):
        raise InputError(key, " ".join(map(str, names)), "expected each only once")


class WiringError(SwathError):
    """Two ports that do not fit, a port without a source, or a source that does not exist."""


class MissingExtra(SwathError):
    """An optional dependency that is not installed."""

    def __init__(self, extra: str, what: str = "this") -> None:
        super().__init__(f"{what} needs an optional part: pip install 'swath[{extra}]'")


class Extra:
    """`with Extra("geo", "reading a DEM"): import rasterio`, MissingExtra where that is not installed."""

    def __init__(self, extra: str, what: str = "this") -> None:
        self._missing = extra, what

    def __enter__(self) -> None:
        """Imports follow."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """MissingExtra in the place of an ImportError."""
        if isinstance(error, ImportError):
            raise MissingExtra(*self._missing) from error


def absence_of(path: str | Path, usual: str) -> str:
    """Why nothing was found at a path: `usual`, or that a folder on the way may not be entered."""
    try:
        os.stat(path)
    except PermissionError as error:
        return reason_of(error)
    except (OSError, ValueError):
        pass
    return usual


def reason_of(error: BaseException) -> str:
    """Why something cannot be read, as swath says it: in the words of its own code, or of the system.

    Of what Python or a library says only the place is kept.
    """
    if isinstance(error, OSError) and error.strerror:
        return TOO_LONG if error.errno == errno.ENAMETOOLONG else error.strerror
    column = getattr(error, "colno", getattr(error, "offset", None))
    place = getattr(error, "position", (getattr(error, "lineno", None), column))
    if isinstance(place, tuple) and all(isinstance(number, int) for number in place):  # of JSON, XML
        return f"it goes wrong at line {place[0]}, column {place[1]}"
    said = next(iter(str(error).splitlines()), "")
    return said if said and (isinstance(error, SwathError) or _is_raised_here(error)) else DAMAGED


def _is_raised_here(error: BaseException) -> bool:
    """Whether a `raise` in swath's own code raised it, and not what that calls."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None or not str(trace.tb_frame.f_globals.get("__name__", "")).startswith("swath."):
        return False
    return trace.tb_frame.f_code.co_code[trace.tb_lasti] == opmap["RAISE_VARARGS"]


def fitted(text: str, limit: int = LONGEST, like: str = "") -> str:
    """Text of at most `limit` characters: its longest lists of names with the first of them, or those nearest
    to `like`, and the number of the others; then as `shortened`.
    """
    for _ in range(_MOST_LISTS):
        if len(text) <= limit or not (runs := list(_LIST.finditer(text))):
            break
        run = max(runs, key=lambda found: len(found.group()))
        names, left = run.group(1).split(", "), int(run.group(2) or 0)
        if like and len(names) <= _MOST_LIKE:
            names.sort(key=lambda name: -_likeness(name, like))
        room = limit - (len(text) - len(run.group()))
        count = min(len(names) - 1, max(room, 1))
        while count > 1 and len(_first_of(names, count, left=left)) > room:
            count -= 1
        text = text[: run.start()] + _first_of(names, count, left=left) + text[run.end() :]
        if count == 1:
            break
    return shortened(text, limit)


def some_of(names: Iterable[str], most: int, between: str = ", ") -> str:
    """The first names of a list, at most `most`, and how many more there are."""
    every = list(names)
    return between.join(every) if len(every) <= most else _first_of(every, most, between)


def capped(texts: Sequence[str], most: int, before: str = "") -> list[str]:
    """The first of some lines, at most `most`, and one that says how many more there are.

    before: begins that line
    """
    return [*texts[:most], *([f"{before}and {len(texts) - most} more"] if len(texts) > most else [])]


def _first_of(names: list[str], count: int, between: str = ", ", left: int = 0) -> str:
    return f"{between.join(names[:count])} and {len(names) - count + left} more"


def near_miss(value: Any, names: Iterable[str]) -> str:
    """`, did you mean 'x'?` or nothing."""
    from difflib import get_close_matches

    near = get_close_matches(str(value), list(names), n=1)
    return f", did you mean {near[0]!r}?" if near else ""


def _likeness(name: str, like: str) -> float:
    from difflib import SequenceMatcher

    return SequenceMatcher(None, name[:_LONGEST_VALUE], like[:_LONGEST_VALUE]).ratio()


def shortened(text: str, limit: int = LONGEST) -> str:
    """Text in printable characters, at most `limit`: a longer one without its middle."""
    whole = len(text) <= 2 * limit
    shown = _printable(text if whole else text[:limit] + text[-limit:])
    if whole and len(shown) <= limit:
        return shown
    tail = (limit - 3) // 3
    return f"{shown[: limit - 3 - tail]}...{shown[len(shown) - tail :]}"


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def _shown(value: Any) -> str:
    """At most a line of a value; more of a path, which is recognised by its end."""
    text = str(value) if isinstance(value, str | Path) else _written(value)
    return fitted(text, _LONGEST_PLACE if "/" in text and " " not in text else _LONGEST_VALUE)


def _written(value: Any) -> str:
    """A value as Python writes it; of a long list or array only its kind and length."""
    if isinstance(value, list | tuple | dict | set) and len(value) > _LONGEST_VALUE:
        return f"{type(value).__name__} of {len(value)}"
    return repr(value)


def _can_be_pickled(value: Any) -> bool:
    import pickle

    try:
        pickle.loads(pickle.dumps(value))
    except Exception:  # a value of any kind: how it refuses is its own affair
        return False
    return True


def _restored(kind: type[SwathError], args: tuple[Any, ...], state: dict[str, Any]) -> SwathError:
    """An error as it was, whatever its constructor takes."""
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(state)
    return error
