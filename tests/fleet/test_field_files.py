"""Fields of files of others: outlines, guidance lines, a yield log; and what a job file says beside."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.fleet.files import read_job
from swath.fleet.ground import Ground, shapely_here
from swath.fleet.machines import body_of, machines_of
from swath.fleet.plan import HEADLAND, plan_of
from tests.field.test_plan import EAST_M, NORTH_M, taskdata

REST = "combines: {combine: {machine: lexion-700}}\ntruck: {x_m: -30, y_m: 0}\n"
LON, LAT = 9.0, 52.0


def job_of(tmp_path, field, rest=REST):
    file = tmp_path / "job.yaml"
    file.write_text(f"format: swath fleet 1\nfield: {field}\n{rest}")
    return read_job(str(file))[0]


def passes_of(job):
    """Directions of the passes on the map, as angles of lines [deg], 0 to 180."""
    machines = machines_of(job)
    ground = Ground(job, body_of(machines.truck))
    plan = plan_of(ground, machines.combines, job.plan, job.drawn)
    turn = ground.frame.direction
    return plan, {round(math.degrees(p.heading + turn) % 180.0, 1) for p in plan.passes if p.kind != HEADLAND}


def lon_lat(points):
    return [[LON + x / EAST_M, LAT + y / NORTH_M] for x, y in points]


def geojson(path, *shapes):
    features = [{"type": "Feature", "geometry": s, "properties": {}} for s in shapes]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, -45.0])
def test_passes_have_the_direction_that_the_plan_says(tmp_path, angle):
    rest = f"plan: {{direction_deg: {angle}}}\n{REST}"
    job = job_of(tmp_path, "{boundary_m: [[0, 0], [150, 0], [150, 90], [0, 90]]}", rest)
    plan, directions = passes_of(job)
    assert directions <= {angle % 180.0, 180.0} if angle == 0.0 else directions == {angle % 180.0}
    assert plan.area == pytest.approx(13_500.0)


def test_lines_beside_an_outline_say_the_direction_of_passes(tmp_path):
    ring = lon_lat([(0, 0), (200, 0), (200, 150), (0, 150), (0, 0)])
    long, short = lon_lat([(20, 10), (120, 110)]), lon_lat([(0, 0), (10, 0)])
    lines = {"type": "MultiLineString", "coordinates": [short, long]}
    geojson(tmp_path / "field.geojson", {"type": "Polygon", "coordinates": [ring]}, lines)
    job = job_of(tmp_path, "{file: field.geojson}")
    assert job.plan.direction_deg == pytest.approx(45.0, abs=1.0)
    assert any("longest of 2 lines" in note for note in job.notes)
    assert shapely_here().Polygon(job.field.boundary_m).area == pytest.approx(30_000.0, rel=3e-3)


def test_guidance_lines_and_holes_of_task_data_are_taken(tmp_path):
    """A line from A north to B."""
    taskdata(tmp_path / "TASKDATA")
    job = job_of(tmp_path, "{file: TASKDATA}")
    assert abs(abs(job.plan.direction_deg) - 90.0) < 1.5
    assert len(job.field.holes_m) == 1
    hole = shapely_here().Polygon(job.field.holes_m[0]).area
    assert hole == pytest.approx(0.0005 * NORTH_M * 0.0005 * EAST_M, rel=0.01)


@pytest.mark.parametrize("stated", [False, True])
def test_ground_direction_and_yield_of_a_log_are_taken(tmp_path, stated):
    """Ten passes of 200 m, 8 m wide, at 2 m/s with 11.2 kg/s: 7 t/ha, 60 degrees from east."""
    c, s = math.cos(math.radians(60.0)), math.sin(math.radians(60.0))
    rows, t = ["time,lat,lon,flow,width,speed"], 0
    for n in range(10):
        for i in range(101):
            x, y = 2.0 * i if n % 2 == 0 else 200.0 - 2.0 * i, 8.0 * n
            (lon, lat), flow = lon_lat([(c * x - s * y, s * x + c * y)])[0], 11.2
            rows.append(f"{t},{lat:.8f},{lon:.8f},{flow},8,2")
            t += 1
        t += 20
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    job = job_of(tmp_path, "{log: log.csv, yield_t_ha: 5}" if stated else "{log: log.csv}")
    assert job.field.yield_t_ha == pytest.approx(5.0 if stated else 7.0, rel=0.01)
    assert job.plan.direction_deg == pytest.approx(60.0, abs=2.5)  # of grid north
    assert shapely_here().Polygon(job.field.boundary_m).area == pytest.approx(16_000.0, rel=0.03)
    assert np.min(job.field.boundary_m, axis=0) == pytest.approx([0.0, 0.0], abs=1.0)


def test_grain_varies_under_the_passes_as_in_the_log(tmp_path):
    """Ten passes of 200 m, 10 m wide, of which each one farther north bears 0.25 t/ha more, the first 6."""
    rows, t = ["time,lat,lon,flow,width,speed"], 0
    for n in range(10):
        for i in range(101):
            x = 2.0 * i if n % 2 == 0 else 200.0 - 2.0 * i
            (lon, lat), flow = lon_lat([(x, 10.0 * n)])[0], 2.0 * (6.0 + 0.25 * n)
            rows.append(f"{t},{lat:.8f},{lon:.8f},{flow},10,2")
            t += 1
        t += 20
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    job = job_of(tmp_path, "{log: log.csv}")
    assert any("the yield varies as in the log" in note for note in job.notes)
    ground = Ground(job, body_of(machines_of(job).truck))
    south, north = (np.array([shapely_here().box(40.0, y, 60.0, y + 2.0)]) for y in (14.0, 84.0))
    placed = [
        np.array([shapely_here().Polygon(ground.frame.to_field(a[0].exterior.coords))])
        for a in (south, north)
    ]
    low, high = (10.0 * float(ground.density(a)[0]) for a in placed)
    assert (low, high) == pytest.approx((6.25, 8.0), rel=0.03)
    even = replace(job, yields=())
    assert Ground(even, body_of(machines_of(job).truck)).density(placed[0]) == pytest.approx(0.7125, rel=0.02)


@pytest.mark.parametrize(
    ("field", "rest", "said"),
    [
        ("{}", REST, "expected one of boundary_m, file and log"),
        ("{file: a.geojson, log: b.csv}", REST, "expected one of boundary_m, file and log"),
        ("{file: none.geojson}", REST, "expected a file that is there"),
        ("{boundary_m: [[0, 0], [9, 0], [9, 9]]}", REST.replace("combine:", '"../c":'), "a machine's name"),
        ("{boundary_m: [[0, 0], [9, 0], [9, 9]]}", REST.replace("{combine:", "{truck:"), "not truck"),
    ],
)
def test_wrong_input_is_one_clear_error(tmp_path, field, rest, said):
    with pytest.raises(InputError, match=said):
        job_of(tmp_path, field, rest)


RING = "{boundary_m: [[0, 0], [90, 0], [90, 60]]}"


def test_keys_of_0_2_are_left_out_with_a_note_that_says_where_they_stand(tmp_path):
    rest = REST + "carts: {k: {align_s: 9}}\nunload: {mode: on_the_go, finish_s: 3}\nteam: {lag_m: 20}\n"
    job = job_of(tmp_path, RING, rest)
    for key, line in (
        ("carts.k.align_s", 5), ("unload.mode", 6), ("unload.finish_s", 6), ("team.lag_m", 7),
    ):  # fmt: skip
        (note,) = [note for note in job.notes if note.startswith(f"unused: {key} ")]
        assert f"is read no more (job.yaml:{line}): " in note
    assert len(job.notes) == 4


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("team: {together: echelon}\n", r"team\.together.*nothing drives in echelon.*job\.yaml:5"),
        ("carts: {k: {}}\nunload: {mode: standing}\n", r"unload\.mode.*dispatcher of your own.*job\.yaml:6"),
        ("unload: {mode: rolling, ramps_s: 2, pipe: 3}\n", r"unload.*"),
    ],
)
def test_what_is_not_done_any_more_is_refused_with_its_place(tmp_path, more, said):
    with pytest.raises(InputError, match=said):
        job_of(tmp_path, RING, REST + more)


def test_without_carts_a_combine_that_was_emptied_standing_still_is(tmp_path):
    (note,) = job_of(tmp_path, RING, REST + "unload: {mode: standing}\n").notes
    assert note.startswith("unused: unload.mode is read no more")


def lines_over(tmp_path, rows, more=()):
    """A field of 200 m by 72 m with lines along it at some heights [m], every other one westwards."""
    ring = lon_lat([(0, 0), (200, 0), (200, 72), (0, 72), (0, 0)])
    lines = [lon_lat([(0, y), (200, y)][:: -1 if n % 2 else 1]) for n, y in enumerate(rows)]
    shape = {"type": "MultiLineString", "coordinates": [*lines, *more]}
    geojson(tmp_path / "field.geojson", {"type": "Polygon", "coordinates": [ring]}, shape)
    return job_of(tmp_path, "{file: field.geojson}")


def on_map(plan, job):
    frame = Ground(job, body_of(machines_of(job).truck)).frame
    return [frame.to_map([p.start, p.end]) for p in plan.passes]


def test_lines_that_cover_a_field_are_its_passes_in_their_order(tmp_path):
    rows = [66.0, 6.0, 54.0, 18.0, 42.0]
    job = lines_over(tmp_path, rows)
    plan, _ = passes_of(job)
    found = on_map(plan, job)
    assert [np.mean(ends[:, 1]) for ends in found] == pytest.approx(rows, abs=0.6)
    assert [ends[0, 0] < ends[1, 0] for ends in found] == [True, False, True, False, True]
    assert plan.left == pytest.approx(200.0 * 72.0 - 5 * 200.0 * 12.0, rel=0.15)
    assert plan.notes == ("shape: the 5 lines of the file are the passes, in their order",)


@pytest.mark.parametrize(
    ("rows", "more", "said"),
    [
        ([6.0, 18.0], (), "they cover 33.3 % of the field"),
        ([6.0, 18.0, 30.0, 42.0], ([(0, 54), (100, 58), (200, 54)],), "line 5 bends by 4 m"),
    ],
)
def test_lines_that_are_no_plan_say_the_direction_alone(tmp_path, rows, more, said):
    job = lines_over(tmp_path, rows, [lon_lat(line) for line in more])
    plan, directions = passes_of(job)
    assert plan.notes == (f"shape: lines of the file say the direction of passes alone: {said}",)
    assert plan.left < 0.01 * plan.area
    assert len(directions) == 1


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ("[[0, 18], [70, 20], [150, 18]]", "straight passes, number 2 bends by 2"),
        ("[[0, 18], [0.4, 18]]", "passes of more than 0.5 m, number 2 is shorter"),
    ],
)
def test_passes_of_a_job_have_to_be_straight_and_longer_than_a_point(tmp_path, second, said):
    field = "{boundary_m: [[0, 0], [150, 0], [150, 90], [0, 90]]}"
    line = f"plan: {{passes_m: [[[0, 6], [150, 6]], {second}]}}\n"
    with pytest.raises(InputError, match=said):
        passes_of(job_of(tmp_path, field, line + REST))


def test_without_an_outline_the_field_is_the_ground_under_the_lines(tmp_path):
    """Headers of 12.19 m on lines 12 m apart."""
    shape = {"type": "MultiLineString", "coordinates": [lon_lat([(0, y), (200, y)]) for y in (6, 18, 30)]}
    geojson(tmp_path / "field.geojson", shape)
    job = job_of(tmp_path, "{file: field.geojson}")
    plan, _ = passes_of(job)
    width = machines_of(job).combines[0].width
    assert plan.area == pytest.approx(200.0 * (24.0 + width), rel=2e-3)
    assert len(plan.passes) == 3
    assert any("no outline" in note for note in job.notes)


@pytest.mark.parametrize(
    "content",
    [
        "{}", '{"type": "Point", "coordinates": [1, 2]}', '{"type": "LineString", "coordinates": 7}',
        *(f'{{"type": "LineString", "coordinates": [{points}]}}' for points in (
            "[9, 52], [9.01]", "[9, 52], [[9], 53]", "[9, 52], [9.1, 5200]", "1, 2")),
    ],
)  # fmt: skip
def test_a_file_without_lines_and_outline_is_refused(tmp_path, content):
    (tmp_path / "field.geojson").write_text(content)
    with pytest.raises(InputError, match="expected"):
        job_of(tmp_path, "{file: field.geojson}")


def test_a_line_without_length_says_no_direction(tmp_path):
    job = lines_over(tmp_path, [], [lon_lat([(10, 10), (10, 10)])])
    assert job.plan.direction_deg is None
    assert "unused: line of fewer than 2 places" in job.notes
