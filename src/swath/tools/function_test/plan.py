"""The plan of a function test: every run with its name, which says all that its result depends on.

The name is a SHA-256 (FIPS 180-4) of the scenario as it is resolved, the contents of every file that it or a
change of it names, the changes, the seed, and the code of this package. A result is found again under it
however often a plan is interrupted, and not found where anything has changed. What the runs of a plan are
called is written down when it is made: results are read, reported and judged by that, whatever has changed
since.
"""

import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

import swath
from swath.core.errors import InputError
from swath.core.foreign_code import Gate, present_gate, through
from swath.documents.contents import file_hash, hashes_by_path, with_contents
from swath.documents.validation import checked
from swath.documents.yaml_document import Document, parse_value
from swath.scenario.overrides import change_of, layered, says_about
from swath.scenario.scenario import Scenario, load_scenario
from swath.scenario.versions import SECTIONS
from swath.tools.function_test.candidates import EVERY
from swath.tools.function_test.case import Case, Point, Scalar, find_cases
from swath.tools.function_test.fidelity import CHEAP, chosen_level, scanners

AS_SET = "as set"  # level of scanners: what scenario and changes say, whether it can carry the limits or not
ID_LENGTH = 16  # hexadecimal digits: a clash in a million runs has a chance of 3e-8
CODE = (".py", ".cpp", ".yaml", ".json", ".npz", ".dbc", ".j2")


@dataclass(frozen=True)
class PlannedRun:
    """One run. scenario: bundled name or path; sets: changes, as after `--set`.

    shadows: candidates that go along in open loop, with their changes
    why_dear: why its scanner is at the dear level though the cheap one is asked for, "" where it is not
    met: quantities that are written down along its way
    """

    id: Annotated[str, Field(pattern=rf"^[0-9a-f]{{{ID_LENGTH}}}$")]
    case: str
    candidate: str
    point: Mapping[str, Scalar]
    seed: int
    scenario: str
    sets: Sequence[str]
    shadows: Mapping[str, Sequence[str]] = field(default_factory=dict)
    why_dear: str = ""
    met: Sequence[str] = ()

    @property
    def about(self) -> dict[str, Any]:
        """What its result says of it."""
        names = ("id", "case", "candidate", "point", "seed")
        return {name: getattr(self, name) for name in names} | {"point": dict(self.point)}


