"""The drawn worlds of benchmarks/edge_worlds.py: their axes, what the scans hold, and the verdicts."""

import json

import numpy as np
import pytest
from benchmarks import edge_worlds
from benchmarks.edge_worlds import (
    COUNTS,
    CROPS,
    POOLS,
    SCANNERS,
    STEEPEST,
    TALLEST,
    Case,
    drawn,
    driven,
    numbers,
    run_all,
    samples,
    sets_of,
    texts,
)

from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario

BOUNDS = {
    "height": (0.7, 1.2), "lean": (0.0, 35.0), "towards": (-180.0, 180.0), "length": (20.0, 80.0),
    "wave": (0.0, 0.8), "slope": (0.0, 14.0), "stubble": (0.05, 0.45), "mount": (1.8, 3.6),
    "wind": (0.0, 8.0),
}  # fmt: skip


@pytest.mark.parametrize("pool", ["building", "judging"])
def test_draws_fill_their_ranges_and_stay_in_them(pool):
    cases = [drawn(pool, number) for number in range(400)]
    for axis, (low, high) in BOUNDS.items():
        values = np.array([d[axis] for d in cases])
        assert low <= values.min() <= low + 0.1 * (high - low), axis
        assert high - 0.1 * (high - low) <= values.max() <= high, axis
    for d in cases:
        assert 2.0 * np.pi * d["wave"] <= STEEPEST * d["length"] * (1.0 + 1e-9)
        assert d["stubble"] <= TALLEST * d["height"] * CROPS[d["crop"]][2]


def test_building_has_nothing_of_what_is_left_out_and_judging_has_all():
    building, judging = ([drawn(pool, n) for n in range(400)] for pool in ("building", "judging"))
    assert {d["crop"] for d in building} == set(CROPS) - {"rye"}
    assert {d["scanner"] for d in building} == set(SCANNERS) - {"hokuyo-utm-30lx"}
    assert not any(30.0 <= d["length"] <= 45.0 for d in building)
    assert {d["crop"] for d in judging} == set(CROPS)
    assert {d["scanner"] for d in judging} == set(SCANNERS)
    assert any(30.0 <= d["length"] <= 45.0 for d in judging)
    assert not {d["seed"] for d in building} & {d["seed"] for d in judging}


def test_a_sixth_of_the_judging_cases_lean_out():
    tags = [POOLS["judging"](number).tags for number in range(COUNTS["judging"])]
    assert sum("leans out" in of for of in tags) >= 20


@pytest.mark.draws
@pytest.mark.parametrize("pool", list(POOLS))
def test_cases_are_worlds_of_straight(pool):
    for number in range(0, COUNTS[pool], 1 + COUNTS[pool] // 40):
        case = POOLS[pool](number)
        assert case == POOLS[pool](number)
        assemble(load_scenario("straight", sets=list(case.sets))).close()


def test_the_other_side_is_the_mirror_image():
    d = drawn("judging", 3) | {"hole": "none", "wind": 5.0}
    left, right = (sets_of(d | {"side": side}) for side in ("left", "right"))
    for section, key in (("field.stand", "lean_azimuth_deg"), ("field.terrain", "slope_azimuth_deg"),
                         ("field.weather", "wind_azimuth_deg")):  # fmt: skip
        assert left[section][key] == -right[section][key] != 0.0


def row(*, way=30.0, lateral=0.0, error=0.0, sd=0.05, confidence=0.9, nat=300.0, tags=()):
    at = np.arange(0.0, way + 1e-9, 0.02)
    told = np.where(at > 1.0, confidence, 0.0) * np.ones_like(at)
    return {
        "name": "a", "sets": ["a"], "tags": list(tags), "facts": "", "metres": 30.0, "seconds": 20.0,
        "cpu_s": 1.0, "way": at.tolist(), "told_way": at.tolist(),
        "lateral": (lateral * np.ones_like(at)).tolist(),
        "error": np.where(told > 0.0, error, np.nan).tolist(), "sd": (sd * np.ones_like(at)).tolist(),
        "confidence": told.tolist(), "nat": [nat] * 20, "edge_sd": [0.02] * 20,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("of", "verdict", "needless"),
    [
        ({}, "holds", False),
        ({"lateral": 0.31}, "off", False),
        ({"way": 20.0, "lateral": 0.31, "error": 0.31, "confidence": 0.2}, "stops", True),
        ({"way": 20.0, "nat": 20.0}, "stops", False),
        ({"way": 20.0, "tags": ["leans out"]}, "stops", False),
        ({"way": 20.0, "lateral": 0.6}, "off", False),
        ({"way": 4.8, "lateral": 0.6, "confidence": 0.0}, "stops", True),
        ({"error": -0.31}, "off", False),
        ({"error": -0.31, "confidence": 0.4}, "holds", False),
        ({"confidence": 0.0}, "off", False),
    ],
)
def test_verdicts(of, verdict, needless):
    found = numbers(row(**of))
    assert (found["verdict"], found["needless"]) == (verdict, needless)


def test_samples_are_even_over_the_way():
    at = samples(row())[:, 0]
    assert len(at) == pytest.approx(220, abs=2)
    assert numbers(row(error=0.08, sd=0.05))["band"] == 1.0
    assert numbers(row(error=0.12, sd=0.05))["band"] == 0.0


@pytest.mark.draws
def test_scans_hold_an_edge_where_one_stands_and_none_behind_dust():
    sets = {"seed": 3, "run.distance_m": 12, "combine.lidar.level": "empirical"}
    clear = driven(Case("clear", texts(sets)))
    assert np.median(clear["nat"]) > 100.0
    assert np.median(clear["edge_sd"]) < 0.05
    assert np.nanmax(np.abs(samples(clear)[:, 1])) < 0.1
    fog = driven(Case("fog", texts(sets | {"combine.lidar.weather.extinction_per_m": 5.0})))
    assert not len(fog["nat"]) or np.median(fog["nat"]) < 10.0


def test_what_was_driven_is_not_driven_again(tmp_path, monkeypatch):
    calls = []

    def stand_in(case):
        calls.append(case.name)
        return {**row(), "name": case.name, "sets": list(case.sets)}

    monkeypatch.setattr(edge_worlds, "driven", stand_in)
    file, first = tmp_path / "runs.parquet", [Case("a", ("seed=1",)), Case("b", ("seed=2",))]
    run_all(iter(first), file)
    rows = run_all(iter([*first, Case("c", ("seed=3",)), Case("b", ("seed=4",))]), file)
    assert calls == ["a", "b", "c", "b"]
    assert [one["sets"] for one in rows] == [["seed=1"], ["seed=2"], ["seed=3"], ["seed=4"]]
    assert json.dumps(numbers(rows[0])) == json.dumps(numbers(row()))
