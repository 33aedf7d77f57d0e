"""The documentation as a site: every page within two clicks of the first one, and no warning."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
TREE = re.compile(r"```\{toctree\}\n(.*?)```", re.DOTALL)


def children(page):
    """Pages that the tables of contents of a page list."""
    found = []
    for tree in TREE.findall(page.read_text(encoding="utf-8")):
        for line in tree.splitlines():
            if line and not line.startswith(":"):
                found += sorted(page.parent.resolve().glob(f"{line}.md"))
    return [page.resolve() for page in found]


def test_every_page_is_one_click_away():
    first = DOCS / "index.md"
    assert {first.resolve(), *children(first)} == {page.resolve() for page in DOCS.rglob("*.md")}


def test_the_site_builds_without_a_warning(tmp_path):
    for module in ("sphinx", "myst_parser", "furo", "gymnasium"):
        pytest.importorskip(module)
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", "-b", "dummy"]
    done = subprocess.run([*command, str(DOCS), str(tmp_path)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_page_of_the_site_is_searchable_and_loads_nothing_from_elsewhere(tmp_path):
    """Two pages by the configuration of all."""
    for module in ("sphinx", "myst_parser", "furo"):
        pytest.importorskip(module)
    (tmp_path / "explanation").mkdir()
    (tmp_path / "index.md").write_text("# swath\n```{toctree}\nexplanation/validation\n```\n")
    shutil.copy(DOCS / "explanation" / "validation.md", tmp_path / "explanation")
    (tmp_path / "static").symlink_to(DOCS / "static")
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", "-c", str(DOCS)]
    subprocess.run([*command, str(tmp_path), str(tmp_path / "site")], capture_output=True, check=True)
    searchable = (tmp_path / "site" / "searchindex.js").read_text(encoding="utf-8")
    assert "explanation/validation" in searchable
    page = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="https?://(?!www\.sphinx-doc|github\.com/pradyunsg)[^"]*"', page)
