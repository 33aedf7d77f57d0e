"""What an attack of a file is, and what attacks share."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ACTED = "ACTED"  # a file that code of a stranger makes, where it runs
PORT = int(os.environ.get("ATTACK_PORT", "48123"))  # of this machine: who connects there was led by a file
WRITE = f'open("{ACTED}","a").write("x")'
DONE, REFUSED = 0, 2
RAN = (0, 1, 2, 3)  # of a run, too: its limits


@dataclass(frozen=True)
class Attack:
    """make: writes the files into a folder, where `swath COMMAND` is started; tries: what they want.

    codes: exit codes that are right; is_quick: that a suite has the time for
    """

    make: Callable[[Path], object]
    command: tuple[str, ...]
    tries: str
    codes: tuple[int, ...] = (DONE, REFUSED)
    is_quick: bool = False


def sparse(path: Path, head: bytes, size: int, fill: bytes = b"") -> None:
    """A file of some size that takes no room: its head, then zeros; or `fill` over and over, of one block."""
    with path.open("wb") as file:
        file.write(head)
        for _ in range(0, size if fill else 0, len(fill) or 1):
            file.write(fill)
        if not fill:
            file.truncate(size)
