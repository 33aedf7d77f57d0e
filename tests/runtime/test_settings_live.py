"""Settings of the organs, changed while a run goes on."""

import math
import threading
from types import SimpleNamespace

import pytest

from swath.core.schedule import NS
from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions, Script
from swath.runtime.job import unheard
from swath.runtime.loop import drive
from swath.runtime.run_control import RunControl
from swath.scenario.scenario import parse_scenario
from swath.signals import OrganSettings
from tests.link.fmu_scenario import TEXT
from tests.waiting import until

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


@pytest.mark.parametrize(("process", "count"), [("organs", 0), ("threshing", 1)])
def test_settings_that_no_part_takes_are_noted(process, count):
    world = assemble(parse_scenario(LONG + f"    process: {process}\n    settings: fixed\n"))
    assert len(unheard(world)) == count
    world.close()


@pytest.mark.parametrize("key", ["concave_mm", "fan_rpm", "drum_rpm"])
def test_a_setting_that_the_scenario_leaves_out_is_asked_for_from_outside(key):
    """As the page of `--view` and the parameters of the ROS 2 node do, from a thread of their own."""
    world = assemble(parse_scenario(LONG + "    process: organs\n    settings: fixed\n"))
    control, replies, wanted = RunControl(), [], []
    control.join(SimpleNamespace(world=world, changes=Interventions(world), start=None))
    asking = threading.Thread(target=lambda: replies.append(control.set(f"combine.settings.{key}", 20.5)))

    def ask(t):
        if t == 2 * NS:
            asking.start()
            until(lambda: not control._requests._waiting.empty(), "it is asked")

    def note(slot, t, outputs):
        wanted.extend(
            (t, s) for s in outputs.values() if isinstance(s, OrganSettings) and slot.endswith("settings")
        )

    world.graph.before_tick.append(ask)
    drive(world, [note], until_s=4.0)
    asking.join()
    world.close()
    assert replies == [(True, "")]
    name = key.partition("_")[0]
    per = {"mm": 1e-3, "rpm": math.pi / 30.0}[key.partition("_")[2]]
    before = [getattr(s, name) for t, s in wanted if t <= 2 * NS]
    assert all(math.isnan(value) for value in before)
    assert getattr(wanted[-1][1], name) == pytest.approx(20.5 * per)
