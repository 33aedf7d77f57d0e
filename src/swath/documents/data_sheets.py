"""Data cards: YAML files of numbers with their source.

    divergence: {value: 4.7, unit: mrad, tag: S, source: "maker's manual 8013796"}

tag: S seen in the source, M from memory, D derived, E estimate; a trailing + or - says how sure.
"""

import difflib
import math
import re
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from swath.core.errors import InputError

FORM = '{value: 4.7, unit: mrad, tag: S, source: "the maker\'s manual"}'
SUFFIXES = {"deg", "mrad", "mm", "nm", "ns", "hz", "kg"}  # a unit that contradicts its key is refused
TAGS = {"S", "M", "M+", "M-", "D", "E", "S/D", "M/E", "D/E"}


def viewer_layout() -> Path:
    """The layout for Foxglove that shows a run.mcap of a machine called `combine`."""
    return Path(str(files("swath.data") / "foxglove" / "swath.json"))


def card_names(kind: str) -> list[str]:
    """Names of the bundled cards of a kind: `sensors`, `machines`, `crops`."""
    folder = Path(str(files("swath.data") / kind))
    return sorted(p.stem for p in folder.glob("*.yaml"))


def find_card(kind: str, name: str, base: Path | None = None) -> Path:
    """Path of a bundled card by name, or of the user's own file (relative to `base`)."""
    if name.endswith((".yaml", ".yml")):
        path = Path(name) if Path(name).is_absolute() else (base or Path.cwd()) / name
    else:
        path = Path(str(files("swath.data") / kind / f"{name}.yaml"))
    if path.is_file():
        return path
    names = card_names(kind)
    near = difflib.get_close_matches(name, names, n=1)
    hint = f", did you mean {near[0]!r}?" if near else ""
    raise InputError(kind, name, f"expected a file or one of {', '.join(names)}{hint}")


class Card:
    """A read card; numbers are taken by dotted key and checked. It remembers which keys were asked for."""

    def __init__(self, path: Path) -> None:
        import yaml

        self.path = path
        try:
            text = path.read_text(encoding="utf-8")
            data, node = yaml.safe_load(text), yaml.compose(text, Loader=yaml.SafeLoader)
        except (yaml.YAMLError, UnicodeDecodeError, OSError) as error:
            mark = getattr(error, "problem_mark", None)
            expected = f"expected a YAML card, {str(error).splitlines()[0]}"
            raise InputError(
                "card", None, expected, file=path, line=None if mark is None else mark.line + 1
            ) from error
        if not isinstance(data, dict):
            raise InputError(str(path), None, "expected a mapping of keys")
        self.data: dict[str, Any] = data
        self._lines = dict(_lines(node, ""))
        self._asked: set[str] = set()

    def entry(self, key: str) -> Any:
        """Raw entry of a dotted key. InputError when it is missing."""
        self._asked.add(key)
        node, rest = self.data, key
        while rest:
            names = node if isinstance(node, Mapping) else {}
            fits = [n for n in map(str, names) if rest == n or rest.startswith(f"{n}.")]
            if not fits:
                near = difflib.get_close_matches(rest, map(str, names), n=1, cutoff=0.7)
                hint = f", there is {near[0]!r}" if near else ""
                above = key[: len(key) - len(rest) - 1]
                raise self.error(key, None, f"missing{hint}", at=f"{above}.{near[0]}" if near else above)
            part = max(fits, key=len)  # a name may have dots itself
            node, rest = names[part], rest[len(part) + 1 :]
        return node

    def error(self, key: str, value: Any, expected: str, *, at: str | None = None) -> InputError:
        """The error about a key, with file and line. at: the key that is there instead."""
        line = self._lines.get(key if at is None else at.lstrip("."))
        return InputError(key, value, expected, file=self.path, line=line)

    def refuse_unknown(self, *free: str) -> None:
        """Raise InputError for the first key that nobody has asked for yet. free: keys that are only read by
        people.
        """
        for key in self._unread(self.data, ""):
            if key.split(".")[0] not in free:
                near = difflib.get_close_matches(key, self._asked, n=1, cutoff=0.8)
                hint = f", did you mean {near[0]!r}?" if near else ""
                raise self.error(key, None, f"unknown key{hint}")

    def _unread(self, node: Mapping[Any, Any], above: str) -> Iterator[str]:
        for name, value in node.items():
            key = f"{above}{name}"
            if key in self._asked:
                continue
            if isinstance(value, Mapping) and "value" not in value:
                yield from self._unread(value, f"{key}.")
            else:
                yield key

    def has(self, key: str) -> bool:
        """True when the key is there."""
        try:
            self.entry(key)
        except InputError:
            return False
        return True

    def value(self, key: str) -> Any:
        """The value of a cited entry {value, tag, source}, whatever its type."""
        entry = self.entry(key)
        if not isinstance(entry, Mapping) or "value" not in entry:
            raise self.error(key, entry, f"expected {FORM}")
        if str(entry.get("tag")) not in TAGS or not entry.get("source"):
            tags = "S seen in the source, M from memory, D derived, E estimate"
            raise self.error(key, entry, f"every number needs a tag and a source: {FORM} (tags: {tags})")
        unit, wanted = str(entry.get("unit") or ""), key.rpartition("_")[2]
        if unit and wanted in SUFFIXES and wanted not in re.findall(r"[a-z]+", unit.lower()):
            raise self.error(f"{key}.unit", unit, f"expected {wanted}, as the key says")
        return entry["value"]

    def number(self, key: str, *, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number within [low, high], in the card's unit."""
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.error(key, value, "expected a finite number")
        if not low <= value <= high:
            raise self.error(key, value, f"expected {low:g} to {high:g}")
        return float(value)

    def numbers(self, key: str) -> list[Any]:
        """A list of numbers, or of lists of numbers."""
        value = self.value(key)
        if not isinstance(value, list):
            raise self.error(key, value, "expected a list of numbers")
        return value

    def text(self, key: str) -> str:
        """A plain string entry."""
        value = self.entry(key)
        if not isinstance(value, str):
            raise self.error(key, value, "expected text")
        return value


def _lines(node: Any, above: str) -> Iterator[tuple[str, int]]:
    """(dotted key, line from 1) of every key of a YAML mapping."""
    import yaml

    for name, value in node.value if isinstance(node, yaml.MappingNode) else ():
        yield f"{above}{name.value}", name.start_mark.line + 1
        yield from _lines(value, f"{above}{name.value}.")
