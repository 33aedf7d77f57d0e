"""The table "Where things are": one link per row, to a file that holds what the row says."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"^\| (?P<what>.+) \| \[[^]]+\]\((?P<file>[^)#]+)\) \| `(?P<name>[^`]+)` \|$", re.MULTILINE)
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
SECTION = PAGE.read_text(encoding="utf-8").partition("## Where things are\n")[2]
TABLE = [line for line in SECTION.partition("\n\n")[0].splitlines() if line.startswith("|")][2:]
ROWS = [m.group("what", "file", "name") for m in ROW.finditer("\n".join(TABLE))]


def test_every_row_is_one_link_and_there_are_enough():
    assert len(ROWS) == len(TABLE) >= 12
    said = " ".join(what for what, *_ in ROWS)
    for asked in (
        "steering law",
        "edge detector",
        "echo rule",
        "threshing model",
        "where a run ends",
        "lateral_rms_m",
    ):
        assert asked in said


@pytest.mark.parametrize(("what", "file", "name"), ROWS, ids=lambda v: v[:40])
def test_the_file_holds_it(what, file, name):
    text = (PAGE.parent / file).read_text(encoding="utf-8")
    defined = (
        rf"^(?:class|def) {name}\b|^{name}\b.*="
        if file.endswith(".py")
        else rf"^\s*(?:static constexpr auto )?{re.escape(name)}\b"
    )
    assert re.search(defined, text, re.MULTILINE), f"{file} defines no {name}"
    if "`" in what:
        assert re.search(r"`(\w+)`", what).group(1) in text
