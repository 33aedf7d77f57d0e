"""Results of crop and engine say on which numbers they rest, and which matter most."""

from types import SimpleNamespace

import pytest

from swath.documents.data_sheets import find_sheet
from swath.runtime.inputs import _crop
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario


@pytest.fixture(scope="module")
def summary(tmp_path_factory):
    scenario = load_scenario("record-run", sets=["run.distance_m=25", "run.record=none"])
    return run_job(scenario, tmp_path_factory.mktemp("run") / "run").summary


def worth(summary, metric):
    rows = summary["inputs"]["combine"][metric]["matter_most"]
    return {row["key"]: (row["tag"], row["percent_per_percent"]) for row in rows}


def test_every_metric_of_load_fuel_loss_and_throughput_says_what_it_rests_on(summary):
    told = summary["inputs"]["combine"]
    for name in ("mean_throughput_t_h", "mean_loss_percent", "mean_engine_load", "fuel_l_t", "grain_cut_kg"):
        sources = told[name]["numbers"]
        assert set(sources) == {"combine.process: threshing", "combine.powertrain: hydrostat", "crop wheat"}
        assert all(set(tags) == {"S", "D", "E", "U"} and sum(tags.values()) > 10 for tags in sources.values())


def test_sensitivities_are_those_of_the_closed_forms(summary):
    """Load is power over rated power; fuel is in proportion to the work but for what turning alone burns."""
    load, fuel = worth(summary, "mean_engine_load"), worth(summary, "fuel_l_t")
    assert len(load) == len(fuel) == 3
    assert load["engine.rated_power_kw"] == ("D", pytest.approx(-1.0, abs=1e-3))
    tag, share = fuel["engine.fuel_g_kwh"]
    assert tag == "E"
    assert 0.9 < share < 1.0
    both = set(load) & set(fuel)
    assert both
    for key in both:
        assert fuel[key][1] == pytest.approx(share * load[key][1], rel=0.01)


def test_a_crop_of_a_field_folder_is_found_there(tmp_path):
    (tmp_path / "mine.yaml").write_text(find_sheet("crops", "wheat").read_text())
    field, scenario = (SimpleNamespace(**of) for of in (
        {"stand": SimpleNamespace(crop="mine.yaml")}, {"field": SimpleNamespace(folder=tmp_path)}
    ))  # fmt: skip
    told = _crop(SimpleNamespace(field=field, scenario=scenario))
    assert list(told) == ["crop mine"]
    assert sum(told["crop mine"].values()) > 10
