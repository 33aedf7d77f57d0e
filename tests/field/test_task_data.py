"""What ISOXML means: polygons, crops, guidance and widths by their types, dates that are not known yet.

All logs are of one field: 6 passes of 120 m, 9 m apart, 5.4 t/ha, moisture 14 %.
"""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rasterio")

from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.field.crop_sheet import load_crop
from swath.field_io.grid import make_grid
from swath.field_io.importer import import_log
from swath.field_io.logs.log import read_log
from swath.field_io.plan import largest_part, plan_field, read_plan
from swath.field_io.task_data.taskdata import (
    A_PLUS,
    AB,
    PATTERNS,
    PIVOT,
    POLYGONS,
    Device,
    DeviceElement,
    drawn,
    pivot_radius,
)
from swath.fleet.files import read_field
from tests.field.made_taskdata import (
    COMBINE,
    EAST_M,
    GRAIN,
    LONG,
    NORTH_M,
    PASSES,
    WIDE,
    YIELD,
    harvest,
    place,
    points,
    polygon,
    section,
    task_data,
)

FIELD = (0, 0, 200, 300)  # m
WIDTH = (67, "DET-2", 9000)


def plan(path, inside, *, crop="", outside="", **more):
    return task_data(path, fields=f'<PFD A="PFD1" C="Home" D="1" {crop}>{inside}</PFD>{outside}', **more)


def area(path):
    """Of the field [ha], and what is said of it."""
    _, found, _, notes = largest_part(read_plan(path), path)
    return found.area / 1e4, notes


def made(path, *, width=9.0):
    """The field of a plan, on level ground."""

    def level(polygon, epsg):
        grid = make_grid(polygon.bounds, 5.0, 10.0, epsg)
        return replace(grid, values=np.zeros_like(grid.values)), {}

    return plan_field(path, path / "f", crop=None, width=width, cell=5.0, load=load_crop, terrain=level)


def logged(path, **more):
    log = read_log(path, **more)
    assert log.flow[log.flow > 0].mean() == pytest.approx(YIELD / 10 * WIDE * 2.0, rel=0.01)
    return log


@pytest.mark.parametrize("kind", POLYGONS)
def test_what_lies_in_a_field_bears_crop_or_not_by_its_type(tmp_path, kind):
    if kind == "1":
        return
    role, name = POLYGONS[kind]
    data = plan(tmp_path / "a", polygon(1, *FIELD) + polygon(kind, 50, 100, 90, 150))
    found, notes = area(data)
    assert found == pytest.approx(5.8 if role == "bare" else 6.0, rel=1e-3)
    assert any(f"{name} 0.2 ha" in note for note in notes) == (role == "bare")
    data = plan(tmp_path / "b", polygon(kind, 210, 0, 310, 300) + polygon(1, *FIELD))
    found, notes = area(data)
    assert found == pytest.approx(6.0, rel=1e-3)
    left = {"unused: " + name, f"unused: {name} area outside of the field"}
    assert left & set(made(data).info["notes"])


def test_shapes_of_polygons(tmp_path):
    island = polygon(1, *FIELD) + polygon(3, 50, 100, 90, 150, inner=(60, 110, 80, 140))
    assert area(plan(tmp_path / "a", island))[0] == pytest.approx(5.8, rel=1e-3)  # its island is another part
    two = polygon(1, *FIELD) + polygon(1, 200, 0, 300, 300)
    assert area(plan(tmp_path / "b", two))[0] == pytest.approx(9.0, rel=1e-3)
    road = polygon(5, -5, 100, 205, 110) + polygon(1, *FIELD)
    found, notes = area(plan(tmp_path / "c", road))
    assert found == pytest.approx(200 * 190 / 1e4, rel=1e-3)
    assert "unused: the field of 3.8 ha is taken, another area of 2 ha is left out" in notes
    parts = polygon(9, 20, 20, 180, 280) + polygon(10, *FIELD, inner=(20, 20, 180, 280))
    found, notes = area(plan(tmp_path / "d", parts))
    assert found == pytest.approx(6.0, rel=1e-3)
    assert "shape: main field and headland, the field has no boundary" in notes
    assert not read_plan(plan(tmp_path / "e", polygon(11, *FIELD))).parts


