"""`swath odd check`, `swath test run --odd`: binding, design, what was driven, verdicts on cells, dossier."""

import csv
import json
import shutil
from dataclasses import replace
from html import unescape
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.commands.main import main
from swath.core.errors import InputError
from swath.documents.yaml_document import read_document
from swath.runtime.job import run_unrecorded
from swath.runtime.met import MetHook
from swath.scenario.scenario import load_scenario
from swath.tools.function_test.case import Claim, Varied, read_case
from swath.tools.function_test.one_run import scenario_of
from tests.tools.fake_work import driven_here
from tests.tools.odd_files import (
    BINDING,
    DENSITY,
    OPENODD,
    RAIN,
    SLOPE,
    SPEED,
    conducted,
    failing,
    small_odd,
    write_odd,
)

pytest.importorskip("openodd", reason="needs the extra odd")

from swath.tools.function_test.judging.verdict import BROKEN, SHOWN
from swath.tools.function_test.odd.binding import find_odd, read_odd
from swath.tools.function_test.odd.campaign import Conducted
from swath.tools.function_test.odd.causes import AS_THE_REST, KINDS, REACH, explained
from swath.tools.function_test.odd.cells import (
    NEVER,
    needed_each,
    p_broken,
    p_shown,
)
from swath.tools.function_test.odd.check import check
from swath.tools.function_test.odd.coverage import Coverage, driven_of
from swath.tools.function_test.odd.design import Design
from swath.tools.function_test.odd.dossier import _runs_of, _unfelt, summary_of, write_dossier
from swath.tools.function_test.odd.openodd import attributes_of
from swath.tools.function_test.odd.trace import DEGREE_M, broken_by, trace_rows, traced, write_cod

CLAIM = Claim(pass_rate=0.8, confidence=0.95)


@pytest.fixture(scope="module")
def passing(tmp_path_factory: pytest.TempPathFactory) -> Conducted:
    """A campaign of 450 runs that all pass."""
    folder = tmp_path_factory.mktemp("campaign")
    with pytest.MonkeyPatch.context() as patch:
        return conducted(patch, folder / "out", small_odd(folder), 450, 1, lambda run, u: False)


def kinds(path: Path) -> dict[tuple[str, str], str]:
    return {(f.kind, f.name): f.text for f in check(read_odd(path))}


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_bundled_odd_binds_seven_layers_and_has_nothing_to_mend():
    odd = read_odd(find_odd("wheat-harvest"))
    assert odd.layers == [
        "terrain", "edge", "temporary", "moving", "weather", "communication", "process"
    ]  # fmt: skip
    assert set(odd.file.attributes) == set(odd.domain.attributes)
    assert all(axis.count >= 4 or not axis.edges for axis in odd.axes)
    assert {f.kind for f in check(odd)} <= {"not simulated", "not drawn"}
    assert len([f for f in check(odd) if f.kind == "not simulated"]) == 7


def test_attributes_that_no_sensor_asks_for_are_told(passing: Conducted):
    density, speed = "field.stand.stems_per_m2", "combine.speed.speed_kmh"
    asked = [{density: ["combine.motion"], speed: []}, {density: ["combine.dust"], f"{speed}_limit": []}, {}]
    results = [{"asked_by": by} for by in asked]

    def told(*more: dict[str, Any]) -> list[list[str]]:
        runs = [SimpleNamespace(result=result) for result in (*results, *more)]
        return _unfelt(SimpleNamespace(odd=passing.odd, coverage=SimpleNamespace(runs=runs)))  # type: ignore[arg-type]

    felt_not = ["process.speed", "nothing", "1"]
    assert told() == [felt_not, [DENSITY, "combine.dust, combine.motion", "2"]]
    for slot, rest in (("combine.lidar_left", 1), ("combine.edge", 1), ("combine.header", 2)):
        assert len(told({"asked_by": {density: [slot]}})) == rest


def test_check_names_what_is_wrong(tmp_path: Path):
    assert kinds(write_odd(tmp_path)) == {
        ("not simulated", "weather.fog"): "no drops",
        ("not drawn", "weather.rain"): "outside the ODD: downpour",
        ("not drawn", "process.speed"): "the ODD goes on below 2 km/h, the buckets end there",
    }
    unbound = BINDING.replace("  weather.fog: {not_simulated: no drops}\n", "")
    assert ("unbound", "weather.fog") in kinds(write_odd(tmp_path, unbound))
    far = BINDING.replace("300, 500, 700]", "300, 500, 4000]")
    assert "4000" in kinds(write_odd(tmp_path, far))["out of range", DENSITY]
    few = BINDING.replace("buckets: [2, 4, 6, 8, 10], exposure: [1, 2, 2, 1]", "buckets: [2, 6, 10]")
    assert ("few buckets", "process.speed") in kinds(write_odd(tmp_path, few))
    twice = BINDING.replace("combine.speed.speed_kmh", "field.terrain.slope_percent")
    assert ("contradictory", "process.speed") in kinds(write_odd(tmp_path, twice))
    none = OPENODD.replace('process.speed: "[0 .. 10] km/h"', 'process.speed: "> 12 km/h"')
    assert ("contradictory", "process.speed") in kinds(write_odd(tmp_path, BINDING, none))
    inside = BINDING.replace("buckets: [50, 150,", "buckets: [50, 120,")
    limit = OPENODD.replace("[50 .. 700] 1/m2", "[100 .. 700] 1/m2")
    assert "a limit of the ODD lies inside" in kinds(write_odd(tmp_path, inside, limit))["not drawn", DENSITY]


