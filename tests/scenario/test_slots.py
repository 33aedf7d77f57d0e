"""The slots of a machine: every level has the ports that its slot promises."""

import sys
import types

import pytest

from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.estimate import estimates
from swath.core.registry import Level, Registry
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario
from swath.scenario.slots import CATALOGUE, GONE, GONE_SLOTS, PEER, REGISTRY, SLOTS, TRUTH
from swath.signals import SteerCommand
from swath.signals.setup import LinkSetup
from swath.tools.function_test.case import Varied


@pytest.mark.parametrize("kind", SLOTS, ids=lambda s: s.name)
def test_levels_give_what_their_slot_promises(kind):
    for name in REGISTRY.names(kind.name):
        given = getattr(REGISTRY.get(kind.name, name).component, "outputs", None)
        if isinstance(given, tuple):  # a scanner's depend on its parameters
            assert set(kind.outputs) <= set(given), name


def test_wires_come_from_promised_outputs():
    gives = {s.name: {p.name for p in (*s.outputs, *s.more)} for s in SLOTS}
    for slot in SLOTS:
        for port, (source, output) in slot.wires.items():
            name = source.removeprefix(PEER)
            if name not in gives:  # one of several, as peer_link_1
                name = name.rpartition("_")[0]
            assert output in gives[name], f"{slot.name}.{port}"


class Held:
    """A steering of somebody else that keeps what it was told and never steers."""

    def __init__(self, params, setup):
        self.setup = setup
        self.inputs = setup.inputs
        self.outputs = setup.outputs
        self.is_open = True

    def reset(self, stream):
        return {"command": SteerCommand(0, 0.0, True)}

    def step(self, t, dt, inputs):
        return {"command": SteerCommand(t + dt, 0.0, True)}

    def save(self):
        return {}

    def load(self, state):
        pass

    def close(self):
        self.is_open = False


@pytest.fixture
def linked(monkeypatch):
    """The registry with one more level, `held`, for any slot."""
    package, module = types.ModuleType("fake_links"), types.ModuleType("fake_links.held")
    package.__path__ = []
    module.LEVEL = Level(Held, None, "held", is_link=True)
    module.__spec__ = types.SimpleNamespace(name="fake_links.held")
    monkeypatch.setitem(sys.modules, "fake_links", package)
    monkeypatch.setitem(sys.modules, "fake_links.held", module)
    monkeypatch.setattr(REGISTRY, "_links", "fake_links")


@pytest.mark.usefixtures("linked")
def test_a_part_of_somebody_else_fills_a_slot():
    scenario = load_scenario("straight", sets=["combine.steer.level=held", "run.distance_m=2"])
    world = assemble(scenario)
    part = world.leader.parts["steer"]
    assert isinstance(part.setup, LinkSetup)
    assert part.setup.name == "combine.steer"
    assert part.setup.outputs == (Port("command", SteerCommand),)
    assert {p.name for p in part.setup.inputs} == {
        "edge",
        "odometry",
        "inertial",
        "ground",
        "station",
        "pose",
    }
    assert all(p.optional for p in part.setup.inputs)
    ticks = []
    world.graph.before_tick.append(ticks.append)
    world.graph.reset()
    world.graph.run(40_000_000)
    assert world.graph.latest("combine.steer", "command").t == 40_000_000
    assert ticks == sorted(ticks)
    assert ticks[0] == 5_000_000
    world.close()
    assert not part.is_open


@pytest.mark.usefixtures("linked")
@pytest.mark.parametrize("slot", [s.name for s in SLOTS if s.is_control])
def test_no_truth_reaches_a_part_in_control(slot):
    sets = [f"combine.{slot}.level=held", "run.distance_m=2"]
    setup = assemble(load_scenario("straight", sets=sets)).leader.parts[slot].setup
    assert not any(p.signal in TRUTH for p in setup.inputs)


def test_links_are_not_levels_of_the_field():
    registry = Registry({"terrain": (), "steer": ()}, links="swath.link.levels", linkable=("steer",))
    assert registry.names("steer") == []
    with pytest.raises(InputError, match=r"terrain\.level = nothing: expected one of .*file.py:Class"):
        registry.get("terrain", "nothing")


def test_a_level_that_went_says_what_there_is_instead():
    for gone in GONE:
        kind, level = gone.split(".")
        assert level not in REGISTRY.names(kind)
        with pytest.raises(InputError, match="expected another level: it is gone, `"):
            REGISTRY.get(kind, level)


@pytest.mark.parametrize("slot", GONE_SLOTS)
def test_a_slot_that_went_says_what_there_is_instead(slot):
    with pytest.raises(InputError, match=rf"combine\.{slot}: unknown key: it is gone, `"):
        load_scenario("straight", sets=[f"combine.{slot}.level=x"])


def test_what_is_an_estimate_has_a_band_to_draw_from():
    band = CATALOGUE.estimate_of("combine.threshing.threshing_speed")
    assert (band, CATALOGUE.estimate_of("truck.crop_flow_2.camera_lag_s")) == ((0.5, 1.5), (10, 30))
    for slot in SLOTS:
        for name in REGISTRY.names(slot.name):
            params = REGISTRY.get(slot.name, name).params
            for key, of in estimates(params).items():
                assert of.low <= getattr(params, key, of.low) <= of.high, (slot.name, name, key)
    shoe = REGISTRY.get("cleaning", "model").params
    assert estimates(shoe).keys() == shoe.__dataclass_fields__.keys()
    assert CATALOGUE.estimate_of("combine.lidar_left.window.drop_mm") == (1, 3.4)
    assert CATALOGUE.estimate_of("field.stand.straw_lag_h") == (1, 2)
    for none in (
        "combine.threshing.threshability",
        "combine.lidar.window",
        "field.stand",
        "field",
        "seed.a.b",
    ):
        with pytest.raises(InputError, match="one with a band"):
            CATALOGUE.estimate_of(none)


def test_a_case_draws_from_the_band():
    drawn = Varied(key="combine.threshing.moisture_rate", estimate=True)
    assert (drawn.range, drawn.at) == ((2, 4), [2, 4])
