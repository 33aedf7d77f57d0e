"""A scenario of version 0.1 in the form of today: line by line, so that comments and layout stay."""

import re

from swath.documents.yaml_document import Document, dump, parse
from swath.scenario.catalogue import CATALOGUE
from swath.scenario.expectations import FIELD
from swath.scenario.versions import FORMAT, SECTIONS

RENAMED = {"ease": "threshability"}  # keys of the slot `process`
_TOP = re.compile(r"^(['\"]?)([A-Za-z_][\w-]*)\1\s*:(?=\s|$)")
_ENTRY = re.compile(r"^(\s+)(['\"]?)([\w-]+)\2\s*:(?=\s|$)")


def migrate_scenario(text: str) -> str:
    """The text in the new form; one that has its format line or `machines:` comes back as it is.

    New are the format line, `machines:`, the name of a key of `process`, and the limits of several machines:
    version 0.1 judged the first one only. Raises InputError for what is not YAML or has no keys in lines of
    their own.
    """
    document = parse(text)
    data = document.data
    if not isinstance(data, dict):
        raise document.error((), data, "expected the keys of a scenario")
    if "format" in data or "machines" in data:
        return text
    blocks = _blocks(_with_new_keys(text, document))
    if {name for name, _ in blocks if name} != set(data):
        raise document.error((), None, "expected every section to begin on a line of its own")
    machines = [name for name in data if name not in SECTIONS]
    made: list[str] = []
    for index, (name, lines) in enumerate(blocks):
        if index == 1:  # block 0 holds the comments at the start of the file
            made.append(f"format: {FORMAT}\n")
        if name == "expect" and len(machines) > 1:
            made += _limits(lines, document, machines[0])
        elif name in ("", *SECTIONS):
            made += lines
        elif name == machines[0]:
            made.append("machines:\n")
            made += [_deeper(line) for key, below in blocks if key in machines for line in below]
    return "".join(made)


def _blocks(text: str) -> list[tuple[str, list[str]]]:
    """(top-level key, its lines with the comments just above it); the first block has no key."""
    blocks: list[tuple[str, list[str]]] = [("", [])]
    for line in text.splitlines(keepends=True):
        if not line.endswith("\n"):
            line += "\n"
        if found := _TOP.match(line):
            above = blocks[-1][1]
            start = len(above)
            while len(blocks) > 1 and start > 0 and above[start - 1].startswith("#"):
                start -= 1
            blocks[-1] = (blocks[-1][0], above[:start])
            blocks.append((found.group(2), [*above[start:], line]))
        else:
            blocks[-1][1].append(line)
    return blocks


def _with_new_keys(text: str, document: Document) -> str:
    """The text with the keys of every machine's `process` under their present names."""
    lines = text.splitlines(keepends=True)
    for machine in document.data:
        entry = document.value((machine, "process"))
        if not isinstance(entry, dict) or ".py:" in str(entry.get("level")):
            continue
        for old in RENAMED.keys() & entry.keys():
            line = document.line((machine, "process", old))
            if line is not None:
                key = rf"(?<![\w-]){old}(?=['\"]?\s*:)"
                lines[line - 1] = re.sub(key, RENAMED[old], lines[line - 1], count=1)
    return "".join(lines)


def _limits(lines: list[str], document: Document, first: str) -> list[str]:
    """The lines of `expect` with its limits under the first machine's name and under `field`."""
    scopes = CATALOGUE.judged().by_scope()
    expect = document.value(("expect",))
    head = next(i for i, line in enumerate(lines) if _TOP.match(line))
    entries: dict[str, list[str]] = {}
    above: list[str] = []
    margin = ""
    for line in lines[head + 1 :]:
        found = _ENTRY.match(line)
        margin = margin or (found.group(1) if found else "")
        if found and found.group(1) == margin:
            entries[found.group(3)] = [*above, line]
            above = []
        elif entries and not line.lstrip().startswith("#"):
            entries[list(entries)[-1]].append(line)
        else:
            above.append(line)
    if not isinstance(expect, dict) or entries.keys() != expect.keys():  # in other lines than one for each
        entries = {
            k: [f"  {line}\n" for line in dump({k: v}).splitlines()] for k, v in dict(expect or {}).items()
        }
    made = [*lines[:head], "expect:\n"]
    of_field = [name for name in entries if name in scopes["field"] or name in scopes["run"]]
    for subject, names in ((first, [n for n in entries if n not in of_field]), (FIELD, of_field)):
        if names:
            made += [f"  {subject}:\n", *(_deeper(line) for name in names for line in entries[name])]
    return made + above


def _deeper(line: str) -> str:
    return "  " + line if line.strip() else line
