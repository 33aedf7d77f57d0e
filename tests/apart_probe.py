"""Readers that try what a reader must not be able to do; see `tests/core/test_apart.py`."""

import os
import socket
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.apart.call import apart
from swath.core.errors import InputError


def _tried(do: Any) -> str:
    try:
        do()
    except (OSError, MemoryError) as error:
        return type(error).__name__
    return "done"


def _connect(port: int) -> None:
    with socket.socket() as client:
        client.connect(("127.0.0.1", port))


@apart("log", "a log")
def attempts(path: Path, elsewhere: str, port: int, parent: int) -> dict[str, str]:
    """What became of each attempt, by name."""
    own = f"{path}.new"
    tries = {
        "read the file": lambda: path.read_bytes(),
        "read beside it": lambda: path.with_suffix(".beside").read_bytes(),
        "read elsewhere": lambda: Path(elsewhere).read_bytes(),
        "list elsewhere": lambda: os.listdir(Path(elsewhere).parent),
        "write over it": lambda: path.write_bytes(b"x"),
        "append to it": lambda: path.open("ab").write(b"x"),
        "write beside it": lambda: Path(own).write_bytes(b"x"),
        "write elsewhere": lambda: Path(elsewhere).write_bytes(b"x"),
        "make a folder": lambda: os.mkdir(own),
        "make a link": lambda: os.symlink("/", own),
        "make a hard link": lambda: os.link(path, own),
        "rename": lambda: os.rename(path, own),
        "remove": lambda: os.unlink(path),
        "change rights": lambda: os.chmod(path, 0o777),
        "change times": lambda: os.utime(path, (0, 0)),
        "truncate": lambda: os.truncate(path, 0),
        "start a program": lambda: subprocess.run(["true"], check=True),
        "start by a shell": lambda: os.system("true") and _refuse(),
        "fork": lambda: os.fork() or os._exit(0),
        "connect": lambda: _connect(port),
        "kill": lambda: os.kill(parent, 0),
        "ptrace": lambda: os.open(f"/proc/{parent}/mem", os.O_RDONLY),
        "read its environment": lambda: Path(f"/proc/{parent}/environ").read_bytes(),
    }
    return {name: _tried(do) for name, do in tries.items()}


def _refuse() -> None:
    raise OSError


@apart("log", "a log")
def content(path: Path) -> bytes:
    """What is in it; an error where that is nothing."""
    if not (found := path.read_bytes()):
        raise InputError("log", path.name, "expected no empty file", file=path)
    return found


@apart("log", "a log")
def much(path: Path, gigabytes: float) -> int:
    """Takes memory."""
    return len(np.ones(int(gigabytes * (1 << 27))))


@apart("log", "a log")
def long(path: Path) -> None:
    """Never ends."""
    while True:
        pass


@apart("log", "a log")
def broken(path: Path) -> None:
    """Ends its process."""
    os.abort()


@apart("log", "a log")
def counted(path: Path, most: int, fails_at: int) -> Any:
    """Numbers; an error."""
    for number in range(most):
        if number == fails_at:
            raise ValueError(f"at {number}")
        yield number, np.full(3, number), {"name": str(number)}


class Tally:
    """An object that stays."""

    def __init__(self, path: Path) -> None:
        self.path, self.notes = path, dict[str, int]()

    def numbers(self, most: int) -> Any:
        """Numbers, each of which is noted."""
        for number in range(most):
            self.notes["numbers"] = number + 1
            yield number

    def fail(self) -> None:
        """A KeyError."""
        raise KeyError("nothing")


@apart("log", "a log", kept=(Tally,))
def tally(path: Path) -> Tally:
    """An object that stays."""
    return Tally(path)
