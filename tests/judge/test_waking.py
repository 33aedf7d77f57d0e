"""Judges that rest until compiled code wakes them look at the same states as if they were shown all."""

import numpy as np
import pytest

import swath.compiled
from swath.judge.evaluators import rollover
from swath.judge.evaluators.rollover import Rollover
from swath.runtime.assembly import assemble
from swath.runtime.credibility import Credibility
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.runtime.met import EVERY_M
from swath.runtime.worlds import Worlds
from swath.scenario.scenario import load_scenario

QUICK = ("combine.lidar.level=profile", "combine.header.level=profile", "combine.edge.level=otsu")
TENTH = 100_000_000  # ns


def world_of(*sets, scenario="straight", seconds=3):
    return assemble(load_scenario(scenario, sets=[f"run.max_duration_s={seconds}", *sets]))


def looked(monkeypatch):
    """Where `Credibility` looks: by machine and time."""
    found, look_at = [], Credibility.look_at

    def note(self, name, state):
        found.append((name, state.t, state.distance))
        look_at(self, name, state)

    monkeypatch.setattr(Credibility, "look_at", note)
    return found


class Asked:
    """The first state of each tenth of a second, once a metre is driven since the last one."""

    def __init__(self):
        self.next, self.found = {}, []

    def __call__(self, slot, t, outputs):
        if slot.endswith(".motion"):
            name, state = slot.partition(".")[0], outputs["state"]
            next_t, way = self.next.get(name, (0, 0.0))
            if t >= next_t:
                next_t = t + TENTH
                if t > 0 and state.distance >= way:
                    way = state.distance + EVERY_M
                    self.found.append((name, t, state.distance))
            self.next[name] = next_t, way


@pytest.mark.parametrize(
    "sets", [QUICK, (*QUICK[:2], "combine.motion.rate_hz=30")], ids=["walked", "in Python, too"]
)
def test_ranges_are_looked_at_once_a_metre(sets, monkeypatch):
    found, asked = looked(monkeypatch), Asked()
    world = world_of(*sets, "combine.motion.start_speed_kmh=8")
    drive(world, [make_evaluation(world), asked])
    assert found == asked.found
    assert len(found) > 3
    again = found[:]
    found.clear()
    world = world_of(*sets, "combine.motion.start_speed_kmh=8")
    evaluation = make_evaluation(world)
    for k, until in enumerate(np.cumsum(np.random.default_rng(1).uniform(0.01, 0.4, 40)).tolist()):
        drive(world, [evaluation], until_s=min(until, 3.0), resume=k > 0)
    assert found == again


def test_ranges_of_several_machines_are_looked_at_each_on_its_way(monkeypatch):
    found, asked = looked(monkeypatch), Asked()
    world = world_of(scenario="two-combines")
    drive(world, [make_evaluation(world), asked], until_s=0.8)
    assert found == asked.found
    assert len({name for name, _, _ in found}) == len(world.machines) > 1


def test_ranges_are_looked_at_in_worlds_as_in_each_alone(monkeypatch):
    found = looked(monkeypatch)
    lengths = 1.3, 2.0, 1.6
    together = Worlds([world_of(*QUICK, f"run.distance_m={m}") for m in lengths])
    assert len([*together.drive()]) == 3
    at_once, found[:] = sorted(found), []
    for m in lengths:
        world = world_of(*QUICK, f"run.distance_m={m}")
        drive(world, [make_evaluation(world)])
    assert sorted(found) == at_once
    assert len(found) > 3


def tilt_of(self, state):
    """Against the vertical alone: none of these machines leaves the ground."""
    return float(np.arccos(state.pose.rotation[2, 2]))


def test_a_machine_that_rolls_over_ends_its_run_at_the_same_tick(monkeypatch):
    """Whoever walks, and whoever looks on. Drawn: from which tilt on, as it is at any time of the run."""
    tilts, draw = [], np.random.default_rng(1)
    world = world_of(*QUICK, scenario="rolling-slope", seconds=1.2)

    def note(slot, t, outputs):
        if slot == "combine.motion":
            tilts.append(tilt_of(None, outputs["state"]))

    drive(world, [note])
    monkeypatch.setattr(Rollover, "_tilt", tilt_of)
    for tipped in draw.uniform(tilts[0], max(tilts), 2):
        monkeypatch.setattr(rollover, "TIPPED", tipped)
        ends = []
        for is_shown in (False, True):
            monkeypatch.setattr(swath.compiled, "IS_WALKED_BY_PYTHON", is_shown)
            evaluation = make_evaluation(world)
            alone = Rollover(evaluation._setups["combine"])
            drive(world, [evaluation, *([alone.see] if is_shown else [])])
            events = [event for event in evaluation.events("combine") if event.kind == "rollover"]
            ends.append((world.graph.t, world.graph.ended, str(events)))  # a nan of theirs is equal to none
        assert ends[0] == ends[1]
        assert str(alone.events()) == ends[1][2]
        assert 0 < ends[0][0] < 1_200_000_000
        assert "rolled over" in ends[0][1]
