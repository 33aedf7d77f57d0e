"""A batch gives what single runs give, byte for byte, after errors and with a worker that was killed."""

import gc
import json
import os
import weakref

import pytest

import swath
from swath.core.errors import InputError, SwathError
from swath.runtime import job
from swath.runtime.workers import in_workers, workers_kept
from tests.tools.fake_work import begin_fake, begin_told, no_begin

SETS = {
    "run.distance_m": 0.5,
    "combine.lidar.level": "empirical",
    "combine.lidar.reach_m": 10,
    "combine.motion.start_speed_kmh": 7,
}
CASES = {  # name -> what differs; a and b have the same field, c another
    "a": {"sets": SETS, "seed": 1},
    "b": {"sets": {**SETS, "combine.motion.start_speed_kmh": 6}, "seed": 1},
    "c": {"sets": SETS, "seed": 2},
}
PARTS = """
import os, signal
from swath.signals import CropEdge
from swath.core.component import Port

class Crashes:
    inputs, outputs = (), (Port("edge", CropEdge),)
    def __init__(self, params, setup): pass
    def reset(self, stream): return {}
    def step(self, t, dt, inputs): raise ValueError("a mistake in it")
    def save(self): return {}
    def load(self, state): pass

class Kills(Crashes):
    def step(self, t, dt, inputs): os.kill(os.getpid(), signal.SIGKILL)
"""
CLOCK = ("inputs", "wall_s", "real_time_factor", "cost")


def judged(summary):
    """A summary without what the clock on the wall says."""
    return json.dumps({key: value for key, value in summary.items() if key not in CLOCK}, sort_keys=True)


@pytest.fixture(scope="module")
def singles(tmp_path_factory):
    folder = tmp_path_factory.mktemp("single")
    return {name: swath.run("straight", folder / name, report=False, **case) for name, case in CASES.items()}


@pytest.mark.parametrize("processes", [1, 2])
def test_a_batch_gives_what_single_runs_give(singles, processes, tmp_path):
    parts = tmp_path / "parts.py"
    parts.write_text(PARTS)
    wanted = ["a", "wrong", "b", "crashes", "c", *(["kills"] if processes > 1 else []), "a", "recorded"]
    entries = {
        **{name: {"scenario": "straight", **case} for name, case in CASES.items()},
        "wrong": {"scenario": "straight", "sets": {"combine.speed.sped_kmh": 5}},
        "crashes": {"scenario": "straight", "sets": {**SETS, "combine.edge.level": f"{parts}:Crashes"}},
        "kills": {"scenario": "straight", "sets": {**SETS, "combine.edge.level": f"{parts}:Kills"}},
        "recorded": {"scenario": swath.load_scenario("straight", **CASES["b"]), "out": tmp_path / "out"},
    }
    runs = list(swath.batch((entries[name] for name in wanted), workers=processes))
    assert [run.index for run in runs] == list(range(len(wanted)))
    found = dict(zip(wanted, runs, strict=True))  # of `a` the second, after all others
    for name, single in {**singles, "recorded": singles["b"]}.items():
        assert found[name].error is None
        assert judged(found[name].summary) == judged(single.summary)
        assert found[name].exit_code == single.exit_code
    for file in ("tracks.parquet", "run.mcap", "scenario.yaml"):
        assert (tmp_path / "out" / file).read_bytes() == (singles["b"].folder / file).read_bytes()
    assert found["a"].folder is None
    assert found["wrong"].error.key == "combine.speed.sped_kmh"
    assert found["wrong"].exit_code == 2
    with pytest.raises(InputError, match="did you mean"):
        found["wrong"].summary["digest"]
    assert "ValueError: a mistake in it" in str(found["crashes"].error)
    if processes > 1:
        assert str(found["kills"].error) == "entry 5: ended its process 2 times, exit code -9"


def test_entries_are_taken_as_they_are_needed():
    taken = []

    def entries():
        for number in range(1000):
            taken.append(number)
            yield {"scenario": "straight", "nonsense": 1}

    runs = swath.batch(entries())
    assert taken == []
    assert str(next(runs).error) == "entry.nonsense: unknown key, expected one of scenario, sets, seed, out"
    assert taken == [0]
    with pytest.raises(InputError, match="workers = 0"):
        swath.batch(entries(), workers=0)


def test_a_run_that_is_over_is_gone_from_memory_at_once(monkeypatch):
    left = {}

    def assemble(*args, **more):
        world = real(*args, **more)
        left.update(world=weakref.ref(world), field=weakref.ref(world.field), graph=weakref.ref(world.graph))
        return world

    real = job.assemble
    monkeypatch.setattr(job, "assemble", assemble)
    gc.disable()
    try:
        next(swath.batch([{"scenario": "straight", "sets": {**SETS, "run.distance_m": 0.1}}]))
        assert {name for name, ref in left.items() if ref() is not None} == set()
    finally:
        gc.enable()


def test_workers_take_jobs_and_tell_in_order_and_go_with_the_caller():
    taken = []

    def jobs():
        for number in range(1000):
            taken.append(number)
            yield number

    found = in_workers(jobs(), begin_fake, 2, in_order=True)
    assert [next(found) for _ in range(5)] == [(n, 10 * n) for n in range(5)]
    assert len(taken) < 30
    found.close()
    assert [*in_workers([], begin_fake, 2)] == []


def test_workers_wait_for_the_next_call_inside_a_block_and_end_with_it():
    def told(jobs, begin=begin_told):
        return {pid for _, pid in in_workers(jobs, begin, 1)}

    with workers_kept():
        (first,) = told([0, 0])
        assert told([0]) == {first}
        with workers_kept():
            assert told([0]) == {first}
        assert [*in_workers([4], begin_fake, 1)] == [(4, 40)]  # begun otherwise: another worker
        left = in_workers([0, 0], begin_told, 1)
        assert next(left) == (0, first)
        left.close()
        (second,) = told([0])
        assert second != first  # what was left in the middle is not kept
    for pid in (first, second):
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert told([0]) != {second}


def test_workers_that_cannot_begin_say_why():
    with pytest.raises(SwathError, match="__main__"):
        next(in_workers([1], no_begin, 2))
