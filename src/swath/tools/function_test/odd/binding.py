"""An ODD bound to swath: which scenario key an attribute sets, in which buckets it is tried, what a run
measures.

A binding is a file of its own beside the OpenODD documents, which stay as their owner wrote them. It also
says what is asked of the function: scenario, limits and claim, in the words of a test case.
"""

import os
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from swath.core.errors import InputError, near_miss
from swath.documents.validation import checked
from swath.documents.yaml_document import Document, dump, read_document
from swath.runtime.met import QUANTITIES, check_quantities
from swath.signals import F64
from swath.tools.function_test.case import FORMAT as CASE_FORMAT
from swath.tools.function_test.case import Case, CaseFile, Claim, from_beside, limits_of
from swath.tools.function_test.odd.openodd import Domain, Value, read_domain

FORMAT = "swath odd 1"
WITHIN = (0.02, 0.5, 0.98)  # of the width of a bucket, where it is looked at: near both edges, in the middle
BUNDLED = Path(str(files("swath.data") / "odds"))
CLAIM = Claim(pass_rate=0.8, confidence=0.95)  # 14 runs without a failure for one cell


@dataclass(frozen=True, kw_only=True)
class Bound:
    """How swath makes and measures an attribute.

    key: of the scenario, which gets value * scale + offset
    unit: of the values here

    buckets: rising edges of a number
    values: of a category, the scenario keys and values each stands for

    exposure: share of the working time of each bucket or value, any sum; none = all alike

    met: quantity of a run (`swath.runtime.met`), in the same unit, that says what was driven; none = what was
        set holds all the way; alone: nothing sets the attribute, runs only measure whether they stay inside
        the ODD

    not_simulated: why swath cannot make it; such an attribute has nothing else
    """

    key: str = ""
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    buckets: list[float] = field(default_factory=list)
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    exposure: list[Annotated[float, Field(ge=0)]] = field(default_factory=list)
    met: str = ""
    not_simulated: str = ""

    def __post_init__(self) -> None:
        if self.not_simulated:
            if self.key or self.values or self.buckets or self.met:
                raise InputError("not_simulated", self.not_simulated, "expected nothing else beside it")
            return
        if not self.is_drawn and self.met and not self.buckets:
            self._check_met()
            return
        if bool(self.key) == bool(self.values):
            raise InputError("key", self.key or None, "expected `key`, `values`, `met` or `not_simulated`")
        if self.key and (len(self.buckets) < 2 or not all(a < b for a, b in pairwise(self.buckets))):
            raise InputError("buckets", self.buckets, "expected edges, at least two, each above the last")
        count = len(self.values) or len(self.buckets) - 1
        if self.exposure and (len(self.exposure) != count or not sum(self.exposure) > 0.0):
            raise InputError("exposure", self.exposure, f"expected {count} shares, one for each bucket")
        self._check_met()

    @property
    def is_drawn(self) -> bool:
        """True where it sets something."""
        return bool(self.key or self.values)

    @property
    def keys(self) -> list[str]:
        """The scenario keys that it sets."""
        return [self.key] if self.key else sorted({key for keys in self.values.values() for key in keys})

    def _check_met(self) -> None:
        if not self.met:
            return
        check_quantities([self.met])
        if self.unit != (unit := QUANTITIES[self.met].unit):
            raise InputError("unit", self.unit or None, f"expected {unit}, in which {self.met} is measured")


