"""Ops are walked by compiled code as they are from Python, whatever a beat is, to the bit."""

import re
from dataclasses import dataclass, field

import numpy as np
import pytest

import swath.compiled
from swath.core.errors import SwathError
from swath.core.frames import Pose
from swath.core.frozen import changed, frozen
from swath.core.graph import Lockstep
from swath.core.rows import Room, Row, Trail, Waiting, can_be_row, held_row, row_like, row_of
from swath.core.together import Samples
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.runtime.worlds import drive_together
from swath.scenario.scenario import load_scenario
from swath.signals import CropEdge, Inertial, MachineState, Scan, Signal, SteerCommand

QUICK = ("combine.lidar.level=profile", "combine.header.level=profile", "combine.edge.level=otsu")
SETS = {
    "kinematic": (*QUICK, "combine.motion.level=kinematic"),
    "single track": QUICK,
    "parts in Python between ops": ("combine.lidar.level=empirical",),
}
NS = 1_000_000_000


def world_of(sets, *more):
    return assemble(load_scenario("straight", sets=[*sets, "run.max_duration_s=4", *more]))


def digest_of(world, beats=()):
    digest = Digest()
    world.graph.observers = [digest]
    world.reset()
    for until in (*np.cumsum(beats).tolist(), 3.0):
        world.graph.run(round(until * NS))
    assert bool(world.graph.lockstep._program.members) is not swath.compiled.IS_WALKED_BY_PYTHON
    return digest.hex


@pytest.mark.parametrize("sets", SETS.values(), ids=SETS)
def test_compiled_and_python_walk_the_same(sets, monkeypatch):
    compiled = digest_of(world_of(sets))
    draw = np.random.default_rng(1)
    for beats in ([0.005] * 40, [0.05] * 30, draw.uniform(0.001, 0.3, 9)):
        assert digest_of(world_of(sets), beats) == compiled
    monkeypatch.setattr(swath.compiled, "IS_WALKED_BY_PYTHON", True)
    assert digest_of(world_of(sets)) == compiled


def test_a_machine_that_stands_without_an_edge_ends_its_run_at_the_same_tick(monkeypatch):
    ends = []
    for is_by_python in (False, True):
        monkeypatch.setattr(swath.compiled, "IS_WALKED_BY_PYTHON", is_by_python)
        world = world_of(SETS["kinematic"], "combine.edge.min_step_m=2", "combine.motion.start_speed_kmh=7")
        world.reset()
        world.graph.run(20 * NS)
        ends.append((world.graph.t, world.graph.ended))
    assert ends[0] == ends[1]
    assert "no crop edge seen" in ends[0][1]


def test_a_run_that_is_saved_and_loaded_goes_on_the_same():
    sets = SETS["single track"]
    digest = digest_of(world_of(sets))
    for seconds in (0.005, 0.13, 1.0):
        world, seen = world_of(sets), Digest()
        world.graph.observers = [seen]
        world.reset()
        world.graph.run(round(seconds * NS))
        saved, kept = world.save(), seen.save()
        other, seen = world_of(sets), Digest()
        other.load(saved)
        seen.load(kept)
        other.graph.observers = [seen]
        other.graph.run(3 * NS)
        assert seen.hex == digest


def test_a_distance_is_reached_at_the_same_tick(monkeypatch):
    ends = []
    for by_python in (False, True):
        monkeypatch.setattr(swath.compiled, "IS_WALKED_BY_PYTHON", by_python)
        world = world_of(SETS["kinematic"], "run.distance_m=3.3")
        drive(world)
        ends.append((world.graph.t, world.graph.latest("combine.motion", "state").distance))
    assert ends[0] == ends[1]
    assert 3.3 <= ends[0][1] < 3.33


def test_worlds_that_end_one_after_the_other_are_each_as_alone():
    lengths = 2.0, 3.0, 3.7
    found = {}
    for _, summary in drive_together([world_of(QUICK, f"run.distance_m={m}") for m in lengths]):
        found[summary["simulated_s"]] = summary["digest"]
    alone = {}
    for m in lengths:
        ((_, summary),) = drive_together([world_of(QUICK, f"run.distance_m={m}")])
        alone[summary["simulated_s"]] = summary["digest"]
    assert found == alone
    assert len(found) == 3


