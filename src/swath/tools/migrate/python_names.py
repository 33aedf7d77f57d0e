"""A user's Python file of swath 0.1 with the modules and names that it imports under their present names."""

import ast
import importlib
import re

from swath.core.errors import InputError
from swath.core.renamed import present_name, why_gone

_DOTTED = re.compile(r"(?<![\w.])swath(?:\.\w+)+")


def migrate_python(text: str) -> str:
    """The new text; a class with another name keeps its old one in the file (`import New as Old`).

    Raises InputError for text that is no Python.
    """
    lines = text.splitlines(keepends=True)
    for node in reversed(_imports(text)):
        if isinstance(node, ast.ImportFrom) and (new := _import_lines(node)):
            first, last, end = node.lineno - 1, (node.end_lineno or node.lineno) - 1, node.end_col_offset
            before = lines[first].encode()[: node.col_offset].decode()
            after = lines[last].encode()[end:].decode()
            joint = "; " if before.strip() else "\n" + before
            lines[first : last + 1] = [before + joint.join(new) + after]
    return _DOTTED.sub(lambda found: present_name(found.group()), "".join(lines))


def missing_names(text: str) -> list[tuple[int, str]]:
    """(line, what is the matter) of every import from swath that leads nowhere."""
    found = []
    for node in _imports(text):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        gone = [name for name in names if name.startswith("swath.") and not _is_there(name)]
        found += [(node.lineno, f"{n} is no more: {why_gone(n) or 'no successor'}") for n in gone]
    return found


def _imports(text: str) -> list[ast.Import | ast.ImportFrom]:
    """The import statements in file order."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError) as error:
        line = error.lineno if isinstance(error, SyntaxError) else None
        raise InputError("Python", None, f"expected a Python file: {error}", line=line) from error
    found = [n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)]
    return sorted(found, key=lambda node: (node.lineno, node.col_offset))


def _import_lines(node: ast.ImportFrom) -> list[str]:
    """The statement anew, where it is not enough to give its module another name; else nothing."""
    module = node.module or ""
    if node.level or not f"{module}.".startswith("swath."):
        return []
    names = {alias: present_name(f"{module}.{alias.name}") for alias in node.names}
    if all(new == f"{present_name(module)}.{alias.name}" for alias, new in names.items()):
        return []
    lines: dict[str, list[str]] = {}
    for alias, new in names.items():
        home, _, name = new.rpartition(".")
        shown = alias.asname or alias.name
        lines.setdefault(home, []).append(name if name == shown else f"{name} as {shown}")
    return [f"from {home} import {', '.join(entries)}" for home, entries in lines.items()]


def _is_there(name: str) -> bool:
    """Whether a module, or a name in one, can be imported."""
    try:
        importlib.import_module(name)
        return True
    except ImportError as error:
        if error.name is None or not f"{name}.".startswith(f"{error.name}."):
            return True  # it is there; an extra of it is not installed
    module, _, attribute = name.rpartition(".")
    try:
        return attribute in dir(importlib.import_module(module))
    except ImportError:
        return False
