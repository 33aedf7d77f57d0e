"""Readers that run in a process of their own: declared by `apart`, called as if they ran here.

    @apart("raster", "a GeoTIFF", libraries=("rasterio",), records=(Raster,))
    def read(path: Path, band: int) -> Raster: ...

The first argument is the file or folder that is read. What comes back is plain (`plain.py`): numbers, texts,
lists, arrays, the records that are declared, messages; an iterator comes in blocks, as it is asked; an object
of the kinds that are declared as kept stays there, and its methods are asked. Errors of swath arrive as they
are; one that ends the process, or lasts too long, is an InputError of the file.

A process reads what lies in one folder and stays for further files there. It has no rights but to read them
(`confine.py`), memory and processor time by the size of the file: SWATH_READ_MEMORY_GB (1.25) and 8 bytes for
each byte, SWATH_READ_S (20) and 1 s for each MiB until the next answer.
"""

import functools
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from swath.core.apart.plain import Classes, read_plain
from swath.core.errors import InputError, MissingExtra, SwathError, fitted
from swath.core.process.processes import start_module

P = ParamSpec("P")
R = TypeVar("R")
MEMORY_GB, PER_BYTE = "SWATH_READ_MEMORY_GB", 8
USUAL_BYTES = 32 << 20  # of files that the same process reads
SECONDS, BYTES_PER_S = "SWATH_READ_S", 1 << 20
LAYERS = "SWATH_READ_CONFINED"  # landlock,seccomp: what confines a reader, where the system has it
WAITED = 10.0  # wall time over processor time, after which a process counts as one that stands still
MOST_ALIVE, MOST_WRITTEN = 4, 1000
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "GDAL_NUM_THREADS"),
    "1",
)
ERRORS: Mapping[str, type[Exception]] = {
    kind.__name__: kind for kind in (ValueError, KeyError, IndexError, OSError, TypeError, AttributeError)
}
_written: dict[tuple[int, ...] | None, None] = {}
is_apart = False  # in a process of a reader: what is declared runs at once


