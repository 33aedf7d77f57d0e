"""No module hides behind an underscore, and every package says what it holds."""

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
