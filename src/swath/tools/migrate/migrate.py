"""A file of swath 0.1 in the form of today: scenarios, data sheets, a user's Python file."""

from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.whole_file import write_whole
from swath.documents.migrate_sheet import MARKS, migrate_sheet
from swath.documents.text_file import read_text
from swath.documents.yaml_document import parse
from swath.scenario.catalogue import CATALOGUE
from swath.scenario.migrate import migrate_scenario
from swath.scenario.versions import SECTIONS
from swath.tools.migrate.python_names import migrate_python


def migrate_text(file: Path, text: str) -> str:
    """The text of a file in its new form; the same text where nothing is to change.

    Raises InputError for a file that is neither a scenario, a data sheet nor a Python file.
    """
    if file.suffix == ".py":
        return migrate_python(text)
    if file.suffix not in (".yaml", ".yml"):
        raise InputError("file", str(file), "expected a scenario or data sheet (.yaml), or a Python file")
    data = parse(text, str(file), file).data
    data = data if isinstance(data, dict) else {}
    if set(data) & set(MARKS):
        return migrate_sheet(text)
    if set(data) & {"machines", *SECTIONS} - {"name", "summary"} or any(map(_is_machine, data.values())):
        return migrate_scenario(text)
    raise InputError("file", str(file), "expected a scenario or a data sheet of swath")


def _is_machine(section: Any) -> bool:
    return isinstance(section, dict) and any(k == "machine" or CATALOGUE.kind_of(k) for k in section)


def migrate_file(file: Path, *, is_dry: bool = False) -> bool:
    """Rewrite a file in place; the old one stays beside it as `NAME.orig`. True where something changed."""
    text = read_text(file, "file", "a scenario, sheet or Python file")
    new = migrate_text(file, text)
    if new == text:
        return False
    if not is_dry:
        kept = file.with_name(file.name + ".orig")
        if kept.exists():
            raise InputError("file", str(kept), "expected no such file: the old form would be kept there")
        write_whole(kept, text)
        write_whole(file, new)
    return True
