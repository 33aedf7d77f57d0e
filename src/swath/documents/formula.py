"""Formulas of measurement files, computed by a walk over their syntax: nothing else in them is done.

They are of numbers, variables, the four operations, powers and the functions of `FUNCTIONS`, which are those
of a general formula of ASAM MDF 4 (block CC) and ASAM MCD-2 MC.
"""

import ast
import operator
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

LONGEST = 500  # characters of a formula
CONSTANTS = {"INF": np.inf, "NaN": np.nan, "pi": np.pi}
OPERATIONS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
FUNCTIONS: Mapping[str, tuple[Callable[..., Any], int]] = {  # and how many numbers they take
    **{name: (getattr(np, name), 1) for name in ("abs", "sqrt", "exp", "log", "log10", "floor", "ceil")},
    **{name: (getattr(np, name), 1) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{name: (getattr(np, name), 1) for name in ("arcsin", "arccos", "arctan", "asin", "acos", "atan")},
    "arctan2": (np.arctan2, 2),
    "pow": (np.power, 2),
}


@lru_cache(maxsize=256)
def parsed(text: str) -> ast.expr:
    """The syntax of a formula. ValueError for a text that is none."""
    if len(text) > LONGEST:
        raise ValueError(f"a formula of {len(text)} characters, at most {LONGEST} are read")
    try:
        found = ast.parse(text.strip(), "formula", mode="eval").body
        _check(found)
    except (SyntaxError, RecursionError, MemoryError) as error:
        raise ValueError(f"no formula: {text[:60]}") from error
    return found


def _check(node: ast.AST) -> None:
    """ValueError for syntax that is no arithmetic, whatever the variables are called."""
    parts: list[ast.expr] | None = None
    match node:
        case ast.Constant(value=bool()) | ast.Call(keywords=[_, *_]):
            pass
        case ast.Constant(value=int() | float()) | ast.Name():
            parts = []
        case ast.UnaryOp(op=op, operand=a) if type(op) in OPERATIONS:
            parts = [a]
        case ast.BinOp(left=a, op=op, right=b) if type(op) in OPERATIONS:
            parts = [a, b]
        case ast.Call(func=ast.Name(id=name), args=given) if FUNCTIONS.get(name, (None, -1))[1] == len(given):
            parts = given
    if parts is None:
        raise ValueError(f"{type(node).__name__} is no arithmetic: {ast.unparse(node)[:60]}")
    for part in parts:
        _check(part)


def computed(text: str, variables: Mapping[str, Any]) -> Any:
    """The value of a formula, of arrays an array. ValueError for a text that is none, or an unknown name."""
    with np.errstate(all="ignore"):
        return _value(parsed(text), {**CONSTANTS, **variables})


def _value(node: ast.AST, names: Mapping[str, Any]) -> Any:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)  # no whole number grows without bound
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.UnaryOp(op=op, operand=a):
            return OPERATIONS[type(op)](_value(a, names))
        case ast.BinOp(left=a, op=op, right=b):
            return OPERATIONS[type(op)](_value(a, names), _value(b, names))
        case ast.Call(func=ast.Name(id=name), args=given):
            return FUNCTIONS[name][0](*(_value(a, names) for a in given))
    raise ValueError(f"unknown name {ast.unparse(node)[:60]}")
