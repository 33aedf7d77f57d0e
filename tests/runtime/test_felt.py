"""What a run says of keys that were set and that nothing uses."""

from contextlib import suppress

import pytest

from swath.core.errors import InputError
from swath.runtime.job import run_unrecorded
from swath.runtime.kept import KeptFields
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from tests.felt import SHORT, Looked, drawn_rows, rows_of, weather_rows

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


UNUSED = {  # key that changes nothing -> its value, and what makes it change something
    "combine.imu.fault.burst_ms": ("100", "combine.imu.fault.loss_percent=50"),
    "combine.odometry.fault.hold_s": ("[[50, 51]]", "combine.odometry.fault.hold_s=[[0.2, 0.3]]"),
    "combine.motion.latch": ("true", "combine.motion.latch=false"),
    "realtime.patience": ("5", "realtime.on_overrun=degrade"),
}


def test_keys_of_slots_and_realtime_are_told():
    pace = ("realtime={factor: 100, degrade: [{slot: combine.edge, level: otsu}]}",)
    sets = {key: f"{key}={value}" for key, (value, _) in UNUSED.items()}
    assert set(told("straight", *pace, *sets.values())[0]) == {*UNUSED, "realtime.degrade"}
    used = {of.partition("=")[0]: of for _, of in UNUSED.values()}
    assert told("straight", *pace, *(sets | used).values())[0] == []
    assert set(told("straight", *pace, "realtime.pace=free")[0]) == {"realtime.factor", "realtime.degrade"}


def test_what_no_contact_asks_for_is_told():
    person = "field.obstacles=[{kind: person, x_m: 2, y_m: 1}]"
    assert told("straight", "run.on_contact=note")[0] == ["run.on_contact"]
    assert told("straight", "run.on_contact=note", "run.distance_m=3", person)[0] == []


def test_keys_of_a_machine_without_a_header_are_told():
    sets = "cart.edge_side=right", "cart.start={x_m: 30, y_m: 0, heading_deg: 90}"
    assert told("unload-on-the-go", *sets)[0] == ["cart.edge_side"]


def test_a_slot_that_is_never_due_is_named():
    scenario = load_scenario("straight", sets=layered(SHORT, CHEAP, ("combine.imu.rate_hz=0.1",)))
    said = "combine.imu: it is first due at 10 s, when the run is over"
    assert said in run_unrecorded(scenario)["notes"]


def test_drawn_keys_that_are_told_are_not_felt():
    looked, rows = Looked(), drawn_rows("straight", CHEAP, count=8)
    assert {row.group for row in rows} == {"run", "realtime", "machine", "slot", "fault", "part"}
    found = {}
    for row in rows:
        with suppress(InputError):  # a value that cannot be
            found[row.key] = looked.look(row)
    assert len(found) >= 6
    assert not [key for key, of in found.items() if of.is_false]
