"""Slots of a scenario by the names that people type."""

from collections.abc import Sequence

from swath.core.errors import InputError
from swath.scenario.scenario import Scenario


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
