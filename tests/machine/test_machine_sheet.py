import re

import pytest

from swath.core.errors import InputError
from swath.documents.data_sheets import find_sheet, sheet_names
from swath.field.solid.solids import machine_body, solid_count
from swath.machine.machine_sheet import MachineSheet, dynamics_of, load_machine
from swath.signals.setup import MachineGeometry
from tests.changed_sheets import changed_sheet
from tests.machine.machine_fakes import site


@pytest.mark.parametrize("name", sheet_names("machines"))
def test_the_steered_axle_carries_at_least_a_fifth(name):
    machine = load_machine(name)
    assert 0.20 <= machine.dynamics.cg_behind / machine.wheelbase <= 0.4


def test_short_name_and_other_header():
    machine = load_machine("lexion-700", header_width_m=9.0)
    assert machine.header_width == 9.0
    assert machine.header_end("left") == (4.0, 4.5)
    assert load_machine("lexion-700").header_width == 12.0


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("chassis", "wheelbase_m", None),
        ("chassis", "wheelbase_m", -1),
        ("mass", "total_kg", 1e300),
        ("mass", "cg_behind_axle_m", 5.0),
        ("chassis", "top_m", 0.2),
        ("tyres", "friction", "much"),
    ],
)
def test_bad_sheets_name_the_key(tmp_path, section, key, value):
    changed_sheet(tmp_path, "machines", "combine-5m", f"{section}.{key}", value and {"value": value})
    with pytest.raises(InputError, match=rf"{section}\.{key}.*own\.yaml"):
        load_machine("own.yaml", base=tmp_path)


def test_unknown_machine_names_the_nearest():
    with pytest.raises(InputError, match="combine-5m"):
        load_machine("combine-5")


def test_bare_geometry_is_refused_where_masses_are_needed():
    machine = site().machine
    assert isinstance(machine, MachineSheet)
    bare = MachineGeometry(**{k: getattr(machine, k) for k in MachineGeometry.__dataclass_fields__})
    with pytest.raises(InputError, match="machine data sheet"):
        dynamics_of(bare)


@pytest.mark.parametrize("width", [0.0, float("nan"), 100.0])
def test_impossible_header_is_refused(width):
    with pytest.raises(InputError, match="header_width_m"):
        load_machine("lexion-700", header_width_m=width)


def without(text, section):
    """The text of a sheet without one of its sections."""
    return re.sub(rf"^{section}:\n(?: .*\n)+", "", text, flags=re.M)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("type: combine\n", "", r"type: expected a value, the key is missing \("),
        (
            "type: combine",
            "type: combin",
            r"type = combin: expected one of combine, .*did you mean 'combine'",
        ),
        ("type: combine", "type: tractor", r"header: expected no section `header` for type tractor"),
        ("format: swath machine 2\n", "", r"format: .*`swath migrate` of version 0\.2 .*own\.yaml"),
        ("format: swath machine 2", "format: swath crop 2", r"format = swath crop 2: .*swath machine 2"),
        ("wheelbase_m", "wheelbase_cm", r"chassis\.wheelbase_cm: unknown key, .*expected in m"),
        (
            "torque_speed_rpm: {value: 1600",
            "torque_speed_rpm: {value: 2300",
            r"less than engine.rated_speed_rpm",
        ),
    ],
)
def test_what_contradicts_is_refused(tmp_path, old, new, message):
    text = find_sheet("machines", "combine-5m").read_text()
    assert old in text
    (tmp_path / "own.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message):
        load_machine("own.yaml", base=tmp_path)


def test_a_harvester_needs_its_header_and_a_tractor_has_none(tmp_path):
    text = find_sheet("machines", "combine-5m").read_text()
    (tmp_path / "own.yaml").write_text(without(text, "header"))
    with pytest.raises(InputError, match="header: expected a section `header` for type combine"):
        load_machine("own.yaml", base=tmp_path)
    tractor = load_machine("tractor-grain-cart")
    assert (tractor.has_header, tractor.header_width) == (False, 0.0)
    assert tractor.header_end("left") == (tractor.body[1], 0.0)
    assert solid_count(machine_body(tractor)) == 1
    assert solid_count(machine_body(load_machine("combine-5m"))) == 2
    with pytest.raises(InputError, match="header_width_m"):
        load_machine("tractor-grain-cart", header_width_m=6.0)


def test_type_slots_and_trailer_are_read(tmp_path):
    text = find_sheet("machines", "tractor-grain-cart").read_text()
    (tmp_path / "own.yaml").write_text(text + "slots: {gnss: error, steering: off}\n")
    machine = load_machine("own.yaml", base=tmp_path)
    assert machine.type == "tractor_with_trailer"
    assert machine.slots == {"gnss": "error", "steering": "off"}
    assert machine.trailer.empty == 7500.0
    assert load_machine("lexion-700").slots == {}


@pytest.mark.parametrize("section", ["bodies", "engine"])
def test_a_sheet_may_be_without_masses_or_drivetrain(tmp_path, section):
    text = find_sheet("machines", "combine-5m").read_text()
    (tmp_path / "own.yaml").write_text(without(text, section))
    machine = load_machine("own.yaml", base=tmp_path)
    assert (machine.masses is None, machine.drivetrain is None) == (section == "bodies", section == "engine")