def test_a_pair_of_modules_that_exclude_everything_is_contradictory(tmp_path: Path):
    ruled = OPENODD.replace("    EXCLUDE_OR:\n      wet_slope: true\n",
                            "    EXCLUDE_OR:\n      slow: true\n      fast: true\n") + (
        "  slow:\n    INCLUDE_AND:\n      process.speed: \"<= 6 km/h\"\n"
        "  fast:\n    INCLUDE_AND:\n      process.speed: \"> 5 km/h\"\n"
    )  # fmt: skip
    assert ("contradictory", "process.speed") in kinds(write_odd(tmp_path, BINDING, ruled))


@pytest.mark.parametrize(
    ("before", "after", "key", "told"),
    [
        (
            "process.density:",
            "process.densty:",
            "attributes.process.densty",
            "did you mean 'process.density'",
        ),
        ("      downpour: {field.stand.lean_deg: 15}\n", "", "attributes.weather.rain.values", "downpour"),
        ("[2, 4, 6, 8, 10]", "[2, 4, 4, 8, 10]", "attributes.process.speed", "rising|above the last"),
        ("exposure: [1, 2, 2, 1]", "exposure: [1, 2, 2]", "attributes.process.speed", "4 shares"),
        ("met: stems_per_m2", "met: stems_per_m", "attributes.process.density", "stems_per_m2"),
        ("unit: 1/m2, buckets", "unit: 1/ha, buckets", "attributes.process.density", "expected 1/m2"),
        (
            "not_simulated: no drops",
            "not_simulated: no drops, key: a.b",
            "attributes.weather.fog",
            "nothing else",
        ),
    ],
)
def test_a_wrong_binding_is_one_error_with_its_place(
    tmp_path: Path, before: str, after: str, key: str, told: str
):
    file = write_odd(tmp_path, BINDING.replace(before, after))
    with pytest.raises(InputError, match=told) as found:
        read_odd(file)
    assert found.value.key.startswith(key)
    assert found.value.line is not None


def test_a_wrong_module_is_told_with_its_line(tmp_path: Path):
    wrong = OPENODD.replace("weather.fog: false", "weather.mist: false")
    with pytest.raises(InputError, match="neither a concept nor a module") as found:
        read_odd(write_odd(tmp_path, BINDING, wrong))
    assert Path(str(found.value.file)).name == "small.openodd.yaml"
    assert found.value.line in range(14, 22)


def test_command_says_exit_codes(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["odd", "check", str(write_odd(tmp_path))]) == 0
    assert "5 of 6 attributes are bound; 0 to mend" in capsys.readouterr().out
    assert main(["odd", "check", str(tmp_path / "small.openodd.yaml")]) == 1
    assert "0 of 6 attributes are bound; 6 to mend" in capsys.readouterr().out
    assert main(["odd", "check", "nowhere"]) == 2
    assert main(["test", "run", "bend", "--odd", "wheat-harvest", "--out", str(tmp_path / "x")]) == 2
    assert main(["test", "run", "--out", str(tmp_path / "x")]) == 2


def test_buckets_hold_their_lower_edge_and_the_last_one_both(tmp_path: Path):
    axis = small_odd(tmp_path).axes[0]
    found = [axis.bucket_of(v) for v in (-16.1, -16, -8.01, -8, 0, 15.9, 16, 16.1, None, float("nan"))]
    assert found == [-1, 0, 0, 1, 2, 3, 3, -1, -1, -1]
    rain = next(a for a in small_odd(tmp_path).axes if a.name == RAIN)
    assert [rain.bucket_of(v) for v in ("no_rain", "downpour", "snow", None)] == [0, 3, -1, -1]


@given(value=st.floats(-16, 16), scale=st.sampled_from([1.0, 0.01, 3.6]), offset=st.floats(-5, 5))
def test_a_parameter_is_converted_to_the_unit_of_its_key(value: float, scale: float, offset: float):
    varied = Varied(key="a.b", at=[1.0], scale=scale, offset=offset)
    assert varied.at_value(value)["a.b"] == pytest.approx(value * scale + offset, rel=1e-5, abs=1e-5)


