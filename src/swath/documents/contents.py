"""Hashes of the files that plain data names: sheets, code, logs, terrain, fields.

A Python file stands for all that it consists of (`part_of`), and for nothing else that lies beside it.
"""

import ast
import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from swath.core.files.read_file import open_to_read
from swath.core.files.whole_file import copy_whole
from swath.core.foreign_code import present_gate, source_of, through


def with_contents(node: Any) -> Any:
    """The data with hashes of the contents instead of the path of a file or folder (`file.py:Class` too)."""
    if isinstance(node, Mapping):
        return {str(key): with_contents(value) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return [with_contents(value) for value in node]
    path = _named(node)
    if path is None:
        return str(node) if isinstance(node, Path) else node
    name = str(node).partition(":")[2]
    return [name, *(f"{p.name} {file_hash(p)}" for p in _with_parts(path))]


def hashes(node: Any) -> dict[str, str]:
    """SHA-256 of each file or folder that the data names, by its name; of Python with what it imports."""
    found: dict[str, str] = {}
    for path, value in hashes_by_path(node).items():
        name = Path(path).name
        found[name if found.get(name, value) == value else path] = value
    return dict(sorted(found.items()))


def hashes_by_path(node: Any) -> dict[str, str]:
    """Hashes by the path of each file."""
    every = (part for path in _all_named(node)
             for part in (_with_parts(path) if path.suffix == ".py" else [path]))  # fmt: skip
    return {path.as_posix(): _hash_of(path) for path in dict.fromkeys(every)}


def changed_since(made_of: Mapping[str, str]) -> str:
    """Names of the files and folders that are not as `hashes_by_path` found them then, each with `changed` or
    `gone`; "" where all are. Of files of one name the paths.
    """
    now = ((path, _hash_of(path) if os.path.exists(source_of(path)) else "") for path in map(Path, made_of))
    others = [(path, "changed" if is_now else "gone") for path, is_now in now
              if is_now != made_of[path.as_posix()]]  # fmt: skip
    count = Counter(Path(path).name for path in made_of)
    said = sorted((str(p) if count[p.name] > 1 else p.name, what) for p, what in others)
    return ", ".join(f"{name} ({what})" for name, what in said)


def python_in(node: Any) -> set[Path]:
    """The Python files that the data names, and those that they import."""
    return {file for path in _all_named(node) if path.suffix == ".py" for file in part_of(path)[0]}


def keep_python(node: Any, folder: Path) -> None:
    """Copy the Python files of `python_in` into a folder, each under its hash."""
    for path in python_in(node):
        if not os.path.isfile(copy := folder / file_hash(path)):
            copy_whole(source_of(path), copy, "file", "a Python file")


def kept_python(made_of: Mapping[str, str], folder: Path) -> Any:
    """A block in which files with these hashes are read from their copies, where the folder holds such.

    A copy that is another than the file now may come from anybody: it runs only where all code may.
    """
    gate = present_gate()
    every = ((Path(path).resolve(), folder.resolve() / value, value) for path, value in made_of.items())
    copies = {path: copy for path, copy, value in every
              if os.path.isfile(copy) and file_hash(copy) == value
              and (gate.files is None or (os.path.isfile(path) and file_hash(path) == value))}  # fmt: skip
    return through(replace(gate, copies=copies))


def part_of(path: Path) -> tuple[list[Path], list[Path]]:
    """What a Python file consists of: with it the files that are imported, anywhere in it or in these, from
    its folder; and those that its texts name, as data or as a module.
    """
    folder, imported, named, waiting = path.parent, dict[Path, None](), dict[Path, None](), [path]
    while waiting:
        if (file := waiting.pop()) in imported:
            continue
        imported[file] = None
        of = os.stat(source_of(file))
        names, texts = _said_in(source_of(file), of.st_mtime_ns, of.st_size)
        for level, name in names:
            waiting += _modules(file.parents[level - 1] if level else folder, name)
        places = [file.parent, *(at for text in texts if os.path.isdir(at := file.parent / text))]
        for text in texts:
            named |= dict.fromkeys(_modules(folder, text))
            named |= dict.fromkeys(at / text for at in places if os.path.isfile(at / text))
    return [path, *sorted(set(imported) - {path})], sorted(set(named) - set(imported))


LONGEST_NAME = 255  # of a text that names a file


@lru_cache(maxsize=256)
def _said_in(path: Path, _changed_ns: int, _size: int) -> tuple[tuple[tuple[int, str], ...], tuple[str, ...]]:
    """Level and name of all that a Python file imports, and its texts that may name a file."""
    names, texts = dict[tuple[int, str], None](), dict[str, None]()
    try:
        with open_to_read(path, "file", "a file") as file:
            tree = ast.parse(file.read())
    except (SyntaxError, ValueError):  # told where it is loaded
        return (), ()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= dict.fromkeys((0, one.name) for one in node.names)
        elif isinstance(node, ast.ImportFrom):
            of = node.module or ""
            names |= dict.fromkeys((node.level, f"{of}.{one.name}".strip(".")) for one in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            is_name = 0 < len(text := node.value) <= LONGEST_NAME and text.isprintable() and ".." not in text
            texts |= dict.fromkeys([text] if is_name else ())
    return tuple(names), tuple(texts)


def _modules(folder: Path, name: str) -> list[Path]:
    """The files in a folder that `import NAME` runs, as far as they are there."""
    found, at = list[Path](), folder
    for part in name.split(".") if "/" not in name else ():
        at /= part
        found += [file for file in (at.with_name(f"{part}.py"), at / "__init__.py")
                  if part and os.path.isfile(source_of(file))]  # fmt: skip
    return found


def file_hash(path: Path) -> str:
    """SHA-256 of a file."""
    of = os.stat(path := source_of(path))
    return _read_hash(path, of.st_mtime_ns, of.st_size)


@lru_cache(maxsize=256)
def _read_hash(path: Path, _changed_ns: int, _size: int) -> str:
    """Files are read once, also for many runs."""
    with open_to_read(path, "file", "a file") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _hash_of(path: Path) -> str:
    files = _files(path)
    if files == [path]:
        return file_hash(path)
    return hashlib.sha256("\n".join(f"{p.name} {file_hash(p)}" for p in files).encode()).hexdigest()


def _all_named(node: Any) -> Iterator[Path]:
    if isinstance(node, Mapping | list | tuple):
        for value in node.values() if isinstance(node, Mapping) else node:
            yield from _all_named(value)
    elif (path := _named(node)) is not None:
        yield path


def _named(node: Any) -> Path | None:
    """The file or folder that a text names, None where it names none."""
    if not isinstance(node, str | Path):
        return None
    file = str(node).partition(":")[0]
    if "/" not in file and "." not in file:
        return None
    try:
        there = Path(file).name not in ("", "..") and os.path.exists(source_of(Path(file)))
    except (OSError, ValueError):
        there = False
    return Path(file) if there else None


def _files(path: Path) -> list[Path]:
    if os.path.isfile(source_of(path)):
        return [path]
    return sorted(p for p in path.rglob("*") if os.path.isfile(p))


def _with_parts(path: Path) -> list[Path]:
    """A file with the others that a part consists of; a folder with its files."""
    return [file for some in part_of(path) for file in some] if path.suffix == ".py" else _files(path)
