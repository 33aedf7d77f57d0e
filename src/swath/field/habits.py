"""Habits of crops: the files of `field/plants` that define `HABIT`, and files of the user."""

import importlib
import pkgutil
from typing import Any

from swath.core.errors import InputError
from swath.core.foreign_code import load_python
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
        try:
            module: Any = load_python("habit", file)
        except InputError as error:
            raise sheet.error("habit", error.expected) from error
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
