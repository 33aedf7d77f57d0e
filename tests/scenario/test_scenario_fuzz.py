"""Whatever is done to a scenario file: it is read, or refused in one line. Never anything else."""

import copy
from functools import cache

import jsonschema
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.errors import SwathError
from swath.documents.yaml_document import dump, parse
from swath.scenario.scenario import Scenario, parse_scenario
from swath.scenario.schema import scenario_schema
from tests.fake_levels import FAKE, GOOD

NASTY = [None, True, False, -1, 0, 1 << 40, -(1 << 62), 1e308, -1e308, 5e-324, "", "7 km/h", "nan", "x" * 500]
NASTY += [".nan", "off", "a.py:B", "..", "/", "\0", "é\n\t", "../../etc", "__init__", "level", [], {}, [[]]]
NASTY += [
    {"level": "plants"}, {"level": None}, {"level": ["plants"]}, {"": 1}, [1, [2, [3, [4]]]],
    {"a": {"b": {}}},
]  # fmt: skip
RAW = [
    ".nan", "-.inf", "1e999", "!!python/object:os.system {}", "*none", "&a [*a]", "[", "{a: 1, a: 2}",
    "<<: x",
]  # fmt: skip
RAW += [
    "9" * 5000, "[" * 300, "? [x]", "'", '"\\ud800"', "%", "@", "`", "|", "- -", "{<<: [1]}",
    "0x" + "f" * 40,
]  # fmt: skip
KEYS = [
    "level", "rate_hz", "wires", "file", "folder", "sensor", "machine", "shape", "kind", "x_m",
    "spead_kmh", "a.b",
]  # fmt: skip


def paths(data, at=()):
    """Every place in nested data."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [at, *(p for key, value in items for p in paths(value, (*at, key)))]


def inside(data, path):
    for part in path:
        data = data[part]
    return data


@st.composite
def mutated(draw):
    """Text of a scenario after one to four changes."""
    data = copy.deepcopy(parse(GOOD).data)
    for _ in range(draw(st.integers(1, 4))):
        places = [p for p in paths(data) if p]
        if not places:
            break
        *where, key = draw(st.sampled_from(places))
        parent = inside(data, where)
        action = draw(st.sampled_from(["delete", "rename", "replace", "add", "wrap", "number"]))
        if action == "delete":
            del parent[key]
        elif action == "rename" and isinstance(parent, dict):
            parent[draw(st.sampled_from(KEYS) | st.text(min_size=1, max_size=6))] = parent.pop(key)
        elif action == "add" and isinstance(parent, dict):
            parent[draw(st.sampled_from(KEYS))] = copy.deepcopy(draw(st.sampled_from(NASTY)))
        elif action == "wrap":
            parent[key] = [parent[key]] if draw(st.booleans()) else {"level": parent[key]}
        elif action == "number":
            parent[key] = draw(st.floats(allow_nan=False, allow_infinity=False) | st.integers())
        else:
            parent[key] = copy.deepcopy(draw(st.sampled_from(NASTY)))
    return dump(data)


@st.composite
def scrambled(draw):
    """Text of a scenario in which pieces were replaced or lines were doubled."""
    text = GOOD
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 30)))
        piece = draw(st.sampled_from(RAW) | st.text(max_size=8) | st.just(text[start:end] * 2))
        text = text[:start] + piece + text[end:]
    lines = text.split("\n")
    index = draw(st.integers(0, len(lines) - 1))
    return "\n".join(
        [*lines[: index + 1], *([lines[index]] if draw(st.booleans()) else []), *lines[index + 1 :]]
    )


def read(text, sets=()):
    """A scenario, or None when it was refused as it should be."""
    said = ""
    try:
        scenario = parse_scenario(text, catalogue=FAKE, sets=sets)
    except SwathError as error:
        said = str(error)
        scenario = None
    if scenario is None:
        assert said.strip()
        assert len(said.splitlines()) == 1
        return None
    assert isinstance(scenario, Scenario)
    assert parse_scenario(scenario.resolved(), catalogue=FAKE) == scenario
    return scenario


@cache
def validator():
    return jsonschema.Draft202012Validator(scenario_schema(FAKE))


@settings(max_examples=150)
@given(mutated())
def test_mutated_data(text):
    if read(text) is not None:
        assert validator().is_valid(parse(text).data)  # an editor must not mark what can be run


@settings(max_examples=120)
@given(scrambled() | st.text(max_size=60))
def test_scrambled_text(text):
    read(text)


@settings(max_examples=80)
@given(
    st.lists(
        st.sampled_from(
            ["combine", "field", "run", "seed", "lidar", "stand", "obstacles", "0", "level", "", "é"]
        ),
        min_size=1,
        max_size=4,
    ).map(".".join),
    st.sampled_from([str(n) for n in NASTY] + RAW) | st.text(max_size=10),
)
def test_overrides(key, value):
    read(GOOD, sets=[f"{key}={value}"])
    read(GOOD, sets=[f"{key}{value}"])