def apart(
    key: str,
    what: str,
    *,
    libraries: Sequence[str] = (),
    records: Sequence[type] = (),
    kept: Sequence[type] = (),
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Declare a reader of files of others, a function of a module whose first argument is a path.

    key, what: of the InputError of a file that ends the process; libraries: loaded before it is confined
    records: classes of what it gives; kept: of objects that stay there
    """

    def declared(reader: Callable[P, R]) -> Callable[P, R]:
        name = reader.__module__, reader.__qualname__

        @functools.wraps(reader)
        def called(*args: P.args, **kwargs: P.kwargs) -> R:
            path = Path(os.path.abspath(str(args[0])))
            if is_apart or _state_of(path) in _written:
                return reader(*args, **kwargs)
            classes = {kind.__qualname__: kind for kind in records}
            size = _size(path)
            request, place = ("call", name, args, kwargs), _Place(key, what, path, size, classes)
            while True:
                process = _process_for(path, size, (reader.__module__, *libraries))
                try:
                    found: R = process.ask(request, place)
                    return found
                except _Elsewhere:  # never of a new one
                    process.may_read = False

        vars(called).update(kept=tuple(kept))
        return called

    return declared


def written_here(path: Path) -> None:
    """Note a file that swath has written in this process, of nothing of a stranger's: it is read here."""
    if (state := _state_of(path)) is not None:
        _written[state] = None
        while len(_written) > MOST_WRITTEN:
            del _written[next(iter(_written))]


def _state_of(path: Path) -> tuple[int, ...] | None:
    try:
        about = os.stat(path)
    except (OSError, ValueError):
        return None
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns


class _Elsewhere(Exception):
    """A folder was made anew, and what was confined to the one before may not read it."""


class _Place:
    """Which file is read. key, what: of its errors; size [bytes]; classes: of what comes back."""

    def __init__(self, key: str, what: str, path: Path, size: int, classes: Classes) -> None:
        self.key, self.what, self.path, self.classes = key, what, path, classes
        self.seconds = float(os.environ.get(SECONDS) or 20.0) + size / BYTES_PER_S

    def error(self, reason: str) -> InputError:
        """The error of a file that ended its reader."""
        return InputError(self.key, self.path.name, f"expected {self.what}: {reason}", file=self.path)


class Kept:
    """An object of a reader's process: its attributes as they were told last, its methods asked there."""

    def __init__(self, process: "_Process", number: int, told: dict[str, Any], place: _Place) -> None:
        vars(self).update(told)
        self._asked = process, number, place
        process.keeps[number] = place.path
        weakref.finalize(self, process.drop, number)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return functools.partial(self._ask, name)

    def _ask(self, name: str, *args: Any, **kwargs: Any) -> Any:
        process, number, place = self._asked
        return process.ask(("method", number, name, args, kwargs), place, self)


class _Process:
    """A process that reads. roots: what it may read; libraries: that it has loaded."""

    def __init__(self, roots: frozenset[str], libraries: frozenset[str], size: int) -> None:
        self.roots, self.libraries, self.size = roots, libraries, size
        self.dropped: list[tuple[str, int]] = []
        self.keeps: dict[int, Path] = {}  # of which file each object is that stays here
        self._lock = threading.RLock()
        self._most = int(float(os.environ.get(MEMORY_GB) or 1.25) * (1 << 30)) + PER_BYTE * size
        errors = None if os.environ.get("SWATH_DEBUG") else subprocess.DEVNULL
        self._child = start_module(
            "swath.core.apart.serve", stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
            environment=ONE_THREAD,
        )  # fmt: skip
        layers = os.environ.get(LAYERS, "landlock,seccomp").split(",")
        self._end = weakref.finalize(self, _close, self._child)
        self._send(pickle.dumps(([*sys.path], sorted(roots), sorted(libraries), self._most, layers)))
        self._awaited, self._is_new = {*filter(None, layers)}, True
        self.may_read = True

    def drop(self, number: int) -> None:
        """Let an object go with the next request."""
        self.dropped.append(("object", number))
        self.keeps.pop(number, None)

    @property
    def is_alive(self) -> bool:
        """Whether it can be asked."""
        return self.may_read and self._child.poll() is None

    def ask(self, request: tuple[Any, ...], place: _Place, kept: Kept | None = None) -> Any:
        """What comes back; an iterator is asked for further blocks. Raises what the reader raised."""
        with self._lock:
            answer = self._answer(request, place)
        if answer.get("elsewhere"):
            raise _Elsewhere
        if kept is not None:
            vars(kept).update(answer.get("told", {}))
        if (error := answer.get("error")) is not None:
            raise _error_of(error, place)
        if (number := answer.get("stream")) is not None:
            return self._stream(number, place, kept)
        if (number := answer.get("object")) is not None:
            return Kept(self, number, answer["told"], place)
        return answer["value"]

    def _stream(self, number: int, place: _Place, kept: Kept | None) -> Iterator[Any]:
        is_whole = False
        try:
            while not is_whole:
                with self._lock:
                    answer = self._answer(("next", number), place)
                if kept is not None:
                    vars(kept).update(answer.get("told", {}))
                is_whole = answer["end"]
                yield from chain.from_iterable(answer["items"])
                if (error := answer.get("error")) is not None:
                    raise _error_of(error, place)
        finally:
            if not is_whole:
                self.dropped.append(("stream", number))

    def _answer(self, request: tuple[Any, ...], place: _Place) -> dict[str, Any]:
        """The answer to a request. InputError where the process ends over it."""
        dropped, self.dropped[:] = [*self.dropped], []
        read = functools.partial(self._read, until=time.monotonic() + WAITED * place.seconds)
        asked = pickle.dumps((os.getcwd(), dropped, place.seconds, *request))
        try:
            self._send(asked)
            if self._is_new:
                lacking = self._awaited - {*read_plain(read, {}, self._most)["layers"]}
                self._is_new = False
                _tell(frozenset(lacking))
            found = read_plain(read, place.classes, self._most)
            if not isinstance(found, dict):
                raise ValueError("an answer of another form")
            return found
        except Exception as error:  # a broken reader may answer anything
            broken = place.error(self._why(error, place))
            self.close()
            raise broken from error
        except BaseException:  # Ctrl-C: what it still answers belongs to nobody
            self.close()
            raise

    def _why(self, error: Exception, place: _Place) -> str:
        """Why there is no answer, in words."""
        if isinstance(error, EOFError | BrokenPipeError):
            with suppress(subprocess.TimeoutExpired):
                self._child.wait(5.0)
        number, memory = -(self._child.poll() or 0), f"{self._most / 2**30:.2g} GB of memory ({MEMORY_GB})"
        if isinstance(error, TimeoutError) or number == getattr(signal, "SIGXCPU", -1):
            return f"to read it takes more than {place.seconds:.0f} s ({SECONDS})"
        if number > 0:
            return f"what reads it ended by signal {number}; it may take {memory}"
        return f"what reads it ended ({error or type(error).__name__})"

    def _send(self, data: bytes) -> None:
        file = self._child.stdin
        assert file is not None
        file.write(len(data).to_bytes(8, "little") + data)
        file.flush()

    def _read(self, size: int, until: float) -> bytearray:
        """As many bytes of the answer. EOFError where it ends, TimeoutError where it stands still."""
        file, found, done = self._child.stdout, bytearray(size), 0
        assert file is not None
        while done < size:
            left = max(until - time.monotonic(), 0.0)
            if os.name == "posix" and not select.select([file], [], [], left)[0]:
                raise TimeoutError
            if not (part := os.read(file.fileno(), min(size - done, 1 << 20))):
                raise EOFError("it ended")
            found[done : done + len(part)] = part
            done += len(part)
        return found

    def close(self) -> None:
        """End it."""
        self._end()


@functools.cache
def _tell(lacking: frozenset[str]) -> None:
    """Say once what does not confine a reader here."""
    if lacking:
        names = ", ".join(sorted(lacking))
        print(f"note    files of others are read without {names}, which this system lacks", file=sys.stderr)


def _close(child: "subprocess.Popen[bytes]") -> None:
    """End a process; it ends by itself where nobody asks it any more."""
    for file in (child.stdin, child.stdout):
        if file is not None:
            with suppress(OSError):
                file.close()
    try:
        child.wait(0.2)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def _error_of(told: Mapping[str, Any], place: _Place) -> Exception:
    """The error that a reader told of."""
    kind, text, about = told["kind"], fitted(str(told["text"])), told["about"]
    if kind == "MemoryError":
        return place.error("it takes too much memory to read")
    if kind == "InputError":
        error: SwathError = InputError(about["key"], about["value"], str(about["expected"]))
        vars(error).update(file=about["file"], line=about["line"])
    elif kind in ("MissingExtra", "SwathError"):
        error = object.__new__(MissingExtra if kind == "MissingExtra" else SwathError)
    else:
        return ERRORS.get(kind, RuntimeError)(text)
    error.args = (text,)
    return error


_alive: list[_Process] = []
_of_pid = os.getpid()
_lock = threading.Lock()


def _process_for(path: Path, size: int, libraries: Sequence[str]) -> _Process:
    """A process that may read a file, or all in a folder; the newest that may."""
    global _of_pid
    folder = str(path) if os.path.isdir(path) else str(path.parent)
    real, beside = os.path.realpath(path), os.path.realpath(folder)
    elsewhere = [] if real == beside or os.path.dirname(real) == beside else [real]  # a link leads there
    roots, needed = frozenset((folder, beside, *elsewhere)), frozenset(libraries)
    with _lock:
        if _of_pid != os.getpid():  # after a fork they answer the process before
            _alive.clear()
            _of_pid = os.getpid()
        for process in reversed(_alive):
            if (
                process.roots >= roots
                and process.libraries >= needed
                and process.size >= size
                and all(kept == path for kept in [*process.keeps.values()])  # no file ends another's object
                and process.is_alive
            ):
                return process
        made = _Process(roots, needed, max(size, USUAL_BYTES))
        _alive.append(made)
        while len(_alive) > MOST_ALIVE:
            _alive.pop(0)
        return made


def _size(path: Path) -> int:
    """Bytes of a file, or of the files of a folder, that are on the disk."""
    try:
        about = [p.stat() for p in (path.iterdir() if os.path.isdir(path) else [path]) if os.path.isfile(p)]
    except OSError:
        return 0
    return sum(min(each.st_size, 512 * getattr(each, "st_blocks", each.st_size)) for each in about)


def close_all() -> None:
    """End the processes of readers; the next file has a new one."""
    with _lock:
        while _alive:
            _alive.pop().close()
