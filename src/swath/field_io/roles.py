"""What things of a map say that they are, asked before geometry decides: by data/maps/words.yaml."""

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from swath.documents.yaml_document import read_mapping
from swath.field_io import trade

FIELD, BARE, LINE, OTHER, UNKNOWN = "field", "bare", "line", "other", "unknown"
"""Crop stands in it; none does; guidance; neither of these; its word is in no table."""


@cache
def _table() -> dict[str, Any]:
    """The table of words, `roles` as word -> role."""
    table = read_mapping(Path(str(files("swath.data") / "maps" / "words.yaml")), "words").data
    roles = {word: role for role, rows in table["roles"].items() for row in rows for word in row.split(", ")}
    return {**table, "roles": roles, "nothing": set(table["nothing"])}


def role_of(said: Mapping[str, Any]) -> tuple[str, str]:
    """Role and word of a thing by its properties; ("", "") where it says nothing."""
    table = _table()
    texts = {
        _plain(key): word for key, text in said.items() if (word := _plain(text)) not in table["nothing"]
    }
    by_key = next(
        (key for key in table["bare_by_key"] if texts.get(key) or _plain(said.get(key)) == "yes"), ""
    )
    for key in table["says_it"]:
        if re.search(r"[^\W\d]", word := texts.get(key, "")):
            is_crop = trade.sheet_of(word) is not None or trade.is_other(word)
            return _known(word) or BARE * bool(by_key) or FIELD * is_crop or UNKNOWN, word
    if by_key:
        return BARE, by_key
    for key in table["may_say_it"]:
        word = re.sub(r" ?\d+$", "", texts.get(key, ""))
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
