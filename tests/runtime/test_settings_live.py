"""Settings of the organs, changed while a run goes on."""

import pytest

from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions, Script
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from tests.link.fmu_scenario import TEXT

LONG = TEXT.replace("distance_m: 3, max_duration_s: 6", "distance_m: 40, max_duration_s: 16")


def driven(*changes):
    """Power of the drum [W], step by step, with changes at (time [s], key, value)."""
    world, powers = assemble(parse_scenario(LONG + "    process: organs\n    settings: fixed\n")), []
    events = [{"t_s": t, "set": key, "value": value} for t, key, value in changes]
    world.graph.before_tick.append(Script(Interventions(world), events))
    seen = {}
    drive(world, [lambda slot, t, outputs: seen.update(outputs) or powers.append((t, seen.get("organs")))])
    world.close()
    return {round(t * 1e-9, 3): loads.threshing_power for t, loads in powers if loads is not None}


def test_the_drum_turns_slower_from_when_it_is_told():
    own, slower = driven(), driven((8.0, "combine.settings.drum_rpm", 608))
    assert slower[8.0] == own[8.0] > 0.0
    assert slower[11.0] == pytest.approx(own[11.0] * (708.0 - 20.0 * 2.0) / 708.0, abs=0.03 * own[11.0])
    assert slower[15.0] == pytest.approx(own[15.0] * 608.0 / 708.0, rel=1e-3)
