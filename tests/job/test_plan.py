"""Plans: all ground once, sides that a cart may drive on, files of others, a recorded day."""

import json
import math
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.job.fleet import read_fleet
from swath.job.lands import PlanSettings, plan_field
from swath.job.plan_files import plan_from_file
from swath.job.recorded import check_one_machine, predict, read_day, recorded_plan
from swath.job.turns import limits_of
from swath.job.work import work_off
from tests.field.test_plan import EAST_M, NORTH_M, taskdata

FIELDS = {
    "rectangle": [(0, 0), (800, 0), (800, 400), (0, 400)],
    "five corners": [(0, 0), (905, 35), (880, 525), (520, 640), (50, 575)],
    "triangle": [(0, 0), (700, 0), (200, 500)],
    "L": [(0, 0), (600, 0), (600, 250), (300, 250), (300, 500), (0, 500)],
}
SHARED = Path(os.environ.get("SWATH_DATA", Path(__file__).parents[3] / "shared" / "data"))
LOG = SHARED / "wheat_combine_logs_msu" / "si" / "farmerB_sec1west_2014_winterwheat.csv.gz"
LIMITS = limits_of(3.9, 6.4, math.radians(15.0), 2.0)
LON, LAT = 9.5, 54.2


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("order", ["adjacent", "lands", "skip"])
def test_all_ground_is_cut_once(name, order):
    plan = plan_field(FIELDS[name], 12.0, PlanSettings(headland_rounds=2, order=order))
    assert math.fsum(p.area for p in plan.passes) == pytest.approx(plan.area, rel=2e-3)
    assert plan.area_left >= -1e-3
    assert all(p.area <= 12.0 * (p.length + 12.0) for p in plan.passes)


def test_passes_are_a_width_apart_and_along_the_longest_side():
    plan = plan_field(FIELDS["rectangle"], 12.0, PlanSettings(headland_rounds=2, order="adjacent"))
    inside = [p for p in plan.passes if p.kind == "land"]
    y = np.array([p.line[0, 1] for p in inside])
    assert np.diff(y) == pytest.approx(-11.7)
    assert all(abs(math.sin(p.start.heading)) < 1e-9 for p in inside)
    turned = plan_field(FIELDS["rectangle"], 12.0, PlanSettings(direction_deg=90.0))
    assert all(abs(math.cos(p.start.heading)) < 1e-9 for p in turned.passes if p.kind == "land")


def test_a_land_worked_clockwise_has_cut_ground_on_the_left_but_for_its_far_side():
    plan = plan_field(FIELDS["rectangle"], 12.0, PlanSettings(headland_rounds=2, land_passes=8))
    inside = [p for p in plan.passes if p.kind == "land"]
    lands = max(p.land for p in inside) + 1
    assert sum(not p.cart_beside for p in inside) == lands - 1


def test_adjacent_passes_have_standing_crop_on_the_left_every_other_time():
    plan = plan_field(FIELDS["rectangle"], 12.0, PlanSettings(headland_rounds=2, order="adjacent"))
    inside = [p.cart_beside for p in plan.passes if p.kind == "land"]
    assert inside[:6] == [True, False] * 3


def test_in_echelon_neighbours_are_driven_the_same_way_the_left_one_first():
    plan = plan_field(FIELDS["rectangle"], 12.0, PlanSettings(headland_rounds=2), abreast=2)
    inside = [p for p in plan.passes if p.kind == "land"]
    for first, second in zip(inside[0::2], inside[1::2], strict=False):
        if first.land == second.land and math.cos(first.start.heading - second.start.heading) > 0.0:
            course = first.start.heading
            assert (first.line[0] - second.line[0]) @ [-math.sin(course), math.cos(course)] > 0.0


def lon_lat(points):
    return [[LON + x / 65200.0, LAT + y / 111300.0] for x, y in points]


def geojson(tmp_path, *geometries):
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    path = tmp_path / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    return path


def line(*points):
    return {"type": "LineString", "coordinates": lon_lat(points)}


def test_lines_of_a_geojson_file_are_driven_as_they_stand_there(tmp_path):
    path = geojson(tmp_path, line((0, 6), (400, 6)), line((400, 30), (0, 30)), line((0, 18), (400, 18)))
    plan = plan_from_file(path, 12.0, PlanSettings(), pipe=8.0)
    headings = [math.cos(p.start.heading) > 0 for p in plan.passes]
    assert headings == [True, False, True]
    assert [p.length for p in plan.passes] == pytest.approx([400.0] * 3, rel=0.01)
    offsets = [p.line[:, 1].mean() for p in plan.passes]
    assert np.diff(offsets) == pytest.approx([24.0, -12.0], abs=0.3)


def test_a_geojson_outline_is_planned_by_the_settings_and_worked_off(tmp_path):
    ring = [*FIELDS["L"], FIELDS["L"][0]]
    path = geojson(tmp_path, {"type": "Polygon", "coordinates": [lon_lat(ring)]})
    plan = plan_from_file(path, 12.0, PlanSettings(headland_rounds=2), pipe=8.0)
    assert plan.area == pytest.approx(225000.0, rel=0.01)
    file, _ = read_fleet("echelon", (f"field={{file: {path}, yield_t_ha: 6}}",))
    assert work_off(file).grain == pytest.approx(225.0 * 600.0, rel=0.01)


