"""A launch reads its numbers at one place: threads that share it overwrite them for each other."""

import ast
from pathlib import Path

import swath

SOURCE = Path(swath.__file__).parent
MAKERS = {"repeatable", "launch_on", "numbered", "Row", "Rows"}


def _makes(node):
    calls = (call.func for call in ast.walk(node) if isinstance(call, ast.Call))
    return any(getattr(f, "id", getattr(f, "attr", "")) in MAKERS for f in calls)


def shared_in(source):
    """Lines of launches, or of the numbers of one, that all threads have: of a module, or kept by a cache."""
    found = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and _makes(node):
            found.append(node.lineno)
        if isinstance(node, ast.FunctionDef) and _makes(node):
            marks = {ast.unparse(mark).partition("(")[0].rpartition(".")[2] for mark in node.decorator_list}
            found += [node.lineno] if marks & {"cache", "lru_cache"} else []
    return found


def test_what_is_looked_for_is_found():
    planted = "@cache\ndef a():\n    return repeatable(k, [])\n", "x = numbered(k, 1, 2)\n", "y: R = Row(Z)\n"
    assert all(shared_in(text) for text in planted)
    assert not shared_in(
        "class L(local):\n    @cached_property\n    def a(self):\n        return repeatable(k)\n"
    )


def test_no_launch_is_shared_by_threads():
    texts = {str(file.relative_to(SOURCE)): file.read_text("utf-8") for file in SOURCE.rglob("*.py")}
    making = {name: text for name, text in texts.items() if any(f"{maker}(" in text for maker in MAKERS)}
    assert len(making) > 30
    assert {name: lines for name, text in making.items() if (lines := shared_in(text))} == {}
