"""Scenario files: what runs where, at which level, and which limits it must keep.

    scenario = load_scenario("laser-pilot", sets=["combine.lidar.rate_hz=50"])
    scenario.machines["combine"].slots["lidar"].params

Reading checks everything that can be known without building the field. Every error names the key, its value,
what was expected, the file and the line.

`code_of` is what a scenario brings along of code; `find_slots` takes slots by the names that people type.
"""

import dataclasses
import html
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from swath.core.asked import unasked
from swath.core.errors import InputError, absence_of, shortened
from swath.core.foreign_code import Gate, NamesCode, file_of, is_allowed, present_gate
from swath.documents.data_sheets import expected_name, find_sheet, sheet_names
from swath.documents.yaml_document import Document, dump, key_path, parse, read_document
from swath.scenario.expectations import plain_expect
from swath.scenario.overrides import apply_overrides
from swath.scenario.reader import read_sections
from swath.scenario.resolved import Expectation, FieldSection, LevelChoice, MachineSection, RealTimeSection
from swath.scenario.sections import LONGEST_SUMMARY, Run
from swath.scenario.slots import CATALOGUE, Catalogue
from swath.scenario.versions import FORMAT, lift_machines

UNTOLD = {"expect", "evaluators", "name", "run.record"}  # changes that change nothing of what is driven


@dataclass(frozen=True, eq=False)
class Scenario:
    """A validated scenario. Two are equal when they would be written the same.

    expect: limits on metrics and columns
    evaluators: its own, `/path/file.py:Class`
    gate: which code might run where it was read, and may where it is run
    """

    name: str
    summary: str
    seed: int
    run: Run
    field: FieldSection
    machines: Mapping[str, MachineSection]
    expect: tuple[Expectation, ...]
    evaluators: tuple[str, ...] = ()
    realtime: RealTimeSection | None = None
    document: Document = dataclasses.field(default_factory=lambda: Document(None), repr=False)
    gate: Gate = dataclasses.field(default_factory=present_gate, repr=False)

    def __repr__(self) -> str:
        machines = ", ".join(self.machines)
        return f"<scenario {self.name}, seed {self.seed}: {machines}; .resolved() is all of it>"

    @property
    def file(self) -> Path | None:
        """File that it was read from."""
        return self.document.file

    @property
    def field_seed(self) -> int:
        """Seed of terrain and stand."""
        own = self.field.common.seed
        return self.seed if own is None else own

    @property
    def is_paced(self) -> bool:
        """True when it is to run in step with the clock on the wall."""
        return self.realtime is not None and self.realtime.common.pace == "real_time"

    def _repr_html_(self) -> str:
        """HTML for a notebook: what it is, and all of it to unfold."""
        text = html.escape(self.resolved())
        return f"<details><summary>{html.escape(repr(self))}</summary><pre>{text}</pre></details>"

    @unasked
    def plain(self) -> dict[str, Any]:
        """Plain data with every default filled in and every path absolute."""
        return {
            "format": FORMAT,
            "name": self.name,
            "summary": self.summary,
            "seed": self.seed,
            "run": self.run.model_dump(mode="json"),
            **({} if self.realtime is None else {"realtime": self.realtime.plain()}),
            "field": self.field.plain(),
            "machines": {name: machine.plain() for name, machine in self.machines.items()},
            **({"evaluators": list(self.evaluators)} if self.evaluators else {}),
            "expect": plain_expect(self.expect, self.machines),
        }

    def lifted(self) -> dict[str, Any]:
        """As `plain`, with the machines beside the sections, as keys of `--set` have them."""
        plain = self.plain()
        del plain["format"]
        return {**{k: v for k, v in plain.items() if k != "machines"}, **plain["machines"]}

    def resolved(self) -> str:
        """YAML text of the whole scenario; reading it again gives an equal scenario."""
        return self._text

    @cached_property
    def _text(self) -> str:
        return dump(self.plain())

    def locate(self, error: InputError) -> InputError:
        """The same error with the file and line of its key, when the key can be found in the scenario.

        A key may be full (`combine.lidar.mount.z_m`) or the end of one (`lidar.mount.z_m`).
        """
        if error.file is not None or error.key.startswith("-"):  # of a flag
            return error
        parts = key_path(error.key)
        places = self.document.places
        for end in range(len(parts), 0, -1):
            if parts[:end] in places:
                return self.document.error(parts, error.value, error.expected)
            tails = [p for p in places if len(p) > end and p[-end:] == parts[:end]]
            if len(tails) == 1:
                return self.document.error((*tails[0], *parts[end:]), error.value, error.expected)
        return InputError(error.key, error.value, error.expected, file=self.file)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scenario) and self.plain() == other.plain()

    __hash__ = None  # type: ignore[assignment]


def load_scenario(
    source: str | Path,
    *,
    sets: Sequence[str] = (),
    flags: Mapping[str, str] | None = None,
    catalogue: Catalogue = CATALOGUE,
) -> Scenario:
    """Read a bundled scenario by name, a file, or the scenario in a run folder.

    sets: overrides such as `combine.lidar.rate_hz=50`; flags: overrides that errors call otherwise, such as
    {"--seed 3": "seed=3"}. Raises InputError: the first thing that is wrong; its `others` are the rest.
    """
    return read_scenario(read_document(find_scenario(source)), sets=sets, flags=flags, catalogue=catalogue)


def parse_scenario(
    text: str, *, base: Path | None = None, sets: Sequence[str] = (), catalogue: Catalogue = CATALOGUE
) -> Scenario:
    """Read a scenario from text; paths in it are relative to the folder `base`."""
    file = None if base is None else base / "scenario.yaml"
    return read_scenario(parse(text, "text", file), sets=sets, catalogue=catalogue)


