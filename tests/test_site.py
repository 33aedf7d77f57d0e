"""The documentation as a site: every page within two clicks of the first one, and no warning."""

import re
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


def test_every_page_is_within_two_clicks():
    first = DOCS / "index.md"
    near = {first.resolve(), *children(first)}
    near |= {page for part in set(near) for page in children(part)}
    further = {page for page in DOCS.rglob("*.md") if page.resolve() not in near}
    # the pages of decisions hang below their list, which the first page links
    assert {page.parent.name for page in further} <= {"decisions"}
    assert "decisions/index.md" in first.read_text(encoding="utf-8")


def test_the_site_builds_without_a_warning(tmp_path):
    for module in ("sphinx", "myst_parser", "furo", "gymnasium"):
        pytest.importorskip(module)
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", "-b", "html"]
    done = subprocess.run([*command, str(DOCS), str(tmp_path)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    searchable = (tmp_path / "searchindex.js").read_text(encoding="utf-8")
    assert "explanation/validation" in searchable
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="https?://(?!www\.sphinx-doc|github\.com/pradyunsg)[^"]*"', page)