def test_a_value_stands_for_several_keys(tmp_path: Path):
    case = tmp_path / "c.yaml"
    case.write_text(
        "format: swath test case 1\nobjective: o\nsource: s\nscenario: straight\nexpect: {}\nvary:\n"
        "  rain:\n    at: [wet, dry]\n"
        "    sets: {wet: {field.stand.lean_deg: 5, combine.speed.speed_kmh: 4}, dry: {}}\n"
    )
    read = read_case(case)
    assert read.sets({"rain": "wet"})[-2:] == ["field.stand.lean_deg=5", "combine.speed.speed_kmh=4"]
    assert read.sets({"rain": "dry"}) == ["expect={}"]
    case.write_text(case.read_text().replace("at: [wet, dry]", "at: [wet, snow]"))
    with pytest.raises(InputError, match="names of sets"):
        read_case(case)


@pytest.mark.parametrize("seed", range(4))
def test_design_drives_every_pair_and_stays_inside(tmp_path: Path, seed: int):
    odd = small_odd(tmp_path)
    points = Design(odd, 24, seed).next(np.zeros((16, 16)), 0, 60)
    assert all(odd.domain.holds(point) for point in points)
    seen = {
        (a.first + a.bucket_of(p[a.name]), b.first + b.bucket_of(p[b.name]))
        for p in points[:24]
        for a, b in combinations(odd.axes, 2)
    }
    wanted = {(i, j) for i, j in zip(*np.nonzero(np.triu(odd.possible, 1)), strict=True)}
    assert wanted == seen  # 16 runs are the least for four values each
    assert len(wanted) == 6 * 16 - 3 * 4 - 1  # without the downpour, and showers on the steepest slope


def test_design_aims_at_what_was_not_driven(tmp_path: Path):
    odd = small_odd(tmp_path)
    done = np.full((16, 16), 30.0)
    thin, slope = odd.axes[3], odd.axes[0]
    done[slope.first + 2, thin.first] = done[thin.first, slope.first + 2] = 0.0
    (point,) = Design(odd, 24, 1).next(done, 7, 1)
    assert slope.bucket_of(point[SLOPE]) == 2
    assert thin.bucket_of(point[DENSITY]) == 0


def test_draws_beyond_the_target_follow_the_exposure(tmp_path: Path):
    odd = small_odd(tmp_path)
    points = Design(odd, 1, 5).next(np.full((16, 16), 2.0), 0, 400)
    speed = next(a for a in odd.axes if a.name == "process.speed")
    shares = np.bincount([speed.bucket_of(p["process.speed"]) for p in points], minlength=4) / 400
    assert shares == pytest.approx([1 / 6, 1 / 3, 1 / 3, 1 / 6], abs=0.08)


def test_what_was_driven_counts_metres_seconds_and_the_way_out(tmp_path: Path):
    odd = small_odd(tmp_path)
    point = {SLOPE: 3.0, RAIN: "drizzle", "process.speed": 7.0, DENSITY: 400.0}
    met = {
        "t_s": [0.0, 0.5, 1.0, 1.5], "distance_m": [0.0, 1.0, 3.0, 6.0],
        "slope_across_percent": [3.0, 3.0, 9.0, 17.0], "slope_along_percent": [0.0] * 4,
        "stems_per_m2": [400.0] * 4,
    }  # fmt: skip
    run = driven_of(odd, {"id": "ab", "point": point, "verdict": "pass", "met": met})
    assert run.metres.tolist() == [1.0, 2.0, 3.0, 1.0]
    assert run.seconds.tolist() == [0.5] * 4
    assert run.outside is not None
    assert (run.outside.t_s, run.outside.distance_m, run.outside.length_m) == (1.5, 6.0, 1.0)
    assert run.outside.why == "terrain.side_slope 17"
    assert not run.counts  # a seventh of its way is outside
    failed = driven_of(odd, {"id": "ab", "point": point, "verdict": "fail", "met": met})
    assert failed.counts
    cover = Coverage(odd)
    cover.add(failed)
    slope = odd.axes[0].first
    assert [cover.metres[slope + b, slope + b] for b in range(4)] == [0.0, 0.0, 3.0, 3.0]
    assert cover.counted[slope + 2, slope + 2] + cover.counted[slope + 3, slope + 3] == 1
    density = next(a for a in odd.axes if a.name == DENSITY).first
    assert cover.metres[slope + 3, density + 2] == 3.0
    assert cover.failed.sum() == 16
    nothing = driven_of(odd, {"id": "ab", "point": point, "verdict": "error", "met": None})
    assert nothing.main.tolist() == failed.main.tolist()  # where it was meant to drive
    cover = Coverage(odd)
    cover.add(nothing)
    assert not cover.hits.any()
    assert cover.pair_share == (0, 83)
    assert not cover.counted.any()  # it is told, and nothing is judged from it


