"""`swath docs`: the pages that come with the installation."""

from pathlib import Path

import pytest

from swath.commands import docs
from swath.commands.main import main

ROOT = Path(__file__).parents[1]


def test_every_page_is_listed_with_its_title(capsys):
    assert main(["docs"]) == 0
    shown = capsys.readouterr().out
    assert len(docs.pages()) > 20
    assert [name for name in docs.pages() if f" {name} " not in shown] == []


@pytest.mark.parametrize("name", ["tutorials/first-run", "docs/tutorials/first-run.md"])
def test_a_page_is_printed_as_it_is(capsys, name):
    assert main(["docs", name]) == 0
    assert capsys.readouterr().out == (ROOT / "docs" / "tutorials" / "first-run.md").read_text(
        encoding="utf-8"
    )


def test_a_name_of_several_pages_and_one_of_none_say_which_there_are(capsys):
    assert main(["docs", "architectur"]) == 2
    assert "did you mean 'architecture'?" in capsys.readouterr().err
    name = "index" if "index" not in docs.pages() else "no-page"
    assert main(["docs", name]) == 2
