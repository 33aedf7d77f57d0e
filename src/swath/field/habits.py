"""Habits of crops: the files of `field/plants` that define `HABIT`, and files of the user."""

import importlib
import importlib.util
import pkgutil
import sys
import zlib
from pathlib import Path
from typing import Any

from swath.core.errors import SwathError
from swath.core.foreign_code import is_allowed, refusal
from swath.core.registry import USER_MODULE
from swath.documents.data_sheets import Sheet
from swath.documents.hints import near_miss
from swath.field.crop import Habit

PACKAGE = "swath.field.plants"


def habit_names() -> list[str]:
    """Names of the built-in habits: the files of `field/plants` that define `HABIT`."""
    files = [f"{PACKAGE}.{i.name}" for i in pkgutil.iter_modules(importlib.import_module(PACKAGE).__path__)]
    return [f.rpartition(".")[2] for f in files if "HABIT" in vars(importlib.import_module(f))]


def find_habit(sheet: Sheet) -> Habit:
    """The habit that a crop's sheet names: a built-in one, or a `file.py` beside the sheet with `HABIT`.

    Raises InputError when there is none of this name.
    """
    name = sheet.value("habit") or "cereal"
    if isinstance(name, str) and name.endswith(".py"):
        file = sheet.path.parent / name
        if not file.is_file():
            raise sheet.error("habit", f"expected a Python file, there is no {file}")
        if not is_allowed(file):
            raise sheet.error("habit", refusal())
        module = _load(file)
    elif name in habit_names():
        module = importlib.import_module(f"{PACKAGE}.{name}")
    else:
        names = habit_names()
        expected = f"expected one of {', '.join(names)}, or a file.py that defines HABIT"
        raise sheet.error("habit", expected + near_miss(name, names))
    habit = vars(module).get("HABIT")
    if not isinstance(habit, Habit):
        raise sheet.error("habit", f"expected a file that defines HABIT, a {Habit.__name__}")
    return habit


def _load(file: Path) -> Any:
    name = f"{USER_MODULE}{file.stem}_{zlib.crc32(str(file.resolve()).encode()):08x}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and annotations look their module up there
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise SwathError(f"{file}: could not be loaded: {type(error).__name__}: {error}") from error
    return module
