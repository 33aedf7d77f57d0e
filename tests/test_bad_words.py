"""Words that no command can use are told in one line of ours: names of 300 letters, and what is no number."""

import re

import pytest

from swath.commands.main import UsageError, main, make_parser, subcommands

LONG = "x" * 300
NUMBERS = (int, float)
NO_NUMBERS = ("abc", "", "nan", "1e999", "9" * 5000, "0x10", "1,5", LONG)
LIBRARIES = re.compile(
    r"invalid literal|could not convert|unpack requires|Expecting |not well-formed|Errno|File name too long|"
    r"invalid \w+ value|Traceback|mistake in swath|cannot convert|Exceeds the limit"
)
SERVE = {"can box", "can listen", "ros2 play", "paper"}  # they run until they are stopped, or for minutes
COMMANDS = {p.prog.removeprefix("swath "): p for p in subcommands(make_parser()[0])}


def _positionals(parser):
    return [a for a in parser._actions if not a.option_strings and a.dest != "help"]


def _line(name, parser, words):
    """A command line with these words for its positionals, and what it needs beside them."""
    needed = [a for a in parser._actions if a.option_strings and a.required]
    beside = [w for a in needed for w in (a.option_strings[-1], "1" if a.type in NUMBERS else _usual(a))]
    return [*name.split(), *words, *beside]


def _usual(action):
    return str(next(iter(action.choices))) if action.choices else "straight"


def told(line, capsys):
    """What a line is refused with."""
    code = main(line)
    said = [text for text in capsys.readouterr().err.splitlines() if text]
    assert code == 2, (line, said)
    assert all(len(text) <= len("swath: ") + 300 for text in said), said
    assert not LIBRARIES.search(" ".join(said)), said
    return " ".join(said)


@pytest.mark.parametrize(
    "name", [n for n, p in COMMANDS.items() if any(a.type in NUMBERS for a in p._actions)]
)
def test_what_is_no_number(name):
    parser = COMMANDS[name]
    line = _line("", parser, [_usual(a) for a in _positionals(parser)])
    for action in parser._actions:
        if action.type in NUMBERS and action.option_strings:
            for word in NO_NUMBERS:
                more = [word] * (action.nargs if isinstance(action.nargs, int) else 1)
                with pytest.raises(UsageError) as found:
                    parser.parse_args([*line, action.option_strings[-1], *more])
                said, kind = str(found.value), "a number" if action.type is float else "a whole number"
                assert f"expected {kind}, not" in said, (name, action.dest, word, said)


@pytest.mark.parametrize("name", sorted(COMMANDS.keys() - SERVE))
def test_names_of_300_letters(name, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parser = COMMANDS[name]
    places = _positionals(parser)
    for k in range(len(places)):
        words = [LONG if i == k else _usual(a) for i, a in enumerate(places)]
        told(_line(name, parser, words), capsys)
