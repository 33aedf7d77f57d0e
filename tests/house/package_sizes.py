"""Lines of code by package: `python -m tests.house.package_sizes [COMMIT] [--write]`.

Counted are lines of Python, C++, JavaScript, CSS and templates that are not blank, not a docstring and not a
comment of their own. A package is a folder below `src/swath`, and below its `control`, `link`, `machine`,
`sensing` and `tools`; files beside packages count for the folder that they are in.
"""

import argparse
import ast
import re
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_name("package_sizes.csv")
FOLDERS = ("src/swath", "examples")
SPLIT = ("control", "link", "machine", "sensing", "tools")
MARKS = {  # suffix -> (begin of a comment of one line or None, of many lines)
    ".cpp": ("//", r"/\*.*?\*/"),
    ".h": ("//", r"/\*.*?\*/"),
    ".js": ("//", r"/\*.*?\*/"),
    ".css": (None, r"/\*.*?\*/"),
    ".j2": (None, r"\{#.*?#\}|<!--.*?-->"),
    ".html": (None, r"<!--.*?-->"),
}

Files = Iterator[tuple[PurePosixPath, Callable[[], str]]]


def lines_of(text: str, suffix: str) -> int:
    """Lines of code of a file's text; 0 for files of other kinds."""
    lines = text.splitlines()
    if suffix == ".py":
        skipped = _docstrings(ast.parse(text))
        numbered = ((number, line.strip()) for number, line in enumerate(lines, 1))
        return sum(bool(line) and line[0] != "#" and number not in skipped for number, line in numbered)
    if suffix not in MARKS:
        return 0
    one, many = MARKS[suffix]
    # A comment before or behind code is on a line of code: only lines that hold nothing else go.
    whole = re.compile(rf"^[ \t]*(?:{many})[ \t]*$", re.MULTILINE | re.DOTALL)
    lines = [line.strip() for line in whole.sub("", text).splitlines()]
    return sum(bool(line) and not (one and line.startswith(one)) for line in lines)


def _docstrings(tree: ast.Module) -> set[int]:
    """Numbers of the lines that hold them, and other strings that stand alone."""
    found = (node for node in ast.walk(tree) if isinstance(node, ast.Expr))
    texts = (n for n in found if isinstance(n.value, ast.Constant) and isinstance(n.value.value, str))
    return {number for n in texts for number in range(n.lineno, (n.end_lineno or n.lineno) + 1)}


def package_of(path: PurePosixPath) -> str:
    """The package that a file, below the root, counts for."""
    if path.parts[0] == "examples":
        return "examples"
    folders = path.parts[2:-1]
    return "/".join(folders[: 2 if folders[:1] and folders[0] in SPLIT else 1]) or "swath"


def sizes(commit: str | None = None) -> dict[str, int]:
    """Lines by package, of the files that are here, or of a commit."""
    found: Counter[str] = Counter()
    for path, read in _of_commit(commit) if commit else _here():
        if path.suffix in {".py", *MARKS}:
            found[package_of(path)] += lines_of(read(), path.suffix)
    return {package: lines for package, lines in sorted(found.items()) if lines}


def _here() -> Files:
    for folder in FOLDERS:
        for file in (ROOT / folder).rglob("*"):
            if file.is_file():
                yield PurePosixPath(file.relative_to(ROOT)), partial(file.read_text, encoding="utf-8")


def _of_commit(commit: str) -> Files:
    for path in _git("ls-tree", "-r", "--name-only", commit, "--", *FOLDERS).splitlines():
        yield PurePosixPath(path), partial(_git, "show", f"{commit}:{path}")


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def reviewed() -> dict[str, int]:
    """Lines by package as they were reviewed last."""
    rows = (line.split(",") for line in TABLE.read_text(encoding="utf-8").splitlines()[1:])
    return {package: int(lines) for package, lines in rows}


def main() -> None:
    """Print the table; with `--write` it becomes the reviewed one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commit", nargs="?")
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    found = sizes(args.commit)
    if args.write:
        rows = [f"{package},{lines}\n" for package, lines in found.items()]
        TABLE.write_text("package,lines\n" + "".join(rows), encoding="utf-8")
    for package, lines in [*found.items(), ("all", sum(found.values()))]:
        print(f"{package:28} {lines:7,}")


if __name__ == "__main__":
    main()
