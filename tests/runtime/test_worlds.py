"""Worlds in step come to what runs of their own come to, byte for byte, whatever goes beside them."""

import json
from typing import ClassVar

import numpy as np
import pytest

import swath
from swath.api import load_scenario
from swath.control.speed.constant import ConstantSpeed, Params
from swath.core.blocks import Block, Seen
from swath.core.errors import InputError, SwathError
from swath.core.frames import Pose
from swath.core.frozen import frozen
from swath.core.rows import Trail, held_row, row_like
from swath.core.signal import Signal
from swath.core.together import InWorlds, Samples
from swath.record.digest import Digest, sample_bytes
from swath.runtime.assembly import assemble
from swath.runtime.worlds import groups_in_step
from swath.signals import CropEdge, CropFlow, MachineState, Scan, SpeedCommand, SteerCommand
from swath.signals.objects import objects_of

CLOCK = ("wall_s", "real_time_factor", "cost", "expect")
SHORT = {
    "run.distance_m": 1.0,
    "combine.motion.start_speed_kmh": 7,
    "combine.lidar.sector_deg": [-30, 30],
    "combine.edge": "otsu",
}
PROFILE = {**SHORT, "combine.lidar.level": "profile", "combine.header.level": "profile"}
KERNELS = {**PROFILE, "combine.motion.level": "kinematic"}
HOLE = {"start_m": 20.0, "end_m": 22.5, "depth_m": 1.0}
VARY = {"combine.motion.start_speed_kmh": (4.0, 9.0), "run.distance_m": [1.0, 0.4]}


def judged(summary):
    """A summary without what the clock on the wall says."""
    return json.dumps({k: v for k, v in summary.items() if k not in CLOCK}, sort_keys=True)


@pytest.fixture(scope="module")
def in_step():
    """Four worlds, half of which end earlier."""
    return list(swath.worlds("straight", n=4, vary=VARY, sets=KERNELS, seed=3))


def test_each_is_what_it_is_alone(in_step):
    assert len({run.summary["digest"] for run in in_step}) == 4
    assert [run.summary["seed"] for run in in_step] == [3, 4, 5, 6]
    for run in in_step:
        (alone,) = swath.batch([run.entry])
        assert judged(run.summary) == judged(alone.summary)


@pytest.mark.parametrize(("together", "processes"), [(1, 1), (3, 1), (2, 2)])
def test_company_and_processes_change_nothing(in_step, together, processes):
    again = swath.worlds(
        "straight", n=4, vary=VARY, sets=KERNELS, seed=3, together=together, processes=processes
    )
    assert [judged(run.summary) for run in again] == [judged(run.summary) for run in in_step]


@pytest.mark.parametrize(
    "sets",
    [
        {**SHORT, "combine.lidar.level": "empirical"},
        PROFILE,
        {**KERNELS, "combine.edge": "truth", "combine.steering": "ideal", "combine.odometry": "ideal"},
        {**KERNELS, "run.max_duration_s": 0.33},
    ],
    ids=["nothing together", "single track", "others world by world", "ends by its duration"],
)
def test_parts_without_a_kernel_go_world_by_world(sets):
    for run in swath.worlds("straight", n=2, sets={**sets, "run.distance_m": 0.5}):
        (alone,) = swath.batch([run.entry])
        assert judged(run.summary) == judged(alone.summary)


