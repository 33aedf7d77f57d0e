"""The code that a scenario brings along: Python files, FMUs, systems of FMUs."""

from pathlib import Path

from swath.core.foreign_code import NamesCode, file_of
from swath.scenario.resolved import LevelChoice
from swath.scenario.scenario import Scenario


def code_of(scenario: Scenario) -> list[Path]:
    """Files with code that a scenario names, without crop habits, which data sheets name."""
    base = scenario.file.parent if scenario.file is not None else Path.cwd()
    choices: list[LevelChoice | None] = [scenario.field.terrain, scenario.field.stand]
    choices += [choice for machine in scenario.machines.values() for choice in machine.slots.values()]
    choices += [choice for _, choice in scenario.realtime.cheaper] if scenario.realtime is not None else []
    references = [r for choice in choices if choice is not None for r in _named(choice)]
    return list(dict.fromkeys(file_of(r, base) for r in (*references, *scenario.evaluators)))


def _named(choice: LevelChoice) -> list[str]:
    own = [choice.level] if ".py:" in choice.level else []
    return [*own, *choice.params.foreign_code] if isinstance(choice.params, NamesCode) else own
