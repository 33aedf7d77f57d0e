"""Hashes of the files that plain data names: sheets, code, logs, terrain, fields."""

import hashlib
import os
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from swath.core.files.read_file import open_to_read


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
    return [name, *(f"{p.name} {file_hash(p)}" for p in _files(path))]


def hashes(node: Any) -> dict[str, str]:
    """SHA-256 of each file or folder that the data names, by its name; of Python with what lies beside it."""
    found: dict[str, str] = {}
    for path, value in hashes_by_path(node).items():
        name = Path(path).name
        found[name if found.get(name, value) == value else path] = value
    return dict(sorted(found.items()))


def hashes_by_path(node: Any) -> dict[str, str]:
    """Hashes by the path of each file."""
    return {path.as_posix(): _hash_of(path) for path in dict.fromkeys(_all_named(node))}


def changed_since(made_of: Mapping[str, str]) -> str:
    """Names of the files and folders that are not as `hashes_by_path` found them then; "" where all are."""
    is_as_it_was = ((path, _named(path) is not None and _hash_of(Path(path)) == value)
                    for path, value in made_of.items())  # fmt: skip
    return ", ".join(sorted({Path(path).name for path, same in is_as_it_was if not same}))


def file_hash(path: Path) -> str:
    """SHA-256 of a file."""
    of = path.stat()
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
        there = Path(file).name not in ("", "..") and os.path.exists(Path(file))
    except (OSError, ValueError):
        there = False
    return Path(file) if there else None


def _files(path: Path) -> list[Path]:
    if path.suffix == ".py":  # a user's level may import what lies beside it
        return sorted(path.parent.glob("*.py"))
    return [path] if os.path.isfile(path) else sorted(p for p in path.rglob("*") if os.path.isfile(p))