@pytest.mark.parametrize(
    ("scenario", "sets", "vary"),
    [
        ("straight", {"combine.edge.min_step_m": 1.9, "run.distance_m": 30.0}, {}),
        (
            "straight",
            {"run.distance_m": 1.5},
            {
                "combine.steer.dead_time_s": [0.0, 0.15, 0.4],
                "combine.steer.engage_s": [0.0, 0.5],
                "combine.imu.unit": ["mti-1", "bmi088"],
                "combine.process.loss_percent": [1.0, 4.0],
                "combine.edge.echo_parts": [1, 3],
                "combine.speed.guard.when_lost": ["stop", "slow", "ignore"],
            },
        ),
        ("straight", {"combine.speed.speed_kmh": 2.0, "run.distance_m": 0.6, "combine.imu.rate_hz": 200}, {}),
        ("straight", {"combine.edge": "truth", "run.distance_m": 3.0, "combine.lidar.rate_hz": 10}, {}),
        ("straight", {"run.distance_m": 13.0, "field.edge.gaps": [HOLE], "combine.lidar.rate_hz": 10}, {}),
        (
            "straight",
            {"run.distance_m": 0.5},
            {
                "combine.lidar.sector_deg": [[-30, 30], [-20, 25], [-30, 30]],
                "combine.lidar.mount": [{"z_m": 3.0}, {"z_m": 3.5}],
            },
        ),
    ],
    ids=[
        "no edge: the runs end",
        "levels' parameters differ",
        "slow, other rates",
        "another detector",
        "beside a hole",
        "other beams",
    ],
)
def test_all_that_takes_worlds_at_once_is_the_same_alone(scenario, sets, vary):
    made = list(swath.worlds(scenario, n=3 if vary else 2, vary=vary, sets={**KERNELS, **sets}, seed=11))
    for run in made:
        (alone,) = swath.batch([run.entry])
        assert judged(run.summary) == judged(alone.summary)
    if not vary and "combine.edge.min_step_m" in sets:
        assert all("no crop edge seen" in " ".join(run.summary["notes"]) for run in made)
        assert all(run.summary["ended"]["reason"] == "edge_lost" for run in made)
    if "field.edge.gaps" in sets:  # told where the initial edge goes on, not 1 m further in
        assert all(run.summary["edge_rmse_m"] < 0.1 for run in made)
        assert all(run.summary["edge_judged_share"] > 0.5 for run in made)


class Slower(ConstantSpeed):
    """A user's own step on a built-in part: what that does for all worlds at once is not his."""

    def __init__(self, params, setup):
        super().__init__(Params(), setup)

    def step(self, t, dt, inputs):
        made = super().step(t, dt, inputs)["command"]
        return {"command": SpeedCommand(made.t, 0.5 * made.speed)}


def test_a_part_that_changes_the_step_of_another_goes_world_by_world():
    sets = {**KERNELS, "combine.speed": Slower, "run.distance_m": 0.4}
    for run in swath.worlds("straight", n=2, sets=sets):
        (alone,) = swath.batch([run.entry])
        assert judged(run.summary) == judged(alone.summary)


def test_a_world_that_fails_leaves_the_others():
    speeds = {"combine.speed.speed_kmh": [7.0, 900.0, 6.0]}
    good, bad, other = swath.worlds("straight", n=3, vary=speeds, sets={**KERNELS, "run.distance_m": 0.3})
    assert good.exit_code == other.exit_code == 0 or good.summary["digest"] != other.summary["digest"]
    assert isinstance(bad.error, InputError)
    assert "speed_kmh" in str(bad.error)


@pytest.mark.parametrize(
    ("sets", "vary"),
    [
        ({"combine.edge.fault.loss_percent": 30.0}, {}),
        ({}, {"combine.edge.fault.latency_ms": [0.0, 80.0]}),
        ({"combine.edge.fault.bias.offset_m": 0.1}, {}),
    ],
    ids=["lost", "late", "wrong"],
)
def test_worlds_with_faults_are_the_same_alone(sets, vary):
    runs = list(swath.worlds("straight", n=2, vary=vary, sets={**KERNELS, **sets}, seed=5))
    assert len({run.summary["digest"] for run in runs}) == 2
    for run in runs:
        (alone,) = swath.batch([run.entry])
        assert judged(run.summary) == judged(alone.summary)


def test_samples_of_several_times_are_refused_where_worlds_run():
    edges = [CropEdge(t, 0.0, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0) for t in (5, 9, 9)]
    row = held_row(CropEdge, 3)
    row.take({1: edges[1], 2: edges[2]})
    assert row.t == 9
    row.take(dict(enumerate(edges)))
    assert [row.view(world).t for world in range(3)] == [5, 9, 9]
    with pytest.raises(SwathError, match=r"t = 5 ns in one world, 9 ns in another.*together=1"):
        assert row.stacked.t


def test_arrays_of_different_lengths_go_in_step():
    samples = [objects_of(5, np.arange(12.0 * count).reshape(count, 12)) for count in (0, 3, 1)]
    joined = Samples.joined(samples)
    for found, own in zip([*joined.each(), joined.copy().of(1)], [*samples, samples[1]], strict=True):
        assert sample_bytes("a", "b", 5, found) == sample_bytes("a", "b", 5, own)