@dataclass(frozen=True)
class Plan:
    """Which runs there are. cases: sources of `find_cases`; candidates: changes of the scenario by name.

    seeds: of each case, None = its own
    drawn: points at random instead of the grid
    draw_seed: of them
    sets: changes of every scenario, after those of its case and before the candidate's
    shadow: the first candidate steers, the others go along in shadow
    level: of scanners, "" = those of the scenarios; the cheap one only where it can carry the limits, unless
        AS_SET
    points: (seed, point) of each run instead of all points with all seeds, as a search chose them
    chosen: the same, by case
    code: hash of the code that its results come from, "" = this
    made_of: of the files that it names, by path
    expects: limits of the cases when the plan was made, by case: they belong to the names of the runs; others
        = as the cases have them now
    """

    cases: str | tuple[str, ...]
    tags: tuple[str, ...] = ()
    candidates: Mapping[str, Sequence[str]] = field(default_factory=lambda: {"base": ()})
    seeds: int | None = None
    drawn: int = 0
    draw_seed: int = 1
    sets: tuple[str, ...] = ()
    shadow: bool = False
    level: str = ""
    points: tuple[tuple[int, Point], ...] = ()
    chosen: Mapping[str, tuple[tuple[int, Point], ...]] = field(default_factory=dict)
    code: str = ""
    expects: Mapping[str, Any] = field(default_factory=dict)
    made_of: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def found(self) -> list[Case]:
        """The cases that all candidates can be tried in."""
        return [case for case in find_cases(self.cases, self.tags) if case.name not in self.left_out]

    @cached_property
    def left_out(self) -> dict[str, str]:
        """Cases that a candidate cannot be tried in, and why; none where no case has what it changes."""
        cases = find_cases(self.cases, self.tags)
        lacks = {case.name: lack for case in cases if (lack := self._lack(case))}
        return lacks if len(lacks) < len(cases) else {}

    def _lack(self, case: Case) -> str:
        changes = [change_of(text, text) for sets in self.candidates.values() for text in sets]
        if not changes:
            return ""
        machines = _kinds_of(case)
        for _, path, value in changes:
            is_new = "machine" in (path[1:2] or (value if isinstance(value, dict) else ()))
            if path[0] == EVERY:
                count = sum(list(kinds.values()).count(str(path[1])) for kinds in machines.values())
                if count == 0 or (self.shadow and count > 1):
                    return f"{count or 'no'} parts of kind {path[1]} that could be replaced"
            elif not (path[0] in SECTIONS or path[0] in machines or is_new):
                return f"no machine {path[0]}"
        return ""

    def _placed(self, case: Case) -> dict[str, list[str]]:
        """Changes of the scenarios of a case by candidate: with the machines that it has."""

        def of(text: str) -> list[str]:
            key, equals, value = text.partition("=")
            machine, _, rest = key.partition(".")
            if machine != EVERY:
                return [text]
            kind = rest.partition(".")[0]
            inner = rest.removeprefix(kind)
            places = ((m, slot, k) for m, kinds in _kinds_of(case).items() for slot, k in kinds.items())
            return [f"{m}.{slot}{inner}{equals}{value}" for m, slot, k in places if k == kind]

        return {
            name: layered(self.sets, [one for text in sets for one in of(text)])
            for name, sets in self.candidates.items()
        }

    def runs(self) -> Iterator[PlannedRun]:
        """Every run, in order: case, seed, point, candidate, so that an early look has seen all points."""
        for case in self.found:
            base = _base(case, self.code or code_hash())
            changed = self._placed(case)
            contents = {name: _contents_of_sets(sets) for name, sets in changed.items()}
            for seed, point in (self._point_of(case, n) for n in range(self.counts[case.name])):
                own = case.sets(point, self.expects.get(case.name))
                at = {name: layered(own, sets) for name, sets in changed.items()}
                for name in self.steering:
                    more, why = self._level_at(case, at[name])
                    shadows = {other: layered(at[other], more) for other in at if other not in self.steering}
                    sets = layered(at[name], more)
                    content: list[Any] = [base, contents[name], *sets, f"seed={seed}"]
                    content += [[other, contents[other], *shadows[other]] for other in shadows]
                    content += [["met", *case.file.met]] if case.file.met else []
                    run_id = _sha(content)[:ID_LENGTH]
                    yield PlannedRun(
                        run_id, case.name, name, point, seed, case.scenario, sets, shadows, why, case.file.met
                    )

    @property
    def steering(self) -> list[str]:
        """Candidates that have runs of their own."""
        return list(self.candidates)[: 1 if self.shadow else None]

    @cached_property
    def counts(self) -> dict[str, int]:
        """How many runs each case has with one candidate."""
        sizes = {case.name: self.drawn or case.grid_size for case in self.found}
        if self.points or self.chosen:
            return {name: len(self.chosen.get(name, self.points)) for name in sizes}
        return {case.name: sizes[case.name] * len(self._seeds_of(case)) for case in self.found}

    def _point_of(self, case: Case, place: int) -> tuple[int, Point]:
        """Seed and point of one of the runs of a case with each candidate, 0 <= place < its count."""
        if points := self.chosen.get(case.name, self.points):
            seed, point = points[place]
            return seed, {name: point[name] for name in case.file.vary}  # a file keeps no order
        of_seed, number = divmod(place, self.drawn or case.grid_size)
        seed = self._seeds_of(case)[of_seed]
        return seed, case.drawn_point(number, self.draw_seed) if self.drawn else case.grid_point(number)

    def _seeds_of(self, case: Case) -> Sequence[int]:
        return case.seeds if self.seeds is None else range(1, self.seeds + 1)

    def _level_at(self, case: Case, sets: Sequence[str]) -> tuple[list[str], str]:
        """Changes for the level at which a run is judged, and why that is the dear one, if so."""
        if self.level == AS_SET:
            return [], ""
        if not self.level and not any(CHEAP in text for text in sets) and not _is_cheap(case.scenario):
            return [], ""
        try:
            return chosen_level(looked_at(case.scenario, sets), self.level)
        except InputError:  # told as the result of the run
            return [], ""

    def check(self, file: Path | None = None) -> None:
        """Raise InputError where the scenario of the first point of a case cannot be read, or a change is of
        what a case varies. file: that names the candidates.
        """
        for case in self.found:
            for name, changed in self._placed(case).items():
                sets = self.candidates[name]
                for varied in case.file.vary.values():
                    for text in changed:
                        if key_of := next((key for key in varied.keys if says_about(text, key)), ""):
                            expected = f"expected another key, {case.name} varies {key_of}"
                            raise InputError(f"--set {text}", None, expected)
                try:
                    point = self._point_of(case, 0)[1]
                    load_scenario(case.scenario, sets=layered(case.sets(point), changed))
                except InputError as error:
                    where = f"{case.name}, candidate {name}: {error.key}"
                    source = self._source(error, sets, file) or case.document.file
                    raise InputError(where, error.value, error.expected, file=source) from error

    def _source(self, error: InputError, sets: Sequence[str], file: Path | None) -> Path | str | None:
        """Where a change of a candidate or of all scenarios stands that is refused; None for any other."""
        key = str(error.file).partition("=")[0]
        for changes, place in ((sets, file or error.file), (self.sets, error.file)):
            if any(key == f"--set {text.partition('=')[0]}" for text in changes):
                return place
        return None

    @property
    def named(self) -> list[Any]:
        """What it says, with the files that its scenarios, cases and candidates name."""
        changes = [parse_value(text.partition("=")[2], text)
                   for sets in (self.sets, *self.candidates.values()) for text in sets]  # fmt: skip
        return [changes, [[case.scenario, _named_by(case)] for case in self.found]]

    def text_in(self, folder: Path) -> str:
        """As it stands in plan.json, with the code that it was made with; a case in the folder by its name.

        The candidates keep their order, of which the first one may steer.
        """
        expects = {case.name: self.expects.get(case.name, case.file.expect) for case in self.found}
        plain = {"format": "swath test plan 1", **asdict(self), "expects": expects}
        plain["made_of"] = hashes_by_path(self.named)
        plain["code"] = self.code or code_hash()
        if isinstance(self.cases, str) and Path(self.cases).parent == folder.resolve():
            plain["cases"] = Path(self.cases).name
        return json.dumps(plain, indent=2) + "\n"


