"""A file of swath 0.1 in the form of today: scenarios, data sheets, a user's Python file."""

import re
from pathlib import Path

from swath.core.errors import InputError
from swath.documents.migrate_sheet import migrate_sheet
from swath.scenario.migrate import migrate_scenario
from swath.tools.migrate.python_names import migrate_python

SHEET = re.compile(r"^(kind|beam|chassis|organs|divergence\w*)\s*:", re.MULTILINE)
SCENARIO = re.compile(r"^(field|machines|run)\s*:", re.MULTILINE)


def migrate_text(file: Path, text: str) -> str:
    """The text of a file in its new form; the same text where nothing is to change.

    Raises InputError for a file that is neither a scenario, a data sheet nor a Python file.
    """
    if file.suffix == ".py":
        return migrate_python(text)
    if file.suffix not in (".yaml", ".yml"):
        raise InputError("file", str(file), "expected a scenario or data sheet (.yaml), or a Python file")
    if SCENARIO.search(text):
        return migrate_scenario(text)
    if SHEET.search(text) or text.startswith("name:") or "\nname:" in text:
        return migrate_sheet(text)
    raise InputError("file", str(file), "expected a scenario or a data sheet of swath")


def migrate_file(file: Path, *, is_dry: bool = False) -> bool:
    """Rewrite a file in place; the old one stays beside it as `NAME.orig`. True where something changed."""
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("file", str(file), f"could not be read as text: {error}") from error
    new = migrate_text(file, text)
    if new == text:
        return False
    if not is_dry:
        kept = file.with_name(file.name + ".orig")
        if kept.exists():
            raise InputError("file", str(kept), "expected no such file: the old form would be kept there")
        kept.write_text(text, encoding="utf-8")
        file.write_text(new, encoding="utf-8")
    return True