@pytest.mark.parametrize("level", ["plants", "empirical"])
def test_scanners_with_other_beams_do_not_go_in_step(level):
    """They once failed in step, which was told, and were run again one by one."""
    sets = {**SHORT, "combine.lidar.level": level}
    steps = ({"combine.lidar.step_deg": step} for step in (0.5, 1.0, 0.5))
    assert groups_in_step([assemble(load_scenario("straight", sets={**sets, **s})) for s in steps]) == [
        [0, 2],
        [1],
    ]


def test_worlds_see_different_numbers_of_objects():
    """One person is near, or two; none of the worlds goes alone."""
    near, far = ({"kind": "person", "x_m": x, "y_m": y} for x, y in ((-3.0, 12.0), (-1.0, 14.0)))
    sets = {"combine.lidar": "off", "combine.edge": "truth", "combine.objects": "truth"}
    sets |= {"run.distance_m": 0.6, "combine.motion": {"level": "kinematic", "start_speed_kmh": 7}}
    runs = list(swath.worlds("straight", n=2, vary={"field.obstacles": [[near], [near, far]]}, sets=sets))
    assert len({run.summary["digest"] for run in runs}) == 2
    for run in runs:
        (alone,) = swath.batch([run.entry])
        assert judged(run.summary) == judged(alone.summary)


class Crashes:
    """A detector that fails in one world."""

    inputs: ClassVar = ()
    outputs: ClassVar = ()

    def __init__(self, params, setup):
        from swath.core.component import Port

        self.outputs = (Port("edge", CropEdge),)

    def reset(self, stream):
        self._fails = stream.seed == 2
        return {"edge": CropEdge(0, 0.0, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0)}

    def step(self, t, dt, inputs):
        if self._fails:
            raise ValueError("a mistake in it")
        return {"edge": CropEdge(t + dt, 0.0, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0)}

    def save(self):
        return {}

    def load(self, state):
        pass


def test_a_part_that_crashes_ends_its_world_alone():
    sets = {**KERNELS, "combine.edge": Crashes, "run.distance_m": 0.3}
    first, second, third = swath.worlds("straight", n=3, sets=sets, seed=1)
    assert "a mistake in it" in str(second.error)
    assert first.summary["digest"] != third.summary["digest"]


class NeverBegins(Crashes):
    """One that fails before the first step."""

    def reset(self, stream):
        if stream.seed == 2:
            raise ValueError("a mistake at the start")
        return super().reset(stream)


def test_a_part_that_cannot_begin_costs_its_world_alone():
    sets = {**KERNELS, "combine.edge": NeverBegins, "run.distance_m": 0.3}
    runs = list(swath.worlds("straight", n=3, sets=sets, seed=1))
    assert "a mistake at the start" in str(runs[1].error)
    for run in (runs[0], runs[2]):
        (alone,) = swath.batch([run.entry])
        assert judged(run.summary) == judged(alone.summary)


class NeverInStep(InWorlds, Crashes):
    """One whose batch takes one world alone."""

    @classmethod
    def together(cls, parts):
        if len(parts) > 1:
            raise IndexError("a mistake in the batch")
        return BatchedParts(len(parts))


def test_a_batch_that_fails_is_told_and_its_worlds_go_alone():
    sets = {**KERNELS, "combine.edge": NeverInStep, "run.distance_m": 0.3}
    with pytest.warns(UserWarning, match=r"run one by one: IndexError: a mistake in the batch"):
        runs = list(swath.worlds("straight", n=2, sets=sets, seed=5))
    assert all(run.error is None for run in runs)


class Batched(Crashes):
    """The same for all worlds at once."""

    steps = 0

    @classmethod
    def together(cls, parts):
        return BatchedParts(len(parts))


class BatchedParts:
    def __init__(self, count):
        self.count, self.errors = count, {}

    def reset(self, streams):
        return self._edges(0, np.zeros(self.count))

    def step(self, t, dt, inputs):
        Batched.steps += 1
        return self._edges(t + dt, 0.001 * np.arange(self.count))

    def save(self, world):
        return {}

    def load(self, world, state):
        pass

    def _edges(self, t, offset):
        zero, some = np.zeros(self.count), np.full(self.count, 8.0)
        names = ("heading", "curvature", "confidence", "crop_height", "stubble_height")
        arrays = {"offset": offset, "reference_x": some, **dict.fromkeys(names, zero)}
        return {"edge": Samples(CropEdge, t, arrays)}