def test_numbers_of_runs_and_p_values_are_closed_forms():
    assert needed_each(1, CLAIM) == 14
    assert 0.8 ** needed_each(3694, CLAIM) <= 0.05 / (np.log(3694) + 0.5772156649)
    assert p_shown(14, 0, CLAIM, True) == pytest.approx(0.8**14)
    assert p_broken(7, 7, CLAIM, True) == pytest.approx(0.2**7)
    assert p_broken(10, 0, CLAIM, True) == 1.0
    assert p_broken(12, 12, CLAIM, False) > p_broken(12, 12, CLAIM, True)  # a look costs something


def test_verdicts_are_the_p_values_corrected_by_holm_and_by_benjamini_and_yekutieli(passing: Conducted):
    cells = failing(passing, 250, 3, lambda run, u: is_planted(run)).cells
    broken = set()
    for rank, cell in enumerate(sorted(cells, key=lambda c: c.p_broken)):
        if cell.p_broken > 0.05 / (len(cells) - rank):
            break
        broken.add(cell.text)
    shown = set()
    for size in (1, 2):
        family = sorted((c for c in cells if len(c.places) == size), key=lambda c: c.p_shown)
        limit = 0.05 / len(family) / sum(1.0 / n for n in range(1, len(family) + 1))
        last = max((n for n, c in enumerate(family, 1) if c.p_shown <= n * limit), default=0)
        shown |= {c.text for c in family[:last]}
    assert {c.text for c in cells if c.verdict == BROKEN} == broken
    assert {c.text for c in cells if c.verdict == SHOWN} == shown - broken
    assert broken
    assert 10 < len(shown) < len(cells) - 10


def test_cells_at_the_claimed_rate_are_seldom_called_broken(passing: Conducted):
    wrong = 0
    for seed in range(8):
        found = failing(passing, 40, seed, lambda run, u: u < 0.2)
        wrong += any(cell.verdict == BROKEN for cell in found.cells)
    assert wrong <= 2  # more than 2 of 8 has a chance of 0.6 % at 5 % each


def is_planted(run: Any) -> bool:
    return float(run.point[SLOPE]) > 8.0 and float(run.point[DENSITY]) < 150.0


def test_planted_fault_is_found_and_its_cell_is_the_only_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    odd = small_odd(tmp_path)
    found = conducted(monkeypatch, tmp_path / "out", odd, 250, 0, lambda run, u: is_planted(run) or u < 0.01)
    cells = found.cells
    assert [c.text for c in found.causes] == [f"{SLOPE} 8 to 16 %, {DENSITY} 50 to 150 1/m2"]
    why = explained(found.coverage, cells, found.causes, found.claim)
    assert {cell.text for cell in cells if cell.verdict == BROKEN} == set(why)
    assert all(of.cause for of in why.values())
    write_dossier(found)
    shown = read_odd(found.folder / "shown.odd.yaml")
    inside = {SLOPE: 12.0, DENSITY: 300.0, RAIN: "no_rain", "process.speed": 5.0, "weather.fog": "false"}
    assert shown.domain.holds(inside)
    assert not shown.domain.holds({**inside, DENSITY: 100.0})
    assert shown.domain.holds({**inside, DENSITY: 100.0, SLOPE: 4.0})
    assert not shown.domain.holds({**inside, "weather.fog": "true"})  # as before
    assert {f.kind for f in check(shown)} <= {"not simulated", "not drawn"}


@pytest.mark.parametrize("seed", range(3))
def test_causes_are_what_contrasts_with_the_rest(passing: Conducted, seed: int):
    def two(run: Any, u: float) -> bool:
        return u < (0.95 if run.point[RAIN] == "showers" or float(run.point[SLOPE]) < -8.0 else 0.1)

    def adjacent(run: Any, u: float) -> bool:
        return u < (0.9 if float(run.point[SPEED]) > 6.0 else 0.2)

    rain, slope = f"{RAIN} showers", f"{SLOPE} -16 to -8 %"
    found = failing(passing, 200, seed, two)
    first, second = found.causes
    assert {first.text, second.text} == {rain, slope}
    assert first.counted + first.rest_counted == sum(run.counts for run in found.coverage.runs)
    assert second.counted + second.rest_counted == first.rest_counted
    (_, runs, here, _), (_, others, there, _) = _runs_of(found)
    assert (here, there) == (first.counted, second.counted)  # they drove where they were drawn
    assert not {run.result["id"] for run in runs} & {run.result["id"] for run in others}
    (cause,) = failing(passing, 200, seed, adjacent).causes
    assert cause.text == f"{SPEED} from 6 km/h on"


