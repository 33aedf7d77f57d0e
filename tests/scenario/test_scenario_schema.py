"""The JSON Schema: valid itself, agrees with the reader, and documents units."""

import inspect
import json
import re
from dataclasses import fields
from pathlib import Path

import jsonschema
import pytest
from docs.make.scenario import reference

from swath.documents.yaml_document import parse
from swath.scenario.reference import parameter_rows
from swath.scenario.scenario import parse_scenario
from swath.scenario.schema import _classes, meanings, scenario_schema
from swath.scenario.slots import CATALOGUE
from tests.fake_levels import FAKE, GOOD

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "scenario.md"


@pytest.fixture(scope="module")
def validator():
    schema = scenario_schema(FAKE)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert json.loads(json.dumps(schema)) == schema
    return jsonschema.Draft202012Validator(schema)


def test_accepts_what_the_reader_accepts(validator):
    data = parse(GOOD).data
    assert list(validator.iter_errors(data)) == []
    assert list(validator.iter_errors(parse(parse_scenario(GOOD, catalogue=FAKE).resolved()).data)) == []
    data["machines"]["combine"]["steer"] = {"level": "mine.py:Steer", "gain": 2}
    data["machines"]["combine"]["speed"] = "off"
    assert list(validator.iter_errors(data)) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("rate_hz: 25", "rate_hz: -5"),
        ("speed_kmh: 7", "speed_mph: 7"),
        ("steer: preview", "steer: previw"),
        ("{z_m: 2.5}", "{z_m: high}"),
        ("shape: straight", "shape: strait"),
        ("kind: post, ", ""),
        ("lateral_rms_m", "lateral_rsm_m"),
    ],
)
def test_refuses_what_the_reader_refuses(validator, old, new):
    changed = parse(GOOD.replace(old, new)).data
    assert list(validator.iter_errors(changed))


def test_units_are_in_the_descriptions(validator):
    lidar = validator.schema["$defs"]["lidar.plants"]["properties"]
    assert lidar["rate_hz"]["description"] == "how often it runs [Hz]"
    assert validator.schema["$defs"]["speed.constant"]["properties"]["speed_kmh"]["description"] == (
        "over ground [km/h]"
    )
    assert (
        validator.schema["$defs"]["lidar.plants.Mount"]["properties"]["z_m"]["description"]
        == "above ground [m]"
    )


def test_meanings_of_a_docstring():
    text = """Parameters of the law.

    overlap_m: how far out
    lookahead_m, lookahead_s: the greater of
    both; lag_s [s]: of the steering; row_m, 0 = none; x_m, y_m: east, north; last_m: the end.

    Not about last_m: this.
    """
    said = meanings(
        text, ["overlap_m", "lookahead_m", "lookahead_s", "lag_s", "row_m", "x_m", "y_m", "last_m"]
    )
    assert said == {
        "overlap_m": "how far out",
        "lookahead_m": "the greater of both",
        "lookahead_s": "the greater of both",
        "lag_s": "of the steering",
        "row_m": "0 = none",
        "x_m": "east",
        "y_m": "north",
        "last_m": "the end",
    }


def test_the_reference_has_every_key_of_every_level_once_a_slot():
    """The page itself, which is what `reference` gives: test_scenario_bundled.py."""
    page = PAGE.read_text(encoding="utf-8")
    for kind in (*CATALOGUE.field_levels, *(slot.name for slot in CATALOGUE.slots)):
        heading = f"\n### field.{kind}\n" if kind in CATALOGUE.field_levels else f"\n### {kind}\n"
        section = page.partition(heading)[2].partition("\n### ")[0]
        lines = [line for line in section.splitlines() if line.startswith("| `")]
        assert len(set(lines)) == len(lines)
        for name in CATALOGUE.registry.names(kind):
            assert f"- `{name}`: " in section
            for key, *_ in parameter_rows(CATALOGUE.registry.get(kind, name).params):
                head, _, rest = key.partition(".")
                line = next(
                    line for line in lines if line.startswith((f"| `{key}` |", f"| `{head}` | keys of "))
                )
                if "| keys of `" in line:  # of another level of the slot
                    assert f"| `{rest}` |" in section
                group = re.search(r"\(#keys-of-([\w-]+)\)", line)
                if group:
                    keys = page.partition(f"\n### Keys of {group[1]}\n")[2].partition("\n### ")[0]
                    assert f"| `{rest}` |" in keys


def test_every_key_of_every_level_has_a_meaning():
    """More than its unit, also where the class of an inner mapping has the name of another."""
    registry = CATALOGUE.registry
    kinds = (*CATALOGUE.field_levels, *(slot.name for slot in CATALOGUE.slots))
    levels = [registry.get(kind, name) for kind in kinds for name in registry.names(kind)]
    levels += [registry.get("lidar", name) for name in registry.links()]
    bare = {
        f"{level.params.__module__}: {key}"
        for level in levels
        for key, *_, meaning in parameter_rows(level.params)
        if not re.sub(r"\[[^]]*\]", "", meaning).strip()
    }
    assert not bare


def test_every_key_has_an_entry_of_its_own_line():
    """No clause in a paragraph: a class with the field, or one it derives from, has a line `key: meaning`."""
    registry = CATALOGUE.registry
    kinds = (*CATALOGUE.field_levels, *(slot.name for slot in CATALOGUE.slots))
    levels = [registry.get(kind, name) for kind in kinds for name in registry.names(kind)]
    classes = {kind for level in levels for kind in _classes(level.params).values()}
    without = set()
    for kind in classes:
        said = "\n".join(inspect.cleandoc(base.__doc__ or "") for base in kind.__mro__)
        keys = [field.name for field in fields(kind)]
        without |= {f"{kind}: {k}" for k in keys if not re.search(rf"(?m)^{k}( \[[^\]]*\])?: \S", said)}
    assert not without


def test_reference_has_every_key():
    page = reference(FAKE)
    for key in ("`mount.z_m`", "`stems_per_m2`", "`speed_kmh`", "`wires`", "`points_m`"):
        assert key in page
    assert "| `sub_rays` | whole, [1, 217] | `19` | per beam |" in page
