"""What a run says of keys that were set and that nothing uses."""

import pytest

from swath.runtime.job import run_unrecorded
from swath.runtime.kept import KeptFields
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from tests.felt import SHORT, Looked, rows_of, weather_rows

CHEAP = ("run.distance_m=1", "combine.lidar={level: empirical, step_deg: 2}")
WIND = "field.weather.wind_m_s=12"


def told(name, *sets, fields=None):
    """Keys that a run says are unused, and who asked for others."""
    cheap = CHEAP[: 1 if name != "straight" else 2]
    scenario = load_scenario(name, sets=layered(SHORT, cheap, sets))
    summary = run_unrecorded(scenario, fields)
    begin = "no part of this run uses "
    notes = [note.removeprefix(begin) for note in summary.get("notes", []) if note.startswith(begin)]
    return [note.partition(":")[0] for note in notes], summary.get("asked_by", {})


def test_a_wind_that_no_crop_leans_in_is_told():
    assert told("straight", WIND) == (["field.weather.wind_m_s"], {"field.weather.wind_m_s": []})
    assert told("straight", WIND, "field.stand.wind={}", "combine.lidar=plants") == (
        [],
        {"field.weather.wind_m_s": ["combine.lidar"]},
    )
    assert told("straight", WIND, "field.stand.wind={}")[0] == ["field.weather.wind_m_s"]  # `empirical`
    assert told("straight", "combine.lidar.weather={near_returns: 1, near_share: 0.5}") == ([], {})
    key = "combine.lidar.weather.near_share"
    assert told("straight", f"{key}=0.5") == ([key], {key: []})


def test_who_asks_for_the_water_in_straw_is_told():
    water = "field.stand.straw_moisture_percent"
    assert told("straight", f"{water}=20")[1][water] == []
    assert told("drifting-dust")[1][water] == ["combine.dust"]


def test_a_kept_field_says_the_same():
    fields = KeptFields()
    changes = (), ("combine.dust=off",), ()
    in_turn = [told("drifting-dust", *sets, fields=fields) for sets in changes]
    assert in_turn == [told("drifting-dust", *sets) for sets in changes]
    assert "field.weather.wind_m_s" in in_turn[1][0]
    assert "field.weather.wind_m_s" not in in_turn[2][0]


@pytest.mark.parametrize("first", [0, 1])
def test_keys_that_are_told_are_not_felt(first):
    looked, rows = Looked(), [*weather_rows("drifting-dust")][first::3]
    found = {row.key: looked.look(row) for row in rows}
    assert not [key for key, of in found.items() if of.is_false]
    assert {of.is_told for of in found.values()} == {of.is_felt for of in found.values()} == {True, False}


def test_keys_of_a_scenario_are_found():
    keys = {row.key for row in rows_of("straight", ("combine.steer.lookahead_m=3", WIND))}
    assert keys >= {"field.terrain.slope_percent", "field.weather.wind_m_s", "combine.steer.lookahead_m"}