@pytest.mark.parametrize("seed", [0, 3])
def test_a_range_contrasts_where_no_single_bucket_of_it_does(
    passing: Conducted, monkeypatch: pytest.MonkeyPatch, seed: int
):
    found = failing(passing, 160, seed, lambda run, u: u < (0.4 if float(run.point[SPEED]) < 6.0 else 0.8))
    assert [cause.text for cause in found.causes] == [f"{SPEED} from 6 km/h on"]
    monkeypatch.setattr("swath.tools.function_test.odd.causes._ranges", lambda odd: iter(()))
    assert not replace(found).causes


def test_where_all_fails_alike_no_cause_is_separated(passing: Conducted):
    called = 0
    for seed in range(8):
        found = failing(passing, 200, seed, lambda run, u: u < 0.67)
        called += bool(found.causes)
    assert called <= 2  # more than 2 of 8 has a chance of 0.6 % at 5 % each
    cells = found.cells
    why = explained(found.coverage, cells, [], found.claim)
    assert sum(cell.verdict == BROKEN for cell in cells) == len(why) > 20
    assert {of.why for of in why.values()} == {AS_THE_REST}
    assert not found.causes
    assert f"{len(why)} cells broken {AS_THE_REST}" in summary_of(found).lines
    assert "no cause can be separated" in write_dossier(found).read_text()


def test_a_cause_is_what_was_drawn_and_not_where_a_failing_run_drove(passing: Conducted):
    found = failing(passing, 200, 1, lambda run, u: float(run.point[SLOPE]) > 8.0)
    axes = [axis.name for axis in found.odd.axes]
    coverage = Coverage(found.odd)
    for run in found.coverage.runs:
        if not run.passes:  # what fails sinks to the thinnest stand and rolls to the other side
            run.main[axes.index(DENSITY)] = run.main[axes.index(SLOPE)] = 0
        coverage.add(run)
    found = replace(found, coverage=coverage)
    cells = found.cells
    assert next(c for c in cells if c.text == f"{DENSITY} 50 to 150 1/m2").verdict == BROKEN
    (cause,) = found.causes
    assert cause.text == f"{SLOPE} 8 to 16 %"
    assert (cause.failed, cause.rest_failed) == (cause.counted, 0)
    told = summary_of(found).lines
    assert any("only 0 drove mainly there" in line and cause.text in line for line in told)
    page = write_dossier(found).read_text()
    assert "(!)" in page
    assert "mainly in another bucket" in page


def test_a_range_is_left_out_as_one_condition(passing: Conducted):
    found = failing(passing, 300, 2, lambda run, u: float(run.point[SPEED]) > 6.0)
    write_dossier(found)
    shown = read_odd(found.folder / "shown.odd.yaml")
    assert "process.speed: '[6 .. 10] km/h'" in (found.folder / "shown.openodd.yaml").read_text().replace(
        '"', "'"
    )
    at = {SLOPE: 4.0, DENSITY: 300.0, RAIN: "no_rain", "weather.fog": "false"}
    assert shown.domain.holds({**at, SPEED: 5.0})
    assert not shown.domain.holds({**at, SPEED: 7.0})
    assert not shown.domain.holds({**at, SPEED: 9.5})


def test_nothing_planted_nothing_broken_and_all_shown(passing: Conducted):
    found, cells = passing, passing.cells
    assert {c.verdict for c in cells} == {SHOWN}
    assert all(c.hits for c in cells)
    assert found.coverage.pair_share == (83, 83)
    assert {row["verdict"] for row in rows_of(write_dossier(found).parent / "cells.csv")} == {SHOWN}
    assert "EXCLUDE_OR" not in (found.folder / "shown.openodd.yaml").read_text().split("shown:")[-1]


def test_a_longer_campaign_after_a_look_is_judged_by_the_e_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    odd = small_odd(tmp_path)
    once = conducted(monkeypatch, tmp_path / "once", odd, 100, 1, lambda run, u: False)
    first = conducted(monkeypatch, tmp_path / "twice", odd, 60, 1, lambda run, u: False)
    again = conducted(monkeypatch, tmp_path / "twice", odd, 100, 1, lambda run, u: False)
    assert [r["point"] for r in again.results[:60]] == [r["point"] for r in first.results]
    assert (once.is_complete, first.is_complete, again.is_complete) == (True, True, False)
    with pytest.raises(InputError, match="another campaign"):
        conducted(monkeypatch, tmp_path / "twice", odd, 100, 2, lambda run, u: False)
    for before, after in (("exposure: [1, 2, 2, 1]", "exposure: [1, 2, 2, 2]"), ("[2, 4, 6", "[2, 4.1, 6")):
        other = small_odd(tmp_path / after, BINDING.replace(before, after))
        with pytest.raises(InputError, match=r"another campaign \(revision .*\.\.\..*, now \.\.\.") as told:
            conducted(monkeypatch, tmp_path / "twice", other, 100, 1, lambda run, u: False)
        was, now = str(told.value).rpartition("(revision ")[2].split(", now ")
        assert was != now.rstrip(")")


