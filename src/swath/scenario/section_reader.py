"""What the reading of every section of a scenario needs: errors, levels, parameters, absolute paths."""

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, SwathError, absence_of
from swath.core.foreign_code import NamesCode, is_allowed, is_left, refusal
from swath.core.registry import Level
from swath.documents.data_sheets import find_sheet
from swath.documents.validation import known_keys, unknown_key, validate
from swath.documents.yaml_document import Document, KeyPath, read_document
from swath.scenario.resolved import UnreadParams
from swath.scenario.slots import Catalogue

SHEETS = {"machine": "machines", "sensor": "sensors", "crop": "crops"}
NAME = re.compile(r"^[A-Za-z_][A-Za-z0-9_-]{0,40}$")  # of a machine or an edge


MOST_ERRORS = 100  # that are reported of one document


class ScenarioError(InputError):
    """The first thing wrong in a scenario; `others` are the rest, in the order found."""

    def __init__(self, errors: list[InputError]) -> None:
        first = errors[0]
        super().__init__(first.key, first.value, first.expected, file=first.file, line=first.line)
        self.others = tuple(errors[1:])


class SectionReader:
    """Checks parts of one document against a catalogue. errors: all found so far, in order."""

    def __init__(self, document: Document, catalogue: Catalogue) -> None:
        self.document, self.catalogue = document, catalogue
        self.folder = document.file.resolve().parent if document.file else Path.cwd()
        self.errors: list[InputError] = []

    def check(self, kind: Any, data: Any, path: KeyPath) -> Any:
        """The validated object; None when there were errors, which are noted."""
        value, found = validate(kind, data, path, self.document)
        for error in found:
            self.take(error)
        return value

    def take(self, error: InputError) -> None:
        """Note an error. ScenarioError at MOST_ERRORS: what follows is hardly meant as a scenario."""
        self.errors.append(error)
        if len(self.errors) == MOST_ERRORS:
            raise ScenarioError(self.errors)

    def note(self, path: KeyPath, value: Any, expected: str) -> None:
        """Note an error."""
        self.take(self.document.error(path, value, expected))

    def mapping(self, data: Any, path: KeyPath) -> dict[str, Any]:
        """The mapping at a path; an empty one, and an error noted, when it is something else."""
        if isinstance(data, dict):
            return data
        self.note(path, "(nothing)" if data is None else data, "expected a mapping of keys")
        return {}

    def unknown(self, data: Mapping[str, Any], path: KeyPath, known: tuple[str, ...]) -> None:
        """Note every key that is not known."""
        for key in data:
            if key not in known:
                self.note((*path, key), None, unknown_key(key, known))

    def base(self, path: KeyPath) -> Path:
        """Where a relative path starts: the scenario's folder, or for a flag the working directory."""
        place = self.document.place(path)
        return Path.cwd() if place is not None and place.line is None else self.folder

    def level(self, kind: str, data: Any, path: KeyPath, default: str) -> tuple[dict[str, Any], Level | None]:
        """The entry as a mapping with its level filled in, and the level, None when it cannot be had."""
        if isinstance(data, str):
            data, where = {"level": data}, path
        else:
            where = (*path, "level")
        entry = {"level": default} | self.mapping(data, path)
        level = entry["level"]
        if not isinstance(level, str):
            self.note(where, "(nothing)" if level is None else level, "expected a level's name")
            return entry, None
        try:
            found = self.catalogue.registry.get(kind, level, base=self.base(where))
        except InputError as error:
            self.note(where, level, error.expected)
        except (OSError, ValueError):
            self.note(where, level, "expected a level's name, or file.py:Class")
        except SwathError as error:
            self.note(where, level, str(error))
        else:
            if callable(found.component):
                entry["level"] = self.absolute_level(level, self.base(where))
                return self._with_paths(entry, path), found
            self.note(where, level, "expected a class")
        return entry, None

    def absolute_level(self, level: str, base: Path) -> str:
        """`file.py:Class` with the whole path of the file; a level's name as it is."""
        file, colon, name = level.rpartition(":")
        return f"{(base / file).resolve()}:{name}" if colon and ".py:" in level else level

    def params(self, found: Level, data: dict[str, Any], path: KeyPath, also: tuple[str, ...] = ()) -> Any:
        """Validated parameters. Unknown keys are noted here: they may be meant for the slot itself."""
        if found.is_unread:
            return UnreadParams(data)
        known = known_keys(found.params)
        for key in data:
            if key not in known:
                self.note((*path, key), None, unknown_key(key, [*known, "level", *also]))
        own = {k: v for k, v in data.items() if k in known}
        params = None if found.params is None else self.check(found.params, own, path)
        if isinstance(params, NamesCode):
            for reference in params.foreign_code:
                if not is_allowed(reference, self.folder) and not is_left(reference, self.folder):
                    self.note(path, reference, refusal())
        return params

    def _with_paths(self, data: Any, path: KeyPath) -> Any:
        """The data with the paths in it made absolute; notes what is not there."""
        if isinstance(data, list):
            return [self._with_paths(item, (*path, i)) for i, item in enumerate(data)]
        if not isinstance(data, dict):
            return data
        return {key: self.with_path(key, value, (*path, key)) for key, value in data.items()}

    def with_path(self, key: str, value: Any, path: KeyPath) -> Any:
        """The value of a key with the paths in it made absolute; notes what is not there."""
        if not isinstance(value, str):
            return self._with_paths(value, path)
        if key in SHEETS:
            return self._sheet(SHEETS[key], value, path)
        is_table = key == "table" and value.endswith(".npz")
        if is_table or key in ("file", "folder") or key.endswith(("_file", "_folder")):
            return self._existing(key, value, path)
        return value

    def _sheet(self, kind: str, value: str, path: KeyPath) -> str:
        """A bundled data sheet's name as it is, the user's own file as an absolute path."""
        try:
            file = find_sheet(kind, value, self.base(path))
        except InputError as error:
            self.note(path, value, error.expected)
            return value
        except (OSError, ValueError):
            self.note(path, value, "expected a name, or a YAML file")
            return value
        if not value.endswith((".yaml", ".yml")):
            return value
        if kind == "crops":
            self._check_habit(file, path)
        return str(file.resolve())

    def _check_habit(self, sheet: Path, path: KeyPath) -> None:
        """Note a habit of a crop that may not run; the rest of the sheet is read when the crop is made."""
        data = None
        with suppress(InputError):
            data = read_document(sheet).data
        habit = data.get("habit") if isinstance(data, dict) else None
        habit = habit.get("value") if isinstance(habit, dict) else habit
        if not isinstance(habit, str) or not habit.endswith(".py"):
            return
        if not is_allowed(habit, sheet.parent) and not is_left(habit, sheet.parent):
            self.note(path, habit, refusal())

    def _existing(self, key: str, value: str, path: KeyPath) -> str:
        wants_folder = key.endswith("folder")
        try:
            target = (self.base(path) / value).resolve()
            is_there = os.path.isdir(target) if wants_folder else os.path.exists(target)
        except (OSError, ValueError, RuntimeError):
            is_there = False
        if is_there:
            return str(target)
        none = f"there is no such {'folder' if wants_folder else 'file'}"
        self.note(path, value, absence_of(self.base(path) / value, none))
        return value
