"""Organs of a combine in a row: of any levels, from elsewhere, against the one part that they were."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.component import Port
from swath.core.errors import SwathError
from swath.core.foreign_code import allow_code
from swath.core.schedule import NS
from swath.machine.organ import (
    SHARED,
    added,
    linked_cleaning,
    linked_feeder,
    linked_returns,
    linked_separation,
    linked_threshing,
)
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.machine_types import ORGANS
from swath.scenario.scenario import parse_scenario
from swath.scenario.slots import CATALOGUE
from swath.signals import CropFlow, CropStream, MachineLoad
from swath.signals.flat import flat_fields, read
from tests.link.fmu_scenario import TEXT
from tests.machine.machine_fakes import STREAM, site
from tests.machine.process_rig import GRAIN, STRAW, Rig, Row, flow, state

STREAMS = {
    "feeder": (("flow",), ("fed",)),
    "threshing": (("fed", "back"), ("over", "through")),
    "separation": (("fed",), ("over", "through")),
    "cleaning": (("pan", "more"), ("clean", "returned", "over")),
    "returns": (("fed",), ("back",)),
}
shares = st.lists(st.floats(0.0, 0.33), min_size=3, max_size=3)
mixtures = st.fixed_dictionaries(
    {n: st.one_of(st.sampled_from(CATALOGUE.registry.names(n)), shares) for n in ORGANS}
)


class Somebodys:
    """Sends a share of what comes to each output, and says nothing of what it keeps."""

    def __init__(self, slot, shares):
        feeds, streams = STREAMS[slot]
        kind = CropFlow if slot == "feeder" else CropStream
        self.inputs = tuple(Port(name, kind, history=True) for name in feeds)
        self.outputs = tuple(Port(name, CropStream) for name in streams)
        self.shares = dict(zip(streams, shares, strict=False))

    def reset(self, stream):
        return {port.name: CropStream(0) for port in self.outputs}

    def step(self, t, dt, inputs):
        came = [sample for port in self.inputs for sample in inputs[port.name]]
        sums = {n: sum(getattr(s, n) for s in came if hasattr(s, n)) for n in SHARED}
        sums["unthreshed"] += sum(s.grain for s in came if isinstance(s, CropFlow))
        return {
            name: CropStream(t + dt, **{n: share * mass for n, mass in sums.items()}, dt=dt / NS)
            for name, share in self.shares.items()
        }


def made(levels):
    """Organs of the drawn levels; of shares somebody's part, as it stands in a scenario."""
    links = {"feeder": linked_feeder, "threshing": linked_threshing, "separation": linked_separation,
             "cleaning": linked_cleaning, "returns": linked_returns}  # fmt: skip
    return {
        slot: level if isinstance(level, str) else links[slot](Somebodys(slot, level), site())
        for slot, level in levels.items()
    }


def beat(x):
    return GRAIN * (1.0 + 0.5 * np.sin(x / 7.0)), STRAW * (1.0 + 0.3 * np.sin(x / 11.0))


def test_organs_are_what_the_one_part_is():
    """Every number of the load and of the engine, at each step, on a slope and with the tank emptied."""
    keys = {"straw": "chop", "tank_start_percent": 79.0, "unload_at_percent": 80.0}
    today = {"threshing": {"ears_through_percent": 0.0}, "separation": {"short_percent": 0.0}}
    row = Row(site(period=0.1), {"cleaning": "overload"}, today, **keys)
    one, row = Rig(crop=beat, **keys), Rig(crop=beat, process=row)
    for rig in (one, row):
        rig.run(2.0, 20.0)
        rig.run(3.0, 20.0, roll=0.1, pitch=-0.05)
    for (load, engine, _), (other, driven, _) in zip(one.rows, row.rows, strict=True):
        for name in flat_fields(MachineLoad):
            assert read(load, name) == pytest.approx(read(other, name), rel=1e-12, abs=1e-12)
        assert engine == driven
    assert row.organs.threshing_power > 50e3
    assert one.organs is None


@given(
    mixtures,
    st.lists(st.tuples(st.floats(0, 6), st.floats(0, 5)), min_size=1, max_size=20),
    st.sampled_from([0.04, 0.1, 0.5]),
)
@settings(max_examples=30)
def test_any_mixture_keeps_every_kilogram(levels, course, dt):
    row = Row(site(period=dt), made(levels))
    row.reset(STREAM)
    h, fed = round(dt * NS), np.zeros(2)
    for k, (grain, straw) in enumerate(course * 4):
        fed += grain, straw
        inputs = {"flow": (flow(k, grain, straw, dt),), "state": state(k, 0.1 * k, 1.0)}
        load = row.step(k * h, h, inputs)["load"]
        inside = load.tank_gain + load.lost_grain + load.held_grain, load.dropped_straw + load.held_straw
        assert inside == pytest.approx(fed, rel=1e-12, abs=1e-12)


