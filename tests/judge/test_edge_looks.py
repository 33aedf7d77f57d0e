"""Where edges are reported, compiled code sees what the field itself says then, and Python is not asked.

Axes over which the runs are drawn: pages or profiles, detector compiled or in Python, side, stand in rows or
not, holes of the edge, length of a look.
"""

from dataclasses import fields

import numpy as np
import pytest

import swath.compiled
from swath.core.errors import InputError
from swath.field.edges.present_edge import crop_across, edges_of
from swath.judge import edge_looks
from swath.judge.evaluators.edge_detection import EdgeDetection, EdgeSeries
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.runtime.worlds import Worlds
from swath.scenario.scenario import load_scenario

NS = 1_000_000_000
PROFILE = ("combine.lidar.level=profile", "combine.header.level=profile", "combine.edge.level=otsu")
PAGES = ("combine.lidar.level=empirical", "combine.edge.level=otsu")
IN_PYTHON = ("combine.lidar.level=empirical",)
HOLE = "gaps: [{start_m: 6, end_m: 9, depth_m: 3, stubble_height_m: 0.1}]"
FIELDS = [field.name for field in fields(EdgeSeries)]


def world_of(sets, *more, scenario="straight"):
    return assemble(load_scenario(scenario, sets=["run.max_duration_s=3", *sets, *more]))


def judge_of(world, evaluation):
    return evaluation.find(next(iter(world.machines)), EdgeDetection)


def series_of(judge):
    series = judge.series()
    return {name: getattr(series, name).tobytes() for name in FIELDS}


def run_of(world, *observers, beats=(3.0,)):
    evaluation = make_evaluation(world)
    for k, until in enumerate(np.cumsum(beats).tolist()):
        drive(world, [evaluation, *observers], until_s=min(until, 3.0), resume=k > 0)
    return evaluation


class Asked:
    """Asks the field itself what stands, whenever an edge is sent for the place of the newest state."""

    def __init__(self, world):
        machine = next(iter(world.recorded().values()))
        self.field, self.side = world.field, machine.edge_side
        self.reference, self.end_y = machine.geometry.header_end(self.side)
        self.state, self.places, self.edges = None, [], []

    def __call__(self, slot, t, outputs):
        self.state = outputs.get("state", self.state) if slot.endswith(".motion") else self.state
        if slot.endswith(".edge") and self.state is not None:
            edge = outputs["edge"]
            if np.isfinite(edge.reference_x):
                self.reference = edge.reference_x
            out = 1.0 if self.side == "left" else -1.0
            begin = self.end_y + out * (edge_looks.FAR_M + 1.5)
            end = 2.0 * self.end_y - begin
            crop = crop_across(self.field, self.state.pose, [self.reference], begin, end)
            self.edges.append(edge)
            self.places.append(begin - out * 0.01 * edges_of(crop)[0])

    def walls(self):
        """The place nearest to each reported edge, or to the header end where one is near that."""
        for edge, places in zip(self.edges, self.places, strict=True):
            is_found = edge.confidence > 0.0 and np.isfinite(edge.offset)
            is_near = len(places) > 0 and np.abs(places - self.end_y).min() <= 5.0
            at = edge.offset if is_found else self.end_y
            knows = len(places) > 0 and (is_found or is_near)
            yield places[np.abs(places - at).argmin()] if knows else np.nan


@pytest.mark.parametrize("seed", range(3))
def test_what_is_seen_is_what_the_field_says_at_that_time(seed):
    draw = np.random.default_rng(seed)
    side = ("left", "right")[seed % 2]
    shape = f"shape: straight, crop_side: {'right' if side == 'left' else 'left'}"
    shape += f", {HOLE}" if draw.random() < 0.7 else ""
    more = (f"field.edge={{{shape}}}", f"combine.edge_side={side}", f"seed={draw.integers(1, 1000)}")
    sets = (PAGES, PROFILE, IN_PYTHON)[draw.integers(3)]
    world = world_of(sets, *more)
    asked = Asked(world)
    evaluation = run_of(world, asked)
    series = judge_of(world, evaluation).series()
    walls = np.array([*asked.walls()])
    assert np.array_equal(series.wall, walls, equal_nan=True)
    assert np.isfinite(walls).mean() > 0.5
    assert len(walls) == 76
    without = world_of(sets, *more)
    other = run_of(without, beats=draw.choice([0.1, 0.25, 1.0, 0.07], 60))
    assert series_of(judge_of(without, other)) == series_of(judge_of(world, evaluation))
    assert str(other.metrics("combine")) == str(evaluation.metrics("combine"))


