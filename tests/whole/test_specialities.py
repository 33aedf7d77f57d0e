"""Every example shows what it is named for: taken away, the limit that shows it moves; none is not judged."""

import json
import math

import pytest
from benchmarks.specialities import KEPT, driven, examples, fault, read, shown, values

from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import scenario_names

EXAMPLES = examples()
SHOWN = [one for name in EXAMPLES for one in shown(name)]
QUICK = {
    "camera-cab", "drifting-dust", "evening-camera", "fawn-at-dawn", "feed-rate", "gnss-lost", "record-run",
}  # fmt: skip
BY_COST = [
    pytest.param(one, id=one.key, marks=() if one.example in QUICK else pytest.mark.draws) for one in SHOWN
]


def test_each_example_states_what_it_shows():
    assert {one.example for one in SHOWN} == set(EXAMPLES)
    assert len(EXAMPLES) >= len(scenario_names()) + 2


def test_by_is_what_was_measured_over_seeds():
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    assert list(kept) == [one.key for one in SHOWN]
    faults = [fault(one, kept[one.key]["with"], kept[one.key]["without"]) for one in SHOWN]
    assert not any(faults), faults


@pytest.mark.parametrize("one", BY_COST)
def test_the_limit_moves_without_it(one):
    as_shipped, without = values(one)
    assert math.isfinite(as_shipped)
    assert abs(as_shipped - without) >= one.speciality.by
    entries = driven(one.example, one.speciality.run_m, 1)
    assert not [entry["name"] for entry in entries if entry.get("rests_outside")]


@pytest.mark.draws
@pytest.mark.parametrize("name", EXAMPLES)
def test_every_limit_passes_as_shipped(name):
    expect = run_unrecorded(read(name))["expect"]
    assert all(entry["result"] == "pass" and "rests_outside" not in entry for entry in expect), expect
