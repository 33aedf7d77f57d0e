"""Two combines on opposite sides of a strip and a tractor: one conserved field, each machine on its own."""

import json
import pickle

import pyarrow.parquet as pq
import pytest

from swath.record.digest import Digest
from swath.replay.writer import ReplayWriter
from swath.report.report import ReportWriter
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.runtime.loop import drive
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from tests.replay.page_data import data_of

CHEAP = [f"{name}.lidar.{key}" for name in ("west", "east") for key in ("sub_rays=1", "step_deg=2")]
SHORT = ["run.distance_m=11", "east.speed.speed_kmh=7", *CHEAP]


def two_combines(*sets):
    return load_scenario("two-combines", sets=layered(SHORT, sets))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "two"
    return run_job(two_combines(), out, hooks=[ReportWriter(), ReplayWriter()])


def test_what_left_the_field_is_in_both_machines(finished):
    summary = finished.summary
    assert finished.exit_code == 0
    assert summary["field"]["mass_balance_error"] < 1e-9
    west, east, tractor = (summary["machines"][name] for name in ("west", "east", "tractor"))
    assert west["area_cut_m2"] == pytest.approx(12.2 * 11, rel=0.1)
    assert east["area_cut_m2"] == pytest.approx(5.0 * 11, rel=0.1)
    assert "area_cut_m2" not in tractor
    assert tractor["distance_m"] > 8


def test_the_replay_shows_all_machines_and_both_scanners(finished):
    values, arrays = data_of(finished.folder / "replay.html")
    assert [(m["name"], m["cuts"]) for m in values["machines"]] == [
        ("west", True),
        ("east", True),
        ("tractor", False),
    ]
    assert [(s["machine"], s["slot"]) for s in values["scanners"]] == [(0, "lidar"), (1, "lidar")]
    assert [s["machine"] for s in values["straw"]] == [0, 1]
    assert [m["trailer"] is not None for m in values["machines"]] == [False, False, True]
    taken = (arrays["cut_when"] > 0) & (arrays["cut_when"] < 65535)
    area = float(taken.sum()) * (values["area"]["tile"] / values["area"]["cells"]) ** 2
    west, east = (finished.summary["machines"][name]["area_cut_m2"] for name in ("west", "east"))
    assert area == pytest.approx(west + east, rel=0.01)


def test_limits_and_metrics_belong_to_a_machine_or_the_field(finished):
    limits = {(e["subject"], e["name"]): e["result"] for e in finished.summary["expect"]}
    assert limits["west", "lateral_p95_m"] == limits["east", "lateral_p95_m"] == "pass"
    assert limits["field", "mass_balance_error"] == "pass"
    assert limits["tractor", "contact_count"] == "pass"
    assert "lateral_p95_m" not in finished.summary  # no machine stands for all


def test_a_limit_of_one_machine_fails_the_run(tmp_path):
    scenario = two_combines("run.distance_m=0.3", "expect.east.distance_m={min: 100}")
    result = run_job(scenario, tmp_path / "run")
    assert result.exit_code == 1
    failed = [(e["subject"], e["name"]) for e in result.summary["expect"] if e["result"] == "fail"]
    assert ("east", "distance_m") in failed
    assert ("west", "distance_m") not in failed


def test_tracks_and_report_show_every_machine(finished):
    table = pq.read_table(finished.folder / "tracks.parquet")
    assert set(table["machine"].to_pylist()) == {"west", "east", "tractor"}
    page = (finished.folder / "report.html").read_text(encoding="utf-8")
    for name in ("west", "east", "tractor"):
        assert f"Results: {name}" in page
    assert json.loads((finished.folder / "summary.json").read_text())["format"] == "swath summary 2"


def digest_of(world, **keys):
    digest = Digest()
    drive(world, [digest], **keys)
    return digest


def test_the_same_digest_for_other_threads_and_after_save_and_load(monkeypatch):
    sets = ("run.distance_m=1",)
    monkeypatch.setenv("SWATH_THREADS", "1")
    reference = digest_of(assemble(two_combines(*sets))).hex
    monkeypatch.setenv("SWATH_THREADS", "2")
    world = assemble(two_combines(*sets))
    digest = digest_of(world, until_s=0.5)
    state = pickle.loads(pickle.dumps({"world": world.save(), "digest": digest.save()}))
    fresh, second = assemble(two_combines(*sets)), Digest()
    fresh.load(state["world"])
    second.load(state["digest"])
    drive(fresh, [second], resume=True)
    assert second.hex == reference


def test_driven_reset_and_driven_again_is_the_same_digest():
    world = assemble(two_combines("run.distance_m=1"))
    first = digest_of(world).hex
    world.reset()
    assert digest_of(world).hex == first
