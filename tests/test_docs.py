"""The pages: links lead somewhere, every page is linked, and the command lines they print are understood."""

import re
import shlex
from pathlib import Path

import pytest

from swath.commands.main import UsageError, make_parser
from swath.core.errors import InputError
from swath.scenario.scenario import load_scenario, scenario_names

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
PATH = re.compile(r"`((?:docs|src|examples|tests|benchmarks)/[\w./-]+)")
LINE = re.compile(r"^(?:    )?swath (\w[^\n]*)$", re.MULTILINE)


def links(page):
    text = page.read_text(encoding="utf-8")
    beside = [page.parent / m for m in LINK.findall(text) if not m.startswith("http")]
    return {p.resolve() for p in (*beside, *(ROOT / m.rstrip(".") for m in PATH.findall(text)))}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    assert [str(p) for p in links(page) if not p.exists()] == []


def test_every_page_is_linked():
    linked = set().union(*(links(page) for page in PAGES))
    pages = [p for p in PAGES[1:] if p.parent.name == "docs"]
    assert [p.name for p in pages if p.resolve() not in linked] == []


def command_lines(page):
    """Whole command lines of a page's listings, without comments and what the shell does with them."""
    for line in LINE.findall(page.read_text(encoding="utf-8")):
        words = shlex.split(line.rstrip("\\").rstrip(), comments=True)
        cut = [i for i, word in enumerate(words) if word in (">", "&", "|")]
        words = words[: cut[0]] if cut else words
        is_form = any(w.startswith(("[", "<")) or w.isupper() or "..." in w for w in words)
        if words and words[0] in NAMES and not is_form and not line.endswith("\\"):
            yield words


PARSER, NAMES = make_parser()
LINES = [(p.name, words) for p in PAGES for words in command_lines(p)]


def test_there_are_command_lines_to_check():
    assert len(LINES) > 40


@pytest.mark.parametrize(
    ("page", "words"), LINES, ids=lambda v: " ".join(v)[:60] if isinstance(v, list) else v
)
def test_a_printed_command_line_is_understood(page, words, monkeypatch):
    monkeypatch.chdir(ROOT)
    try:
        args = PARSER.parse_args(words)
    except UsageError as error:
        pytest.fail(f"{page}: swath {' '.join(words)}: {error}")
    if getattr(args, "scenario", None) not in scenario_names():
        return
    try:
        load_scenario(args.scenario, sets=args.sets)
    except InputError as error:
        if "there is no" not in str(error) and "expected a file" not in str(error):  # a file of the reader's
            pytest.fail(f"{page}: swath {' '.join(words)}: {error}")
