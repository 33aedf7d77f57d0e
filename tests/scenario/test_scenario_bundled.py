"""The bundled scenarios, the schema and the reference, with the levels that are really there."""

from pathlib import Path

import jsonschema
import pytest
from docs.make.scenario import reference

from swath.core.errors import InputError
from swath.documents.yaml_document import parse, read_document
from swath.scenario.scenario import find_scenario, load_scenario, parse_scenario, scenario_names
from swath.scenario.schema import scenario_schema
from swath.scenario.slots import CATALOGUE

DOCS = Path(__file__).parents[2] / "docs" / "reference"


@pytest.fixture(scope="module")
def validator():
    schema = scenario_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_names():
    assert {"laser-pilot", "straight", "bend"} <= set(scenario_names())


@pytest.mark.parametrize("name", scenario_names())
def test_scenario_is_read_written_and_valid(name, validator):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.summary
    assert scenario.expect
    assert parse_scenario(scenario.resolved()) == scenario
    assert list(validator.iter_errors(read_document(find_scenario(name)).data)) == []
    assert list(validator.iter_errors(parse(scenario.resolved()).data)) == []


def test_a_folder_of_that_name_does_not_hide_a_bundled_scenario(tmp_path, monkeypatch):
    (tmp_path / "straight").mkdir()
    (tmp_path / "straight" / "scenario.yaml").write_text("name: mine\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert find_scenario("straight").parent.name == "scenarios"
    assert find_scenario("./straight").resolve() == tmp_path / "straight" / "scenario.yaml"


def test_every_level_can_be_chosen_by_name_or_says_what_it_needs():
    refused = []
    base = "format: swath scenario 2\nname: x\nfield: {edge: {shape: straight}}\n"
    base += "machines: {combine: {machine: lexion-700-class}}\n"
    for kind in [*CATALOGUE.field_levels, *(s.name for s in CATALOGUE.slots)]:
        where = f"field.{kind}" if kind in CATALOGUE.field_levels else f"combine.{kind}"
        for level in CATALOGUE.registry.names(kind):
            try:
                parse_scenario(base, sets=[f"{where}={level}"])
            except InputError as error:
                refused.append((level, error.expected))
    missing = "expected a value, the key is missing"
    needing = ["dem", "replay", "file", "onnx", "onnx"]  # of edge and objects
    assert refused == [(level, missing) for level in needing]


def test_reference_is_up_to_date():
    written = (DOCS / "scenario.md").read_text(encoding="utf-8")
    assert written == reference(), "run: python -m docs.make.scenario"


def test_schema_refuses_a_wrong_unit_and_a_wrong_level(validator):
    data = read_document(find_scenario("straight")).data
    for slot, entry in (
        ("speed", {"speed_mph": 7}),
        ("lidar", "plant"),
        ("steer", {"level": "preview", "gain": 1}),
    ):
        combine = {**data["machines"]["combine"], slot: entry}
        changed = {**data, "machines": {"combine": combine}}
        assert list(validator.iter_errors(changed))
