"""Every level of every slot states a tolerance, and has it held in this folder."""

import re
from pathlib import Path

import pytest

from swath.scenario.slots import CATALOGUE
from tests.levels.limits import LIMITS

FOLDER = Path(__file__).parent
SLOTS = sorted(CATALOGUE.registry.packages)


@pytest.mark.parametrize("slot", SLOTS)
def test_every_level_states_a_tolerance_that_has_a_number_here(slot):
    names = CATALOGUE.registry.names(slot)
    assert set(LIMITS.get(slot, ())) == set(names)
    for name in names:
        assert LIMITS[slot][name].said in CATALOGUE.registry.get(slot, name).tolerance


def test_every_slot_has_a_case():
    text = "\n".join(p.read_text(encoding="utf-8") for p in FOLDER.glob("test_*.py"))
    assert set(re.findall(r'^@each_level\("(\w+)"\)', text, re.MULTILINE)) == set(SLOTS)


def test_levels_of_any_slot_state_theirs():
    for name in CATALOGUE.registry.links():
        assert len(CATALOGUE.registry.get("steer", name).tolerance) > 10
