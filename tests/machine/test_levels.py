from dataclasses import is_dataclass

import pytest

from swath.core.component import Component
from swath.core.errors import MissingExtra
from swath.core.registry import Registry
from swath.machine.machine_sheet import load_machine
from swath.scenario.machine_types import ORGANS
from tests.machine.machine_fakes import STREAM, site

SLOTS = {
    kind: [f"swath.machine.{kind}"]
    for kind in ("motion", "header", *ORGANS, "process", "powertrain", "steering")
}
REGISTRY = Registry(SLOTS)
LEVELS = [(kind, name) for kind in SLOTS for name in REGISTRY.names(kind)]
LEVELS.remove(("header", "profile"))  # needs a field with an edge: tests/field/test_profile.py


def test_the_levels_of_the_machine():
    found = set(LEVELS)
    assert found >= {("motion", "kinematic"), ("motion", "single_track"), ("motion", "multibody")}
    assert ("header", "fixed_height") in found
    assert found >= {("process", "constant"), ("process", "delay_line"), ("process", "threshing")}
    assert found >= {("powertrain", "ideal"), ("powertrain", "hydrostat")}
    assert found >= {("steering", "actuator"), ("steering", "ideal")}


@pytest.mark.parametrize(("kind", "name"), LEVELS)
def test_each_level_is_a_component_with_every_output_at_the_start(kind, name):
    level = REGISTRY.get(kind, name)
    assert level.params is None or is_dataclass(level.params)
    try:
        machine = load_machine("tractor-grain-cart") if name == "articulated" else None
        component = level.component(level.params and level.params(), site(machine=machine))
    except MissingExtra as error:
        pytest.skip(str(error))
    assert isinstance(component, Component)
    outputs = component.reset(STREAM)
    assert set(outputs) == {p.name for p in component.outputs}
    for port in component.outputs:
        assert isinstance(outputs[port.name], port.signal)
        assert outputs[port.name].t == 0
