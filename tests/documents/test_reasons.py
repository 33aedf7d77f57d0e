"""The list of keys of notes and refusals: as the page shows it, and as notes carry it."""

import ast
import re
from pathlib import Path

import swath
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


SOURCE = Path(swath.__file__).parent
READERS = ["field_io/**/*.py", "record/read/*.py", "field/weather*.py", "fleet/files.py", "fleet/outlines.py",
           "fleet/ground.py"]  # fmt: skip
OPEN = {"{key}", "{said}", "note"}  # parts of a note made above it


def begins(note):
    """What the text of a note begins with: of each branch where it has two."""
    match note:
        case ast.Constant():
            return [note.value]
        case ast.JoinedStr():
            return begins(note.values[0])
        case ast.FormattedValue():
            return [f"{{{ast.unparse(note.value)}}}"]
        case ast.BinOp():
            return begins(note.left)
        case ast.IfExp():
            return [*begins(note.body), *begins(note.orelse)]
    return [ast.unparse(note)]


def unkeyed(text):
    calls = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Call) and len(n.args) == 1]
    noted = [n.args[0] for n in calls if re.search(r"\bnotes\.append$", ast.unparse(n.func))]
    return [b for note in noted for b in begins(note) if b not in OPEN and not key_of(b)]


def test_what_readers_note_begins_with_a_key():
    files = [file for pattern in READERS for file in SOURCE.glob(pattern)]
    assert len(files) > 40
    assert {file.name: found for file in files if (found := unkeyed(file.read_text(encoding="utf-8")))} == {}
    assert unkeyed("self.notes.append(f'speed: {x}'); notes.append('form: ' + y if y else 'as it is')") == [
        "speed: ", "as it is",
    ]  # fmt: skip
