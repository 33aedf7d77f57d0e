"""Every level of every slot stands in a bundled scenario or case in which a limit depends on it."""

import pytest
from benchmarks.dead_parts import WHERE, holds, levels, scenario_of, without

TABLE = {level: where for where, of in WHERE.items() for level in of.split()}
QUICK = ["steer.constant", "header.profile"]  # all: benchmarks.dead_parts


def test_every_level_stands_somewhere():
    assert sorted(TABLE) == sorted(levels())


@pytest.mark.parametrize("where", WHERE)
def test_it_is_there(where):
    for level in WHERE[where].split():
        assert without(where, level) is not None


@pytest.mark.parametrize("level", [*QUICK, pytest.param("ground_speed.ideal", marks=pytest.mark.draws)])
def test_a_dead_part_breaks_a_limit(level):
    assert holds(scenario_of(TABLE[level]))
    assert not holds(without(TABLE[level], level))
