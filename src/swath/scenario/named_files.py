"""Files and folders that a scenario, or a change to it, names: they are read with the user's rights."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from swath.scenario.scenario import Scenario


def folder_of(scenario: Scenario) -> Path:
    """The folder that paths in a scenario start from."""
    return scenario.file.parent if scenario.file is not None else Path.cwd()


def named_files(value: Any, base: Path) -> set[Path]:
    """What among the texts of a value, however deep, is there as a file or folder, absolute.

    A single word without a dot or slash is a level, a name or a kind, even where something is called so; for
    `file.py:Class` see `code.py`.
    """
    return {path for text in _texts(value) if (path := _there(text, base)) is not None}


def files_of(scenario: Scenario) -> set[Path]:
    """Files and folders that a scenario names."""
    base = folder_of(scenario)
    machines = [machine.plain() for machine in scenario.machines.values()]
    return named_files([scenario.field.plain(), *machines], base)


def _there(text: str, base: Path) -> Path | None:
    if ".py:" in text or not any(mark in text for mark in "./\\~"):
        return None
    try:
        path = (base / Path(text).expanduser()).resolve()
        return path if path.exists() else None
    except (OSError, ValueError, RuntimeError):
        return None


def _texts(value: Any) -> Iterator[str]:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = vars(value)
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, dict):
        for part in value.values():
            yield from _texts(part)
    elif isinstance(value, list | tuple | set | frozenset):
        for part in value:
            yield from _texts(part)
