"""A tutorial as its reader uses it: `python -m tests.typed_tutorial PAGE OUT`, in an empty folder.

Listings in `yaml` or `python` are saved under the last name above them that ends in .yaml or .py; those in
`sh` run in their order, and what each prints is OUT/NUMBER.txt. Lines of `swath` alone, or with TELLING
behind, run in this one process, which loads the packages once; all others in bash. Figures are made but
stay blank: tests marked `drawn` draw them.
"""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from swath.commands.main import main

LISTING = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAME = re.compile(r"`([\w-]+\.(?:yaml|py))`")
OF_SHELL = re.compile(r"[|&;<>$(){}*?~`]")
QUOTED = re.compile(r"'[^']*'")
TELLING = ' || echo "exit code $?"'


def listings(text: str) -> Iterator[tuple[str, str, str]]:
    """(language, content, name to save it under) of the listings of a page."""
    end = 0
    for found in LISTING.finditer(text):
        names = NAME.findall(text[end : found.start()])
        yield found[1], found[2], names[-1] if names else ""
        end = found.end()


def is_own(line: str) -> bool:
    """Whether a line is one of swath alone, or one that tells its exit code."""
    return line.startswith("swath ") and not OF_SHELL.search(QUOTED.sub("", line.removesuffix(TELLING)))


def type_lines(content: str) -> None:
    """The lines of a listing; SystemExit where one fails."""
    lines = [line for line in content.replace("\\\n", " ").splitlines() if line.strip()]
    for own, group in groupby(lines, is_own):
        if not own:
            done = subprocess.run(["bash", "-e", "-o", "pipefail", "-c", "\n".join(group)], check=False)
            if done.returncode:
                raise SystemExit(done.returncode)
            continue
        for line in group:
            code = main(shlex.split(line.removesuffix(TELLING), comments=True)[1:])
            if code and not line.endswith(TELLING):
                raise SystemExit(code)
            if code:
                print(f"exit code {code}")


@contextmanager
def printing_to(path: Path) -> Iterator[None]:
    """All that this process and its children print goes to a file."""
    sys.stdout.flush()
    kept = os.dup(1), os.dup(2)
    with path.open("wb") as file:
        for number in (1, 2):
            os.dup2(file.fileno(), number)
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for number, old in zip((1, 2), kept, strict=True):
            os.dup2(old, number)
            os.close(old)


def type_page(page: Path, out: Path) -> None:
    """Use a page from top to bottom."""
    for number, (language, content, name) in enumerate(listings(page.read_text(encoding="utf-8"))):
        if language == "sh":
            with printing_to(out / f"{number}.txt"):
                type_lines(content)
        elif language != "text":
            Path(name).write_text(content, encoding="utf-8")


if __name__ == "__main__":
    Figure.draw = lambda self, renderer: None
    type_page(Path(sys.argv[1]), Path(sys.argv[2]))