def test_the_ground_of_a_row_is_its_own():
    world = world_of((), scenario="forage-maize")
    asked = Asked(world)
    series = judge_of(world, run_of(world, asked, beats=(0.4,))).series()
    assert world.field.rows is not None
    assert np.array_equal(series.wall, [*asked.walls()], equal_nan=True)


@pytest.mark.parametrize("sets", [PROFILE, PAGES], ids=["profile", "pages"])
def test_python_is_asked_only_for_what_is_not_in_memory(sets, monkeypatch):
    """In 3 s, 75 edges: compiled code looks, told by launches; its rows are taken at looks."""
    shown, supplied, told = [], [], []
    see, supply = EdgeDetection.see_live, edge_looks.LooksOfAll.supply
    monkeypatch.setattr(EdgeDetection, "see_live", lambda self, *a: shown.append(a[1]) or see(self, *a))
    monkeypatch.setattr(edge_looks.LooksOfAll, "supply", lambda s, k: supplied.append(k) or supply(s, k))
    add = EdgeDetection.add
    monkeypatch.setattr(EdgeDetection, "add", lambda s, *a: told.append(len(a[0])) or add(s, *a))
    world = world_of(sets)
    evaluation = run_of(world)
    (op,) = world.graph.lockstep._looking["combine.edge"].values()
    assert len(op.calls()) == 1
    assert shown == [0] * len(shown)  # before anything is compiled
    assert len(supplied) <= 4
    assert sum(told) == 76
    assert max(told) > 5
    assert len(judge_of(world, evaluation).series().t) == 76


@pytest.mark.parametrize(
    "sets",
    [
        (*PROFILE, "combine.edge.rate_hz=30"),
        (*PAGES, "combine.motion.rate_hz=10"),
        (*IN_PYTHON, "combine.edge.rate_hz=30"),
    ],
)
def test_who_walks_is_no_matter(sets, monkeypatch):
    """Nor how many rows there is room for, nor whether the times of edges are those of the truth."""
    found = []
    for room, is_by_python in ((32, False), (3, False), (3, True)):
        monkeypatch.setattr(edge_looks, "ROOM", room)
        monkeypatch.setattr(swath.compiled, "IS_WALKED_BY_PYTHON", is_by_python)
        world = world_of(sets)
        found.append(series_of(judge_of(world, run_of(world, beats=(1.3,)))))
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("sets", [PROFILE, PAGES], ids=["profile", "pages"])
def test_worlds_in_step_are_judged_as_each_alone(sets):
    lengths = 1.0, 2.1, 1.6
    seeds = [(f"seed={k}", f"run.distance_m={m}") for k, m in enumerate(lengths, 1)]
    worlds = Worlds([world_of(sets, *own) for own in seeds])
    ended = [number for number, summary in worlds.drive() if isinstance(summary, dict)]
    assert sorted(ended) == [0, 1, 2]
    for run, own in zip(worlds.runs, seeds, strict=True):
        world = world_of(sets, *own)
        evaluation = make_evaluation(world)
        drive(world, [evaluation])
        assert series_of(judge_of(world, run.evaluation)) == series_of(judge_of(world, evaluation))


@pytest.mark.parametrize("sets", [PROFILE, PAGES], ids=["profile", "pages"])
def test_a_run_that_is_saved_on_the_way_is_judged_the_same(sets):
    world = world_of(sets)
    found = series_of(judge_of(world, run_of(world)))
    for until in (0.005, 1.31):
        world = world_of(sets)
        evaluation = run_of(world, beats=(until,))
        saved, kept = world.save(), evaluation.save()
        other = world_of(sets)
        again = make_evaluation(other)
        other.load(saved)
        again.load(kept)
        drive(other, [again], until_s=3.0, resume=True)
        assert series_of(judge_of(other, again)) == found


def test_a_place_that_is_too_far_is_refused_as_by_the_field():
    """The truth is asked where compiled code does not look."""
    world = world_of(PAGES)
    looks = edge_looks.EdgeLooks([make_evaluation(world)._setups["combine"]])
    place = [2e6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    with pytest.raises(InputError, match="within 1e"):
        looks.look_at([0.0, 10.0, 1.0, 0.9, 0.0, 0.1], place)
    place[0] = 2.0
    looks.look_at([0.0, 10.0, 1.0, 0.9, 0.0, 0.1], place)
    rows, crop = looks.take(0)
    assert rows.shape == (1, 16)
    assert crop.any()
