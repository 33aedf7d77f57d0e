"""What things of a map say that they are, asked before geometry decides: by data/maps/words.yaml."""

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from swath.documents.yaml_document import read_mapping
from swath.field_io import trade

FIELD, BARE, LINE, PART, OTHER, UNKNOWN = "field", "bare", "line", "part", "other", "unknown"
"""Crop stands in it; none does; guidance; a part of a field; none of these; its word is in no table."""


@cache
def _table() -> dict[str, Any]:
    """The table of words, `roles` as word -> role."""
    table = read_mapping(Path(str(files("swath.data") / "maps" / "words.yaml")), "words").data
    roles = {word: role for role, rows in table["roles"].items() for row in rows for word in row.split(", ")}
    return {**table, "roles": roles, "nothing": set(table["nothing"])}


def role_of(said: Mapping[str, Any]) -> tuple[str, str]:
    """Role and word of a thing by the properties that state its kind; ("", "") where none does."""
    table = _table()
    texts = {_plain(key): _plain(text) for key, text in said.items()}
    by_key = next((key for key in table["bare_by_key"] if _is_bare(texts.get(key, ""), key)), "")
    for key in table["says_it"]:
        word = texts.get(key, "")
        if word in table["nothing"] or not re.search(r"[^\W\d]", word):
            continue
        role = _known(word)
        if key in table["crops"]:
            role = FIELD if role == FIELD or trade.sheet_of(word) is not None or trade.is_other(word) else ""
        elif not role and key in table["of_keys"]:
            role = BARE * any(word in words for words in table["bare_by_key"].values())
        return role or BARE * bool(by_key) or UNKNOWN, word
    return (BARE, by_key) if by_key else ("", "")


def _is_bare(word: str, key: str) -> bool:
    """Whether the value of a property says that no crop stands in a thing."""
    table = _table()
    return word in table["affirmed"] or word in table["bare_by_key"][key] or _known(word) in (BARE, OTHER)


def named(said: Mapping[str, Any]) -> tuple[str, str]:
    """Role and word of a thing by its name and its folder alone; ("", "") for other words."""
    table = _table()
    texts = {_plain(key): re.sub(r" ?\d+$", "", _plain(text)) for key, text in said.items()}
    for key in table["may_say_it"]:
        word = texts.get(key, "")
        found = _known(word)
        if found and (found != FIELD or key not in table["of_many"]):
            return found, word
    return "", ""


def _known(word: str) -> str:
    """The role of a word, in the plural too, '' for one that is in no table."""
    roles: dict[str, str] = _table()["roles"]
    return roles.get(word) or roles.get(re.sub(r"(?<=\w\w)s$", "", word), "")


def _plain(text: Any) -> str:
    """Small letters, words with one blank between them."""
    return " ".join(re.findall(r"[^\W_]+", str("" if text is None else text).lower()))
