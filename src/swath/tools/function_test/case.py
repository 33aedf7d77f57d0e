"""Test cases as files: a scenario, what varies in it, what is expected of each run and of all together.

The words are those of ISO 34505: a test case has an identifier (the name of its file), an objective, inputs,
a platform and an expected result.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from itertools import pairwise
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from swath.core import foreign_code
from swath.core.errors import InputError, near_miss
from swath.core.process.shell import command
from swath.core.random import Stream
from swath.documents.validation import checked
from swath.documents.yaml_document import Document, read_mapping
from swath.runtime.met import check_quantities
from swath.scenario.overrides import layered
from swath.scenario.sections import Bounds
from swath.scenario.slots import CATALOGUE as SLOTS
from swath.scenario.versions import READ_BY

SUFFIXES = (".py", ".yaml", ".fmu", ".onnx", ".csv", ".npz")  # of files that a case or a candidate names
FORMAT = "swath test case 1"
MOST_RUNS = 1_000_000
CATALOGUE = Path(str(files("swath.data") / "tests"))
Scalar = str | float | int | bool
Point = Mapping[str, Scalar]


@dataclass(frozen=True, kw_only=True)
class Varied:
    """A parameter.

    key: of the scenario, as after `--set`
    at: the values of the grid, without them the ends of the range, or the names of `sets`
    range: of values drawn
    estimate: whether the range is the band of a key that is an estimate (`swath levels SLOT`)

    scale, offset: the key gets value * scale + offset
    sets: instead of a key, by value, the scenario keys and values that it stands for

    exposure: share of the working time of each bucket of the range, or where there is none of each of `sets`
        or values of `at`, any sum; none = all alike
    buckets: rising edges, none = equal parts of the range. Only `swath test estimate` draws by it.
    """

    key: str = ""
    at: Annotated[list[Scalar], Field(min_length=1)] = field(default_factory=list)
    range: tuple[float, float] | None = None
    estimate: bool = False
    scale: float = 1.0
    offset: float = 0.0
    sets: dict[str, dict[str, Any]] = field(default_factory=dict)
    exposure: list[Annotated[float, Field(ge=0)]] = field(default_factory=list)
    buckets: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.estimate:
            object.__setattr__(self, "range", SLOTS.estimate_of(self.key))
        if self.range is not None and not self.range[0] < self.range[1]:
            raise InputError("range", list(self.range), "expected two numbers, the lower one first")
        if not self.at:
            object.__setattr__(self, "at", list(self.range or self.sets))
        if not self.at:
            expected = "expected the values of the grid, as [0.5, 1.5], or a range, as `range: [0.5, 1.5]`"
            raise InputError("at", None, expected)
        self._check_exposure()
        if bool(self.key) == bool(self.sets):
            raise InputError("key", self.key or None, "expected a key, or `sets`, keys by value")
        if self.sets and (self.range is not None or not set(map(str, self.at)) <= set(self.sets)):
            raise InputError("at", list(self.at), f"expected names of sets: {', '.join(self.sets)}")

    @property
    def drawn_values(self) -> list[Scalar]:
        """What is drawn by its exposure where there is no range."""
        return list(self.sets) if self.sets and self.exposure else self.at

    def _check_exposure(self) -> None:
        edges = self.buckets
        if edges and (self.range is None or (edges[0], edges[-1]) != tuple(self.range)):
            raise InputError("buckets", edges, "expected edges from the lower to the upper end of `range`")
        if edges and not all(a < b for a, b in pairwise(edges)):
            raise InputError("buckets", edges, "expected edges, each above the last")
        count = len(edges) - 1 if edges else len(self.exposure) if self.range else len(self.drawn_values)
        if self.exposure and (len(self.exposure) != count or not sum(self.exposure) > 0.0):
            raise InputError("exposure", self.exposure, f"expected {count} shares, one above 0 at least")

    @property
    def keys(self) -> list[str]:
        """The scenario keys that it changes."""
        return [self.key] if self.key else sorted({key for keys in self.sets.values() for key in keys})

    def at_value(self, value: Scalar) -> dict[str, Any]:
        """Scenario keys and values at one of its values."""
        if self.sets:
            return self.sets[str(value)]
        if isinstance(value, str | bool) or (self.scale, self.offset) == (1.0, 0.0):
            return {self.key: value}
        return {self.key: float(f"{value * self.scale + self.offset:.6g}")}


@dataclass(frozen=True, kw_only=True)
class Claim:
    """What all runs together shall show: at least this share of runs passes, with this confidence."""

    pass_rate: Annotated[float, Field(gt=0, lt=1)] = 0.95
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95


@dataclass(frozen=True, kw_only=True)
class Known:
    """A failure that is known.

    at: values, or ranges [least, greatest], of the parameters that it happens at, {} = everywhere; why
    """

    why: str
    at: dict[str, Scalar | tuple[float, float]] = field(default_factory=dict)

    def holds_at(self, point: Point) -> bool:
        """True where a point has these values, or lies in the ranges, whose ends belong to them."""
        return all(_holds(value, point.get(name)) for name, value in self.at.items())


@dataclass(frozen=True, kw_only=True)
class CaseFile:
    """The keys of a case file.

    set: scenario keys and values
    seeds: their number, or themselves
    expect: as in a scenario, for each run
    mean: bounds of the mean over the runs, by metric
    met: quantities that are written down along the way of each run (`swath.runtime.met`)
    """

    format: Literal["swath test case 1"]
    objective: str
    source: str
    scenario: str
    expect: dict[str, Any]
    set: dict[str, Any] = field(default_factory=dict)
    vary: dict[str, Varied] = field(default_factory=dict)
    seeds: Annotated[int, Field(ge=1, le=100_000)] | list[int] = 3
    claim: Claim = Claim()
    mean: dict[str, Bounds] = field(default_factory=dict)
    tags: list[str] = field(default_factory=list)
    known: list[Known] = field(default_factory=list)
    met: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        check_quantities(self.met)


@dataclass(frozen=True)
class Case:
    """A test case. name: of its file, without the suffix; document: what was read, for errors."""

    name: str
    file: CaseFile
    document: Document

    @property
    def seeds(self) -> Sequence[int]:
        """Seeds of the scenario, each run at every point."""
        seeds = self.file.seeds
        return range(1, seeds + 1) if isinstance(seeds, int) else seeds

    @property
    def scenario(self) -> str:
        """Name of a bundled scenario, or an absolute path."""
        source = self.file.scenario
        beside = (self.document.file or Path()).parent / source
        return str(beside.resolve()) if beside.suffix in (".yaml", ".yml") else source

    @property
    def grid_size(self) -> int:
        """How many combinations the values of all parameters have."""
        return prod(len(varied.at) for varied in self.file.vary.values())

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Parameters that have a range."""
        return {name: varied.range for name, varied in self.file.vary.items() if varied.range is not None}

    def grid_point(self, number: int) -> dict[str, Scalar]:
        """One combination, 0 <= number < grid_size; the last parameter changes fastest."""
        values: list[Scalar] = []
        for varied in reversed(self.file.vary.values()):
            number, place = divmod(number, len(varied.at))
            values.append(varied.at[place])
        return dict(zip(self.file.vary, reversed(values), strict=True))

    def grid(self) -> list[dict[str, Scalar]]:
        """Every combination of the values of all parameters."""
        return [self.grid_point(number) for number in range(self.grid_size)]

    def drawn_point(self, number: int, seed: int) -> dict[str, Scalar]:
        """A point at random: uniform in the ranges, one of the values where a parameter has no range.

        It depends on the case's name, the seed and its number alone, not on how many are drawn.
        """
        rng = Stream(seed, f"function test {self.name}").at(number)
        return {name: _draw(varied, rng) for name, varied in self.file.vary.items()}

    def drawn(self, count: int, seed: int) -> list[dict[str, Scalar]]:
        """The first points at random."""
        return [self.drawn_point(number, seed) for number in range(count)]

    @cached_property
    def fixed(self) -> dict[str, Any]:
        """Keys and values of the scenario at every point; files beside the case by their absolute paths."""
        found: dict[str, Any] = self.at(self.file.set)
        return found

    def at(self, value: Any) -> Any:
        """A value with files beside the case by their absolute paths."""
        return from_beside(value, (self.document.file or Path()).parent)

    def sets(self, point: Point, expect: Mapping[str, Any] | None = None) -> list[str]:
        """Changes of the scenario at a point, as after `--set`. expect: instead of the case's own limits."""
        fixed = {**self.fixed, "expect": self.file.expect if expect is None else expect}
        changes = [self.file.vary[name].at_value(value) for name, value in point.items()]
        varied = {key: value for change in changes for key, value in self.at(change).items()}
        return layered(*([f"{k}={json.dumps(v)}" for k, v in keys.items()] for keys in (fixed, varied)))

    def known(self, point: Point) -> str:
        """Why a failure at a point is known; "" where it is not."""
        return next((k.why for k in self.file.known if k.holds_at(point)), "")


