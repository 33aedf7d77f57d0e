import pytest
import yaml

from swath.core.errors import InputError
from swath.documents.data_sheets import Card, sheet_names, find_sheet
from swath.machine.machine_sheet import MachineSheet, dynamics_of, load_machine
from swath.signals.setup import MachineGeometry
from tests.machine.machine_fakes import site


@pytest.mark.parametrize("name", sheet_names("machines"))
def test_every_number_of_a_card_is_cited(name):
    card = Card(find_sheet("machines", name))
    for section, entries in card.data.items():
        if isinstance(entries, dict):
            for key, entry in entries.items():
                assert set(entry) == {"value", "unit", "tag", "source"}, f"{section}.{key}"
                card.number(f"{section}.{key}")


@pytest.mark.parametrize("name", sheet_names("machines"))
def test_the_steered_axle_carries_at_least_a_fifth(name):
    machine = load_machine(name)
    assert 0.20 <= machine.dynamics.cg_behind / machine.wheelbase <= 0.4


def test_short_name_and_other_header():
    machine = load_machine("lexion-700", header_width_m=9.0)
    assert machine.header_width == 9.0
    assert machine.header_end("left") == (4.0, 4.5)
    assert load_machine("lexion-700").header_width == 12.0


def changed(tmp_path, section, key, value):
    data = yaml.safe_load(find_sheet("machines", "combine-5m").read_text())
    if value is None:
        del data[section][key]
    else:
        data[section][key]["value"] = value
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(data))
    return tmp_path


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("chassis", "wheelbase_m", None),
        ("chassis", "wheelbase_m", -1),
        ("mass", "total_kg", float("nan")),
        ("mass", "cg_behind_axle_m", 5.0),
        ("chassis", "top_m", 0.2),
        ("tyres", "friction", "much"),
    ],
)
def test_bad_cards_name_the_key(tmp_path, section, key, value):
    base = changed(tmp_path, section, key, value)
    with pytest.raises(InputError, match=rf"{section}\.{key}.*own\.yaml"):
        load_machine("own.yaml", base=base)


def test_unknown_machine_names_the_nearest():
    with pytest.raises(InputError, match="combine-5m"):
        load_machine("combine-5")


def test_bare_geometry_is_refused_where_masses_are_needed():
    machine = site().machine
    assert isinstance(machine, MachineSheet)
    bare = MachineGeometry(**{k: getattr(machine, k) for k in MachineGeometry.__dataclass_fields__})
    with pytest.raises(InputError, match="machine card"):
        dynamics_of(bare)


@pytest.mark.parametrize("width", [0.0, float("nan"), 100.0])
def test_impossible_header_is_refused(width):
    with pytest.raises(InputError, match="header_width_m"):
        load_machine("lexion-700", header_width_m=width)