def plan_of(data: Mapping[str, Any], *, same_code: bool = True) -> Plan:
    """The plan that `text` says. same_code: InputError where it was made with other code."""
    if same_code and data.get("code") != code_hash():
        expected = "expected results of this version of swath; `swath test report` still shows these"
        raise InputError("plan.json", data.get("code"), expected)
    keys = {f.name: data[f.name] for f in fields(Plan) if f.name in data}
    checked(Plan, Document(data, Path("plan.json"), kind="plan"), keys)
    points = tuple((seed, point) for seed, point in data.get("points", ()))
    return Plan(**{**keys, "tags": tuple(data["tags"]), "sets": tuple(data["sets"]), "points": points})


def _kinds_of(case: Case) -> Mapping[str, Mapping[str, str]]:
    """For each machine of a case's scenario: the kind of each slot whose part works on what is measured."""
    return _kinds_in(case.scenario, tuple(f"{key}={json.dumps(value)}" for key, value in case.fixed.items()))


@cache
def _kinds_in(scenario: str, fixed: tuple[str, ...]) -> Mapping[str, Mapping[str, str]]:
    found = looked_at(scenario, fixed).machines
    return {
        name: {slot: choice.kind.name for slot, choice in machine.slots.items() if choice.level != "truth"}
        for name, machine in found.items()
    }


@cache
def _is_cheap(scenario: str) -> bool:
    return bool(scanners(looked_at(scenario), CHEAP))


def looked_at(scenario: str, sets: Sequence[str] = ()) -> Scenario:
    """The scenario without its code: what a run is called must not depend on what may run."""
    with through(Gate(leaves=True, copies=present_gate().copies)):
        return load_scenario(scenario, sets=sets)


@cache
def code_hash() -> str:
    """SHA-256 of what this package consists of."""
    root = Path(swath.__file__).parent
    files = sorted(p for p in root.rglob("*") if p.suffix in CODE and "__pycache__" not in p.parts)
    return _sha(f"{p.relative_to(root).as_posix()} {file_hash(p)}" for p in files)


@cache
def commit() -> str:
    """Commit of the git checkout that this package lies in, `-dirty` behind it with changes; "" = none."""
    root, git = Path(swath.__file__).parent, shutil.which("git")
    if git is None or not any(os.path.exists(folder / ".git") for folder in root.parents):
        return ""
    tracked = [git, "-C", str(root), "ls-files", "--error-unmatch", "__init__.py"]
    if subprocess.run(tracked, capture_output=True, check=False).returncode:
        return ""
    asked = [git, "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    return subprocess.run(asked, capture_output=True, check=False, text=True).stdout.strip()


def _base(case: Case, code: str) -> str:
    """Hash of a case's scenario and of what it names."""
    return _sha([code, json.dumps(with_contents(_named_by(case)), sort_keys=True, default=str)])


def _named_by(case: Case) -> list[Any]:
    """A case's scenario and what it varies, with the files that they name."""
    fixed = [f"{key}={json.dumps(value)}" for key, value in case.fixed.items()]
    try:
        scenario = looked_at(case.scenario, fixed)
    except InputError as error:
        raise InputError(
            f"{case.name}: {error.key}", error.value, error.expected, file=case.document.file
        ) from error
    return [scenario.plain(), *(case.at(varied.sets) for varied in case.file.vary.values())]


def _contents_of_sets(sets: Sequence[str]) -> str:
    return _sha(with_contents(parse_value(text.partition("=")[2], text)) for text in sets)


def _sha(parts: Any) -> str:
    whole = hashlib.sha256()
    for part in parts:
        text = part if isinstance(part, str) else json.dumps(part)
        whole.update(f"{len(text)} {text}".encode())
    return whole.hexdigest()
