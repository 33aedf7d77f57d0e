"""Data cards: YAML files of numbers with their source.

    divergence: {value: 4.7, unit: mrad, tag: S, source: "maker's manual 8013796"}

tag: S seen in the source, M from memory, D derived, E estimate; a trailing + or - says how sure.
"""

import difflib
import math
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from swath.core.errors import InputError

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
    """A read card; numbers are taken by dotted key and checked."""

    def __init__(self, path: Path) -> None:
        import yaml

        self.path = path
        try:
            data = yaml.safe_load(path.read_text(encoding="utf-8"))
        except (yaml.YAMLError, UnicodeDecodeError, OSError) as error:
            raise InputError(
                str(path), None, f"expected a YAML card, {str(error).splitlines()[0]}"
            ) from error
        if not isinstance(data, dict):
            raise InputError(str(path), None, "expected a mapping of keys")
        self.data: dict[str, Any] = data

    def entry(self, key: str) -> Any:
        """Raw entry of a dotted key. InputError when it is missing."""
        node, rest = self.data, key
        while rest:
            names = node if isinstance(node, Mapping) else {}
            fits = [n for n in map(str, names) if rest == n or rest.startswith(f"{n}.")]
            if not fits:
                raise InputError(key, None, "missing", file=self.path)
            part = max(fits, key=len)  # a name may have dots itself
            node, rest = names[part], rest[len(part) + 1 :]
        return node

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
            raise InputError(key, entry, "expected {value, unit, tag, source}", file=self.path)
        if str(entry.get("tag")) not in TAGS or not entry.get("source"):
            raise InputError(key, entry, "every number needs a tag and a source", file=self.path)
        return entry["value"]

    def number(self, key: str, *, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number within [low, high], in the card's unit."""
        value = self.value(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(key, value, "expected a finite number", file=self.path)
        if not low <= value <= high:
            raise InputError(key, value, f"expected {low:g} to {high:g}", file=self.path)
        return float(value)

    def numbers(self, key: str) -> list[Any]:
        """A list of numbers, or of lists of numbers."""
        value = self.value(key)
        if not isinstance(value, list):
            raise InputError(key, value, "expected a list of numbers", file=self.path)
        return value

    def text(self, key: str) -> str:
        """A plain string entry."""
        value = self.entry(key)
        if not isinstance(value, str):
            raise InputError(key, value, "expected text", file=self.path)
        return value
