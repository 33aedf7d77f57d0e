"""Formulas in files: arithmetic is computed, anything else is no formula."""

import numpy as np
import pytest

from swath.documents.formula import CONSTANTS, FUNCTIONS, LONGEST, computed, parsed

X = np.array([0.5, 1.0, 4.0])
ARITHMETIC = {
    "2*x+1": 2 * X + 1,
    "-x/(x+1)": -X / (X + 1),
    "x**2 - 3.5e-1": X**2 - 0.35,
    "exp(-x)*sqrt(x)": np.exp(-X) * np.sqrt(X),
    "pow(x, 3) + arctan2(x, 2)": X**3 + np.arctan2(X, 2),
    "1/(x-x)": np.full(3, np.inf),
    "INF*x": np.full(3, np.inf),
    "log(x) + pi": np.log(X) + np.pi,
    "9**9**9": np.inf,
}


@pytest.mark.parametrize("text", ARITHMETIC)
def test_arithmetic_is_computed(text):
    np.testing.assert_allclose(computed(text, {"x": X}), ARITHMETIC[text], rtol=1e-15)


OTHER = [
    "open('ACTED', 'w')",
    "x*1.0+0*sin(*(eval('1') for i in (1,)))",
    "x.__class__",
    "x.tofile('ACTED')",
    "sin.__globals__",
    "(lambda: 1)()",
    "x[0]",
    "[y for y in x]",
    "x if x else x",
    "f'{x}'",
    "'a'*9",
    "x and x",
    "x == 1",
    "x @ x",
    "x % 2",
    "1 << 99",
    "~x",
    "(x := 2)",
    "sin(x, out=x)",
    "sin(*[x])",
    "sin()",
    "pow(x)",
    "True",
    "1j",
    "...",
    "None",
    "x; x",
    "x = 1",
    "",
    "\0",
    "lambda: x",
    "getattr(x, 'y')",
    "min(x)",
    "sin(sin)",
    "unknown",
    "__import__",
    "(" * 250 + "1" + ")" * 250,
    "-" * (LONGEST + 1) + "1",
    "x" + "+x" * LONGEST,
]


@pytest.mark.parametrize("text", OTHER)
def test_anything_else_is_none(text):
    with pytest.raises(ValueError):
        computed(text, {"x": X})


def test_deep_ones_end():
    assert computed("-" * (LONGEST - 2) + "1", {}) in (1.0, -1.0)


def test_texts_of_the_alphabet_of_python_do_nothing():
    """Drawn from pieces of Python: each is computed of its own numbers, or none."""
    rng = np.random.default_rng(5)
    pieces = "x 1 2.5 + - * / ** ( ) , . [ ] ' for in if lambda : = eval open sin pow __class__ { } % e9"
    good = 0
    for _ in range(20_000):
        text = "".join(rng.choice([*pieces.split(), " "], rng.integers(1, 8)))
        try:
            parsed.__wrapped__(text)
            value = computed(text, {"x": X})
        except ValueError:
            continue
        good += 1
        assert isinstance(value, float | np.ndarray | np.floating)
        assert not {w for w in ("eval", "open", "lambda", "__class__", "for") if w in text}
    assert good > 300
    assert set(FUNCTIONS).isdisjoint(CONSTANTS)
