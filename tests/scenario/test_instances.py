"""Slots have instances, wired by name; the type of a machine says what it has unasked."""

import pytest

from swath.core.errors import InputError
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario, parse_scenario

TEXT = """\
format: swath scenario 2
name: instances
run: {distance_m: 2}
field: {edge: {shape: straight}}
machines:
  combine:
    lidar: off
    lidar_left: {level: empirical, mount: {at: left_end}}
    lidar_right: {level: empirical, mount: {at: right_end}}
    edge: {wires: {scan: lidar_right.scan}}
"""


def test_control_gets_the_mounting_of_the_sensor_it_is_wired_to():
    machine = assemble(parse_scenario(TEXT)).machines["combine"]
    assert machine.slots_of("lidar") == ["lidar_left", "lidar_right"]
    left, right = (machine.mountings[name].position[1] for name in ("lidar_left", "lidar_right"))
    assert left > 0 > right
    named = machine.section.slots["edge"]
    assert named.wires["scan"] == ("combine.lidar_right", "scan")


def test_several_scanners_and_no_wire_are_refused():
    text = TEXT.replace("    edge: {wires: {scan: lidar_right.scan}}\n", "")
    with pytest.raises(InputError, match="wires = none: expected one sensor with a mounting"):
        assemble(parse_scenario(text))


def test_one_scanner_is_wired_whatever_its_name():
    text = TEXT.replace("    lidar_right: {level: empirical, mount: {at: right_end}}\n", "")
    text = text.replace("    edge: {wires: {scan: lidar_right.scan}}\n", "")
    scenario = parse_scenario(text)
    assert scenario.machines["combine"].slots["edge"].wires["scan"] == ("combine.lidar_left", "scan")
    assemble(scenario)


@pytest.mark.parametrize("name", ["header_left", "motion_2", "lidarleft", "lidar_"])
def test_only_sensors_and_detectors_have_instances(name):
    with pytest.raises(InputError, match=rf"combine\.{name}: unknown key"):
        parse_scenario(TEXT.replace("lidar_left:", f"{name}:"))


@pytest.mark.parametrize("name", ["lidar_../../x", "lidar_/etc", "lidar_a b", "lidar_.."])
def test_a_name_is_no_path(name):
    with pytest.raises(InputError, match="expected a slot's name: letters, digits, - and _"):
        parse_scenario(TEXT.replace("lidar_left:", f'"{name}":'))


def test_a_tractor_has_nothing_that_nobody_asked_for():
    text = TEXT + "  cart: {machine: tractor-grain-cart, start: {x_m: -30, y_m: 0}}\n"
    scenario = parse_scenario(text)
    assert set(scenario.machines["cart"].slots) == {"motion", "heap", "steer", "speed", "steering"}
    assert scenario.machines["cart"].slots["steer"].level == "constant"


def test_an_edge_of_the_field_by_name():
    scenario = load_scenario("two-combines")
    machines = assemble(scenario).machines
    assert machines["west"].edge.crop_side == "right"
    assert machines["east"].edge.crop_side == "left"
    with pytest.raises(
        InputError, match=r"west\.field_edge = south: expected one of field\.edges: west, east"
    ):
        assemble(load_scenario("two-combines", sets=["west.field_edge=south"]))


def test_the_long_path_of_set_is_the_short_one():
    short = load_scenario("straight", sets=["combine.speed.speed_kmh=5"])
    assert load_scenario("straight", sets=["machines.combine.speed.speed_kmh=5"]) == short


def test_an_old_form_names_the_last_version_that_rewrites_it(tmp_path):
    file = tmp_path / "old.yaml"
    file.write_text("name: old\nfield: {edge: {shape: straight}}\ncombine: {lidar: off}\n")
    with pytest.raises(InputError, match=r"format: expected 'swath scenario 2'; .*version 0\.2.*old\.yaml"):
        load_scenario(file)
