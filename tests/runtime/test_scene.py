"""Obstacles that go: their way, when they set off, who sees them, and the same bytes again."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.edges.track import Way
from swath.field.solid.obstacles import Path, SheetObstacle, things_of
from swath.record.digest import Digest
from swath.replay.things import things_of as drawn
from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions, Script
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import OBSTACLE_KINDS
from tests.field.made_field import made_field

TEXT = """
format: swath scenario 2
name: scene
run: {distance_m: 50, max_duration_s: 3, on_contact: note}
field:
  edge: {shape: straight}
  boundary: {points_m: [[-20, -20], [30, -20], [30, 60], [-20, 60]]}
  obstacles:
    - {kind: person, name: walker, x_m: 6, y_m: 6, path: {to: [[6, 0]], speed_kmh: 3.6, start_within_m: 9}}
    - {kind: vehicle, x_m: -9, y_m: 0, path: {to: [[-9, 6]], speed_kmh: 18, start_s: 1, at_end: return}}
    - {kind: tree, x_m: -40, y_m: 10}
machines:
  combine:
    motion: {level: kinematic, start_speed_kmh: 7}
    speed: {guard: {when_lost: ignore}}
    lidar:
      {level: empirical, sector_deg: [-60, 60], step_deg: 2, mount: {at: axle, x_m: 2, z_m: 3, pitch_deg: 30}}
