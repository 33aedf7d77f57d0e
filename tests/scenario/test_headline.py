"""The head line of report, replay, live page and diff: what was run, whatever the file's author wrote."""

import random

import pytest

from swath.scenario.scenario import load_scenario, parse_scenario

KEYS = {
    "combine.speed.speed_kmh": lambda draw: round(draw.uniform(2.0, 9.0), 1),
    "field.stand.stems_per_m2": lambda draw: draw.randint(100, 500),
    "field.stand.crop": lambda draw: draw.choice(["wheat", "barley", "rye"]),
    "field.edge": lambda draw: draw.choice(["{shape: straight}", "{shape: curve, radius_m: 60}"]),
    "combine.lidar.level": lambda draw: draw.choice(["plants", "empirical"]),
    "combine.edge_side": lambda draw: draw.choice(["left", "right"]),
    "seed": lambda draw: draw.randint(1, 9),
}


@pytest.mark.parametrize("number", range(20))
def test_what_is_set_is_told_and_nothing_else_is(number):
    draw = random.Random(number)
    name = draw.choice(["straight", "laser-pilot", "bend"])
    written = load_scenario(name).summary
    sets = [f"{key}={KEYS[key](draw)}" for key in draw.sample(sorted(KEYS), draw.randint(1, 3))]
    made = load_scenario(name, sets=[*sets, "expect={}"])
    assert made.summary == f"{name} with {'; '.join(sorted(sets))}"
    assert written not in made.summary
    again = parse_scenario(made.resolved())
    assert again.summary == made.summary
    key, value = sets[0].partition("=")[0], KEYS[sets[0].partition("=")[0]](draw)
    more = parse_scenario(made.resolved(), sets=[f"{key}={value}"])
    assert more.summary == f"{name} with {'; '.join(sorted([*sets[1:], f'{key}={value}']))}"


def test_what_changes_nothing_of_what_is_driven_leaves_the_line():
    written = load_scenario("straight").summary
    assert load_scenario("straight", sets=["expect={}", "run.record=none"]).summary == written
    assert load_scenario("straight", sets=["summary=mine", "seed=3"]).summary == "mine"
    assert load_scenario("straight", flags={"--seed 3": "seed=3"}).summary == "straight with seed=3"
