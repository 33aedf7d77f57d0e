"""One reader of numbers that people type: no command reads one from text past `swath.core.typed_numbers`."""

import ast
import re
from pathlib import Path

import pytest

import swath
from swath.commands.main import _Parser, make_parser, subcommands
from swath.core.typed_numbers import unit_of
from swath.core.units import UNITS

ROOT = Path(swath.__file__).parent
TYPED = ("commands", "terminal", "tools", "fleet", "scenario", "link", "judge", "api.py")
WRITTEN_BY_PROGRAMS = {
    "link/device/cola.py": "telegrams of a scanner",
    "link/device/nmea.py": "sentences of a receiver",
    "link/fmi/description.py": "XML of an FMU",
    "link/fmi/ssp.py": "XML of a system of FMUs",
    "tools/part/table.py": "tables of recorded signals, with nan and inf",
}  # formats, whose numbers are not typed
OF_TEXT = re.compile(r"\.r?(?:split|partition)\(|\bargs\.|\btext\b")
COUNTS = {"N", "S", "M", "DEG", "PERCENT", "P", "X", "PX", "MB", "G", "H", "W", "R", "F", "SHARE", "VALUE"}
"""What stands for the value of options that are numbers."""


def _catches(node):
    """Whether a `try` or `with` goes on after a ValueError."""
    if isinstance(node, ast.Try):
        return any(h.type is None or "ValueError" in ast.dump(h.type) for h in node.handlers)
    if isinstance(node, ast.With):
        return any("suppress" in ast.dump(i) and "ValueError" in ast.dump(i) for i in node.items)
    return False


def _reads(node):
    """Places below a node where `float` or `int` is called, or mapped."""
    for each in ast.walk(node):
        if isinstance(each, ast.Call):
            used = each.args[0] if ast.unparse(each.func) == "map" else each.func
            if isinstance(used, ast.Name) and used.id in ("float", "int"):
                yield each


def readers(text):
    """Lines that read a number from text: refusals are caught around it, or it is a part of a text."""
    found: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if _catches(node):
            found |= {each.lineno for part in node.body for each in _reads(part)}
        if isinstance(node, ast.Call):
            inner = " ".join(ast.unparse(a) for a in node.args)
        elif isinstance(node, ast.ListComp | ast.GeneratorExp | ast.SetComp):
            inner = ast.unparse(node.generators[0].iter)
        else:
            continue
        if OF_TEXT.search(inner):
            found |= {each.lineno for each in _reads(node)}
    return sorted(found)


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("try:\n x = float(t)\nexcept ValueError:\n pass", 1),
        ("with suppress(ValueError):\n x = int(t)", 1),
        ("x = [float(t) for t in args.y.split(',')]", 1),
        ("x = list(map(float, said.split('..')))", 1),
        ("x = float(args.x)", 1),
        ("x = float(np.mean(y))", 0),
    ],
)
def test_the_rule_sees_a_reader(text, count):
    assert len(readers(text)) == count


def _files():
    for name in TYPED:
        yield from [ROOT / name] if name.endswith(".py") else sorted((ROOT / name).rglob("*.py"))


def test_no_command_reads_a_number_past_the_module():
    found = {f.relative_to(ROOT).as_posix(): readers(f.read_text()) for f in _files()}
    past = {name: lines for name, lines in found.items() if lines and name not in WRITTEN_BY_PROGRAMS}
    assert not past
    assert all(found[name] for name in WRITTEN_BY_PROGRAMS)


def test_the_parser_reads_every_number_of_an_option():
    """By `_Parser._get_value`, in a unit that the option's help says in brackets, or its metavar."""
    symbols = {unit.symbol: unit for unit in UNITS.values()}
    for parser in subcommands(make_parser()[0]):
        assert isinstance(parser, _Parser)
        for action in parser._actions:
            name = f"{parser.prog} {action.dest}"
            if action.type not in (int, float):
                kind = getattr(action.type, "__name__", "str")
                assert kind in ("str", "Path", "_change", "_parameter"), name
                assert kind == "Path" or action.metavar not in COUNTS, name
                continue
            unit = UNITS[vars(action).get("unit") or unit_of(action.dest)]
            said = re.findall(r"\[([^\]]+)\]", (action.help or "").replace("%%", "%"))
            said += ["%"] if action.metavar == "PERCENT" else []
            assert all(symbols[s] == unit for s in said if s in symbols), (name, said, unit)
