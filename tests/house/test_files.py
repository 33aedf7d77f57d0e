"""Files stay small, and no module hides behind an underscore."""

from pathlib import Path
from statistics import median

PACKAGE = Path(__file__).parents[2] / "src" / "swath"
FILES = [p for p in PACKAGE.rglob("*.py") if "data" not in p.relative_to(PACKAGE).parts]
LENGTHS = {str(p.relative_to(PACKAGE)): len(p.read_text(encoding="utf-8").splitlines()) for p in FILES}


def test_no_file_is_long_and_most_are_short():
    assert len(LENGTHS) > 300
    assert {name: n for name, n in LENGTHS.items() if n > 400} == {}
    assert median(LENGTHS.values()) <= 130


def test_no_module_begins_with_an_underscore():
    hidden = [
        p.name for p in FILES if p.name.startswith("_") and p.name not in ("__init__.py", "__main__.py")
    ]
    assert hidden == []


def test_every_package_says_what_it_holds():
    silent = [str(p) for p in FILES if p.name == "__init__.py" and not p.read_text(encoding="utf-8").strip()]
    assert silent == []
