"""`swath docs`: the pages of the documentation that came with the installation."""

import argparse
import os
from pathlib import Path
from typing import Any

from swath.core.errors import near_miss
from swath.terminal.options import option, verb

PLACE = "start", 8  # among all commands
NOT_PAGES = ("figures", "make", "static")


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "docs", "list the pages of the documentation; print one", run, _DESCRIPTION)
    option(parser, "page PAGE", "page to print, such as levels or tutorials/first-run", nargs="?")


def run(args: argparse.Namespace) -> int:
    """Print a page as it is, or path and title of all."""
    from swath.core.errors import InputError
    from swath.terminal.tables import say, table

    found = pages()
    if args.page is None:
        table("", ("page", "title"), [(name, _title(path)) for name, path in found.items()])
        say(f"swath docs PAGE prints one; they are in {folder()}")
        return 0
    asked = args.page.removesuffix(".md").removeprefix("docs/")
    named = {name: path for name, path in found.items() if asked in (name, path.stem)}
    if asked in named:
        named = {asked: named[asked]}
    if len(named) != 1:
        near = near_miss(asked, {*found, *(path.stem for path in found.values())})
        which = f"one of {', '.join(named)}" if named else f"a page that swath docs lists{near}"
        raise InputError("PAGE", args.page, f"expected {which}")
    print(*(path.read_text(encoding="utf-8") for path in named.values()), end="")
    return 0


def folder(name: str = "docs") -> Path:
    """A folder, that with the pages: in the package, or beside `src` where it is run from its sources."""
    package = Path(__file__).parents[1]
    installed = package / name
    return installed if os.path.isdir(installed) else package.parents[1] / name


def pages() -> dict[str, Path]:
    """The pages by their path in the folder, without `.md`."""
    found = sorted(folder().rglob("*.md"), key=lambda path: (len(path.relative_to(folder()).parts), path))
    names = {path.relative_to(folder()): path for path in found}
    return {
        name.with_suffix("").as_posix(): path
        for name, path in names.items()
        if name.parts[0] not in NOT_PAGES
    }


def _title(path: Path) -> str:
    with path.open(encoding="utf-8") as lines:
        return next((line.lstrip("# ").strip() for line in lines if line.startswith("# ")), path.stem)


_DESCRIPTION = """List the pages of the documentation of this version, with their titles; or print one
(Markdown). Works offline."""