def test_a_row_is_its_samples():
    draw = np.random.default_rng(2)
    row = row_of(MachineState, 3)
    row.memory.view(np.float64)[:] = draw.normal(size=row.memory.view(np.float64).shape)
    row.t = 7
    other = row_of(MachineState, 3)
    for world, sample in enumerate(row.each()):
        other.put(world, sample)
    assert other.memory.tobytes() == row.memory.tobytes()
    again = row_of(MachineState, 3)
    again.take(Samples.joined(row.each()))
    assert (again.memory.tobytes(), again.t) == (row.memory.tobytes(), 7)


@frozen
class Told(Signal):
    """What a part of a user may say."""

    x: float
    code: int
    pose: Pose
    text: str
    pair: tuple[int, float]
    ranges: np.ndarray
    limit: float | None = None


def told(draw, t):
    """A drawn sample."""
    pose = Pose.from_euler(draw.normal(size=3), *draw.normal(size=3))
    text, ranges = "".join(draw.choice([*"abc"], size=3)), draw.normal(size=int(draw.integers(4)))
    limit = draw.choice([None, 1.5])
    return Told(t, draw.normal(), int(draw.integers(9)), pose, text, (t, draw.normal()), ranges, limit)


def test_a_row_holds_any_sample():
    """Numbers as they are declared, all else as the object that it is; of each world at its own time."""
    draw = np.random.default_rng(8)
    for worlds in (1, 3):
        row = held_row(Told, worlds)
        trail, sent = Trail(row, 1), []
        for k in range(5):
            sent.append([told(draw, 10 * k + int(draw.integers(3))) for _ in range(worlds)])
            row.take(dict(enumerate(sent[-1])))
            trail.append(k)
        assert all(row.view(world) is sample for world, sample in enumerate(sent[-1]))
        for k, each in enumerate(sent):
            for found, sample in zip(trail.at(k).each(), each, strict=True):
                assert found.ranges is sample.ranges
                for name in ("t", "x", "code", "text", "pair", "limit"):
                    assert getattr(found, name) == getattr(sample, name)
                    assert type(getattr(found, name)) is type(getattr(sample, name)) or name == "x"
                assert found.pose.numbers == sample.pose.numbers


@dataclass(frozen=True, kw_only=True)
class Weighed(Signal):
    """A sample whose class does more than to take its fields."""

    grain: float
    share: float = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "share", self.grain / 4.0)
        object.__setattr__(self, "grain", self.grain + 1.0)


def test_a_sample_comes_back_as_it_was_sent():
    sample, row = Weighed(t=3, grain=2.0), held_row(Weighed, 1)
    row.take({0: sample})
    assert row.each() == [sample] == [row.view(0)]
    assert (sample.grain, sample.share) == (3.0, 0.5)


@pytest.mark.parametrize("wrong", [{"x": "far"}, {"code": 2.7}, {"code": None}, {"pose": (1.0, 2.0)}])
def test_a_field_that_is_not_as_declared_is_named(wrong):
    sample = changed(told(np.random.default_rng(1), 5), **wrong)
    with pytest.raises(SwathError, match=f"Told.*{re.escape(repr(next(iter(wrong.values()))))}"):
        held_row(Told, 1).take({0: sample})


def scans(count, worlds, seed=3):
    draw = np.random.default_rng(seed)
    angles = np.linspace(-1, 1, count)
    angles.setflags(write=False)
    values = [draw.normal(size=(2, count, 1)).astype(np.float32) for _ in range(worlds)]
    return [Scan(5, angles, angles, angles, ranges, intensity) for ranges, intensity in values]