def _holds(known: Scalar | tuple[float, float], value: Scalar | None) -> bool:
    if not isinstance(known, list | tuple):
        return known == value
    return isinstance(value, int | float) and known[0] <= value <= known[1]


def _draw(varied: Varied, rng: np.random.Generator) -> Scalar:
    if varied.range is None:
        return varied.at[int(rng.integers(len(varied.at)))]
    low, high = varied.range
    return float(f"{rng.uniform(low, high):.4g}")


def read_case(path: Path) -> Case:
    """A case file. Raises InputError with key, value, file and line; its `others` are what else is wrong."""
    document = read_mapping(path, "test case")
    if (written := document.data.get("format")) != FORMAT:
        command = READ_BY.get(written) if isinstance(written, str) else None
        expected = f"expected a test case; this file is for: {command}" if command else f"expected `{FORMAT}`"
        raise document.error(("format",), written, expected)
    case = Case(path.stem, checked(CaseFile, document), document)
    runs = case.grid_size * len(case.seeds)
    if runs > MOST_RUNS:
        raise document.error(("vary",), runs, f"expected at most {MOST_RUNS} runs, values by seeds")
    for index, known in enumerate(case.file.known):
        for name in known.at:
            if name not in case.file.vary:
                expected = f"expected a parameter of vary{near_miss(name, list(case.file.vary))}"
                raise document.error(("known", index, "at", name), None, expected)
    return case


