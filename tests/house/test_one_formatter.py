"""Numbers for people are written by `swath.core.number_text` alone; what programs read is listed here."""

import ast
import re
from pathlib import Path

import swath

ROOT = Path(swath.__file__).parent
ROOMS = "terminal", "report", "tools", "fleet", "judge", "runtime", "commands", "field_io"
SPEC = re.compile(r"[-+ ]?\d*,?(\.\d*)?[efgEFG%]|[-+ ]?\d*,(\.\d*)?")
IN_TEXT = re.compile(r"\{[\w.\[\]]*:([^{}\s]+)\}|(?<![\d ] )(?<!\d)%[-+0-9.]*[efg]\b")
VALUE = "float", "Stream"  # what is rounded is a number again, or names a stream of random numbers
EXCEPTIONS = {
    "report/chart.py": "places in an SVG",
    "report/html.py:bar": "a length in a style",
    "tools/function_test/odd/dossier.py:_layers": "a length in a style",
    "tools/function_test/odd/dossier.py:_cell_rows": "a table for programs (CSV)",
    "tools/function_test/odd/restricted.py:_condition": "an expression in a file of OpenODD",
    "tools/function_test/estimate/page.py:write_junit": "a file for programs (JUnit)",
    "tools/function_test/field_plan/form.py:write_form": "a table for programs (CSV)",
    "tools/function_test/evidence.py:scans_row": "a table for programs (CSV)",
    "tools/function_test/field_plan/form.py:_log": "a table for programs (CSV)",
    "tools/function_test/odd/binding.py:axes": "names of buckets, by which results are kept",
    "tools/tune/tune.py:_check": "keys of a dict",
    "tools/dataset/dataset.py:scene_of": "keys of a scenario",
    "tools/dataset/scans.py": "keys of a scenario, a name of a file",
    "tools/field_export/sdf.py": "a file for programs (SDF)",
    "tools/field_export/scene.py:known_ground": "an option that can be typed as it stands",
    "tools/lab/comparison.py:write_table": "a table for programs (CSV)",
    "tools/reda/reda.py:write_cells": "a table for programs (CSV)",
    "tools/reda/scene.py:file": "a name of a file",
    "tools/scan/scan.py:_table": "a table for programs (CSV)",
    "tools/yield_log/records.py:write_csv": "a table for programs (CSV)",
    "field_io/agopengps.py:_points": "a file for programs (AgOpenGPS)",
    "field_io/agopengps.py:_place": "a file for programs (AgOpenGPS)",
    "field_io/logs/held.py:__iter__": "texts of a column, which are read again",
    "field_io/logs/table.py:texts": "texts of a column, which are read again",
    "field_io/logs/clock.py:of_digits": "digits of a date, which are read again",
    "field_io/pass_case.py": "a scenario",
    "field_io/pass_scenario.py": "a scenario",
}


def _has_form(text):
    forms = IN_TEXT.finditer(text) if isinstance(text, str) else ()
    return any(m.group(1) is None or SPEC.fullmatch(m.group(1)) for m in forms)


def written(tree):
    """(line, function, what is written) of numbers that are given a form of their own."""
    found = []

    def walk(node, function, is_value):
        for child in ast.iter_child_nodes(node):
            inside = child.name if isinstance(child, ast.FunctionDef) else function
            name = ast.unparse(child.func).rpartition(".")[2] if isinstance(child, ast.Call) else ""
            if isinstance(child, ast.FormattedValue) and child.format_spec is not None and not is_value:
                parts = (p.value if isinstance(p, ast.Constant) else "" for p in child.format_spec.values)
                if SPEC.fullmatch("".join(parts)):
                    found.append((child.lineno, function, ast.unparse(child.value)))
            elif isinstance(child, ast.Constant) and _has_form(child.value):
                found.append((child.lineno, function, child.value))
            walk(child, inside, is_value or name in (*VALUE, "child"))

    walk(tree, "", False)
    return found


def places():
    """file:line, the exception that it falls under, and what stands there."""
    files = [file for room in ROOMS for file in sorted((ROOT / room).rglob("*.py"))]
    for file in files:
        name = file.relative_to(ROOT).as_posix()
        for line, function, what in written(ast.parse(file.read_text(encoding="utf-8"))):
            yield (
                f"{name}:{line}",
                next((k for k in (f"{name}:{function}", name) if k in EXCEPTIONS), ""),
                what,
            )


def test_numbers_for_people_are_written_in_one_place():
    found = list(places())
    used = {exception for _, exception, _ in found}
    wrong = [f"{where}: {what}" for where, exception, what in found if not exception]
    print(f"{len(found)} numbers with a form of their own, {len(wrong)} of them for people")
    assert wrong == []
    assert EXCEPTIONS.keys() - used == set()


def test_the_walk_finds_forms():
    text = (
        'a = f"{x:.3g} m {y} {n:,} {s:<8} {d:02d} {h:X}"\nb = "{:g} to {}".format(1.0, 2)\nc = "%.2f" % 3.0\n'
    )
    assert [what for _, _, what in written(ast.parse(text))] == ["x", "n", "{:g} to {}", "%.2f"]
    assert written(ast.parse('d = float(f"{x:.3g}") + Stream(1, f"at {x:g}").u')) == []
