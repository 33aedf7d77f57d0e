"""The code that a scenario brings along: Python files, FMUs, systems of FMUs."""

from collections.abc import Iterator
from pathlib import Path

from swath.core.foreign_code import NamesCode, file_of, is_allowed
from swath.scenario.resolved import LevelChoice
from swath.scenario.scenario import Scenario


def code_of(scenario: Scenario) -> list[Path]:
    """Files with code that a scenario names, without crop habits, which data sheets name."""
    references = [r for _, choice in _choices(scenario) for r in _named(choice)]
    references += [reference for reference in scenario.evaluators if ".py:" in reference]
    return list(dict.fromkeys(file_of(reference, _base(scenario)) for reference in references))


def slots_without_code(scenario: Scenario) -> list[str]:
    """Full names of the slots that can be made with what may run."""
    base = _base(scenario)
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


def _base(scenario: Scenario) -> Path:
    return scenario.file.parent if scenario.file is not None else Path.cwd()


def _named(choice: LevelChoice) -> list[str]:
    own = [choice.level] if ".py:" in choice.level else []
    return [*own, *choice.params.foreign_code] if isinstance(choice.params, NamesCode) else own
