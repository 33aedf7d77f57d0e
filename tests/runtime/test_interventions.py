"""Changes to a run while it goes: they take effect, keep what must be kept, and can be done again."""

import json

import numpy as np
import pytest

from swath.core.errors import InputError, SwathError
from swath.core.schedule import NS
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions, Script, read_events
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario

TEXT = """
format: swath scenario 2
name: changed
run: {distance_m: 100, max_duration_s: 1.2}
field: {edge: {shape: straight}, obstacles: [{kind: post, x_m: -5, y_m: 30}, {kind: stone, x_m: 5, y_m: 30}]}
machines:
  combine:
    motion: {level: kinematic, start_speed_kmh: 7}
    speed: {guard: {when_lost: ignore}}
    lidar: {sub_rays: 1, sector_deg: [-40, 40], step_deg: 4}
"""
WALL = "{kind: box, x_m: 0, y_m: 4, length_m: 14, width_m: 1, height_m: 3}"


@pytest.fixture
def world():
    return assemble(parse_scenario(TEXT))


@pytest.fixture(scope="module")
def unchanged():
    return assemble(parse_scenario(TEXT))


def drive_with(world, plan, until_s=1.2):
    """Drive with changes at (time [s], key, value); (digest, changes)."""
    changes, digest = Interventions(world), Digest()
    events = [{"t_s": t, "set": key, "value": value} for t, key, value in plan]
    world.graph.before_tick.append(Script(changes, events))
    drive(world, [digest], until_s=until_s)
    return digest.hex, changes


def test_a_parameter_changes_and_the_part_goes_on_where_it_stood(world):
    _, changes = drive_with(
        world, [(0.6, "combine.steer.lookahead_m", 6), (0.6, "combine.speed.speed_kmh", 4)]
    )
    assert 6.0 in world.machines["combine"].parts["steer"].numbers
    assert world.graph.latest("combine.speed", "command").speed == pytest.approx(4 / 3.6)
    assert changes.values()["combine.speed.speed_kmh"] == 4
    same, _ = drive_with(assemble(parse_scenario(TEXT)), [])
    held, _ = drive_with(assemble(parse_scenario(TEXT)), [(0.6, "combine.steer.lookahead_m", 4.0)])
    assert held == same  # set to what it was: the state was carried over to the last bit


def test_motion_keeps_its_place_when_a_parameter_of_it_changes(world):
    drive_with(world, [(0.6, "combine.motion.start_speed_kmh", 1)])
    assert world.graph.latest("combine.motion", "state").distance == pytest.approx(1.2 * 7 / 3.6, rel=0.02)


def test_another_level_takes_over_and_the_same_events_give_the_same_digest(world, tmp_path):
    plan = [(0.4, "combine.edge.level", "otsu"), (0.8, "combine.lidar.level", "empirical")]
    digest, changes = drive_with(world, plan)
    parts = world.machines["combine"].parts
    assert (type(parts["edge"]).__module__, type(parts["lidar"]).__module__) == (
        "swath.control.edge.otsu",
        "swath.sensing.lidar.empirical",
    )
    assert "combine.lidar.sub_rays" not in changes.values()
    (tmp_path / "summary.json").write_text(json.dumps({"events": changes.events}))
    again = assemble(parse_scenario(TEXT))
    redone = Interventions(again)
    again.graph.before_tick.append(Script(redone, read_events(tmp_path)))
    second = Digest()
    drive(again, [second])
    assert second.hex == digest
    assert redone.events == changes.events == [{"t_s": t, "set": key, "value": v} for t, key, v in plan]


def test_obstacles_come_and_go_and_the_sensors_see_it(world):
    seen = {}
    world_ranges = lambda name, t, out: seen.update({t: out["scan"]}) if "scan" in out else None  # noqa: E731
    changes = Interventions(world)
    events = [(0.4, "obstacles.wall", WALL), (0.8, "obstacles.wall", None), (1.0, "obstacles.0", None)]
    world.graph.before_tick.append(Script(changes, [{"t_s": t, "set": k, "value": v} for t, k, v in events]))
    assert len(world.obstacles.capsule_radius) == 1
    drive(world, [world_ranges])

    def nearest(from_s, to_s):
        return np.nanmin([np.nanmin(s.ranges) for t, s in seen.items() if from_s * NS < t <= to_s * NS])

    assert nearest(0.42, 0.77) < nearest(0.05, 0.37) - 1.0
    assert nearest(0.82, 1.2) > nearest(0.42, 0.77) + 0.5
    assert len(world.obstacles.capsule_radius) == 0
    assert len(world.obstacles.ellipsoid_half) == 1
    assert "obstacles.0" not in changes.values()


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("combine.motion.level", "single_track", "to exchange"),
        ("combine.lidar.rate_hz", 10, "rhythm and wires stay"),
        ("combine.steer.lookahead", 3, "lookahead_m"),
        ("combine.steer.lookahead_m", "far", "expected a number"),
        ("combine.nothing.level", "x", "machine.slot.level"),
        ("obstacles.wall", "{kind: wall}", "kind"),
        ("obstacles.wall", None, "there: 0, 1"),
        ("obstacles.0", WALL, "can only be removed"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_changes(unchanged, key, value, words):
    changes = Interventions(unchanged)
    before = changes.values()
    with pytest.raises(InputError) as caught:
        changes.set(0, key, value)
    assert words in str(caught.value)
    assert changes.values() == before
    assert changes.events == []


def answer(changes, key, value):
    """What is wrong with a change, empty where nothing is."""
    try:
        changes.check(key, value)
    except SwathError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("combine.lidar.sensor", "{}"),
        ("obstacles.thing", "{{kind: mesh, x_m: 3, y_m: 9, file: {}}}"),
    ],
)
def test_a_file_that_the_scenario_does_not_name_is_not_read(tmp_path, key, text):
    """Neither by a way out of its folder nor by its full path; allowed ones, and in allowed folders, are."""
    secret = tmp_path / "elsewhere" / "secret.npz"
    secret.parent.mkdir()
    secret.write_text("nothing swath can read")
    (tmp_path / "here").mkdir()
    world = assemble(parse_scenario(TEXT, base=tmp_path / "here"))
    for path in (str(secret), "../elsewhere/secret.npz"):
        for use in (Interventions(world).check, lambda k, v: Interventions(world).set(0, k, v)):
            with pytest.raises(InputError, match="expected no file but those"):
                use(key, text.format(path))
    for allowed in (secret, secret.parent):
        said = answer(Interventions(world, [str(allowed)]), key, text.format(secret))
        assert "expected no file but" not in said  # at most that it is no such file


@pytest.mark.parametrize("text", ["[1]", '[{"t_s": 1}]', "{", '{"events": 3}'])
def test_events_that_are_none_are_refused(tmp_path, text):
    file = tmp_path / "events.json"
    file.write_text(text)
    with pytest.raises(InputError, match="--events"):
        read_events(file)
