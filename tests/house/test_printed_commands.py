"""Commands that are printed can be typed: paths in them are quoted where a shell would part them."""

import ast
import re
import shlex
from pathlib import Path

import pytest

from swath.core.process.shell import command

SOURCES = Path(__file__).parents[2] / "src" / "swath"
BEGUN = re.compile(
    r"\bswath (again|branch|compare|diff|field|fleet|lab|new|report|rerun|run|scan|test|view)\b[^`]*$"
)


def unquoted(tree):
    """Lines where text that begins a command of swath goes on with a value that is not quoted."""
    for node in (n for n in ast.walk(tree) if isinstance(n, ast.JoinedStr)):
        before = ""
        for part in node.values:
            if isinstance(part, ast.Constant):
                before += part.value
                continue
            is_quoted = isinstance(part.value, ast.Call) and getattr(part.value.func, "id", "") in (
                "quote",
                "command",
            )
            if BEGUN.search(before) and not is_quoted:
                yield node.lineno
            before += "x"


def test_no_source_puts_a_value_into_a_command_without_quotes():
    found = [f"{path.relative_to(SOURCES)}:{line}" for path in sorted(SOURCES.rglob("*.py"))
             for line in unquoted(ast.parse(path.read_text(encoding="utf-8")))]  # fmt: skip
    assert found == []


@pytest.mark.parametrize("path", ["plain", "two words", "it's", "a;b", "$HOME", "ü x"])
def test_a_command_is_read_back_as_its_words(path):
    assert shlex.split(command("run", path)) == ["swath", "run", path]
