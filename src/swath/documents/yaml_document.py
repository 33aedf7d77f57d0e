"""YAML in which every key keeps its place, so that an error can say file and line.

Read as YAML 1.2 core (as editors do): `1e3` is a number, `yes`, `on` and `2018-07-01` are text. Anchors,
aliases and `<<` are understood; what is refused: duplicate keys, keys that are not text, tags, numbers that
are not finite, text that is not Unicode, and files too large or too deep to be meant.
"""

import io
import math
import re
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.representer import SafeRepresenter

from swath.core.errors import InputError, reason_of
from swath.core.files.read_file import open_to_read

KeyPath = tuple[str | int, ...]
MAX_BYTES = 1 << 20
MAX_DEPTH = 24
MAX_VALUES = 50_000
KEPT_BYTES = 1 << 16  # texts up to here are parsed once in a process
NO_YAML = {
    ".html": "an HTML page",
    ".htm": "an HTML page",
    ".py": "a Python file",
    ".md": "a page of text",
    ".csv": "a table",
    ".mcap": "a recording",
    ".parquet": "a table",
    ".tif": "a raster",
    ".png": "a picture",
    ".zip": "an archive",
}  # by suffix: files that are often given in the place of a YAML file
_TOO_LARGE = f"expected YAML of at most {MAX_BYTES >> 20} MiB"
_INT = re.compile(r"^[-+]?[0-9]+$|^0x[0-9a-fA-F]+$|^0o[0-7]+$")
_FLOAT = re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$")
_SPECIAL = re.compile(r"^[-+]?\.(?:inf|Inf|INF)$|^\.(?:nan|NaN|NAN)$")
_YAML = "tag:yaml.org,2002:"
_MERGE = _YAML + "merge"
_PLAIN_TAGS = {_YAML + t for t in ("str", "int", "float", "bool", "null", "timestamp", "merge", "value")}
_WORDS: dict[str, bool | None] = {"": None, "~": None, "null": None, "Null": None, "NULL": None}
_WORDS |= {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}


@dataclass(frozen=True)
class Place:
    """Where a value was written: a file and its line, or a command-line flag."""

    file: str
    line: int | None = None


@dataclass
class Document:
    """Plain data and the place of every key path in it."""

    data: Any
    file: Path | None = None
    places: dict[KeyPath, Place] = field(default_factory=dict)
    kind: str = "scenario"  # what an error about the whole of it calls it

    def place(self, path: KeyPath) -> Place | None:
        """Place of a key path, or of its nearest parent that was written."""
        for end in range(len(path), -1, -1):
            if path[:end] in self.places:
                return self.places[path[:end]]
        return None

    def line(self, path: KeyPath) -> int | None:
        """Line of a key path, or of its nearest parent that was written."""
        place = self.place(path)
        return None if place is None else place.line

    def value(self, path: KeyPath) -> Any:
        """What was written at a key path; None where there is nothing."""
        data = self.data
        for part in path:
            if isinstance(data, dict):
                data = data.get(part)
            elif isinstance(data, list) and isinstance(part, int) and part < len(data):
                data = data[part]
            else:
                return None
        return data

    def paths(self, under: KeyPath = ()) -> list[KeyPath]:
        """Every key path in the data below one, in order."""
        data = self.value(under)
        items: Any = (
            data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
        )
        return [p for key, _ in items for p in ((*under, key), *self.paths((*under, key)))]

    def error(self, path: KeyPath, value: Any, expected: str) -> InputError:
        """The error about a key path, with its place."""
        place = self.place(path)
        return InputError(
            dotted(path) if path else self.kind,
            value,
            expected,
            file=None if place is None else place.file,
            line=self.line(path),
        )


def dotted(path: KeyPath) -> str:
    """`("field", "obstacles", 0)` as `field.obstacles.0`; the whole document as `scenario`."""
    return ".".join(str(p) for p in path) or "scenario"


def key_path(text: str) -> KeyPath:
    """`field.obstacles.0` as `("field", "obstacles", 0)`."""
    parts = text.strip().split(".")
    return tuple(int(p) if p.isascii() and p.isdecimal() and len(p) < 7 else p for p in parts)


