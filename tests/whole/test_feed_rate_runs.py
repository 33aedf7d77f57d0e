"""Speed by throughput on real stems: the bundled scenarios, shortened to the jump of the stand."""

import pytest

from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario
from tests.evaluated import metrics_of

JUMP = ("combine.start.along_edge_m=45", "run.distance_m=105")


def judged(name, *sets):
    world = assemble(load_scenario(name, sets=list(sets)))
    evaluation = make_evaluation(world)
    drive(world, [evaluation])
    return metrics_of(evaluation)


def test_the_record_run():
    m = judged("record-run", "run.distance_m=70")
    assert 77.0 < m["mean_throughput_t_h"] < 94.0
    assert m["peak_engine_load"] < 1.0
    assert m["mean_loss_percent"] < 1.5
    assert m["mass_balance_error"] < 1e-9


def test_a_third_more_speed_is_seen_in_every_number():
    """With the engine of the data sheet, that is smaller than the record's."""
    faster = ("combine.speed.speed_kmh=9.55", "combine.speed.guard.when_lost=ignore")
    m = judged("record-run", "run.distance_m=120", "combine.powertrain.rated_power_kw=388.6", *faster)
    assert m["peak_engine_load"] > 1.0
    assert m["lowest_engine_rpm"] < 1750.0
    assert m["peak_loss_percent"] > 3.0
    assert m["mass_balance_error"] < 1e-9


@pytest.fixture(scope="module")
def measured():
    return judged("feed-rate", *JUMP)


@pytest.fixture(scope="module")
def seen():
    return judged("look-ahead", *JUMP)


def test_looking_ahead_spares_the_engine_and_the_grain(measured, seen):
    assert measured["peak_engine_load"] > 1.0 > seen["peak_engine_load"]
    assert seen["peak_loss_percent"] < 0.5 * measured["peak_loss_percent"]
    assert seen["lowest_engine_rpm"] > measured["lowest_engine_rpm"] + 50.0
    assert seen["mean_throughput_t_h"] > 0.85 * measured["mean_throughput_t_h"]


def test_crop_is_conserved_with_both(measured, seen):
    assert measured["mass_balance_error"] < 1e-9
    assert seen["mass_balance_error"] < 1e-9
