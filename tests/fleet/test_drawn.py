"""Whole jobs that were drawn: they end, nothing touches, no grain is lost; however the field lies."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.fleet.command import FILES
from swath.fleet.driven import driven
from swath.fleet.files import FieldSettings, FleetSettings, TruckSettings, read_job
from swath.fleet.ground import shapely_here
from swath.fleet.report import write_result
from swath.fleet.schedule import Scheduler, schedule_of
from swath.fleet.worked import by_events
from tests.fleet.changed import mirrored, turned
from tests.fleet.check import looked_at
from tests.fleet.drawn import SMALL, drawn_job, scheduled


@pytest.mark.draws
@pytest.mark.parametrize("level", ["planned", "driven"])
@pytest.mark.parametrize("seed", [130, 131])
def test_a_drawn_job_ends_with_all_grain_at_the_truck_and_no_contact(seed, level):
    schedule = scheduled(seed)
    found = looked_at(schedule, driven(schedule) if level == "driven" else None)
    assert found.contact == {}
    assert found.left < 0.005
    assert found.mass < 1e-9
    assert (found.hole, found.outside, found.hasty) == (0.0, 0.0, 0)


@pytest.mark.draws
@pytest.mark.parametrize("seed", [755, 759])
def test_fields_whose_passes_end_at_a_pond_are_worked(seed):
    schedule = schedule_of(drawn_job(seed, (0.6, 2.5)))
    found = looked_at(schedule, driven(schedule))
    assert (found.contact, found.hole, found.outside) == ({}, 0.0, 0.0)
    assert found.left < 0.005


def test_driven_bodies_keep_to_their_paths_and_say_what_they_do_all_the_time():
    worked = driven(scheduled(130))
    assert worked.stray < 0.02
    for spans in worked.spans.values():
        assert spans[0].begin == 0.0
        assert all(a.end == pytest.approx(b.begin) for a, b in pairwise(spans))
        assert all(s.reason for s in spans if s.state == "wait")
    assert driven(scheduled(130)).ends == worked.ends


def test_a_result_holds_the_timeline_and_why_machines_waited(tmp_path):
    ends = by_events(scheduled(130)).ends
    worked = by_events(replace(scheduled(130), bound=ends / 1.25))
    write_result(worked, "drawn", "a drawn job", tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index("(gap 25 %)") < page.index('href="replay.html"') < page.index("<section")
    assert all(f"<code>{name}</code>" in page for name in worked.spans)
    result = json.loads((tmp_path / "out" / "results.json").read_text())
    assert {p.name for p in (tmp_path / "out").iterdir()} == set(FILES) - {"draws.json"}
    times = result["machines"]["combine_1"]["times_s"]
    assert times["cut"] == pytest.approx(60.0 * worked.minutes("combine_1", "cut"))
    assert sum(p["kg"] for p in result["poured"] if p["to"] == "truck") == pytest.approx(result["grain_kg"])


@pytest.mark.drawn
def test_a_bundled_job_runs_from_the_command_at_both_levels(tmp_path, capsys):
    assert main(["fleet", "run", "small-field", "--level", "driven", "--out", str(tmp_path / "job")]) == 0
    said = capsys.readouterr().out
    assert "field efficiency" in said
    assert json.loads((tmp_path / "job" / "results.json").read_text())["level"] == "driven"
    assert main(["fleet", "run", "small-field", "--level", "driven", "--spread", "5"]) == 2


def test_outlines_of_a_file_come_with_all_polygons_and_holes(tmp_path):
    def ring(x, y, size):
        corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size), (x, y)]
        return [[11.0 + a / 74_500.0, 48.0 + b / 111_200.0] for a, b in corners]

    shapes = [[ring(0, 0, 120), ring(40, 40, 20)[::-1]], [ring(200, 0, 60)]]
    geometry = {"type": "MultiPolygon", "coordinates": shapes}
    outline = {"type": "Feature", "geometry": geometry, "properties": {}}
    (tmp_path / "field.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [outline]}))
    file = tmp_path / "job.yaml"
    file.write_text(
        "format: swath fleet 1\nfield: {file: field.geojson}\n"
        "combines: {c: {machine: lexion-700}}\ntruck: {x_m: -30, y_m: 0}\n"
    )
    field = read_job(str(file))[0].field
    assert (len(field.parts_m), len(field.holes_m)) == (1, 1)
    area = shapely_here().Polygon(field.boundary_m).area
    assert area == pytest.approx(120.0**2, rel=0.03)


@pytest.mark.draws
@pytest.mark.parametrize("angle", [17.0, 31.0, 73.0, 180.0])
def test_a_field_that_is_turned_and_moved_takes_the_same_time(angle):
    made = schedule_of(turned(drawn_job(131, SMALL), angle, 5000.0))
    assert made.ends == pytest.approx(scheduled(131).ends, rel=0.002)
    assert driven(made).ends == pytest.approx(driven(scheduled(131)).ends, rel=0.002)


def test_a_field_that_is_mirrored_with_its_pipes_takes_the_same_time():
    made = schedule_of(mirrored(drawn_job(131, SMALL)))
    one, two = driven(scheduled(131)), driven(made)
    assert made.ends == pytest.approx(scheduled(131).ends, rel=0.002)
    assert two.ends == pytest.approx(one.ends, rel=0.002)
    for name, way in one.places.items():  # on the map, each is where the other one is in a mirror
        there = scheduled(131).ground.frame.to_map(way[:, :2])
        here = made.ground.frame.to_map(two.places[name][:, :2])
        if len(here) == len(there):
            assert here * (1.0, -1.0) == pytest.approx(there, abs=0.01)


def test_pipes_on_both_sides_are_refused():
    job = drawn_job(131, SMALL)
    name, *others = job.combines
    both = {name: replace(job.combines[name], pipe="right"), "other": job.combines[(others or [name])[0]]}
    with pytest.raises(InputError, match=r"combines\.other\.pipe = left: expected right"):
        schedule_of(replace(job, combines=both))


def test_a_dispatcher_of_ones_own_takes_the_place_of_the_built_in_one(tmp_path, code_allowed):
    (tmp_path / "mine.py").write_text(
        "class Never:\n"
        "    def decide(self, state):\n"
        "        return min(state.options, key=lambda o: (o.kind == 'beside', o.ends))\n"
    )
    job = replace(drawn_job(130, SMALL), fleet=FleetSettings("mine.py:Never"))
    made = schedule_of(job, tmp_path)
    assert made.delivered == pytest.approx(made.harvested)
    assert any(s.kind == "pours standing" for s in made.table.segments)


@pytest.mark.parametrize("name", ["nothing", "none.py:Class"])
def test_a_dispatcher_that_is_not_there_is_refused(name, tmp_path):
    with pytest.raises(InputError, match="dispatcher"):
        schedule_of(replace(drawn_job(130, SMALL), fleet=FleetSettings(name)), tmp_path)


def test_a_header_wider_than_the_pipe_reaches_is_refused():
    job = drawn_job(130, SMALL)
    combines = {"wide": replace(next(iter(job.combines.values())), machine="lexion-700", header_width_m=16.0)}
    with pytest.raises(InputError, match="expected a header of at most"):
        schedule_of(replace(job, combines=combines))


def test_a_job_file_names_key_and_line_of_what_is_wrong(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(
        "format: swath fleet 1\nfield:\n  boundary_m: [[0, 0], [90, 0], [90, 60]]\n  around_m: -3\n"
        "combines: {c: {machine: lexion-700}}\ntruck: {x_m: -30, y_m: 0}\n"
    )
    with pytest.raises(InputError, match=r"around_m = -3: expected >= 0.*job.yaml:4"):
        read_job(str(file))


@pytest.mark.draws
def test_who_is_done_does_not_hold_the_way_of_the_last_grain():
    """All ways of carts to the truck are granted before those of combines to their places."""
    schedule = schedule_of(drawn_job(128, SMALL))
    carts = {k.name for k in schedule.machines.carts}
    segments = schedule.table.segments
    last = max(s.number for s in segments if s.machine in carts and s.kind == "at truck")
    homewards = [s.number for s in segments if s.machine not in carts and s.kind == "to its place"]
    assert homewards
    assert min(homewards) > last


@pytest.mark.draws
@pytest.mark.parametrize("hectares", [1.0, 10.0])
def test_a_way_is_opened_to_a_round_without_corners(hectares):
    """No pass of it begins at the edge, and crop stands all round."""
    far = math.sqrt(hectares * 1e4 / math.pi)
    ring = [(far * math.cos(a), far * math.sin(a)) for a in np.linspace(0.0, 6.2, 100).tolist()]
    job = replace(
        drawn_job(128, SMALL), field=FieldSettings(ring), truck=TruckSettings(x_m=-far - 30.0, y_m=20.0)
    )
    made = Scheduler(job, None)
    c = made.combines[0]
    legs = made.next_legs(c)
    assert any(made.with_way(c, leg, 0.0) is not None for leg in legs)
