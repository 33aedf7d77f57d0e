"""Machines that overlap at the start are refused; driving into something is an event and ends the run."""

import pytest

from swath.core.errors import InputError
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario

TEXT = """\
format: swath scenario 2
name: contacts
run: {distance_m: 12, max_duration_s: 20}
field:
  stand: {level: uniform, stems_per_m2: 100}
  edge: {shape: straight}
machines:
  combine: {lidar: off, edge: truth, start: {along_edge_m: -2}}
"""
PERSON = "{kind: mesh, file: examples/meshes/person.obj, x_m: 6, y_m: 4, name: person}"


def scenario(obstacles="[]", machines="", **run):
    sets = [f"field.obstacles={obstacles}", *(f"run.{key}={value}" for key, value in run.items())]
    return parse_scenario(TEXT + machines, sets=sets)


@pytest.mark.parametrize(
    ("obstacles", "machines", "other"),
    [
        ("[{kind: post, x_m: 3, y_m: 4, name: mast}]", "", "mast"),
        (f"[{PERSON}]", "", "person"),
        ("[]", "  truck: {machine: tractor-grain-cart, start: {x_m: 6, y_m: 9, heading_deg: 0}, speed: "
         "{speed_kmh: 0}}\n", "truck"),
    ],
)  # fmt: skip
def test_driven_into_something_ends_the_run_and_fails(tmp_path, obstacles, machines, other):
    result = run_job(scenario(obstacles, machines), tmp_path / "run")
    summary = result.summary
    assert result.exit_code == 1
    (event,) = [e for e in summary["incidents"] if e["kind"] == "contact" and e["machine"] == "combine"]
    assert other in event["text"]
    assert event["t_s"] > 0.5
    assert summary["simulated_s"] < 12.0
    assert any("combine: touched" in note and other in note for note in summary["notes"])
    entries = [e for e in summary["expect"] if e["name"] == "contact_count" and e["subject"] == "combine"]
    assert [e["result"] for e in entries] == ["fail"]


def test_a_contact_that_is_only_noted_goes_on(tmp_path):
    post = "[{kind: post, x_m: 3, y_m: 4}]"
    result = run_job(scenario(post, on_contact="note", distance_m=8), tmp_path / "run")
    assert result.exit_code == 1
    assert result.summary["distance_m"] >= 8.0


@pytest.mark.parametrize(("y", "is_free"), [(-5.0, False), (-25.0, True)])
def test_machines_that_overlap_at_the_start_are_refused_by_name(y, is_free):
    other = f"  other: {{lidar: off, edge: truth, start: {{x_m: 6, y_m: {y}, heading_deg: 90}}}}\n"
    if is_free:
        assemble(scenario(machines=other))
        return
    with pytest.raises(InputError, match=r"(combine|other)\.start: expected another place: it overlaps"):
        assemble(scenario(machines=other))


def test_a_combine_that_starts_outside_the_field_is_refused_a_tractor_is_not():
    boundary = "{points_m: [[-20, -20], [60, -20], [60, 400], [-20, 400]]}"
    text = TEXT.replace("  edge:", f"  boundary: {boundary}\n  edge:")
    tractor = "  t: {machine: tractor-grain-cart, start: {x_m: -60, y_m: 0}}\n"
    assemble(parse_scenario(text + tractor))
    far = "  other: {lidar: off, edge: truth, start: {x_m: -90, y_m: 0, heading_deg: 90}}\n"
    with pytest.raises(InputError, match=r"other\.start: expected a place in the field"):
        assemble(parse_scenario(text + far))