def test_a_users_part_takes_all_worlds_at_once():
    Batched.steps = 0
    sets = {**KERNELS, "combine.edge": Batched, "run.distance_m": 0.3}
    runs = list(swath.worlds("straight", n=3, sets=sets))
    assert 0 < Batched.steps <= 25 * max(run.summary["simulated_s"] for run in runs) + 1


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ({"n": 0}, "n"),
        ({"n": 1, "together": 0}, "together"),
        ({"n": 1, "vary": {"combine.speed.speed_kmh": (1,)}}, "vary.combine.speed.speed_kmh"),
        ({"n": 1, "vary": {"combine.speed.speed_kmh": []}}, "vary.combine.speed.speed_kmh"),
    ],
)
def test_wrong_input(more, key):
    with pytest.raises(SwathError, match=key.replace(".", r"\.")):
        list(swath.worlds("straight", **more))


@frozen
class RowsStand(Signal):
    """Whether each of some rows stands."""

    stand: np.ndarray


def drawn_signals(rng, worlds):
    """Samples of several kinds in some worlds, with nan among them."""

    def number():
        return float(rng.choice([rng.normal(), np.nan, 0.0]))

    azimuth = rng.normal(size=5)
    return [
        [
            MachineState(
                7, Pose.from_euler(rng.normal(size=3), *rng.normal(size=3)), *(number() for _ in range(5))
            )
            for _ in range(worlds)
        ],
        [SteerCommand(7, number(), bool(rng.integers(2))) for _ in range(worlds)],
        [CropFlow(7, number(), 1.0, 2.0, int(rng.integers(9)), number(), 0.1) for _ in range(worlds)],
        [
            Scan(7, azimuth, azimuth, azimuth, *rng.normal(size=(2, 5, 1)).astype(np.float32))
            for _ in range(worlds)
        ],
        [RowsStand(7, rng.random(4) < 0.5) for _ in range(worlds)],
    ]


@pytest.mark.parametrize("seed", range(4))
def test_the_digest_takes_in_the_same_bytes(seed):
    rng = np.random.default_rng(seed)
    for signals in drawn_signals(rng, 3):
        rows = [held_row(type(signals[0]), 3)]
        if not isinstance(signals[0], RowsStand):  # which does not say what numbers its array holds
            rows.append(row_like(signals[0], 3))
        for row in rows:
            row.take(dict(enumerate(signals)))
            trail = Trail(row, 1, ("combine.x", "out"))
            for k in range(20):
                trail.append(9 + k, k)
            for world, signal in enumerate(signals):
                taken, added, block = Digest(), Digest(), Block(trail, world)
                taken.take(Seen([block]))
                for k in range(20):
                    added("combine.x", 9 + k, {"out": signal})
                assert taken.hex == added.hex
                assert sample_bytes("a", "b", 7, block.sample(7)) == sample_bytes("a", "b", 7, signal)


@pytest.mark.parametrize("room", [1, 2000, 1 << 22])
def test_the_digest_is_the_same_however_many_worlds_are_laid_out_at_once(room, monkeypatch):
    """And whichever of the outputs somebody takes in, before or after all of them."""
    monkeypatch.setattr("swath.record.digest.LAID", room)
    rng, trails = np.random.default_rng(5), []
    for number in range(3):
        row = row_like(SpeedCommand(0, 0.0), 4)
        trails.append(Trail(row, 1, ("combine.x", f"out_{number}")))
        for k in range(9):
            row.take({w: SpeedCommand(k, float(rng.normal())) for w in range(4)})
            trails[-1].append(9 + k, k)
    for chosen in (trails, trails[:2], [trails[0], trails[2]], trails):
        for world in rng.permutation(4).tolist():
            taken, alone = Digest(), Digest()
            taken.take(Seen([Block(trail, world) for trail in chosen]))
            for trail in chosen:
                for k, t in enumerate(trail.times[: trail.count].tolist()):
                    alone("combine.x", t, {trail.wire[1]: Block(trail, world).sample(k)})
            assert taken.hex == alone.hex


@pytest.mark.parametrize("seed", range(2))
def test_samples_are_what_they_were_made_of(seed):
    for signals in drawn_signals(np.random.default_rng(seed), 3):
        samples = Samples.joined(signals)
        for world, signal in enumerate(signals):
            assert sample_bytes("a", "b", 7, samples.of(world)) == sample_bytes("a", "b", 7, signal)