def read_mapping(file: Path, kind: str) -> Document:
    """Parse a YAML file that is a mapping of keys. kind: what errors about the whole of it call it."""
    document = replace(read_document(file), kind=kind)
    if not isinstance(document.data, dict):
        raise document.error((), None, "expected a mapping of keys")
    return document


def read_document(file: Path) -> Document:
    """Parse a YAML file. InputError when it cannot be read or is not YAML."""
    with open_to_read(file, str(file), "a YAML file") as stream:
        if (kind := NO_YAML.get(file.suffix.lower())) is not None:
            raise InputError(str(file), None, f"expected a YAML file, this is {kind}")
        read = stream.read(MAX_BYTES + 1)
    if len(read) > MAX_BYTES:
        raise InputError(str(file), None, _TOO_LARGE)
    try:
        text = read.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(str(file), None, "expected text in UTF-8") from error
    return parse(text, str(file), Path(file))


def parse(text: str, name: str = "text", file: Path | None = None) -> Document:
    """Parse YAML text; `name` stands for the file in error messages.

    A text is parsed once in a process: whoever asks again gets a copy of what was found, theirs to change.
    """
    if len(text) > KEPT_BYTES:
        return _parsed(text, name, file)
    document = _kept(text, name, file)
    return replace(document, data=copied(document.data), places={**document.places})


def copied(data: Any) -> Any:
    """A copy of plain data, down to its texts and numbers."""
    if isinstance(data, dict):
        return {key: copied(value) for key, value in data.items()}
    return [copied(value) for value in data] if isinstance(data, list) else data


def _parsed(text: str, name: str, file: Path | None) -> Document:
    if len(text) > MAX_BYTES:
        raise InputError("YAML", None, _TOO_LARGE, file=name)
    reader = YAML(typ="safe", pure=True)
    reader.Composer = _Composer
    reader.version = (1, 2)
    reader.allow_duplicate_keys = True  # _Builder refuses them, with both lines
    try:
        node = reader.compose(io.StringIO(text))
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = " ".join(filter(None, (error.context, error.problem)))
        if "'\\t'" in problem:
            problem = "expected blanks, not a tab, before a key"
        where = f", column {mark.column + 1}" if mark else ""
        raise InputError(
            "YAML", None, f"{problem}{where}", file=name, line=mark.line + 1 if mark else None
        ) from error
    except ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(
            "YAML", None, "a character that YAML does not allow", file=name, line=line
        ) from error
    except (YAMLError, ValueError) as error:
        raise InputError("YAML", None, f"expected YAML: {reason_of(error)}", file=name) from error
    except RecursionError as error:
        raise InputError("YAML", None, f"nested deeper than {MAX_DEPTH}", file=name) from error
    document = Document(None, file, {(): Place(name, 1)})
    document.data = _Builder(document, name).build(node, ()) if node is not None else None
    return document


_kept = lru_cache(maxsize=256)(_parsed)


def parse_value(text: str, flag: str) -> Any:
    """A single value, as given to a flag; errors name the flag."""
    if _FLOAT.match(text):  # most are, and a plan of a thousand runs has many
        value = _integer(text) if _INT.match(text) else float(text)
        if value is not None and math.isfinite(value):
            return value
    try:
        return parse(text, flag).data
    except InputError as error:
        raise InputError(flag, None, error.expected) from error


class _Composer(Composer):
    """Stops at more values than a document may have, before the rest of the text is read."""

    count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self.count += 1
        if self.count > 2 * MAX_VALUES:  # keys count here, too
            raise YAMLError(f"more than {MAX_VALUES} values")
        return super().compose_node(parent, index)