def test_a_campaign_resumes_and_says_the_same_bytes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("swath.tools.function_test.session.run_all", driven_here())
    odd = write_odd(tmp_path, BINDING.replace("distance_m: 12", "distance_m: 3").replace("11.5", "2.5"))
    line = ["test", "run", "--odd", str(odd), "--runs", "8", "--workers", "1", "--out"]
    assert main([*line, str(tmp_path / "a")]) == 3
    assert "8 of 8 runs pass" in capsys.readouterr().out
    out = tmp_path / "a"
    names = ("cells.csv", "runs.csv", "results.parquet", "dossier.html", "shown.openodd.yaml", "junit.xml")
    before = {name: (out / name).read_bytes() for name in names}
    for journal in (out / "journal").iterdir():
        lines = journal.read_bytes().splitlines(keepends=True)
        journal.write_bytes(b"".join(lines[: len(lines) // 2]))
    assert main([*line, str(out)]) == 3
    assert {name: (out / name).read_bytes() for name in names} == before
    assert main(["test", "report", str(out)]) == 3
    assert {name: (out / name).read_bytes() for name in names} == before
    root = ET.parse(out / "junit.xml").getroot()
    suite = next(s for s in root if s.get("name") == "ODD small")
    assert suite.find("properties/property").get("value") == "R-7"
    row = rows_of(out / "runs.csv")[0]
    assert main(["test", "again", str(out), row["run"][:8]]) == 0
    told = capsys.readouterr().out
    assert "the same digest" in told
    assert told.count(row["digest"]) == 2
    assert "other code" not in (out / "dossier.html").read_text()
    summary = json.loads((out / "kept" / row["run"] / "summary.json").read_text())["summary"]
    assert f"(R-7): side_slope {row[SLOPE]}" in summary
    with monkeypatch.context() as other:
        for module in ("plan", "odd.dossier"):
            other.setattr(f"swath.tools.function_test.{module}.code_hash", lambda: "f" * 64)
        assert main(["test", "again", str(out), row["run"][:8]]) == 0
        told = capsys.readouterr().out
        assert f"this is {'f' * 64}" in told
        assert "the digest may differ" in told
        assert main(["test", "report", str(out)]) == 3
        assert "The runs were made by other code" in (out / "dossier.html").read_text()
    assert main(["test", "report", str(out)]) == 3
    moved = shutil.move(out, tmp_path / "b")
    assert main(["test", "report", str(moved)]) == 3
    assert (Path(moved) / "cells.csv").read_bytes() == before["cells.csv"]
    met = json.loads((next((Path(moved) / "journal").glob("*.jsonl"))).read_text().splitlines()[0])["met"]
    assert len(met["distance_m"]) >= 3


TRACED = """requirements:
  R-8: [distance_m]
  R-9: [lateral_rms_m, combine.distance_m]
expect: {distance_m: {min: 11.5}, lateral_rms_m: {max: 0.1}}
"""


def result_at(number: int, distance: float, rms: float, **more: object) -> dict[str, object]:
    limits = {"distance_m": ({"min": 11.5}, distance, distance >= 11.5)}
    limits |= {"lateral_rms_m": ({"max": 0.1}, rms, rms <= 0.1)}
    entries = [
        {
            "subject": "combine",
            "name": name,
            "limit": limit,
            "value": value,
            "result": "pass" if ok else "fail",
        }
        | ({} if ok else {"reason": "beyond it"})
        for name, (limit, value, ok) in limits.items()
    ]
    point = {SLOPE: 4.0, RAIN: "drizzle", SPEED: 5.0, DENSITY: 200.0}
    met = {"t_s": [0.0, 1.0], "distance_m": [0.0, 1.5], "slope_across_percent": [3.5, None]}
    met |= {"slope_along_percent": [0.1, 0.2], "stems_per_m2": [200.0, 201.0]}
    return {"id": f"{number:016x}", "expect": entries, "point": point, "met": met, **more}


def test_requirements_lead_to_runs_and_runs_to_requirements(tmp_path: Path):
    binding = BINDING.replace("expect: {distance_m: {min: 11.5}}\n", TRACED)
    odd = read_odd(write_odd(tmp_path, binding))
    results = [result_at(1, 12.0, 0.05), result_at(2, 5.0, 0.05), result_at(3, 12.0, 0.3)]
    results[0]["expect"][1]["rests_outside"] = ["combine.lidar"]
    told = {t.name: t for t in traced(odd.file, results)}
    assert {n: (t.kept, t.broken, t.unjudged) for n, t in told.items()} == {
        "R-7": (0, 2, 1),
        "R-8": (2, 1, 0),
        "R-9": (0, 2, 1),
    }
    assert told["R-9"].worst is results[2]  # 3 times a limit is farther beyond it than a way not driven
    assert told["R-9"].why == "combine.lateral_rms_m 0.3"
    open_one = result_at(4, 5.0, 0.0)
    open_one["expect"][1] |= {"value": None, "result": "fail", "reason": "nothing was measured"}
    after = {t.name: t for t in traced(odd.file, [*results, open_one])}
    assert (after["R-7"].broken, after["R-7"].unmeasured) == (3, 0)  # its way is broken, too
    assert broken_by(odd.file, open_one) == ["R-7", "R-8", "R-9"]
    open_one["expect"][0] |= {"value": 12.0, "result": "pass"}
    after = {t.name: t for t in traced(odd.file, [*results, open_one])}
    assert [(after[n].broken, after[n].unmeasured) for n in ("R-7", "R-8", "R-9")] == [(2, 1), (1, 0), (2, 1)]
    assert broken_by(odd.file, open_one) == []
    assert [broken_by(odd.file, r) for r in results] == [[], ["R-7", "R-8", "R-9"], ["R-7", "R-9"]]
    rows = list(trace_rows(odd.file, results, "out"))
    assert len(rows) == 3 * (2 + 1 + 2)
    judged = {(r["requirement"], r["run"][-1], r["result"]) for r in rows if "rms" in r["limit"]}
    assert ("R-9", "1", "not judged") in judged
    assert ("R-9", "3", "fail") in judged
    assert rows[0]["again"] == "swath test again out 00000000"
    assert odd.case.file.vary[RAIN].drawn_values == ["no_rain", "drizzle", "showers", "downpour"]
    wrong = (("R-8: [distanse_m]", "distance_m"), ("R-8: []", "names of limits"), ("R-8: [combine]", "limit"))
    for name, text in wrong:
        with pytest.raises(InputError, match=text):
            read_odd(write_odd(tmp_path / "wrong", binding.replace("R-8: [distance_m]", name)))


def test_what_a_run_drove_as_tables_of_openodd(tmp_path: Path):
    odd = read_odd(write_odd(tmp_path))
    assert write_cod(tmp_path, odd, [result_at(1, 12.0, 0.05), {**result_at(2, 1.0, 0.0), "met": {}}]) == 1
    files = sorted(path.name for path in (tmp_path / "cod").iterdir())
    name = f"{1:016x}"
    assert files == [f"{name}_cod.csv", f"{name}_cod_manifest.csv", f"{name}_taxonomy.yml"]
    one, other = rows_of(tmp_path / "cod" / files[0])
    assert (one["terrain.side_slope;%"], other["terrain.side_slope;%"]) == ("3.5", "")  # measured, unknown
    assert (one["process.speed;km/h"], one["weather.rain"], one["weather.fog"]) == ("5.0", "drizzle", "")
    assert other["TEMPORAL_EXTENT"] == "1970-01-01 00:00:01.000"
    assert float(other["SPATIAL_EXTENT"].split()[1]) * DEGREE_M == pytest.approx(1.5, abs=0.01)
    columns = rows_of(tmp_path / "cod" / files[1])
    assert [row["COMMENT"] for row in columns[1:]] == list(odd.domain.attributes)
    taxonomy = attributes_of([read_document(tmp_path / "cod" / files[2])])
    assert list(taxonomy) == list(odd.domain.attributes)
    assert taxonomy[RAIN].values == odd.domain.attributes[RAIN].values


def test_runs_outside_a_range_and_runs_that_drove_elsewhere_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    found = conducted(monkeypatch, tmp_path / "out", small_odd(tmp_path), 60, 1, lambda run, u: False)
    axis = [a.name for a in found.odd.axes].index(DENSITY)
    for number, run in enumerate(found.coverage.runs):
        run.main[axis] = 0
        if number < 7:
            told = {"quantity": "lean_deg", "met": [5.0, 20.0 + number], "checked": [0, 20]}
            outside = {"combine.lidar": {"level": "empirical", "quantities": [told]}}
            entry = {"subject": "combine", "name": "distance_m", "limit": {"min": 1}, "value": 2.0}
            entry |= {"result": "pass", "rests_outside": ["combine.lidar"]}
            run.result.update(expect=[entry], credibility=outside, verdict="not judged", reason="not judged")
        elif number < 12:
            ended = "the run ended at 3.00 s: combine.speed: no crop edge seen"
            end = {"reason": "edge_lost", "text": ended}
            run.result.update(never_checked={"combine.edge": ["rain_mm_h"]}, ended=end)
            entry = {"subject": "combine", "name": "distance_m", "limit": {"min": 9}, "value": 2.0}
            run.result.update(expect=[entry | {"result": "fail"}], verdict="fail", reason="2 is less than 9")
    page = write_dossier(found).read_text()
    row = '<td class="word">lean_deg</td><td class="n">7</td><td class="word">5 to 26</td>'
    assert row in page
    assert f"{DENSITY}: " in page
    assert "no range declared" in page
    assert '<td class="word">combine.edge</td><td class="word">rain_mm_h</td><td class="n">5</td>' in page
    assert page.count("2 is less than 9; the run ended at 3.00 s: combine.speed: no crop edge seen") == 5
    assert '<td class="word">edge_lost</td><td class="n">5</td><td class="n">0</td>' in page
    cells = "</td><td".join(
        ('"word">combine.distance_m', ' class="n">5', ' class="n">3.13 to 20.7 %', ' class="n">5')
    )
    assert cells in page  # 5 of 53 by both tails of the binomial
    assert "swath test run --odd out/campaign.odd.yaml --runs 60 --out DIR" in page


def test_pairs_that_nothing_drove_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    found = conducted(monkeypatch, tmp_path / "o w", small_odd(tmp_path), 8, 1, lambda run, u: False)
    cells = found.cells
    never = [c for c in cells if c.verdict == NEVER]
    driven, pairs = found.coverage.pair_share
    assert len(never) == pairs - driven > 0
    monkeypatch.setattr("swath.tools.function_test.odd.dossier.LISTED", 5)
    page = write_dossier(found).read_text()
    assert never[0].text in page
    assert f"{len(never) - 5} more are in" in page
    assert "swath test again 'o w' RUN" in unescape(page)
    assert "certifies nothing" in page
    assert "No part of the ODD is shown" in page  # 8 runs show no bucket
    assert "so it has to be confirmed" not in page


def test_what_a_run_met_is_what_was_set():
    sets = ["run.distance_m=15", "combine.edge=truth", "combine.motion.start_speed_kmh=7",
            "combine.lidar=off", "field.terrain.level=plane", "field.terrain.slope_percent=5",
            "field.stand.stems_per_m2=321",
            "field.terrain.slope_azimuth_deg=90", "field.stand.lean_deg=12"]  # fmt: skip
    names = ["slope_across_percent", "slope_along_percent", "stems_per_m2", "lean_deg", "ground_speed_kmh",
             "crop_height_m", "yaw_rate_deg_s"]  # fmt: skip
    told = run_unrecorded(load_scenario("straight", sets=sets), hooks=[MetHook(names)])["met"]
    assert told["distance_m"] == pytest.approx(np.arange(len(told["distance_m"])), abs=0.6)
    count = len(told["distance_m"])
    assert told["slope_across_percent"] == pytest.approx(
        [5.0] * count, abs=0.05
    )  # rises to the east, driven north
    assert told["slope_along_percent"] == pytest.approx([0.0] * count, abs=0.3)
    assert set(told["stems_per_m2"]) == {321.0}
    assert told["lean_deg"] == pytest.approx([12.0] * count, abs=0.1)
    assert told["ground_speed_kmh"][5:] == pytest.approx([7.0] * (count - 5), abs=0.7)
    assert told["yaw_rate_deg_s"] == pytest.approx([0.0] * count, abs=0.5)
    assert len(set(told["crop_height_m"])) == 1
    assert told["crop_height_m"][0] == pytest.approx(0.9, abs=0.2)
    with pytest.raises(InputError, match="stems_per_m2"):
        MetHook(["stems_per_m3"])


def test_the_level_that_a_binding_sets_is_driven_and_told(tmp_path, monkeypatch):
    """Also where it cannot carry a limit: such a run is not judged, and no other level is driven instead."""
    binding = BINDING.replace('combine.lidar: "off"', "combine.lidar: empirical")
    binding = binding.replace("expect: {", "expect: {edge_rmse_m: {max: 0.05}, ")
    made = conducted(
        monkeypatch, tmp_path / "out", small_odd(tmp_path, binding), 8, 1, lambda run, chance: False
    )
    driven = {scenario_of(run).machines["combine"].slots["lidar"].level for run in made.session.runs()}
    assert driven == {"empirical"}
    assert made.session.levels() == {"empirical": 8}
    assert made.session.level_lines() == []
    page = write_dossier(made).read_text(encoding="utf-8")
    assert "empirical" in page.partition("LiDAR level")[2][:80]


def test_the_guide_says_of_causes_and_their_reach_what_the_dossier_does():
    guide = " ".join(Path("docs/how-to/odd.md").read_text(encoding="utf-8").split())
    said = guide.replace(" (`process.density 431 to 468 1/m2`, whatever the buckets)", "")
    assert REACH in guide
    assert f"A cause is {KINDS} whose runs fail" in said