class Sieve:
    """Somebody's: keeps a tenth, cleans the rest; `more` times what it should give."""

    inputs = (Port("pan", CropStream, history=True),)
    outputs = tuple(Port(name, CropStream) for name in ("clean", "returned", "over"))

    def __init__(self, more=1.0):
        self.more = more

    def reset(self, stream):
        return {port.name: CropStream(0) for port in self.outputs}

    def step(self, t, dt, inputs):
        pan = inputs["pan"][-1]
        given = {"returned": CropStream(t + dt), "over": CropStream(t + dt, chaff=pan.chaff)}
        return {**given, "clean": CropStream(t + dt, free=0.9 * self.more * pan.free)}


def test_a_part_from_elsewhere_is_booked():
    """Its work is what came in less what went out, also of an input that it does not know."""
    organ = linked_cleaning(Sieve(), site())
    organ.reset(STREAM)
    pan, more = CropStream(0, free=2.0, chaff=0.4), CropStream(0, free=1.0)
    for k in range(1, 4):
        made = organ.step(k * NS, NS, {"pan": (pan,), "more": (more,)})
    assert made["work"].held_grain == pytest.approx(3 * (0.2 + 1.0))
    assert made["work"].held_mog == pytest.approx(0.0, abs=1e-12)
    rest = organ.step(4 * NS, NS // 3, {"pan": (pan,), "more": ()})
    assert rest["clean"].grain == 0.0
    assert rest["work"].held_grain == pytest.approx(3 * 1.2 + 2.0)
    row = Rig(process=Row(site(period=0.1), {"cleaning": linked_cleaning(Sieve(), site())}))
    row.run(2.0, 20.0)
    assert max(row.balance()) < 1e-12


def test_a_part_that_makes_grain_is_an_error():
    organ = linked_cleaning(Sieve(more=1.2), site())
    organ.reset(STREAM)
    with pytest.raises(SwathError, match=r"cleaning at t = 0 s: it gives 0\.16 kg of grain more"):
        organ.step(0, NS, {"pan": (CropStream(0, free=2.0),), "more": ()})


def test_a_row_goes_on_exactly_from_what_it_saved():
    one, two = (Rig(engine=False, process=Row(site(period=0.1)), crop=beat) for _ in range(2))
    one.run(2.0, 15.3)
    two.process.load(one.process.save())
    two.t, two.x, two.speed = one.t, one.x, one.speed
    assert [one.step(2.0) for _ in range(60)] == [two.step(2.0) for _ in range(60)]


def test_organs_of_another_rate_are_refused():
    with pytest.raises(SwathError, match="one rate_hz of all organs"):
        added(())


def test_somebodys_file_is_booked_in_a_run(tmp_path):
    """A class of a user's file in a slot of a scenario needs no output `work`."""
    file = tmp_path / "mine.py"
    file.write_text(
        "from tests.machine.test_organs import Somebodys\n"
        "class Mine(Somebodys):\n"
        "    def __init__(self, params, setup):\n"
        "        super().__init__('cleaning', [0.9, 0.04, 0.05])\n"
        "    def save(self):\n"
        "        return {}\n"
        "    def load(self, state):\n"
        "        pass\n"
    )
    text = TEXT.replace("distance_m: 3, max_duration_s: 6", "distance_m: 30, max_duration_s: 14")
    with allow_code(None):
        organs = f"    process: organs\n    cleaning: {{level: '{file}:Mine'}}\n"
        world, loads = assemble(parse_scenario(text + organs)), []
    drive(
        world,
        [lambda slot, t, outputs: loads.extend(s for s in outputs.values() if isinstance(s, MachineLoad))],
    )
    world.close()
    missing, last = world.field.recount(), loads[-1]
    assert last.lost_grain > 0.0
    grain = last.tank_gain + last.lost_grain + last.held_grain
    assert grain == pytest.approx(missing.grain, rel=1e-12)
    assert last.dropped_straw + last.held_straw == pytest.approx(missing.straw, rel=1e-12)
