"""Results in the docs stand in the table of figures, with what gives them."""

import re
import shlex

import pytest
from docs.make.figures import DEAR, FIGURE, NONE, PAGE, ROOT, found, held_by, is_dear, stated

from swath.commands.main import make_parser

WORDS = re.compile(r"published|setting|closed form|example|the command of each row|measured: .{10,}")
STATED = stated()


def test_every_figure_is_in_the_table_and_no_other():
    counted = {place: len(figures) for place, figures in found().items()}
    assert counted == {place: count for place, (count, *_) in STATED.items()}, (
        "run: python -m docs.make.figures, and say in reference/figures.md what gives the new ones"
    )


@pytest.mark.parametrize("by", sorted({by for _, by, *_ in STATED.values()}))
def test_what_gives_a_figure_is_there(by):
    for part in by.split("; "):
        if not (command := re.fullmatch("`(.*)`", part)):
            assert WORDS.fullmatch(part), part
            continue
        program, *words = shlex.split(command[1])
        assert program in ("pytest", "python", "swath", "make", "pip")
        files = [word for word in words if word.endswith(".py")]
        assert all((ROOT / name).is_file() for name in files), files
        if program == "swath" and len(words) > 2:
            make_parser()[0].parse_args(words)


def test_each_says_since_which_commit():
    assert all(re.fullmatch("[0-9a-f]{8}", commit) for _, _, commit, _ in STATED.values())
    assert PAGE.read_text(encoding="utf-8").count("\n| ") >= len(STATED)


@pytest.mark.parametrize("place", sorted(STATED), ids=str)
def test_each_says_on_which_commit_it_was_measured_or_that_it_was_not(place):
    _, by, _, measured = STATED[place]
    if is_dear(by):
        assert re.fullmatch(f"{DEAR}|[0-9a-f]{{8}}", measured)
    else:
        assert measured == NONE or (held_by(by) and re.fullmatch("[0-9a-f]{8}", measured))


@pytest.mark.parametrize(
    ("text", "figures"),
    [
        ("wrong by 3.5 cm, in 94 % of runs", ["3.5 cm", "94 %"]),
        ("takes 20 to 100 ms, 1,500 times", ["20 to 100 ms", "1,500 times"]),
        ("version 3.11, 5 km/h, EN 13.5cmx", []),
        ("costs 850 MB", ["850 MB"]),
    ],
)
def test_figures_are_told_from_other_numbers(text, figures):
    assert [f[0] for f in FIGURE.finditer(text)] == figures
