"""What a sensor's mounting is where a scenario writes none of it, or one key."""

from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path

import pytest

from swath import load_scenario
from swath.scenario.slots import CATALOGUE

ROOT = Path(__file__).parents[2]
LEVELS = [
    (kind, name)
    for kind in sorted({slot.name for slot in CATALOGUE.slots})
    for name in CATALOGUE.registry.names(kind)
]


@pytest.mark.parametrize(("kind", "level"), LEVELS)
def test_a_section_has_the_same_defaults_written_in_part_or_not_at_all(kind, level):
    params = CATALOGUE.registry.get(kind, level).params
    for field in fields(params) if is_dataclass(params) else ():
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if is_dataclass(default) and field.default_factory is not MISSING:
            assert field.default_factory is type(default), f"{kind}: {level}, {field.name}"


def mount(sensor, **written):
    said = {"radar": "error", "camera": "rays", "ground_speed": "radar", "objects": "truth"}
    text = ", ".join(f"{k}: {v}" for k, v in written.items())
    given = f", mount: {{{text}}}" if written else ""
    scenario = load_scenario("straight", sets=[f"combine.{sensor}={{level: {said[sensor]}{given}}}"])
    m = scenario.machines["combine"].slots[sensor].params.mount
    return m.at, m.x_m, m.y_m, m.z_m, m.pitch_deg


@pytest.mark.parametrize(
    ("sensor", "own"),
    [
        ("radar", ("axle", 3.5, 0.0, 1.6, 0.0)),
        ("objects", ("axle", 1.5, 0.0, 3.6, 0.0)),
        ("ground_speed", ("axle", -1.0, 0.0, 0.9, 0.0)),
        ("camera", ("edge_end", 0.0, 0.0, 2.4, 16.0)),
    ],
)
def test_one_written_key_leaves_the_others_of_that_sensor(sensor, own):
    assert mount(sensor) == own
    assert mount(sensor, y_m=0.4) == (*own[:2], 0.4, *own[3:])
    assert mount(sensor, z_m=1.1) == (*own[:3], 1.1, own[4])
    assert mount(sensor, pitch_deg=5) == (*own[:4], 5.0)


def test_the_reference_prints_the_radars_own_mounting():
    page = (ROOT / "docs" / "reference" / "scenario.md").read_text(encoding="utf-8")  # it is as made
    radar = page.partition("\n### radar\n")[2].partition("\n### ")[0]
    (line,) = (line for line in radar.splitlines() if line.startswith("| `mount` |"))
    assert "at: axle" in line
    assert "z_m: 1.6" in line
    assert "pitch_deg: 0.0" in line
