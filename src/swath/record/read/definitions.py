"""Definitions of messages that travel in a file, checked before code is made of them.

rosbags makes lines of code for each element of an array of texts or messages, and reads as many elements as
a definition or a message says. So arrays are bounded, every message within another one holds something, and
what a definition says that a message has at least is compared with its length. Then reading a message costs
no more than its bytes.
"""

import re
from collections.abc import Mapping
from typing import Any

from swath.documents.packed import MIB

MOST_TEXT = MIB  # bytes of the definitions of one type
NAME = re.compile(r"[a-z]\w*", re.ASCII | re.IGNORECASE)
_ASIDE = re.compile(r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/', re.DOTALL)  # texts and comments of IDL
MOST_UNROLLED = 4096  # elements of arrays of texts and messages in them


class Definitions:
    """Types of messages by name, as rosbags has them. ValueError for such as no honest file has."""

    def __init__(self, types: Mapping[str, Any]) -> None:
        self.types = types
        self._least: dict[str, int | None] = {}
        self._unrolled = 0
        for name in types:
            self.least(name)
        if self._unrolled > MOST_UNROLLED:
            raise ValueError(
                f"arrays of {self._unrolled} texts and messages, at most {MOST_UNROLLED} are read"
            )

    def least(self, name: str) -> int:
        """Bytes that a message of a type has at least."""
        if name not in self.types:
            return 1  # of which rosbags says that it is missing
        if name not in self._least:
            self._least[name] = None
            self._least[name] = sum(self._size_of(field) for _, field in self.types[name][1])
        found = self._least[name]
        if found is None:
            raise ValueError(f"{name} is within itself")
        return found

    def _size_of(self, field: Any) -> int:
        from rosbags.interfaces import Nodetype

        kind, definition = field
        if kind == Nodetype.NAME:
            if not (least := self.least(definition)):
                raise ValueError(f"{definition}, which holds nothing, is within another message")
            return least
        if kind == Nodetype.BASE:
            return _base_bytes(definition[0])
        least = self._size_of(definition[0])  # of an element
        if kind == Nodetype.SEQUENCE:
            return 4
        if definition[0][0] != Nodetype.BASE or definition[0][1][0] == "string":
            self._unrolled += definition[1]
        return least * int(definition[1])


def definitions_of(text: bytes, name: str, *, is_idl: bool = False) -> Definitions:
    """The definitions in a text. Raises what rosbags raises for another text, and as `Definitions`."""
    if len(text) > MOST_TEXT:
        raise ValueError(f"a definition of {len(text)} bytes")
    return Definitions(types_of_idl(text.decode()) if is_idl else types_of_msg(text.decode(), name))


def types_of_msg(text: str, name: str) -> dict[str, Any]:
    """As rosbags, with names and constants that are such: it makes code of them. ValueError."""
    from rosbags.typesys import get_types_from_msg

    return _named_soundly(get_types_from_msg(text, name))


def types_of_idl(text: str) -> dict[str, Any]:
    """As `types_of_msg`, without expressions: rosbags computes them, and goes through those in brackets
    several times at every depth. What writes definitions writes numbers.
    """
    from rosbags.typesys import get_types_from_idl

    bare = _ASIDE.sub("", text)
    for opened, closed, most in (("(", ")", 1), ("<", ">", 4)):
        depth = 0
        for character in bare:
            depth += (character == opened) - (character == closed)
            if depth > most:
                raise ValueError("brackets within brackets")
    if "<<" in bare:
        raise ValueError("an expression, a number was expected")
    return _named_soundly(get_types_from_idl(text))


def _named_soundly(types: dict[str, Any]) -> dict[str, Any]:
    for kind, (constants, fields) in types.items():
        own = [name for name, *_ in (*constants, *fields)]
        if odd := [name for name in (*kind.split("/"), *own) if not NAME.fullmatch(name)]:
            raise ValueError(f"{odd[0][:40]!r} is no name")
        if odd := [name for name, _, value in constants if type(value) not in (bool, int, float, str)]:
            raise ValueError(f"the constant {odd[0]} is no number and no text")
    return types


def _base_bytes(name: str) -> int:
    from rosbags.serde.utils import SIZEMAP

    return 4 if name == "string" else int(SIZEMAP[name])
