"""Words that no command can use are told in one line of ours: names of 300 letters, and what is no number."""

import re
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import swath
from swath.commands.main import UsageError, main, make_parser, subcommands
from swath.core.errors import InputError
from swath.field.crop_sheet import load_crop
from swath.fleet.files import read_job
from swath.machine.machine_sheet import load_machine
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar_sheet import load_lidar
from swath.tools.function_test.case import read_case
from swath.tools.function_test.odd.binding import read_odd

LONG = "x" * 300
NUMBERS = (int, float)
NO_NUMBERS = ("abc", "", "nan", "1e999", "9" * 5000, "0x10", "1,5", LONG)
LIBRARIES = re.compile(
    r"invalid literal|could not convert|unpack requires|Expecting |not well-formed|Errno|File name too long|"
    r"invalid \w+ value|Traceback|mistake in swath|cannot convert|Exceeds the limit"
)
SERVE = {"can box", "can listen", "ros2 play", "paper"}  # they run until they are stopped, or for minutes
COMMANDS = {p.prog.removeprefix("swath "): p for p in subcommands(make_parser()[0])}


DATA = Path(swath.__file__).parent / "data"
DOCUMENTS = {
    "scenarios/unload-on-the-go.yaml": load_scenario,
    "jobs/two-combines.yaml": lambda file: read_job(str(file)),
    "tests/beside-cart.yaml": read_case,
    "odds/wheat-harvest.odd.yaml": read_odd,
    "machines/tractor-grain-cart.yaml": lambda file: load_machine(str(file)),
    "sensors/velodyne-vlp16.yaml": lambda file: load_lidar(str(file)),
    "crops/wheat.yaml": lambda file: load_crop(str(file)),
}


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


def _names(node):
    """Where the names of a document are, not its sentences: the mapping or list, and the key."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if isinstance(value, str) and " " not in value:
            yield node, key
        elif isinstance(value, dict | list):
            yield from _names(value)


def _refused(read, file):
    """What a file is refused with, nothing if it is read."""
    try:
        read(file)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n.startswith("jobs") else pytest.mark.draws) for n in DOCUMENTS]
)
def test_names_of_300_letters_in_a_document(name, tmp_path):
    file, yaml = tmp_path / "mine.yaml", YAML(typ="safe", pure=True)
    document = yaml.load(DATA / name)
    for node, key in _names(document):
        usual, node[key] = node[key], LONG
        yaml.dump(document, file)
        node[key] = usual
        assert not LIBRARIES.search(_refused(DOCUMENTS[name], file)), key