"""


def world_of(*sets):
    return assemble(parse_scenario(TEXT, sets=list(sets)))


def test_a_way_there_and_back():
    way = Way([[0, 0], [3, 0], [3, 4]], 2.0, returns=True)
    assert way.length == 7.0
    assert way.after(-1.0) == (0.0, 0.0, 0.0, 0.0)
    assert way.after(2.5) == pytest.approx((3.0, 2.0, np.pi / 2, 2.0))
    assert way.after(4.5) == pytest.approx((3.0, 2.0, -np.pi / 2, 2.0))  # 9 of 14 m gone
    assert way.after(7.0 + 2.5) == pytest.approx((3.0, 2.0, np.pi / 2, 2.0))
    assert Way([[0, 0], [3, 0]], 2.0).after(9.0) == pytest.approx((3.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("kind", ["person", "animal", "vehicle", "tree", "hedge", "building"])
def test_the_body_of_a_sheet_has_the_size_of_the_sheet(kind):
    from swath.field.solid.contact import bounds, parts_of
    from swath.field.solid.obstacles import load_obstacle

    sheet = load_obstacle(kind)
    size = np.array([sheet.length, sheet.width, sheet.height])
    for factor in (1.0, 0.5):
        middle, half = bounds(parts_of(sheet.solids(tuple(factor * size), 0.3)))
        assert 2.0 * half == pytest.approx(factor * size, abs=0.08 * factor * size.max(), rel=0.08)
        assert middle[2] + half[2] == pytest.approx(factor * sheet.height, abs=0.02)


def test_a_path_of_two_points_in_one_place_is_refused():
    person = SheetObstacle(kind="person", x_m=1.0, y_m=2.0, path=Path(to=((1.0, 2.0),)))
    with pytest.raises(InputError, match=r"obstacles\.0\.path\.to"):
        things_of([person], made_field())


@pytest.fixture(scope="module")
def run():
    world, digest, seen = world_of(), Digest(), {}

    def watch(slot, t, outputs):
        if slot == "scene.obstacles":
            seen[t] = outputs["state"]
        if "scan" in outputs:
            seen["near"] = min(np.nanmin(outputs["scan"].ranges, initial=99.0), seen.get("near", 99.0))

    judged = make_evaluation(world)
    drive(world, [digest, judged, watch])
    return world, digest.hex, seen, judged


def test_where_they_are(run):
    """The machine starts at (6, -4), 10 m before the walker: he sets off when it has driven 1 m."""
    world, _, seen, _ = run
    last = seen[3_000_000_000]
    names = [OBSTACLE_KINDS[k] for k in last.kind]
    assert sorted(names) == ["person", "tree", "vehicle"]
    car, walker = names.index("vehicle"), names.index("person")
    assert last.y[car] == pytest.approx(2.0, abs=0.1)  # 2 s at 5 m/s: 6 m there and 4 m back
    assert last.speed[car] == pytest.approx(5.0)
    begun = (
        world.graph.plan
        and world.save()["graph"]["components"]["scene.obstacles"]["walkers"]["begun"]["walker"]
    )
    assert begun * 1e-9 == pytest.approx(1.0 / (7 / 3.6), abs=0.05)
    assert last.y[walker] == pytest.approx(6.0 - (3.0 - begun * 1e-9), abs=0.02)
    body = next(b for b in world.bodies.around("combine") if b.name == "walker")
    assert body.velocity == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    assert body.rcs_dbsm == (-3.0, -3.0)


def test_it_is_touched_and_seen(run):
    _, _, seen, judged = run
    metrics = judged.metrics("combine")
    assert metrics["contact_count"] == 1.0
    assert metrics["least_clearance_m"] == 0.0
    assert seen["near"] < 3.9  # the canopy is 4.3 m from the scanner, the person before it nearer


def test_the_same_bytes_with_other_threads_and_after_save_and_load(run, monkeypatch):
    monkeypatch.setenv("SWATH_THREADS", "1")
    world, digest = world_of(), Digest()
    drive(world, [digest], until_s=1.5)
    state, kept = world.save(), digest.save()
    other, rest = world_of(), Digest()
    other.load(state)
    rest.load(kept)
    drive(other, [rest], resume=True)
    assert rest.hex == run[1]


def test_the_page_of_a_run_draws_the_way(run):
    times = np.linspace(0.0, 3.0, 61)
    track = {"t_s": times, "x_m": np.full(61, 6.0), "y_m": -4.0 + 7 / 3.6 * times}
    things, _, _ = drawn(run[0], [], np.zeros(3), {"combine": track})
    way = np.array(next(t["way"] for t in things if t["name"] == "walker"))
    assert way[-1, 2] == pytest.approx(6.0 - (3.0 - 1.0 / (7 / 3.6)), abs=0.06)
    assert way[:, 4] == pytest.approx(-np.pi / 2, abs=1e-3)
    assert all("way" not in t for t in things if t["what"] == "tree")


GOES = "{kind: person, x_m: 8, y_m: 6, path: {to: [[8, 0]], speed_kmh: 3.6, start_within_m: 9}}"
STEPS_IN = [
    {"t_s": 0.3, "set": "obstacles.dog", "value": "{kind: animal, x_m: 20, y_m: 0, path: {to: [[24, 0]]}}"},
    {"t_s": 1.2, "set": "obstacles.guest", "value": GOES},
    {"t_s": 2.5, "set": "obstacles.dog", "value": None},
]


def changed(until_s=None):
    """Digest and world of a run into which somebody walks."""
    world, digest = world_of(), Digest()
    world.graph.before_tick.append(Script(Interventions(world), STEPS_IN))
    drive(world, [digest], until_s=until_s)
    return digest, world


def test_who_comes_while_the_run_goes_walks_too():
    digest, world = changed()
    guest = next(body for body in world.bodies.around("combine") if body.name == "obstacles.guest")
    assert (guest.kind, guest.rcs_dbsm) == ("person", (-3.0, -3.0))
    assert guest.velocity == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    at = 4.0 - np.sqrt(9.0**2 - 2.0**2) + 6.0  # of the axle on its way up from y = -4, where he is 9 m away
    sets_off = max(at / (7 / 3.6), 1.2)
    assert guest.pose.position[:2] == pytest.approx([8.0, 6.0 - (3.0 - sets_off)], abs=0.02)
    assert "obstacles.dog" not in world.bodies
    kinds = [OBSTACLE_KINDS[k] for k in world.graph.latest("scene.obstacles", "state").kind]
    assert sorted(kinds) == ["person", "person", "tree", "vehicle"]
    half, first = changed(until_s=1.6)
    other, rest = world_of(), Digest()
    changes = Interventions(other)
    for event in STEPS_IN[:2]:
        changes.set(round(event["t_s"] * 1e9), event["set"], event["value"])
    other.load(first.save())
    rest.load(half.save())
    other.graph.before_tick.append(Script(changes, STEPS_IN[2:]))
    drive(other, [rest], resume=True)
    assert rest.hex == digest.hex


def test_those_that_only_stand_cost_one_look_a_second():
    world = world_of("field.obstacles=[{kind: tree, x_m: -9, y_m: 10}]")
    assert world.graph.nodes[0].slot.period == 1_000_000_000
    assert len(world.obstacles.ellipsoid_half) == 1
    assert world_of("field.obstacles=[]").graph.nodes[0].slot.name == "combine.motion"