@dataclass(frozen=True, kw_only=True)
class OddFile:
    """The keys of a binding.

    openodd: the documents, beside it
    requirement: its identifier elsewhere, of the whole
    requirements: of others, the limits that stand for each; the others as in a test case
    """

    format: Literal["swath odd 1"]
    openodd: Annotated[list[str], Field(min_length=1)]
    objective: str
    source: str
    scenario: str
    expect: dict[str, Any]
    attributes: dict[str, Bound]
    requirement: str = ""
    requirements: dict[str, list[str]] = field(default_factory=dict)
    set: dict[str, Any] = field(default_factory=dict)
    claim: Claim = CLAIM
    tags: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Axis:
    """An attribute that is drawn: its buckets, in order. first: number of its first one among all buckets.

    labels: of the buckets
    edges: of a number, () for a category
    exposure: shares, sum 1
    """

    name: str
    bound: Bound
    first: int
    labels: tuple[str, ...]
    edges: tuple[float, ...]
    exposure: F64

    @property
    def layer(self) -> str:
        """Its group at the top of the taxonomy."""
        return self.name.partition(".")[0]

    @property
    def unit(self) -> str:
        """With a space before it, to follow a number; "" of what has none."""
        return "" if self.bound.unit in ("", "1") else f" {self.bound.unit}"

    @property
    def count(self) -> int:
        """How many buckets it has."""
        return len(self.labels)

    def value(self, bucket: int, share: float) -> Value:
        """A value of a bucket; share: of a number's bucket, 0 at its lower edge."""
        if not self.edges:
            return self.labels[bucket]
        low, high = self.edges[bucket], self.edges[bucket + 1]
        return min(high, max(low, float(f"{low + share * (high - low):.4g}")))

    def bucket_of(self, value: Value | None) -> int:
        """The bucket of a value, -1 for none; the last one holds its upper edge."""
        if not self.edges:
            return self.labels.index(str(value)) if str(value) in self.labels else -1
        if not isinstance(value, int | float) or not isfinite(value):
            return -1
        if not self.edges[0] <= value <= self.edges[-1]:
            return -1
        return min(int(np.searchsorted(self.edges, value, side="right")) - 1, self.count - 1)


@dataclass(frozen=True)
class Odd:
    """A bound ODD. name: of its file; document: the binding, for errors; path: its file."""

    name: str
    path: Path
    file: OddFile
    document: Document
    domain: Domain

    @cached_property
    def axes(self) -> list[Axis]:
        """The attributes that are drawn, in the order of the taxonomy."""
        found, first = [], 0
        for name in self.domain.attributes:
            bound = self.file.attributes.get(name)
            if bound is None or not bound.is_drawn:
                continue
            labels = tuple(bound.values) or tuple(f"{a:g} to {b:g}" for a, b in pairwise(bound.buckets))
            shares = np.array(bound.exposure or [1.0] * len(labels), dtype=float)
            axis = Axis(name, bound, first, labels, tuple(bound.buckets), shares / shares.sum())
            found.append(axis)
            first += axis.count
        return found

    @cached_property
    def watched(self) -> dict[str, str]:
        """Quantities of the attributes that runs only measure, by attribute."""
        return {n: b.met for n, b in self.file.attributes.items() if b.met and not b.is_drawn}

    @property
    def bucket_count(self) -> int:
        """Number of buckets of all axes together."""
        return sum(axis.count for axis in self.axes)

    @property
    def layers(self) -> list[str]:
        """Groups at the top of the taxonomy, in order."""
        return list(dict.fromkeys(a.layer for a in self.domain.attributes.values()))

    @cached_property
    def bucket_axis(self) -> list[tuple[Axis, int]]:
        """Axis of every bucket, and its number there."""
        return [(axis, bucket) for axis in self.axes for bucket in range(axis.count)]

    @cached_property
    def possible(self) -> Any:
        """Pairs of buckets that have a place inside the ODD, (n, n) of bool; diagonal: a bucket alone."""
        count = self.bucket_count
        out = np.zeros((count, count), dtype=bool)
        tried = [
            {axis.name: [axis.value(bucket, share) for share in (WITHIN if axis.edges else (0.0,))]}
            for axis, bucket in self.bucket_axis
        ]
        alone = [[{n: v} for n, vs in one.items() for v in vs if self.domain.holds({n: v})] for one in tried]
        for i, (axis, _) in enumerate(self.bucket_axis):
            out[i, i] = bool(alone[i])
            for j in range(i + 1, count):
                if self.bucket_axis[j][0] is not axis:
                    holds = any(self.domain.holds({**a, **b}) for a in alone[i] for b in alone[j])
                    out[i, j] = out[j, i] = holds
        return out

    def case_data(self) -> dict[str, Any]:
        """The test case that its runs belong to, as plain data; files by their absolute paths."""
        folder, file = self.path.parent.resolve(), self.file
        scenario = file.scenario
        if Path(scenario).suffix in (".yaml", ".yml"):
            scenario = str((folder / scenario).resolve())
        return {
            "format": CASE_FORMAT,
            "objective": file.objective,
            "source": file.source,
            "tags": list(file.tags),
            "scenario": scenario,
            "set": {key: from_beside(value, folder) for key, value in file.set.items()},
            "vary": {axis.name: _varied(axis) for axis in self.axes},
            "seeds": 1,
            "expect": file.expect,
            "claim": {"pass_rate": file.claim.pass_rate, "confidence": file.claim.confidence},
            "met": sorted({bound.met for bound in file.attributes.values() if bound.met}),
        }

    @cached_property
    def case(self) -> Case:
        """The same, checked. InputError for limits that are none."""
        return Case(self.name, checked(CaseFile, self.document, self.case_data()), self.document)

    def case_text(self) -> str:
        """The case as a file."""
        return dump(self.case_data())


