"""The list of keys of notes and refusals: as the page shows it, and as notes carry it."""

import re
from pathlib import Path

from swath.documents.reasons import REASONS, doubts, key_of

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "field.md"


def test_the_page_lists_them():
    text = PAGE.read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([\w-]+)` \| (\*\*doubt\*\*: )?(.+) \|$", text, re.MULTILINE)
    assert {key: (bool(doubt), text) for key, doubt, text in rows if key in REASONS} == {
        key: (reason.is_doubt, reason.meaning) for key, reason in REASONS.items()
    }


def test_a_note_without_a_key_of_the_list_has_none():
    assert key_of("sources: two buses say it") == "sources"
    assert key_of("speed: taken as km/h") == ""
    assert doubts(["form: CSV", "lost: 20 of 100 rows", "lost"]) == ["lost", "lost"]