def test_fields_in_a_file_of_their_own(tmp_path):
    data = task_data(tmp_path / "a", fields='<XFR A="PFD00001" B="1"/>')
    inside = polygon(1, *FIELD) + polygon(6, 50, 100, 90, 150)
    (data / "PFD00001.XML").write_text(f'<XFC><PFD A="PFD1" C="Home" D="1">{inside}</PFD></XFC>')
    assert area(data)[0] == pytest.approx(5.8, rel=1e-3)
    (data / "PFD00001.XML").unlink()
    assert read_plan(data).problems == ["damaged: PFD00001.XML: referenced, but missing"]


def test_what_is_not_used_is_named_once(tmp_path):
    inside = polygon(1, *FIELD) + f'<LSG A="3">{points([(1, 1), (2, 2)])}</LSG>' * 2 + points([(5, 5)], "5")
    data = plan(tmp_path / "a", inside + polygon(2, 1, 1, 5, 5), more='<XYZ/><CTR A="CTR1" B="Ann"/>')
    expected = "unused: treatment zone, tramline (2), obstacle point, element XYZ"
    assert expected in made(data).info["notes"]


CROPS = '<CTP A="CTP1" B="Winterraps"/><CTP A="CTP2" B="Mais"><CVT A="CVT1" B="P8134"/></CTP>'


@pytest.mark.parametrize(
    ("crops", "of_field", "sheet"),
    [
        (CROPS, 'G="CTP2"', "maize"), (CROPS, 'G="CTP1"', "rape"), (CROPS, 'H="CVT1"', "maize"),
        (CROPS, "", None), (CROPS, 'G="CTP9"', None), ('<CTP A="CTP1" B="Gerste"/>', "", "barley"),
        ('<CTP A="CTP1" B="Winterweizen"/><CTP A="CTP2" B="Sommerweizen"/>', "", "wheat"), ("", "", "wheat"),
    ],
)  # fmt: skip
def test_the_crop_is_that_of_the_tasks_field(tmp_path, crops, of_field, sheet):
    log = plan(harvest(tmp_path / "log", [*GRAIN, WIDTH]), "", crop=of_field, crops=crops)
    even = plan(tmp_path / "plan", polygon(1, *FIELD), crop=of_field, crops=crops)
    if sheet is None:
        for read, data in ((read_log, log), (made, even)):
            with pytest.raises(InputError, match=r"crop = Winterraps or Mais: .*--crop"):
                read(data)
        assert read_log(log, crop="rape").crop == "rape"
        return
    assert read_log(log).crop == sheet
    field = made(even)
    assert field.crop == sheet
    assert any("taken as wheat (--crop)" in note for note in field.info["notes"]) == (not crops)