def _varied(axis: Axis) -> dict[str, Any]:
    bound = axis.bound
    exposure = list(bound.exposure) or [1.0] * axis.count
    if bound.values:
        return {"at": [axis.labels[0]], "sets": bound.values, "exposure": exposure}
    shift = {"scale": bound.scale, "offset": bound.offset}
    more = {} if (bound.scale, bound.offset) == (1.0, 0.0) else shift
    ends = [axis.edges[0], axis.edges[-1]]
    return {
        "key": bound.key,
        "at": [axis.value(axis.count // 2, 0.5)],
        "range": ends,
        **more,
        "buckets": list(axis.edges),
        "exposure": exposure,
    }


def find_odd(source: str, key: str = "--odd") -> Path:
    """The file of a bound ODD: bundled by name, or a path. InputError where there is none."""
    bundled = {path.name.removesuffix(".odd.yaml"): path for path in sorted(BUNDLED.glob("*.odd.yaml"))}
    path = bundled.get(source, Path(source))
    if not os.path.exists(path):
        expected = f"expected a file or one of {', '.join(bundled)}{near_miss(source, list(bundled))}"
        raise InputError(key, source, expected)
    return path


def read_odd(path: Path) -> Odd:
    """A binding with its OpenODD documents. InputError with key, value, file and line."""
    document = read_document(path)
    document.kind = "ODD"
    if not isinstance(document.data, dict) or document.data.get("format") != FORMAT:
        given = document.data.get("format") if isinstance(document.data, dict) else None
        expected = f"expected `{FORMAT}`, a binding of OpenODD documents to scenario keys"
        raise document.error(("format",), given, expected)
    made: OddFile = checked(OddFile, document)
    _check_requirements(made, document)
    units = {name: bound.unit for name, bound in made.attributes.items()}
    domain = read_domain([path.parent / file for file in made.openodd], units)
    names = list(domain.attributes)
    for name, bound in made.attributes.items():
        where = ("attributes", name)
        if name not in domain.attributes:
            expected = f"expected an attribute of the taxonomy{near_miss(name, names)}"
            raise document.error(where, None, expected)
        values = domain.attributes[name].values
        if bound.is_drawn and sorted(values) != sorted(bound.values):
            known = ", ".join(values) or "none, it is a number: `key` and `buckets`"
            raise document.error((*where, "values"), list(bound.values) or None, f"expected {known}")
    odd = Odd(path.name.removesuffix(".yaml").removesuffix(".odd"), path, made, document, domain)
    if len(odd.axes) < 2:
        raise document.error(("attributes",), len(odd.axes), "expected two or more with a key or values")
    return odd


def _check_requirements(made: OddFile, document: Document) -> None:
    """InputError for a requirement without a limit, or with one that is not under `expect`."""
    found = limits_of(made.expect)
    known = list(dict.fromkeys([*(n for _, n in found), *(f"{m}.{n}" for m, n in found if m)]))
    for requirement, limits in made.requirements.items():
        where = ("requirements", requirement)
        if not limits:
            raise document.error(where, None, "expected the names of limits under `expect`")
        for name in limits:
            if name not in known and ("", name.rpartition(".")[2]) not in found:
                raise document.error(where, name, f"expected a limit under `expect`{near_miss(name, known)}")


def keys_set_twice(odd: Odd) -> list[tuple[str, str, str]]:
    """Keys that two attributes set, or an attribute and `set`: attribute, key, and who else sets it."""
    seen: dict[str, str] = dict.fromkeys(odd.file.set, "set")
    found = []
    for axis in odd.axes:
        for key in axis.bound.keys:
            if key in seen:
                found.append((axis.name, key, seen[key]))
            seen[key] = axis.name
    return found
