"""The process that reads files of others, `python -m swath.core.apart.serve`; asked over pipes by `call.py`.

What comes in is of the process that started it and is trusted; what goes out is plain.
"""

import importlib
import os
import pickle
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from typing import Any, BinaryIO

from swath.core.apart import call
from swath.core.apart.confine import confine
from swath.core.apart.plain import Plain
from swath.core.errors import InputError, MissingExtra, SwathError

FIRST, MOST, MOST_GROUP = 4, 4096, 512  # items of the first block, of any, and that are made JSON together
BLOCK_BYTES = 1 << 20  # after which a block goes out; no clock: notes are told by the block


class Server:
    """Objects and iterators that are asked by number."""

    def __init__(self) -> None:
        self._objects: dict[int, Any] = {}
        self._streams: dict[int, tuple[Iterator[Any], Any, int, int]] = {}
        self._last = 0
        self._seconds = 0.0
        self._is_new = True

    def answer(self, request: tuple[Any, ...], plain: Plain) -> str:
        """The answer to a request, as JSON."""
        cwd, dropped, self._seconds, verb, *what = request
        _limit(self._seconds)
        for kind, number in dropped:
            (self._objects if kind == "object" else self._streams).pop(number, None)
        try:
            os.chdir(cwd)
            if verb == "next":
                return self._next(what[0], plain)
            if verb == "call":
                return self._called(*what, plain=plain)
            return self._asked(*what, plain=plain)
        except Exception as error:
            return plain.text({"error": _told(error)})

    def _called(self, name: tuple[str, str], args: Any, kwargs: Any, *, plain: Plain) -> str:
        is_new, self._is_new = self._is_new, False
        if not is_new and not _may_read(args[0]):
            return plain.text({"elsewhere": True})
        reader: Any = importlib.import_module(name[0])
        for part in name[1].split("."):
            reader = getattr(reader, part)
        return self._said(reader(*args, **kwargs), reader.kept, None, plain)

    def _asked(self, number: int, name: str, args: Any, kwargs: Any, *, plain: Plain) -> str:
        of = self._objects[number]
        return self._said(getattr(of, name)(*args, **kwargs), (), of, plain)

    def _said(self, value: Any, kept: tuple[type, ...], of: Any, plain: Plain) -> str:
        self._last += 1
        if isinstance(value, kept):
            self._objects[self._last] = value
            return plain.text({"object": self._last, "told": _attributes(value)})
        about = {} if of is None else {"told": {"notes": of.notes}}
        if isinstance(value, Iterator):
            self._streams[self._last] = value, of, FIRST, 1
            return plain.text({"stream": self._last, **about})
        return plain.text({"value": value, **about})

    def _next(self, number: int, plain: Plain) -> str:
        stream, of, most, group = self._streams[number]
        texts: list[str] = []
        error, is_whole, count, size = "", False, 0, 0
        while not is_whole and count < most and size < BLOCK_BYTES:
            _limit(self._seconds)  # every item is progress
            items: list[Any] = []
            try:
                items.extend(islice(stream, min(group, most - count)))
            except Exception as broken:
                is_whole, error = True, plain.text(_told(broken))
            is_whole |= len(items) < min(group, most - count)
            if items:
                before = plain.size
                texts.append(plain.many(items))
                count += len(items)
                size += (grown := len(texts[-1]) + plain.size - before)
                group = max(1, min(MOST_GROUP, len(items) * BLOCK_BYTES // (2 * grown)))
        if is_whole:
            del self._streams[number]
        else:
            self._streams[number] = stream, of, min(4 * most, MOST), group
        parts = [f'"end":{"true" if is_whole else "false"}', f'"items":[{",".join(texts)}]']
        if of is not None:
            parts.append(f'"told":{plain.text({"notes": of.notes})}')
        if error:
            parts.append(f'"error":{error}')
        return "{" + ",".join(parts) + "}"


def _may_read(path: Any) -> bool:
    """Whether it lies where this process may read, as far as that can be told."""
    try:
        os.close(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)))
    except PermissionError:
        return False
    except OSError:
        return True  # the reader says why not
    return True


def _attributes(value: Any) -> dict[str, Any]:
    names = ("path", "notes", "units", "begin", "end", "sources", "spans", "lacking", "is_held")
    return {name: getattr(value, name) for name in names
            if not callable(getattr(value, name, None)) and hasattr(value, name)}  # fmt: skip


def _told(error: Exception) -> dict[str, Any]:
    about: Any = None
    kind = type(error).__name__
    if isinstance(error, InputError):
        kind = "InputError"
        value = error.value if isinstance(error.value, str | int | float | None) else str(error.value)
        about = {"key": error.key, "value": value, "expected": error.expected,
                 "file": None if error.file is None else str(error.file), "line": error.line}  # fmt: skip
    else:
        bases = (MissingExtra, SwathError, MemoryError, OSError, ValueError)
        kind = next((base.__name__ for base in bases if isinstance(error, base)), kind)
    return {"kind": kind, "text": str(error), "about": about}


def _limit(seconds: float) -> None:
    """So much processor time from here on, which the system sees to."""
    with suppress(ImportError, AttributeError, ValueError, OSError):
        import resource

        used = time.process_time()
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (int(used + seconds) + 1, hard))


def _request(file: BinaryIO) -> Any:
    size = int.from_bytes(file.read(8), "little")
    return pickle.loads(file.read(size)) if size else None


def main() -> None:
    """Serve until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asked, told = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1):  # libraries that print say it to nobody
        os.dup2(nothing, number)
    sys.path[:], roots, libraries, memory, layers = _request(asked)
    call.is_apart = True
    for library in libraries:
        with suppress(ImportError):  # the reader says what is missing
            importlib.import_module(library)
    server, plain = Server(), Plain()
    plain.write(told, plain.text({"layers": confine(roots, memory, layers)}))
    while (request := _request(asked)) is not None:
        text = server.answer(request, plain)
        try:
            plain.write(told, text)
        except BrokenPipeError:
            return


if __name__ == "__main__":
    main()
