"""What simulates uses no operation whose last bit depends on the processor or on the version of Python.

Which ones do is said in `core/portable.py`.
"""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "src" / "swath"
FREE = ("commands", "tools", "report", "replay", "field_io", "terminal", "data")  # in no digest
FILES = [
    path
    for path in PACKAGE.rglob("*.py")
    if path.relative_to(PACKAGE).parts[0] not in FREE and path.name != "portable.py"
]
DISPATCHED = re.compile(
    "sinh|cosh|arc(sin|cos|tan)[h2]?|tan|exp[2m1]*|log(2|10|1p|addexp|space)?|geomspace|(float_)?power|cbrt|angle"
)
BLAS = re.compile("v?dot|vecdot|inner|matmul|tensordot|kron|convolve|correlate|polyfit|cov|corrcoef")
POSES = {  # where `@` joins poses
    "machine/body/body.py",
    "machine/header/header_kinematics.py",
    "record/read/fields.py",
    "record/read/frames.py",
    "sensing/camera/rays.py",
}
SINGLE = {"rays/height_cells.py"}  # exp of 32-bit numbers in [1e-6, 8] is the same with and without AVX-512


def found_in(source, name=""):
    """Lines of a source with such an operation."""
    return [
        (node.lineno, kind)
        for node in ast.walk(ast.parse(source))
        if (kind := _kind(node))
        and not (kind == "@" and name in POSES)
        and not (kind == "exp" and name in SINGLE)
    ]


def _kind(node):
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        return "@"
    if not isinstance(node, ast.Call):
        return ""
    text = ast.unparse(node.func)
    keys = {k.arg: ast.unparse(k.value) for k in node.keywords}
    of_numpy, _, last = text.rpartition(".")
    if of_numpy == "np" and (DISPATCHED.fullmatch(last) or BLAS.fullmatch(last)):
        return last
    if of_numpy == "np.linalg" and not (last == "norm" and "axis" in keys):
        return text
    if last in ("argsort", "argpartition") and keys.get("kind") != "'stable'":
        return text
    return "sum of floats" if text == "sum" and not _counts(node.args[0]) else ""


def _counts(value):
    """True for whole numbers, as far as it can be seen."""
    text = ast.unparse(value.elt if isinstance(value, ast.GeneratorExp) else value)
    return any(sign in text for sign in ("len(", "_count", ".nbytes", "size", "//", " > "))


def test_what_is_looked_for_is_found():
    source = "np.exp(x), sum(v), x @ y, np.linalg.norm(x), np.argsort(x), sum(len(v) for v in x), np.sin(x)"
    kinds = {kind for _, kind in found_in(source)}
    assert kinds == {"exp", "sum of floats", "@", "np.linalg.norm", "np.argsort"}


@pytest.mark.parametrize("room", sorted({p.relative_to(PACKAGE).parts[0] for p in FILES}))
def test_no_operation_depends_on_the_processor(room):
    found = {}
    for path in FILES:
        name = path.relative_to(PACKAGE).as_posix()
        if name.partition("/")[0] == room and (lines := found_in(path.read_text(encoding="utf-8"), name)):
            found[name] = lines
    assert found == {}
