"""CPU time that tests take, kept in durations.json, against what each folder may take in `make test`.

    python -m tests.durations check         # of `make check`: every test is known, no folder over its budget
    python -m tests.durations keep FILE...  # what `pytest --write-durations FILE` wrote, of whole files

A second is one of a core of the machine that wrote it, with what a test starts. Tests marked `draws` are of
`make test-all` alone.
"""

import argparse
import ast
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
KEPT = Path(__file__).with_name("durations.json")
DRAWS = "draws"
Durations = dict[str, dict[str, float]]  # by file and test


def read() -> dict[str, Any]:
    """`budgets`: folder -> CPU-s; `test` and `draws`: file -> test -> CPU-s."""
    found: dict[str, Any] = json.loads(KEPT.read_text(encoding="utf-8"))
    return found


def write(kept: dict[str, Any]) -> None:
    """A line a file."""
    parts = []
    for name, part in kept.items():
        lines = (f"{json.dumps(file)}: {json.dumps(part[file])}" for file in sorted(part))
        parts.append(f"{json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n}")
    KEPT.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


def written() -> dict[str, set[str]]:
    """Tests of each file by its text."""
    found = {}
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        names = {
            n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) and n.name.startswith("test_")
        }
        if names:
            found[file.relative_to(ROOT).as_posix()] = names
    return found


def folder_of(file: str) -> str:
    """The folder below tests that a file is in, else `tests`."""
    return "/".join(file.split("/")[:2]) if file.count("/") > 1 else "tests"


def faults(kept: dict[str, Any], now: dict[str, set[str]]) -> Iterator[str]:
    """Tests that are not known, or are no more, and folders over their budget."""
    known = {
        file: {*kept["test"].get(file, ()), *kept[DRAWS].get(file, ())}
        for file in {**kept["test"], **kept[DRAWS]}
    }
    for file in sorted({*known, *now}):
        new, gone = (
            sorted(one)
            for one in (
                now.get(file, set()) - known.get(file, set()),
                known.get(file, set()) - now.get(file, set()),
            )
        )
        yield from (f"{file}::{name}: how long it takes is not known" for name in new)
        yield from (f"{file}::{name}: is no more" for name in gone)
    spent = Counter[str]()
    for file, tests in kept["test"].items():
        spent[folder_of(file)] += sum(tests.values())
    for folder, seconds in sorted(spent.items()):
        if (most := kept["budgets"].get(folder, 0.0)) < seconds:
            yield f"{folder}: {seconds:.0f} CPU-s in `make test`, {most:g} are its budget"


def keep(files: list[Path]) -> None:
    """Put what was measured of files in the place of what was known; `test` and `draws` each for itself."""
    kept = read()
    for path in files:
        measured = json.loads(path.read_text(encoding="utf-8"))
        for part in ("test", DRAWS):
            kept[part] |= measured[part]
    now = written()
    for part in ("test", DRAWS):
        known = {
            f: {n: s for n, s in tests.items() if n in now.get(f, ())} for f, tests in kept[part].items()
        }
        kept[part] = {file: tests for file, tests in known.items() if tests}
    write(kept)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("check", "keep"))
    parser.add_argument("files", type=Path, nargs="*")
    args = parser.parse_args()
    if args.what == "keep":
        keep(args.files)
        return 0
    found = list(faults(read(), written()))
    if found:
        print(
            *found,
            "pytest FILES --write-durations new.json; python -m tests.durations keep new.json",
            sep="\n",
        )
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
