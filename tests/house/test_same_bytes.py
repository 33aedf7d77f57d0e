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


SAFE_POWERS = ("1", "2", "2.0", "0.5", "-1")  # of arrays: numpy multiplies, divides or draws roots


def found_in(source, name=""):
    """Lines of a source with such an operation."""
    tree = ast.parse(source)
    known, anywhere = {}, _arrays(tree)
    attributes = {name for name in anywhere if "." in name}  # other names are known in their function
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        own = attributes | _arrays(function)
        known |= dict.fromkeys(ast.walk(function), own)
    return [
        (node.lineno, kind)
        for node in ast.walk(tree)
        if (kind := _kind(node, known.get(node, anywhere)))
        and not (kind == "@" and name in POSES)
        and not (kind == "exp" and name in SINGLE)
    ]


def _arrays(tree):
    """Names that hold arrays, as far as it can be seen: so declared, or made by numpy."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.arg) and re.search(
            r"\b(NDArray|Array|F64|F32|I64)\b", _text(node.annotation)
        ):
            found.add(node.arg)
        if isinstance(node, ast.Assign) and re.match(r"[^a-z]*np\.", _text(node.value)):
            found |= {_text(target) for each in node.targets for target in getattr(each, "elts", [each])}
    return found


def _text(node):
    return "" if node is None else ast.unparse(node)


def _kind(node, arrays):
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        return "@"
    if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.Pow):
        left, right = (
            getattr(node, a, None) or getattr(node, b) for a, b in (("left", "target"), ("right", "value"))
        )
        parts = [part for side in (left, right) for part in ast.walk(side)]
        is_array = any(_text(part) in arrays or _text(part) in ("np", "None") for part in parts)
        return "**" if is_array and _text(right) not in SAFE_POWERS else ""
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


@pytest.mark.parametrize(
    ("line", "is_found"),
    [
        ("b = 3.0 ** np.arange(4)", True),
        ("a = np.zeros(3)\nb = 0.9**a", True),
        ("a, c = np.zeros((2, 3))\nb = c**4", True),
        ("b = (a[None] / 2.0) ** 3", True),
        ("def f(a: F64): a **= 1.5", True),
        ("self.a = np.ones(2)\nb = self.a ** x", True),
        ("a = np.zeros(3)\nb = a**2 + a**0.5 + x**4", False),
        ("def f(a: float): return a**1.5", False),
    ],
)
def test_powers_of_arrays_are_found(line, is_found):
    assert [kind for _, kind in found_in(line)] == ["**"] * is_found


@pytest.mark.parametrize("room", sorted({p.relative_to(PACKAGE).parts[0] for p in FILES}))
def test_no_operation_depends_on_the_processor(room):
    found = {}
    for path in FILES:
        name = path.relative_to(PACKAGE).as_posix()
        if name.partition("/")[0] == room and (lines := found_in(path.read_text(encoding="utf-8"), name)):
            found[name] = lines
    assert found == {}