def test_a_row_of_arrays_is_its_samples():
    """Of drawn sizes, from signals and from samples, with room behind; a copy stays as it is."""
    for count, worlds, room in ((1, 1, 16), (7, 3, 0), (33, 2, 48)):
        each = scans(count, worlds)
        form = Room((count, 1), room)
        alike = dict.fromkeys(("beam_t", "azimuth", "elevation"), each[0].azimuth)
        row = row_of(Scan, worlds, rooms={"ranges": form, "intensity": form}, alike=alike)
        row.take(Samples.joined(each))
        row.roomy("ranges", max(room, count))[:, count:] = 9.0  # as compiled code may
        kept = row.copy()
        like = row_like(each[0], worlds)
        for world, sample in enumerate(each):
            like.put(world, sample)
        for found in (row, kept, like):
            for sample, made in zip(each, found.each(), strict=True):
                np.testing.assert_array_equal(made.ranges, sample.ranges)
                np.testing.assert_array_equal(made.intensity, sample.intensity)
                np.testing.assert_array_equal(made.azimuth, sample.azimuth)
        row.arrays["ranges"][:] = 0.0
        assert kept.of(worlds - 1).ranges[0, 0] == each[-1].ranges[0, 0]
        assert row.fits(each[0])
        assert not row.fits(scans(count + 1, 1)[0])


def test_a_walk_goes_on_where_nobody_looks(monkeypatch):
    """Python steps at the ticks of what somebody looks at, 50 a second of 200, and at no other."""
    steps = []
    whole = Lockstep._step_all
    monkeypatch.setattr(Lockstep, "_step_all", lambda *given: [steps.append(1), whole(*given)])
    world = world_of(SETS["kinematic"])
    drive(world, [make_evaluation(world), Digest()])
    assert len(steps) < 0.3 * 200 * world.graph.t / NS


def test_the_field_of_a_world_that_has_ended_is_cut_no_more():
    sets = "combine.lidar.level=empirical", "combine.edge.level=otsu"
    square = [[-15.0, -15.0], [15.0, -15.0], [15.0, 15.0], [-15.0, 15.0]]

    def left_of(worlds):
        list(drive_together(worlds))
        x, y = worlds[0].graph.latest("combine.motion", "state").pose.position[:2]
        return [world.field.standing_area([[x + a, y + b] for a, b in square]) for world in worlds]

    (alone,) = left_of([world_of(sets, "run.distance_m=1.5")])
    first, second = left_of([world_of(sets, f"run.distance_m={m}") for m in (1.5, 3.5)])
    assert first == alone
    assert second < first


def test_what_cannot_be_a_row():
    assert [can_be_row(kind) for kind in (MachineState, SteerCommand, CropEdge, Inertial)] == [True] * 4
    assert not can_be_row(Scan)


def test_a_trail_keeps_samples_in_order_while_it_grows():
    row = row_of(SteerCommand, 2)
    trail, kept = Trail(row, 2), []
    for k in range(50):
        row.arrays["curvature"][:] = k, -k
        row.t = 10 * k
        trail.append(10 * k + 1, k)
        kept.append(k)
        if k == 20:
            trail.clear()
            kept = []
    assert trail.count == len(kept)
    found = [trail.at(k) for k in range(trail.count)]
    assert [r.each()[1].curvature for r in found] == [-float(k) for k in kept]
    assert [r.t for r in found] == [10 * k for k in kept]
    assert trail.times[: trail.count].tolist() == [10 * k + 1 for k in kept]
    assert isinstance(found[0], Row)


@pytest.mark.parametrize("seed", range(6))
def test_what_waits_at_an_input_is_what_came_since_it_was_taken(seed):
    """From rows of any form, also where compiled code reads it at a fixed place; whoever looked before."""
    draw = np.random.default_rng(seed)
    rows = [row_of(SteerCommand, 2), held_row(SteerCommand, 2), held_row(SteerCommand, 2)]
    waiting, wanted, row = Waiting(), [], rows[0]
    for k in range(60):
        row = rows[int(draw.integers(3))] if draw.random() < 0.2 else row
        row.take({world: SteerCommand(k, draw.normal(), True) for world in (0, 1)})
        if waiting.trail(row).is_full:
            for trail in waiting.trails:
                trail.is_fixed = False
        waiting.trail(row).append(k)
        wanted.append(row.each())
        if draw.random() < 0.2:
            place = int(waiting.fixed(row, 3).head[0])
            assert [int(trail.head[0]) for trail in waiting.trails] == [place]
        if draw.random() < 0.5:
            assert len(wanted) == len(waiting.rows())
            assert bool(waiting) == bool(wanted)
            for world in (0, 1):
                each = [sent[world] for sent in wanted]
                assert waiting.samples(world) == each == [row.of(world) for row in waiting.rows()]
        if draw.random() < 0.2:
            waiting.clear()
            wanted = []
