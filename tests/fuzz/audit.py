"""Whole and damaged files of every kind, read by parsers that nothing confines, under an audit hook.

    python -m tests.fuzz.audit --cases 20 [--kinds mf4,blf]

It sees code that is made of a text or run, programs that are started, connections, and files opened to be
written: exit code 1, and a line about each, where that came of anything but an installed module. Each kind is
read whole before, so that what is imported and compiled once has been.
"""

import argparse
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from swath.core.apart import call
from swath.core.errors import SwathError
from tests.fuzz.kinds import KINDS, REFUSED
from tests.fuzz.run import WHOLE, Seeds, damage

STARTED = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "os.spawn", "subprocess.Popen", "pty.spawn")
REACHED = ("socket.connect", "socket.bind", "socket.sendto", "urllib.Request", "ctypes.dlopen")
TO_WRITE = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
WRITES = "core/files/"  # the one way in which swath writes, below --out
MAKES_CODE = {  # what makes code of its own texts; what a file says in them is checked before
    "importlib": "modules", "dataclasses.py": "methods of records", "collections/__init__.py": "named tuples",
    "typing.py": "annotations in quotes", "jinja2/": "templates of swath", "warp/": "kernels of swath",
    "rosbags/typesys/": "classes of messages", "rosbags/serde/": "readers of messages",
    "ast.py": "a syntax tree, which is not run", "pydantic/": "annotations",
}  # fmt: skip


class Hook:
    """What was seen. is_on: whether it is looked."""

    def __init__(self) -> None:
        self.seen: list[str] = []
        self.is_on = False
        sys.addaudithook(self)

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        """Look at an event of Python."""
        if not self.is_on or event not in LOOKED_AT:
            return
        self.is_on = False  # looking opens files, too
        try:
            if said := LOOKED_AT[event](args, sys._getframe(1)):
                self.seen.append(f"{event}: {said}")
        finally:
            self.is_on = True


def _of_code(source: object, name: object, frame: FrameType) -> str:
    if isinstance(name, str | bytes) and os.path.isfile(os.fsdecode(name)):
        return ""  # a module
    maker = frame.f_code.co_filename
    if any(part in maker for part in MAKES_CODE) or maker == "<frozen importlib._bootstrap_external>":
        return ""
    return f"{source!s:.60} by {maker}"


def _compile(args: tuple[Any, ...], frame: FrameType) -> str:
    return "" if args[0] is None else _of_code(args[0], args[1], frame)


def _exec(args: tuple[Any, ...], frame: FrameType) -> str:
    (code,) = args
    made = code.co_filename if isinstance(code, CodeType) else ""
    return _of_code(made, made, frame)


def _open(args: tuple[Any, ...], frame: FrameType) -> str:
    path, mode, flags = args
    is_written = (flags or 0) & TO_WRITE if mode is None else set(str(mode)) & set("wax+")
    if not is_written or isinstance(path, int) or os.fsdecode(path) == os.devnull:
        return ""
    looked: FrameType | None = frame
    while looked is not None:
        if WRITES in looked.f_code.co_filename:
            return ""
        looked = looked.f_back
    return f"{path} to be written by {frame.f_code.co_filename}"


def _any(args: tuple[Any, ...], frame: FrameType) -> str:
    return f"{args!s:.100} by {frame.f_code.co_filename}"


LOOKED_AT: dict[str, Callable[[tuple[Any, ...], FrameType], str]] = {
    "compile": _compile, "exec": _exec, "open": _open, **dict.fromkeys((*STARTED, *REACHED), _any),
}  # fmt: skip


def audit(kinds: list[str], first: int, cases: int, folder: Path) -> tuple[int, list[str]]:
    """Number of cases, and what was seen in which of them."""
    call.is_apart = True
    hook, seeds, found, count = Hook(), Seeds(folder), list[str](), 0
    warnings.simplefilter("ignore")
    for kind in kinds:
        for number in (WHOLE, WHOLE, *range(first, first + cases)):
            damage(seeds.of(kind), folder / "work", kind, number)
            with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
                hook.is_on = count > 0 or number != WHOLE
                try:
                    KINDS[kind].read(folder / "work")
                except SwathError:
                    pass
                except Exception as error:
                    found.append(f"{kind} {number}: {type(error).__name__}: {error!s:.100}")
                finally:
                    hook.is_on = False
            if number == WHOLE and not hasattr(seeds, kind):
                hook.seen.clear()  # what is made once
                setattr(seeds, kind, True)
            found += [f"{kind} {number}: {said}" for said in dict.fromkeys(hook.seen)]
            hook.seen.clear()
            count += 1
    return count, found


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=20, help="damaged ones of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--kinds", default=",".join(k for k in KINDS if k not in REFUSED))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        count, found = audit(args.kinds.split(","), args.first, args.cases, Path(folder))
    print(*found, f"{count} files read, {len(found)} times something was seen", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