def read_scenario(
    document: Document,
    *,
    sets: Sequence[str] = (),
    flags: Mapping[str, str] | None = None,
    catalogue: Catalogue = CATALOGUE,
) -> Scenario:
    """Check a document and make the scenario."""
    document = lift_machines(document)
    changes = [*sets, *(flags or {}).values()]
    apply_overrides(document, sets, catalogue, flags or {})
    made = Scenario(document=document, **read_sections(document, catalogue))
    return dataclasses.replace(made, summary=_headline(made, changes))


def _headline(made: Scenario, changes: Sequence[str]) -> str:
    """What is run, in a line: what its author says of it, or its name with what is changed."""
    keys = [text.partition("=")[0].strip().removeprefix("machines.") for text in changes]
    if "summary" in keys or not set(keys) - UNTOLD:
        return made.summary
    start, changed = f"{made.name} with ", changes_in(made.name, made.summary)
    before = changed.split("; ") if changed else []
    kept = [text for text in before if text.partition("=")[0] not in keys]
    changes_text = [f"{key}={text.partition('=')[2].strip()}" for key, text in zip(keys, changes, strict=True)
            if key not in UNTOLD]  # fmt: skip
    return shortened(start + "; ".join(sorted({*kept, *changes_text})), LONGEST_SUMMARY)


def changes_in(name: str, summary: str) -> str:
    """What a head line says of the changes of a scenario, `seed=3; run.distance_m=6`; "" = none."""
    start = f"{name} with "
    return summary.removeprefix(start) if summary.startswith(start) else ""


def scenario_names() -> list[str]:
    """Names of the bundled scenarios."""
    return sheet_names("scenarios")


def find_scenario(source: str | Path) -> Path:
    """Path of a scenario: a bundled one's name, a file, or a run folder that holds one.

    A bundled name is the bundled scenario, whatever lies in the working directory; `./straight` is a folder.
    """
    path = Path(source)
    try:
        if isinstance(source, str) and source in scenario_names():
            return find_sheet("scenarios", source)
        if os.path.isdir(path) and os.path.isfile(path / "scenario.yaml"):
            return path / "scenario.yaml"
        if os.path.exists(path) and not os.path.isdir(path):
            return path
        is_name = path.suffix not in (".yaml", ".yml") and len(path.parts) == 1 and not os.path.isdir(path)
        if isinstance(source, str) and is_name:
            return find_sheet("scenarios", source)
    except (InputError, OSError, ValueError):
        raise InputError("scenario", str(source), expected_name("scenarios", str(source))) from None
    what = absence_of(path, "there is no such file")
    if os.path.isdir(path):
        what = f"expected a run folder, {absence_of(path / 'scenario.yaml', 'it has no scenario.yaml')}"
    raise InputError("scenario", str(source), what)


@unasked
def code_of(scenario: Scenario) -> list[Path]:
    """Files with code that a scenario names, without crop habits, which data sheets name."""
    references = [r for _, choice in _choices(scenario) for r in _named(choice)]
    references += [reference for reference in scenario.evaluators if ".py:" in reference]
    return list(dict.fromkeys(file_of(reference, folder_of(scenario)) for reference in references))


def slots_without_code(scenario: Scenario) -> list[str]:
    """Full names of the slots that can be made with what may run."""
    base = folder_of(scenario)
    slots = [(f"{m.name}.{slot}", c) for m in scenario.machines.values() for slot, c in m.slots.items()]
    return [name for name, choice in slots if all(is_allowed(r, base) for r in _named(choice))]


def _choices(scenario: Scenario) -> Iterator[tuple[str, LevelChoice]]:
    """Every level that a scenario chose, with its key."""
    for name, ground in (("field.terrain", scenario.field.terrain), ("field.stand", scenario.field.stand)):
        if ground is not None:
            yield name, ground
    for machine in scenario.machines.values():
        yield from ((f"{machine.name}.{slot}", choice) for slot, choice in machine.slots.items())
    if scenario.realtime is not None:
        yield from scenario.realtime.cheaper


def folder_of(scenario: Scenario) -> Path:
    """The folder that paths in a scenario start from."""
    return scenario.file.parent if scenario.file is not None else Path.cwd()


def _named(choice: LevelChoice) -> list[str]:
    own = [choice.level] if ".py:" in choice.level else []
    return [*own, *choice.params.foreign_code] if isinstance(choice.params, NamesCode) else own


def slot_names(scenario: Scenario) -> tuple[str, ...]:
    """Full names of all slots of machines, in the order in which they run: `combine.process`."""
    return tuple(f"{m.name}.{slot}" for m in scenario.machines.values() for slot in m.slots)


def find_slots(scenario: Scenario, wanted: Sequence[str], *, key: str) -> tuple[str, ...]:
    """Full names in the order in which they run. `process` will do where there is one machine.

    key: what the user wrote them under. InputError where there is no such slot, or none is named.
    """
    there = slot_names(scenario)
    found = set()
    for slot in wanted:
        full = [name for name in there if slot in (name, name.rpartition(".")[2])]
        if len(full) != 1:
            raise InputError(key, slot, f"expected one of {', '.join(there)}")
        found.add(full[0])
    if not found:
        raise InputError(key, None, f"expected one or more of {', '.join(there)}")
    return tuple(name for name in there if name in found)


def short_names(scenario: Scenario) -> dict[str, str]:
    """Full name -> the name without its machine, where there is only one."""
    is_one = len(scenario.machines) == 1
    return {name: name.partition(".")[2] if is_one else name for name in slot_names(scenario)}
