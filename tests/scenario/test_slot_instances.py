"""Instances of a slot: `lidar_left` is one of the kind `lidar`."""

import pytest

from swath.core.errors import InputError
from swath.scenario.slot_instances import first_of_kind, kind_of
from swath.scenario.slots import SLOTS


def test_every_kind_is_an_instance_of_itself_and_may_have_named_ones():
    for slot in SLOTS:
        assert kind_of(slot.name) == slot.name
        assert kind_of(f"{slot.name}_left") == slot.name


def test_a_name_is_of_the_longest_kind_that_fits():
    assert kind_of("steering") == "steering"
    assert kind_of("crop_flow_2") == "crop_flow"
    with pytest.raises(InputError, match=r"slot = lidarleft: expected one of motion"):
        kind_of("lidarleft")


def test_the_first_of_a_kind():
    assert first_of_kind("lidar", ["motion", "lidar_right", "lidar_left"]) == "lidar_right"
    assert first_of_kind("camera", ["motion", "lidar_right"]) is None