def test_fields_of_two_crops_are_not_mixed(tmp_path):
    fields = "".join(f'<PFD A="PFD{k}" C="f" D="1" G="CTP{k}"/>' for k in (1, 2))
    names = [f"TLG0000{k}" for k in range(1, 5)]
    for k, name in enumerate(names):
        grain = GRAIN if k < 2 else [(1, "DET-2", 5)]  # the last two are not of a harvest
        harvest(tmp_path, [*grain, WIDTH], name=name, shift=200.0 * k, day=16_000 + k)
    one = PASSES * (LONG // 2 + 1)
    two = [("PFD2", names[:1]), ("PFD1", names[1:2])]
    log = read_log(task_data(tmp_path, fields=fields, crops=CROPS, tasks=two))
    assert (len(log), log.broken["other_crop"]) == (one, one)
    sprayed = [("PFD2", names[:1]), ("PFD1", names[2:])]
    log = read_log(task_data(tmp_path, fields=fields, crops=CROPS, tasks=sprayed))
    assert (len(log), log.crop) == (one, "maize")
    unsaid = [("PFD2", names[:1]), ("", names[1:2])]
    log = read_log(task_data(tmp_path, fields=fields, crops=CROPS, tasks=unsaid))
    assert (len(log), log.crop) == (2 * one, "maize")
    assert "crop: the tasks of TLG00002 name none, taken as the others" in log.notes


def test_the_width_of_a_header_is_that_of_its_sections(tmp_path):
    for name, count in (("two", 2), ("eighteen", 18)):
        device = COMBINE + "".join(section(10 + i) for i in range(count))
        widths = [(67, f"DET-{10 + i}", 9000 // count) for i in range(count)]
        data = task_data(harvest(tmp_path / name, [*GRAIN, *widths]), device=device)
        log = logged(data)
        assert (log.width == 9.0).all()
        assert any(note.startswith("derived: working_width_m: sum of DET-10 (") for note in log.notes)


HALVES = COMBINE + section(10) + section(11)


@pytest.mark.parametrize(
    ("device", "channels"),
    [
        (HALVES, [WIDTH, (67, "DET-10", 4500), (67, "DET-11", 4500)]),  # the whole and its parts
        (HALVES, [(68, "DET-10", 4500), (68, "DET-11", 4500)]),  # default widths
        (HALVES, [(70, "DET-10", 4500), (70, "DET-11", 4500)]),  # largest widths
        (COMBINE + '<DET A="DET-3" B="3" C="2" E="3" F="1"/>', [WIDTH, (67, "DET-3", 18_000)]),  # a spreader
        (COMBINE, [(70, "DET-2", 12_000), (68, "DET-2", 12_000), WIDTH]),  # the actual one counts
    ],
)
def test_widths_of_other_forms(tmp_path, device, channels):
    log = logged(task_data(harvest(tmp_path, [*GRAIN, *channels]), device=device))
    assert (log.width == 9.0).all()


def test_sections_that_do_not_work_do_not_count(tmp_path):
    off = lambda k: int(k < 200)  # noqa: E731
    states = [(141, "DET-10", 1), (141, "DET-11", off)]
    channels = [*GRAIN, (67, "DET-10", 4500), (67, "DET-11", 4500), *states]
    log = read_log(task_data(harvest(tmp_path, channels), device=HALVES))
    assert (log.width == np.where(np.arange(len(log)) < 200, 9.0, 4.5)).all()
    assert (log.flow > 0.0).all()


ROWS = COMBINE + "".join(section(10 + k, refers=f'<DOR A="{20 + k}"/>') for k in range(18))
ROWS += "".join(f'<DPT A="{20 + k}" B="0043" C="500"/>' for k in range(18))


@pytest.mark.parametrize("logs_width", [False, True])
def test_condensed_work_states_say_which_sections_work(tmp_path, logs_width):
    """18 rows of 0.5 m, two bits each, in two numbers; from record 200 on the last six do not work."""
    first, whole, none = 0x55555555, 0b0101, 0xFFFFFFF0
    low = lambda k: first if k < 200 else 0x00555555  # noqa: E731
    high = lambda k: none - (1 << 32) + (whole if k < 200 else 0)  # noqa: E731
    channels = [*GRAIN, (161, "DET-2", low), (162, "DET-2", high), *([WIDTH] if logs_width else [])]
    log = read_log(task_data(harvest(tmp_path, channels), device=ROWS))
    np.testing.assert_allclose(log.width, np.where(np.arange(len(log)) < 200, 9.0, 6.0))
    assert any("sections at work, 66.7 %" in note for note in log.notes)


def test_flows_of_sections_add_up_and_moistures_do_not(tmp_path):
    flow = [(87, f"DET-1{i}", 1e6 * YIELD / 10 * WIDE) for i in (0, 1)]
    moist = [(99, "DET-10", 130_000), (99, "DET-11", 150_000)]
    data = task_data(harvest(tmp_path, [*flow, *moist, WIDTH, (397, "DET-1", 2000)]), device=HALVES)
    log = logged(data)
    np.testing.assert_allclose(log.moisture, 0.14)


SECOND = '<DVC A="DVC-2" B="Header"><DET A="DET-50" B="1" C="1" E="0" F="0"/>%s</DVC>'


@pytest.mark.parametrize(
    ("device", "more", "what"),
    [
        (COMBINE + '<DPT A="5" B="0043" C="9000"/>', "", "actual"),
        (COMBINE.replace('F="1"/>', 'F="1"><DOR A="5"/></DET>') + '<DPT A="5" B="0044" C="9000"/>', "",
         "default"),
        (COMBINE + section(10, refers='<DOR A="5"/>') + section(11, refers='<DOR A="5"/>')
         + '<DPT A="5" B="0046" C="4500"/>', "", "maximum"),
        (COMBINE, SECOND % '<DPT A="5" B="0043" C="9000"/>', "actual"),
    ],
)  # fmt: skip
def test_a_width_that_only_the_device_states_is_used(tmp_path, device, more, what):
    data = task_data(harvest(tmp_path / "a", GRAIN), device=device, more=more)
    file = data / "TASKDATA.XML"
    file.write_text(file.read_text().replace("<TLG", '<DAN A="0" C="DVC-2"/><TLG'))
    log = logged(data)
    assert (log.width == 9.0).all()
    assert any("the machine states 9 m" in note and what in note for note in log.notes)
    assert (read_log(data, header_width=6.0).width == 6.0).all()


def test_a_harvest_without_a_width_is_not_taken_for_a_plan(tmp_path):
    data = plan(harvest(tmp_path / "a", GRAIN), polygon(1, *FIELD))
    with pytest.raises(InputError, match=r"header_width \(or --header-width-m\)"):
        import_log(data, tmp_path / "f", progress=False)


def test_a_plan_of_machines_of_different_widths_asks_for_one(tmp_path):
    wide = SECOND % '<DPT A="5" B="0043" C="24000"/>'
    device = COMBINE + '<DPT A="5" B="0043" C="9000"/>'
    data = plan(tmp_path / "a", polygon(1, *FIELD), device=device, more=wide)
    with pytest.raises(InputError, match=r"9 m .*Combine.*24 m .*Header.*--header-width-m"):
        made(data, width=None)
    file = data / "TASKDATA.XML"
    file.write_text(file.read_text().replace("</TSK>", '<DAN A="0" C="DVC-1"/></TSK>'))
    field = made(data, width=None)
    assert any("header width 9 m" in note for note in field.info["notes"])


@settings(max_examples=200)
@given(st.lists(st.integers(0, 12), min_size=1, max_size=12), st.sets(st.integers(1, 12), min_size=1))
def test_no_part_of_a_header_counts_twice(parents, having):
    """Parents are drawn, in circles too: what is summed never holds an element and one within it."""
    device = Device("")
    for k, parent in enumerate(parents, 1):
        device.elements[f"E{k}"] = DeviceElement("4", str(parent), {})
        device.objects[str(k)] = f"E{k}"
    of = [f"E{k}" for k in having if k <= len(parents)] or ["E1"]
    chosen = device.whole(of)
    assert chosen
    assert set(chosen) <= set(of)
    if not any(a in device.above(b) and b in device.above(a) for a in of for b in of):
        assert not any(a in device.above(b) for a in chosen for b in chosen)


def pattern(kind, places, more="", kinds="9"):
    return (
        f'<GGP A="GGP1"><GPN A="GPN1" C="{kind}" {more}><LSG A="5">{points(places, kinds)}</LSG></GPN></GGP>'
    )


def only(path, text):
    described = read_plan(plan(path, polygon(1, *FIELD) + text))
    (part,) = described.parts.values()
    return part


@pytest.mark.parametrize("heading", [0.0, 45.0, 90.0, 200.0, 359.5])
def test_a_plus_is_a_line_at_its_true_heading(tmp_path, heading):
    part = only(tmp_path / "a", pattern(A_PLUS, [(100, 150)], f'G="{heading}"', "6"))
    (a, b) = drawn(part.guidance[0])
    east, north = (b[0] - a[0]) * math.cos(math.radians(a[1])), b[1] - a[1]
    assert math.degrees(math.atan2(east, north)) % 360 == pytest.approx(heading, abs=0.3)
    assert tuple(a) == pytest.approx(place(100, 150), abs=1e-8)
    (track,) = made(tmp_path / "a").tracks
    across = abs(math.sin(math.radians(heading))), abs(math.cos(math.radians(heading)))
    assert track.length == pytest.approx(
        min(200 / max(across[0], 1e-9), 300 / max(across[1], 1e-9)), rel=0.02
    )
    turned = read_field(tmp_path / "a", 9.0).direction - math.radians(90.0 - heading)
    assert abs(math.sin(turned)) < 0.03


A, B, C = (140, 150), (100, 190), (100, 150)  # start east, end north, centre [m]


@pytest.mark.parametrize(
    ("places", "kinds", "more", "sweep", "radius"),
    [
        ([C, A, B], "2", "", 360, 40), ([A, B, C], ["6", "7", "8"], 'D="2"', 90, 40),
        ([C, A, B], ["8", "6", "7"], 'D="1"', 270, 40), ([C, A, B], "9", 'D="3"', 360, 40),
        ([C], "8", 'H="30000" D="3"', 360, 30), ([C, A], ["8", "6"], "", 360, 40),
    ],
)  # fmt: skip
def test_a_pivot_is_its_circle_or_arc(tmp_path, places, kinds, more, sweep, radius):
    part = only(tmp_path / "a", pattern(PIVOT, places, more, kinds))
    line = drawn(part.guidance[0])
    metres = (line - place(*C)) * (EAST_M, NORTH_M)
    np.testing.assert_allclose(np.hypot(*metres.T), radius, rtol=2e-3)
    assert pivot_radius(part.guidance[0]) == pytest.approx(radius, rel=2e-3)
    length = np.hypot(*np.diff(metres, axis=0).T).sum()
    assert length == pytest.approx(radius * math.radians(sweep), rel=3e-3)
    field = made(tmp_path / "a")
    assert any("pivot its circle of" in note for note in field.info["notes"])
    assert field.tracks[0].length == pytest.approx(length, rel=3e-3)


def test_guidance_that_cannot_be_drawn_is_named(tmp_path):
    text = "".join(
        [
            pattern(A_PLUS, [(1, 1)]), pattern(PIVOT, [C]), pattern("7", [A, B]), pattern(AB, [A]),
            pattern(AB, [(900, 0), (900, 50)]),
        ]
    )  # fmt: skip
    data = plan(tmp_path / "a", polygon(1, *FIELD) + text)
    notes = made(data).info["notes"]
    assert "unused: guidance pattern outside the field" in notes
    expected = (
        "A+ line without a heading, pivot without a radius, guidance of type '7', AB line without its places"
    )
    assert f"unused: {expected}" in notes


def test_every_kind_of_guidance_and_that_of_version_3(tmp_path):
    places = [(100, 20), (100, 100), (120, 200)]
    for kind in PATTERNS:
        part = only(tmp_path / kind, pattern(kind, places, 'G="0"'))
        assert [p.kind for p in part.guidance] == [kind]
    old = only(tmp_path / "old", f'<LSG A="5">{points(places[:2])}</LSG>')
    assert [p.kind for p in old.guidance] == [AB]
    assert made(tmp_path / "old").tracks[0].length == pytest.approx(300, rel=1e-3)


def test_a_job_says_what_of_the_task_data_it_leaves(tmp_path):
    inside = polygon(1, *FIELD) + polygon(3, 50, 100, 90, 150) + pattern(AB, [(9, 0), (9, 50)]) * 2
    field = read_field(plan(tmp_path, inside), 9.0)
    assert sum(a.area for a in field.areas) == pytest.approx(6e4 - 2000, rel=1e-3)
    assert any("longest of 2 guidance lines: " in note for note in field.notes)


@pytest.mark.parametrize("head", [(0, 0), (1, 2**31 - 1), (65_535, -(2**31)), (7305, 0)])
def test_records_before_the_date_is_known_keep_their_values(tmp_path, head):
    """Day 0, 1980-01-02, the largest day, 2000-01-01; with and without a position."""
    channels = [*GRAIN, WIDTH]
    data = task_data(harvest(tmp_path / "a", channels, on_change=True, undated=5, head=head))
    log = logged(data)
    nowhere = 5 if head[1] else 0
    assert len(log) == PASSES * (LONG // 2 + 1) - nowhere
    assert log.broken["position_not_a_number"] == nowhere
    assert (log.width == 9.0).all()
    assert any("5 records without a date: put before the first" in note for note in log.notes)
    whole = logged(task_data(harvest(tmp_path / "b", channels)))
    np.testing.assert_allclose(log.time - log.time[-1], whole.time[nowhere:] - whole.time[-1])


def test_dates_lost_later_leave_only_their_times_out(tmp_path):
    data = task_data(harvest(tmp_path, [*GRAIN, WIDTH]))
    binary = data / "TLG00001.bin"
    made, size = bytearray(binary.read_bytes()), 19 + 1 + 5 * 4
    for k in range(100, 110):
        struct.pack_into("<H", made, k * size + 4, 0)
    binary.write_bytes(made)
    log = logged(data)
    assert len(log) == PASSES * (LONG // 2 + 1)
    assert "clock: TLG00001.bin: 10 records without a date: their time is left out" in log.notes
    np.testing.assert_allclose(np.diff(log.time)[95:115], 1.0)


def test_a_log_that_never_knew_the_date_is_read_in_its_order(tmp_path):
    log = logged(task_data(harvest(tmp_path, [*GRAIN, WIDTH], undated=10**6)))
    assert any("no record has a date" in note for note in log.notes)
    assert set(np.diff(log.time)) == {1.0, 21.0}