class _Builder:
    """Turns nodes into plain data and notes the places."""

    def __init__(self, document: Document, name: str) -> None:
        self.document, self.name, self.count = document, name, 0

    def build(self, node: Node, path: KeyPath) -> Any:
        self.count += 1
        if len(path) > MAX_DEPTH:
            raise self._error(node, path[:4], None, f"nested deeper than {MAX_DEPTH}")
        if self.count > MAX_VALUES:
            raise self._error(node, path, None, f"more than {MAX_VALUES} values, aliases expanded")
        self.document.places.setdefault(path, Place(self.name, node.start_mark.line + 1))
        if isinstance(node, MappingNode):
            self._check_tag(node, path, _YAML + "map")
            return self._mapping(node, path)
        if isinstance(node, SequenceNode):
            self._check_tag(node, path, _YAML + "seq")
            return [self.build(item, (*path, index)) for index, item in enumerate(node.value)]
        return self._scalar(node, path)

    def _mapping(self, node: MappingNode, path: KeyPath) -> dict[str, Any]:
        merges = [v for k, v in node.value if k.tag == _MERGE]
        merged = [item for v in merges for item in (v.value if isinstance(v, SequenceNode) else [v])]
        result: dict[str, Any] = {}
        for source in reversed(merged):
            if not isinstance(source, MappingNode):
                raise self._error(source, path, None, "expected `<<` to name a mapping")
            result |= self.build(source, path)
        first: dict[str, int] = {}
        for key_node, value_node in node.value:
            if key_node.tag == _MERGE:
                continue
            key = self._key(key_node, path)
            line = key_node.start_mark.line + 1
            if key in first:
                raise self._error(key_node, (*path, key), None, f"written twice, first in line {first[key]}")
            first[key] = line
            self.document.places[(*path, key)] = Place(self.name, line)
            result[key] = self.build(value_node, (*path, key))
        return result

    def _key(self, node: Node, path: KeyPath) -> str:
        if not isinstance(node, ScalarNode) or not node.value:
            raise self._error(node, path, None, "expected a name before the colon")
        self._check_text(node, path)
        return str(node.value)

    def _scalar(self, node: Node, path: KeyPath) -> Any:
        text = str(node.value)
        self._check_text(node, path)
        if getattr(node, "style", None) is not None:
            self._check_tag(node, path, _YAML + "str")
            return text
        if node.tag not in _PLAIN_TAGS:
            raise self._error(node, path, None, f"the tag {node.tag} is not understood here")
        if text in _WORDS:
            return _WORDS[text]
        if _SPECIAL.match(text):
            raise self._error(node, path, text, "expected a finite number")
        if _INT.match(text):
            return self._finite(node, path, text, _integer(text))
        if _FLOAT.match(text):
            return self._finite(node, path, text, float(text))
        return text

    def _finite(self, node: Node, path: KeyPath, text: str, value: int | float | None) -> int | float:
        if value is None or not math.isfinite(value):
            raise self._error(node, path, text, "expected a finite number")
        return value

    def _check_tag(self, node: Node, path: KeyPath, plain: str) -> None:
        if node.tag != plain:
            raise self._error(node, path, None, f"the tag {node.tag} is not understood here")

    def _check_text(self, node: Node, path: KeyPath) -> None:
        try:
            str(node.value).encode()
        except UnicodeEncodeError as error:
            raise self._error(node, path, None, "expected text in Unicode") from error

    def _error(self, node: Node, path: KeyPath, value: Any, expected: str) -> InputError:
        return InputError(dotted(path), value, expected, file=self.name, line=node.start_mark.line + 1)


def _integer(text: str) -> int | None:
    """The number, None when it does not fit 64 bits."""
    if len(text) > 24:
        return None
    value = int(text, 0) if text[:2] in ("0x", "0o") else int(text)
    return value if abs(value) < 1 << 63 else None


class _Representer(SafeRepresenter):
    """Writes what `parse` reads: text that YAML 1.2 would take for something else is quoted."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def text(self, text: str) -> ScalarNode:
        ambiguous = text in _WORDS or any(p.match(text) for p in (_INT, _FLOAT, _SPECIAL))
        return self.represent_scalar(_YAML + "str", text, style="'" if ambiguous else None)


_Representer.add_representer(str, _Representer.text)


def dump(data: Any, *, flow: bool = False, width: int = 100) -> str:
    """YAML text of plain data, keys in the given order; `parse` gives the same data back.

    flow: on one line, `{a: 1, b: [2, 3]}`
    """
    writer = YAML(typ="safe", pure=True)
    writer.Representer = _Representer
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    writer.default_flow_style = flow
    writer.allow_unicode, writer.width = True, width
    out = io.StringIO()
    writer.dump(data, out)
    return out.getvalue()
