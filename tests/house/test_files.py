"""No module hides behind an underscore, and every package says what it holds."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "src" / "swath"
FILES = [p for p in PACKAGE.rglob("*.py") if "data" not in p.relative_to(PACKAGE).parts]


def test_no_module_begins_with_an_underscore():
    hidden = [
        p.name for p in FILES if p.name.startswith("_") and p.name not in ("__init__.py", "__main__.py")
    ]
    assert hidden == []


def test_every_package_says_what_it_holds():
    silent = [str(p) for p in FILES if p.name == "__init__.py" and not p.read_text(encoding="utf-8").strip()]
    assert silent == []


def test_whether_a_file_is_there_is_asked_of_os_path():
    """pathlib's own raise an OSError for a name that is too long, up to Python 3.13."""
    asked = {"exists", "is_file", "is_dir", "is_symlink"}
    found = [
        f"{path.relative_to(PACKAGE).as_posix()}:{node.lineno}"
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in asked
        and not (node.args or node.keywords)  # of pathlib, not of os.DirEntry
    ]
    assert found == []
