"""`swath odd check`: what of an ODD is unbound, out of range or contradictory, and what swath cannot
simulate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.documents.yaml_document import read_document
from swath.scenario.scenario import load_scenario
from swath.tools.function_test.odd.binding import FORMAT, WITHIN, Axis, Odd, keys_set_twice, read_odd
from swath.tools.function_test.odd.design import Design
from swath.tools.function_test.odd.openodd import TAXONOMY, Domain, Value, read_domain

FEWEST = 4  # buckets of a number: fewer put its ends and its usual values into one verdict
UNBOUND, OUT_OF_RANGE, CONTRADICTORY, FEW = "unbound", "out of range", "contradictory", "few buckets"
NOT_SIMULATED, NOT_DRAWN = "not simulated", "not drawn"
WRONG = (UNBOUND, OUT_OF_RANGE, CONTRADICTORY, FEW)  # what has to be mended; the others are reported


@dataclass(frozen=True)
class Finding:
    """What is found of an attribute, or of the whole (name "")."""

    kind: str
    name: str
    text: str


def check_file(path: Path) -> tuple[Domain, list[Finding]]:
    """Of a binding, or of an OpenODD document alone, in which every attribute is unbound.

    InputError for others.
    """
    document = read_document(path)
    if isinstance(document.data, dict) and document.data.get("format") == FORMAT:
        odd = read_odd(path)
        return odd.domain, check(odd)
    if isinstance(document.data, dict) and TAXONOMY in document.data:
        domain = read_domain([path], {})
        return domain, [
            Finding(UNBOUND, name, "no binding says how swath makes it") for name in domain.attributes
        ]
    document.kind = "ODD"
    raise document.error(
        (), None, f"expected an OpenODD document (TAXONOMY, ODD) or a binding (format: {FORMAT})"
    )


def check(odd: Odd) -> list[Finding]:
    """Check a bound ODD."""
    bound = odd.file.attributes
    text = "the binding does not name it"
    found = [Finding(UNBOUND, name, text) for name in odd.domain.attributes if name not in bound]
    for name, key, other in keys_set_twice(odd):
        found.append(Finding(CONTRADICTORY, name, f"{key} is set by {other}, too"))
    for axis in odd.axes:
        found += _axis(odd, axis)
    if not any(f.kind == CONTRADICTORY for f in found):
        found += _refused(odd) + _combination(odd)
    found += [Finding(NOT_SIMULATED, n, b.not_simulated) for n, b in bound.items() if b.not_simulated]
    return found


def _axis(odd: Odd, axis: Axis) -> list[Finding]:
    inside = [bool(odd.possible[axis.first + bucket, axis.first + bucket]) for bucket in range(axis.count)]
    if not any(inside):
        return [Finding(CONTRADICTORY, axis.name, "no bucket lies inside the ODD")]
    out = [label for label, holds in zip(axis.labels, inside, strict=True) if not holds]
    found = [Finding(NOT_DRAWN, axis.name, f"outside the ODD: {', '.join(out)}")] if out else []
    if axis.edges:
        if axis.count < FEWEST:
            found.append(Finding(FEW, axis.name, f"{axis.count} buckets, expected {FEWEST} or more"))
        step = 1e-3 * (axis.edges[-1] - axis.edges[0])
        for edge, side, beyond in ((axis.edges[0], "below", -step), (axis.edges[-1], "above", step)):
            if odd.domain.holds({axis.name: edge + beyond}):
                text = f"the ODD goes on {side} {num(edge)}{axis.unit}, the buckets end there"
                found.append(Finding(NOT_DRAWN, axis.name, text))
        for bucket in range(axis.count):
            limits = [odd.domain.holds({axis.name: axis.value(bucket, share)}) for share in WITHIN]
            if any(limits) and not all(limits):
                text = f"a limit of the ODD lies inside the bucket {axis.labels[bucket]}: set an edge there"
                found.append(Finding(NOT_DRAWN, axis.name, text))
    return found


def not_drawn(odd: Odd) -> list[Finding]:
    """Parts of attributes that no draw comes from."""
    return [found for axis in odd.axes for found in _axis(odd, axis) if found.kind == NOT_DRAWN]


def _refused(odd: Odd) -> list[Finding]:
    """Values at the ends of the buckets that the scenario does not take."""
    middle = {a.name: a.value(a.count // 2, 0.5) for a in odd.axes}
    if problem := _error(odd, middle):
        return [Finding(OUT_OF_RANGE, "", problem)]
    found = []
    for axis in odd.axes:
        for value in [axis.edges[0], axis.edges[-1]] if axis.edges else axis.labels:
            if problem := _error(odd, {**middle, axis.name: value}):
                shown = num(value) if isinstance(value, float | int) else value
                found.append(Finding(OUT_OF_RANGE, axis.name, f"{shown}: {problem}"))
    return found


def _error(odd: Odd, point: dict[str, Value]) -> str:
    try:
        load_scenario(odd.case.scenario, sets=odd.case.sets(point))
    except InputError as error:
        return f"{error.key}{'' if error.value is None else f' = {error.value}'}: {error.expected}"
    return ""


def _combination(odd: Odd) -> list[Finding]:
    try:
        Design(odd, 1, 1).next(np.zeros((odd.bucket_count,) * 2), 0, 1)
    except InputError:
        return [Finding(CONTRADICTORY, "", "no combination of buckets lies inside the ODD")]
    return []


def table_of(findings: Sequence[Finding]) -> list[tuple[str, str, str]]:
    """Rows for a table, what has to be mended first."""
    order = (*WRONG, NOT_DRAWN, NOT_SIMULATED)
    rows = sorted(findings, key=lambda f: (order.index(f.kind), f.name))
    return [(f.kind, f.name or "-", f.text) for f in rows]