def test_guidance_lines_of_task_data_are_taken(tmp_path):
    """A line from A north to B: all passes run north and south, 24 of 8.7 m on 206 m."""
    settings = PlanSettings(headland_rounds=0, order="adjacent")
    plan = plan_from_file(taskdata(tmp_path / "TASKDATA"), 9.0, settings, pipe=8.0)
    hole = 0.0005 * NORTH_M * 0.0005 * EAST_M
    assert plan.area == pytest.approx(0.004 * NORTH_M * 0.003 * EAST_M - hole, rel=2e-3)
    assert math.fsum(p.area for p in plan.passes) == pytest.approx(plan.area, rel=5e-3)
    assert "0.19 ha of islands carry no crop" in " ".join(plan.notes)
    assert all(abs(math.cos(p.start.heading)) < 0.03 for p in plan.passes)
    assert len(plan.passes) in (24, 25)


def test_a_name_of_a_machine_is_no_path(tmp_path):
    file = tmp_path / "job.yaml"
    ring = "[[0, 0], [100, 0], [100, 100], [0, 100]]"
    file.write_text(f'format: swath fleet 1\nfield: {{boundary_m: {ring}}}\ncombines: {{"../c": {{}}}}\n')
    with pytest.raises(InputError, match=r"expected a machine's name: letters, digits.*job\.yaml:3"):
        read_fleet(str(file))


BROKEN = '{"type": "LineString", "coordinates": [%s]}'


@pytest.mark.parametrize(
    "content",
    [
        "{}",
        '{"type": "Point", "coordinates": [1, 2]}',
        '{"type": "LineString", "coordinates": 7}',
        *(
            BROKEN % points
            for points in ("[9, 52], [9.01]", "[9, 52], [[9], 53]", "[9, 52], [9.1, 5200]", "1, 2")
        ),
    ],
)
def test_a_file_without_lines_is_refused(tmp_path, content):
    path = tmp_path / "plan.geojson"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match="expected"):
        plan_from_file(path, 12.0, PlanSettings(), pipe=8.0)


@pytest.mark.skipif(not LOG.exists(), reason="needs the Montana yield logs: SWATH_DATA")
def test_the_first_day_of_2014_is_predicted_from_its_first_hour():
    day = read_day(LOG, LIMITS)
    made = predict(day, 3600.0)
    assert made.total_recorded == pytest.approx(8.20 * 3600.0, abs=36.0)
    assert made.cutting == pytest.approx(made.cutting_recorded, rel=0.10)
    assert made.turning == pytest.approx(made.turning_recorded, rel=0.10)
    assert made.total == pytest.approx(made.total_recorded, rel=0.10)
    plan = recorded_plan(day, 7.7)
    assert plan.area == pytest.approx(55.9e4, rel=0.02)


def log_of(tmp_path, *, gap_in_turns=0.0):
    """A log of passes of 200 m, 8 m apart, with turns of 20 s; a record a second.

    gap_in_turns: share of a turn's records that is left out
    """
    rows, t, x0, y0 = ["time,lat,lon,flow,width,speed"], 0, 46.0, 11.0

    def add(x, y, flow):
        rows.append(f"{t},{x0 + y / 111_200:.8f},{y0 + x / 77_300:.8f},{flow},8,2")

    for n in range(12):
        there = n % 2 == 0
        for i in range(101):
            add(2.0 * i if there else 200.0 - 2.0 * i, 8.0 * n, 8.0)
            t += 1
        for i in range(1, 20):
            a = math.pi * i / 20
            if i > (1.0 - gap_in_turns) * 20:
                t += 1
                continue
            far = 12.0 * math.sin(a)
            add(200.0 + far if there else -far, 8.0 * n + 4.0 - 4.0 * math.cos(a), 0.0)
            t += 1
    file = tmp_path / "log.csv"
    file.write_text("\n".join(rows) + "\n")
    return file


def test_turns_are_predicted_where_the_log_goes_on_in_them(tmp_path):
    made = predict(read_day(log_of(tmp_path), LIMITS), 600.0)
    assert made.turning == pytest.approx(made.turning_recorded, rel=0.05)


def test_a_log_that_stops_in_turns_says_so_and_predicts_the_passes_alone(tmp_path):
    day = read_day(log_of(tmp_path, gap_in_turns=1.0), LIMITS)
    made = predict(day, 600.0)
    assert "does not go on in turns" in day.unseen
    assert math.isnan(made.turning)
    assert made.cutting == pytest.approx(made.cutting_recorded, rel=0.02)


def test_records_of_two_machines_as_one_are_refused():
    """Places that lie in two lines 300 m apart by turns, a second from one to the next."""
    t = np.arange(400.0)
    place = np.column_stack([2.0 * t, np.where(t % 2 > 0, 300.0, 0.0)])
    with pytest.raises(InputError, match="records of one machine, places jump 399 times, by 300 m"):
        check_one_machine(SimpleNamespace(time=t, position=place))