def limits_of(expect: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The limits under `expect`: machine or `field`, "" where none is named, and name of the metric."""
    found: list[tuple[str, str]] = []
    for name, limit in expect.items():
        of_machine = isinstance(limit, dict) and all(isinstance(own, dict | list) for own in limit.values())
        found += [(name, inner) for inner in limit] if of_machine else [("", name)]
    return found


def source_of(case: str | Path) -> str:
    """A case, or cases, by name or by whole path, so that a folder can be gone on with anywhere."""
    return str(Path(case).resolve()) if os.path.exists(Path(case)) else str(case)


def one_case(source: str, limit: str = "", expected: str = "expected one case") -> Case:
    """The one case of a source. limit: "", or the name of one that it has. InputError for another."""
    cases = find_cases(source)
    if len(cases) != 1:
        raise InputError("case", source, f"{expected}, there are {len(cases)}")
    (case,) = cases
    names = [name for _, name in limits_of(case.file.expect)]
    if limit and limit not in names:
        expected = f"expected one of {', '.join(names)}{near_miss(limit, names)}"
        raise InputError("--limit", limit, expected, file=case.document.file)
    return case


def find_cases(source: str | Sequence[str], tags: Sequence[str] = ()) -> list[Case]:
    """Cases by name: `catalogue` for all that are bundled, one of them, a case file, or a folder of them; of
    several sources each case once.

    tags: only cases that have one of these. Raises InputError when there is none, or two have a name.
    """
    sources = [source] if isinstance(source, str) else source
    cases = [read_case(path) for path in dict.fromkeys(path for each in sources for path in _paths(each))]
    names = [case.name for case in cases]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise InputError("cases", twice, "expected cases with different names")
    chosen = [case for case in cases if not tags or set(tags) & set(case.file.tags)]
    if not chosen:
        have = sorted({tag for case in cases for tag in case.file.tags})
        raise InputError(
            "--only", ", ".join(tags), f"no case has this tag; there are {', '.join(have) or 'none'}"
        )
    return chosen


def _paths(source: str) -> list[Path]:
    bundled = {path.stem: path for path in sorted(CATALOGUE.glob("*.yaml"))}
    if source == "catalogue":
        return list(bundled.values())
    if source in bundled:
        return [bundled[source]]
    path = Path(source)
    if path.suffix == ".py":
        how = command("test", "run", "bend", "--set", f"combine.edge.level={source}:Class", "--out", "DIR")
        raise InputError(
            "cases", source, f"expected cases; a part of your own goes into them by --set: {how}"
        )
    if os.path.isdir(path):
        found = sorted(path.glob("*.yaml"))
        if not found:
            raise InputError("cases", source, "expected a folder with case files, *.yaml")
        return found
    if os.path.exists(path):
        return [path]
    names = ["catalogue", *bundled]
    raise InputError(
        "cases", source, f"expected a file, a folder or one of {', '.join(names)}{near_miss(source, names)}"
    )


def from_beside(value: object, folder: Path) -> object:
    """A value of a scenario key, files in a folder (`mine.py:Detector`) as absolute paths."""
    if isinstance(value, dict):
        return {key: from_beside(inner, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [from_beside(inner, folder) for inner in value]
    if isinstance(value, str):
        file, colon, name = value.partition(":")
        if file.endswith(SUFFIXES) and os.path.isfile(foreign_code.source_of(folder / file)):
            return f"{(folder / file).resolve()}{colon}{name}"
    return value
