"""A machine that threshes nothing."""

import pytest

from swath.core.errors import InputError
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import load_machine
from swath.scenario.slots import CATALOGUE
from tests.machine.machine_fakes import site


@pytest.mark.parametrize(
    ("slot", "level", "section"),
    [("process", "threshing", "threshing"), ("threshing", "model", "threshing"),
     ("separation", "walkers", "threshing"), ("cleaning", "overload", "cleaning")],
)  # fmt: skip
def test_levels_that_thresh_refuse_it(slot, level, section):
    machine = load_machine("forage-harvester")
    assert drivetrain_of(machine).threshing is drivetrain_of(machine).cleaning is None
    found = CATALOGUE.registry.get(slot, level)
    with pytest.raises(InputError, match=f"expected a machine data sheet with `{section}`"):
        found.component(found.params and found.params(), site(machine=machine))
